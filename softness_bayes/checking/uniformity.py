"""Test of uniformity: exact simultaneous limits of an empirical distribution function.

Limits of the counts at several points are chosen with a common local level such that independent uniform values stay
within all of them with a given probability (Säilynoja, Bürkner and Vehtari, Statistics and Computing 32, 32, 2022).
This probability is computed exactly from the Markov chain of counts from point to point.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, gammaln

FloatArray = NDArray[np.float64]

_HALVINGS = 40


class Band(NamedTuple):
    """Simultaneous limits of an empirical distribution function."""

    points: FloatArray
    """Points at which it is evaluated, shape (points,)."""
    low: FloatArray
    """Smallest share of values up to each point that is within the limits."""
    high: FloatArray
    """Largest such share."""


def simultaneous_band(size: int, points: ArrayLike, probability: float = 0.95) -> Band:
    """Return limits that contain the empirical distribution function of uniform values with given probability.

    Parameters
    ----------
    size
        Number of values.
    points
        Increasing points inside (0, 1) at which values are counted, shape (points,).
    probability
        Smallest probability of staying within all limits.
    """
    points = np.asarray(points, float)
    below, above = _tails(size, tuple(points))
    least, most = 0.0, 1.0 - probability  # bounds of the local level; the upper one is exact for a single point
    wide = narrow = _limits(below, above, least)
    for _ in range(_HALVINGS):
        level = 0.5 * (least + most)
        limits = _limits(below, above, level)
        # limits are whole counts, so that nearby levels share limits with a known probability
        known = np.array_equal(limits, wide), np.array_equal(limits, narrow)
        if known[0] or (not known[1] and _stays(size, points, *limits) >= probability):
            least, wide = level, limits
        else:
            most, narrow = level, limits
    low, high = wide
    return Band(points, low / size, high / size)


def uniformity_p_value(values: ArrayLike, points: ArrayLike) -> float:
    """Return the probability that independent uniform values are at least as extreme at some point as these.

    Parameters
    ----------
    values
        Numbers between 0 and 1, shape (values,); a value at a point counts as below it.
    points
        Rising points inside (0, 1), shape (points,). Of ranks 0 to L, written as (rank + 1) / (L + 1),
        these are 1/(L+1) to L/(L+1), and the probability is exact.
    """
    values, points = np.sort(np.asarray(values, float)), np.asarray(points, float)
    counts = np.searchsorted(values, points * (1.0 + 1e-12), side="right")
    below, above = _tails(values.size, tuple(points))
    place = np.arange(points.size)
    level = float(np.minimum(1.0, 2.0 * np.minimum(below[place, counts], above[place, counts])).min())
    # counts strictly less extreme everywhere, with a tolerance so that rounding does not exclude equal ones
    return min(1.0, 1.0 - _stays(values.size, points, *_limits(below, above, level * (1.0 + 1e-9))))


@lru_cache(maxsize=4)
def _tails(size: int, points: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return P(C <= c) and P(C >= c) of the count at each point, shapes (points, size + 1).

    All quantities of a calibration have the same ones.
    """
    counts, place = np.arange(size + 1), np.array(points)[:, None]
    tails = bdtr(counts, size, place), bdtr(size - counts, size, 1.0 - place)
    for each in tails:
        each.setflags(write=False)
    return tails


def _limits(below: FloatArray, above: FloatArray, level: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the smallest and largest count at each point whose two-sided local probability exceeds a level."""
    inside = 2.0 * np.minimum(below, above) > level
    empty = ~inside.any(axis=1)
    low, high = inside.argmax(axis=1), inside.shape[1] - 1 - inside[:, ::-1].argmax(axis=1)
    return np.where(empty, 1, low), np.where(empty, 0, high)


def _stays(size: int, points: FloatArray, low: NDArray[np.intp], high: NDArray[np.intp]) -> float:
    """Return the probability that the counts at all points lie within low to high."""
    if (low > high).any():
        return 0.0
    factorial = gammaln(np.arange(size + 1) + 1.0)
    counts, weight, before = np.array([0]), np.array([1.0]), 0.0
    for point, least, most in zip(points, low, high, strict=True):
        share = (point - before) / (1.0 - before)
        following = np.arange(least, most + 1)
        new = following - counts[:, None]
        left = size - counts[:, None]
        possible = (new >= 0) & (new <= left)
        k = np.where(possible, new, 0)
        log_mass = factorial[left] - factorial[k] - factorial[left - k]
        log_mass = log_mass + k * np.log(share) + (left - k) * np.log1p(-share)
        weight = weight @ np.where(possible, np.exp(log_mass), 0.0)
        counts, before = following, point
    return float(weight.sum())
