"""Test of uniformity: Kolmogorov's simultaneous limits of an empirical distribution function."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


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
    from scipy.stats import kstwo  # imported here because it takes a third of a second

    points, half = np.asarray(points, float), float(kstwo.ppf(probability, size))
    return Band(points, np.maximum(points - half, 0.0), np.minimum(points + half, 1.0))


def uniformity_p_value(values: ArrayLike, points: ArrayLike) -> float:
    """Return the probability that independent uniform values deviate at least as much at some point as these.

    Counts at some points deviate less than those at all, so that the probability is an upper limit, and a close one for
    many points.

    Parameters
    ----------
    values
        Numbers between 0 and 1, shape (values,); a value at a point counts as below it. Ranks 0 to L are written as
        (rank + 1) / (L + 1).
    points
        Rising points inside (0, 1), shape (points,).
    """
    from scipy.stats import kstwo

    values, points = np.sort(np.asarray(values, float)), np.asarray(points, float)
    share = np.searchsorted(values, points * (1.0 + 1e-12), side="right") / values.size
    return float(kstwo.sf(np.abs(share - points).max(), values.size))
