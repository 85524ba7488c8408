"""Prior laws by name, written forms of priors, and custom laws."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import (
    HalfNormal,
    Law,
    LogNormal,
    LogUniform,
    Normal,
    Prior,
    Signed,
    Truncated,
    Uniform,
    magnitude,
    name_of,
)
from softness_bayes.base.supplied import FORM, installed, is_supplied, require_reference, supplied

FloatArray = NDArray[np.float64]

PRIORS = "priors"
"""Entry-point group of laws in installed packages."""
MEMBERS = ("median", "support", "log_density", "cumulative", "quantile", "draw")
"""Required members of a prior."""

LAWS: Mapping[str, type] = MappingProxyType(
    {"lognormal": LogNormal, "halfnormal": HalfNormal, "normal": Normal, "uniform": Uniform, "loguniform": LogUniform}
)
"""Laws by name."""


def parse_prior(text: str) -> Prior:
    """Return a prior from its written form, such as ``lognormal(100,0.5)``; the inverse of ``str``.

    A third number of ``lognormal`` truncates it at that fraction on both sides of its median.

    Raises
    ------
    InputError
        If the text is not a known law with the numbers it takes.
    """
    if text.strip().startswith("±"):
        return Signed(parse_prior(text.strip()[1:]))
    match = re.fullmatch(r"\s*([\w.:-]+)\s*\(([^()]*)\)\s*", text)
    law = None if match is None else law_named(match[1])
    if match is None or law is None:
        known = [form_of(law) for law in LAWS.values()] + [f"{name}(...)" for name in installed(PRIORS)]
        raise InputError(f"prior '{text}': expected {' or '.join(known)}, or {FORM}(...) for a custom distribution")
    try:
        numbers = [float(part) for part in match[2].split(",") if part.strip() or law in LAWS.values()]
        prior: Prior = law(*numbers)
    except (ValueError, TypeError) as error:
        reason = f" ({error})" if isinstance(error, InputError) else ""
        raise InputError(f"prior '{text}': expected {form_of(law)} with numbers{reason}") from None
    require_prior(f"prior '{text}'", prior)
    return prior


def law_named(name: str) -> type | None:
    """Return a kind of law by its name, entry point or importable name; None if there is none.

    Raises
    ------
    InputError
        If an importable name cannot be imported, or is not that of a law.
    """
    if name.lower() in LAWS:
        return LAWS[name.lower()]
    if not is_supplied(PRIORS, name):
        return None
    found = supplied(PRIORS, name)
    if not (isinstance(found, type) and is_dataclass(found)):
        raise InputError(f"prior: {name} is {found!r:.60}, expected a dataclass, as {Law.__name__} requires")
    return found


def form_of(law: type) -> str:
    """Return the written form of a kind of law, with the names of its numbers."""
    names = [f.name if f.default is not None else f"[{f.name}]" for f in fields(law)]
    return f"{name_of(law)}({', '.join(names)})"


def as_prior(name: str, given: Prior | str) -> Prior:
    """Return the prior of a parameter, given as a law or in written form (`parse_prior`).

    Raises
    ------
    InputError
        If it is not one.
    """
    if isinstance(given, str):
        return parse_prior(given)
    require_prior(f"prior of {name}", given)
    return given


def require_prior(what: str, prior: Any) -> None:
    """Raise an error for a value that is not a prior, and for an inconsistent custom law.

    Raises
    ------
    InputError
        Names the missing or wrong member.
    """
    kind = type(prior)
    if kind in (*LAWS.values(), Truncated, Signed):
        return
    if missing := [name for name in MEMBERS if not hasattr(prior, name)]:
        raise InputError(
            f"{what}: {prior!r:.60} has no {missing[0]!r}, expected a prior, such as LogNormal(100, 0.5) or "
            "'lognormal(100,0.5)'"
        )
    if not is_dataclass(kind) or any(not isinstance(getattr(prior, f.name), (int, float)) for f in fields(kind)):
        raise InputError(f"{what}: {kind.__name__} is not a dataclass of numbers, expected a subclass of Law that is")
    levels = np.linspace(0.1, 0.9, 9)
    places = np.asarray(prior.quantile(levels), float)
    if not np.allclose(prior.cumulative(places), levels, atol=1e-6) or not np.isclose(prior.median, places[4]):
        raise InputError(f"{what}: 'quantile' is not the inverse of 'cumulative', or 'median' is not its value at 1/2")
    x = np.linspace(places[0], places[-1], 20_001)
    mass = float(np.trapezoid(np.exp(prior.log_density(x)), x))
    if abs(mass - 0.8) > 1e-3:
        raise InputError(
            f"{what}: exp(log_density) integrates to {mass:.4g} between quantiles 0.1 and 0.9, expected 0.8: a density "
            "must be normalised"
        )


def require_storable(what: str, prior: Prior) -> None:
    """Raise an error for a prior that could not be restored from its written form.

    Raises
    ------
    InputError
        With the reason.
    """
    kind = type(magnitude(prior))
    if kind in (*LAWS.values(), Truncated):
        return
    require_reference(f"{what}: {kind.__name__}", kind)
    if parse_prior(str(prior)) != prior:
        raise InputError(f"{what}: its written form {str(prior)!r} is read as another distribution; derive it from Law")
