"""Grids of numbers that raters use."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.data.ratings import Ratings

FloatArray = NDArray[np.float64]

CHANCE = 0.01
"""Largest probability at which a rater's numbers would all fall on a coarser grid than the one in use by chance."""

NEGLIGIBLE = 0.02
"""Step, relative to each rating of a rater, up to which the numbers are taken as exact: a rating's error is ten times
as large, and rounding then adds less than a thousandth to its variance."""

WIDEST = 10**12
"""Largest ratio of a rater's numbers for which a grid is looked for."""

_FACTORS = 1, 2, 5  # of powers of ten: the steps of grids, beside halves and quarters
_QUARTERS = Decimal("0.25"), Decimal("0.5")


def steps_of_raters(ratings: Ratings, least: float | None = None) -> FloatArray:
    """Return the step of each participant's grid, shape (participants,); 0 if the numbers are as good as exact."""
    count = len(ratings.participants)
    return np.array([step_of(ratings.rating[ratings.participant == k], least) for k in range(count)])


def step_of(numbers: ArrayLike, least: float | None = None) -> float:
    """Return the largest step of which all numbers are multiples, unless that may be chance; 0 if it is negligible.

    Steps are 1, 2 or 5 times a power of ten, a half or a quarter. A step is believed if so many different numbers of a
    finer one would all fall on it with a probability below `CHANCE`; the finest takes three different numbers. It is
    negligible beside the smallest number, or beside `least`.
    """
    # digits beyond the twelfth are those of rounding
    distinct = sorted({Decimal(f"{x:.12g}") for x in np.unique(np.asarray(numbers, float)).tolist() if x > 0})
    if not distinct or distinct[-1] > WIDEST * distinct[0]:
        return 0.0
    finest = min(int(x.normalize().as_tuple().exponent) for x in distinct)
    found, step = None, Decimal(1).scaleb(finest - 1)
    for coarser in _steps(finest, distinct[-1]):
        if all(x % coarser == 0 for x in distinct) and float(step / coarser) ** len(distinct) < CHANCE:
            found = step = coarser
    return float(step) if found and float(step) > NEGLIGIBLE * (float(distinct[0]) if least is None else least) else 0.0


def _steps(finest: int, largest: Decimal) -> Sequence[Decimal]:
    """Return the steps from a power of ten up to the largest number, in rising order."""
    found = [factor * Decimal(1).scaleb(k) for k in range(finest, largest.adjusted() + 1) for factor in _FACTORS]
    return sorted({step for step in (*found, *_QUARTERS) if Decimal(1).scaleb(finest) <= step <= largest})
