"""Effects of raters and fabrics as they are drawn, stored and named in files (model.md 9)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RATER_SPREADS: Mapping[str, str] = MappingProxyType({"gamma": "tau_gamma", "varsigma": "tau_varsigma"})
"""Name of the parameter for the spread between raters, by the quantity that differs."""

RATER_EFFECTS: Mapping[str, str] = MappingProxyType({"gamma": "rater_log_gamma", "varsigma": "rater_log_varsigma"})
"""Names in files of raters' log deviations from the typical rater, by the quantity that differs."""


class Effects(NamedTuple):
    """Values of the common mean and of the random effects."""

    mu: FloatArray
    """Shape (...)."""
    participant: FloatArray
    """Deviations of log ratings, shape (..., participants)."""
    fabric: FloatArray
    """Fabrics' deviations, shape (..., fabrics); 0 in models without them."""


class RaterEffects(NamedTuple):
    """Values of the common mean and of the effects of raters who differ in exponents or noise, and of fabrics."""

    mu: FloatArray
    """Shape (...)."""
    participant: FloatArray
    """Deviations of log ratings, shape (..., participants)."""
    fabric: FloatArray
    """Fabrics' deviations, shape (..., fabrics); 0 in models without them."""
    log_gamma: FloatArray
    """Deviations of log exponents from the typical rater's, shape (..., participants); 0 if exponents do not differ."""
    log_varsigma: FloatArray
    """Deviations of the log noise from the typical rater's, shape (..., participants); 0 if noise does not differ."""
