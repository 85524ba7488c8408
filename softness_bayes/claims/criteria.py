"""Table of the paper's claims and their criteria (model.md 11)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.inflection import LEAST_DROP
from softness_bayes.claims.numbers import ERROR, Numbers

Array = NDArray[np.float64]
Booleans = NDArray[np.bool_]

LEVEL = 0.01
"""Change over the last decade of E_fab, as a share of the maximum, below which the response has levelled off."""
TOUCHING_FORCE = 1.0
"""Mean force of a finger that judges a material [N]."""
APART = 1.1
"""Ratio above which two places of the maximum count as different."""
HARDLY = 0.1
"""Change, as a share of the maximum, that counts as negligible."""


class ClaimVerdict(StrEnum):
    """Verdict of the model on a claim."""

    HOLDS = "holds"
    FAILS = "fails"
    SILENT = "silent"
    """No receptor fires under any load, so that the claim cannot be tested."""
    UNTESTED = "not testable"
    """The claim is about ratings, and none were given."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and its criterion; functions take `Numbers` of shape (draws, loads)."""

    name: str
    statement: str
    criterion: str
    speaks: Callable[[Numbers], Booleans]
    """The draws and loads with a response to judge, shape (draws, loads)."""
    holds: Callable[[Numbers, Booleans], Booleans]
    """Test of the claim for each draw, from the loads that can be evaluated, shape (draws,)."""
    tell: Callable[[Numbers], str]
    """The numbers behind the verdict on one draw, load by load."""
    of_ratings: bool = False

    def verdicts(self, numbers: Numbers, rated: bool = False) -> list[ClaimVerdict]:
        """Return the verdict on each draw; `rated` is true if there are ratings."""
        if self.of_ratings and not rated:
            return [ClaimVerdict.UNTESTED] * len(numbers.largest)
        speaks = self.speaks(numbers)
        told = np.where(self.holds(numbers, speaks), ClaimVerdict.HOLDS, ClaimVerdict.FAILS)
        return [ClaimVerdict(name) for name in np.where(speaks.any(axis=-1), told, ClaimVerdict.SILENT).tolist()]


def _fires(numbers: Numbers) -> Booleans:
    return np.asarray(numbers.largest > 0)


def _known(name: str) -> Callable[[Numbers], Booleans]:
    return lambda numbers: np.isfinite(getattr(numbers, name))


def _clear(numbers: Numbers) -> Booleans:
    # no receptor fires at the soft end, so that a maximum with this drop to the stiff end exceeds both ends by it
    return np.asarray(numbers.interior & (numbers.drop >= LEAST_DROP))


def _turns(numbers: Numbers, speaks: Booleans) -> Booleans:
    return np.asarray((_clear(numbers) & (numbers.levelling < LEVEL)).any(axis=-1))


def _turns_from_touching_force_on(numbers: Numbers, speaks: Booleans) -> Booleans:
    heavy, clear = numbers.force >= TOUCHING_FORCE, _clear(numbers)
    return np.asarray(((heavy == clear) | ~speaks).all(axis=-1) & clear.any(axis=-1))


def _place_depends_on_load(numbers: Numbers, speaks: Booleans) -> Booleans:
    clear = _clear(numbers)
    different = clear.sum(axis=-1) > 1
    for place in (numbers.modulus, numbers.ratio):
        # missing positions (NaN) sort last, and their differences are NaN
        gaps = np.diff(np.sort(np.where(clear, np.log(place), np.nan), axis=-1), axis=-1)
        different &= ((gaps > np.log(APART)) | np.isnan(gaps)).all(axis=-1)
    return np.asarray(different)


def _every(test: Callable[[Numbers], Booleans]) -> Callable[[Numbers, Booleans], Booleans]:
    """Return the criterion that a test passes under every load for which it can be evaluated."""
    return lambda numbers, speaks: np.asarray((test(numbers) | ~speaks).all(axis=-1))


def _grows(numbers: Numbers) -> Booleans:
    return np.asarray((numbers.growth > 0) & (numbers.setback <= 3.0 * ERROR))


def _listing(values: Array, style: str, unit: str = "", marks: Booleans | None = None) -> str:
    """Return the values of the loads as text: – for a missing value, † after a marked one."""
    marked = np.zeros(values.shape, bool) if marks is None else marks
    texts = [
        (f"{value:{style}}" if style else f"{_significant(value)}") + "†" * bool(mark) if np.isfinite(value) else "–"
        for value, mark in zip(values, marked, strict=True)
    ]
    return ", ".join(texts) + unit


def _significant(value: float) -> str:
    """Return a number with two significant digits, or with all its integer digits if there are more."""
    digits = 2 if abs(value) < 100 else len(f"{abs(value):.0f}")
    return np.format_float_positional(value, digits, fractional=False, trim="-")


def _wide(numbers: Numbers) -> Booleans:
    # a contact radius of exactly half the finger's does not exceed it
    return np.asarray(numbers.interior[0] & (numbers.radius[0] > 0.5 * (1 + 1e-9)))


def _tell_drop(numbers: Numbers) -> str:
    return "drop " + _listing(100 * numbers.drop[0], ".1f", " %", _wide(numbers))


def _tell_force(numbers: Numbers) -> str:
    return f"{_tell_drop(numbers)} at {_listing(numbers.force[0], '', ' N')}"


def _tell_place(numbers: Numbers) -> str:
    clear = _clear(numbers)[0]
    if not clear.any():
        return "no turning point"
    modulus, ratio = (np.where(clear, place[0], np.nan) for place in (numbers.modulus, numbers.ratio))
    return f"{_listing(1e-3 * modulus, '', ' kPa', _wide(numbers))}; ratio {_listing(ratio, '')}"


def _tell_centre(numbers: Numbers) -> str:
    best = _listing(1e3 * numbers.best_centre[0], ".0f", " mm")
    return f"{_listing(100 * numbers.growth[0], '+.0f', ' %')}; most at {best}"


CLAIMS = (
    Claim(
        "turn",
        "The response rises with E_fab, falls again and levels off",
        f"under at least one load an interior maximum, a drop of at least {100 * LEAST_DROP:g} % by 1 GPa, "
        f"and a change below {100 * LEVEL:g} % over the last decade",
        _fires,
        _turns,
        _tell_drop,
    ),
    Claim(
        "threshold",
        "The turn is clear only beyond the mean touching force",
        f"a drop of at least {100 * LEAST_DROP:g} % under every load with {TOUCHING_FORCE:g} N or more at the maximum, "
        "and under no other",
        _fires,
        _turns_from_touching_force_on,
        _tell_force,
    ),
    Claim(
        "place",
        "Where the response turns depends on the load, in E_fab and in E_fab/E_skin",
        f"at least two loads with a maximum and a drop of at least {100 * LEAST_DROP:g} % by 1 GPa, these maxima all "
        f"more than {100 * (APART - 1):.0f} % apart on both axes",
        _fires,
        _place_depends_on_load,
        _tell_place,
    ),
    Claim(
        "centre",
        "The response grows as the centre of contact moves from distal to proximal",
        "under every load the fabric set's mean response never falls from 0 to 30 mm",
        _known("growth"),
        _every(_grows),
        _tell_centre,
    ),
    Claim(
        "depth",
        "Receptor depths from 0.5 to 0.9 mm hardly differ",
        f"under every load at most {100 * HARDLY:g} % of the maximum between them, at any E_fab",
        _known("depth_spread"),
        _every(lambda numbers: numbers.depth_spread <= HARDLY),
        lambda numbers: _listing(100 * numbers.depth_spread[0], ".0f", " %"),
    ),
    Claim(
        "linear",
        "Softness is linear in the response",
        "under every load a slope between mean standardised rating and response that differs from 0 at the 5 % level",
        _known("slope"),
        _every(lambda numbers: numbers.slope >= numbers.slope_needed),
        lambda numbers: "slope " + _listing(numbers.slope[0], "+.2f"),
        of_ratings=True,
    ),
    Claim(
        "correlation",
        "Response and E_fab correlate negatively over the fabric set",
        "a negative correlation under every load",
        _known("correlation"),
        _every(lambda numbers: numbers.correlation < 0),
        lambda numbers: "r " + _listing(numbers.correlation[0], "+.2f"),
    ),
)
"""Every claim, in the order of tables."""
