"""Versions of all software that the numbers of a result depend on."""

from __future__ import annotations

import platform
from importlib.metadata import version

from softness_bayes.provenance import VERSION, family_of

LIBRARIES = ("softness-bayes", "numpy", "scipy", "emcee", "arviz", "xarray")


def versions() -> dict[str, str]:
    """Return the versions, as attributes of a result."""
    libraries = {name.replace("-", "_"): version(name) for name in LIBRARIES}
    return family_of(VERSION, {"python": platform.python_version(), **libraries})
