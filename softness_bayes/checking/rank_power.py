"""Power of a calibration, from tables of ranks simulated under a given fault and the rule of the calibration.

A posterior too narrow by a factor w, or shifted by s of its standard deviations, puts the truth at the normal score
w z + s among its draws, z ~ N(0, 1). The distribution of the rank follows by quadrature. Tables are drawn from it by
inversion of the same uniform numbers for every w and s, so that the frequency of alarms is smooth in both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, gammaln, log_ndtr, ndtri

from softness_bayes.checking.uniformity import simultaneous_band

FloatArray = NDArray[np.float64]

POWER = 0.9
"""Probability of an alarm for which the detectable fault is reported."""

LARGEST_WIDTH, LARGEST_SHIFT = 10.0, 10.0
"""Largest faults in the search."""

TABLES = 2000
"""Simulated tables."""

_SEED, _NODES, _HALVINGS = 20, 2001, 12


class Least(NamedTuple):
    """The smallest fault that raises the alarm with probability `POWER`; infinite if none does."""

    value: float
    error: float
    """Its standard error, due to the number of simulated tables."""


class Alarm:
    """The alarm rule of a calibration, for many tables of ranks of one quantity at once.

    Parameters
    ----------
    size, draws
        Replicates, and posterior draws that each truth is ranked among.
    threshold
        P-value below which each of the two tests raises the alarm.
    """

    def __init__(self, size: int, draws: int, threshold: float) -> None:
        self.size, self.draws = size, draws
        points = np.arange(1, draws + 1) / (draws + 1)
        band = simultaneous_band(size, points, 1.0 - threshold)
        self.low, self.high = np.rint(band.low * size), np.rint(band.high * size)
        squares, freedom = squared_scores(size, draws)
        self._relative = squares / squares.mean()
        self._narrow = chdtri(freedom, 0.5 * threshold) / freedom
        self._wide = chdtri(freedom, 1.0 - 0.5 * threshold) / freedom

    def raised(self, rank: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return whether tables of ranks, shape (tables, replicates), raise the alarm, shape (tables,)."""
        ranks, tables = self.draws + 1, len(rank)
        flat = (rank + ranks * np.arange(tables)[:, None]).ravel()
        counts = np.bincount(flat, minlength=ranks * tables).reshape(tables, ranks)
        below = counts.cumsum(axis=1)[:, :-1]
        spread = counts @ self._relative / self.size
        outside = ((below < self.low) | (below > self.high)).any(axis=1)
        return outside | (spread > self._narrow) | (spread < self._wide)


def squared_scores(size: int, draws: int) -> tuple[FloatArray, float]:
    """Return the squared normal score of every rank, and the degrees of freedom of the matching chi-squared law."""
    squares = ndtri((np.arange(draws + 1) + 0.5) / (draws + 1)) ** 2
    return squares, float(2.0 * size * squares.mean() ** 2 / squares.var())


def rank_law(draws: int, width: float = 1.0, shift: float = 0.0) -> FloatArray:
    """Return the probability of each rank from 0 to `draws` if the posterior is too narrow by a factor, or shifted.

    Parameters
    ----------
    draws
        Posterior draws that a truth is ranked among.
    width
        Ratio of correct to stated standard deviation.
    shift
        Shift of the posterior, in its standard deviations.
    """
    z = np.linspace(-8.0, 8.0, _NODES)
    weight = np.exp(-0.5 * z**2)
    score, rank = width * z + shift, np.arange(draws + 1)[:, None]
    ways = gammaln(draws + 1) - gammaln(rank + 1) - gammaln(draws - rank + 1)
    # the rank of a truth at one score is binomial
    law = np.exp(ways + rank * log_ndtr(score) + (draws - rank) * log_ndtr(-score))
    return np.asarray(law @ (weight / weight.sum()))


@lru_cache(maxsize=64)
def alarm_of(size: int, draws: int, threshold: float) -> Alarm:
    """Return the cached rule of a calibration, whose limits take a second to compute."""
    return Alarm(size, draws, threshold)


def power(size: int, draws: int, threshold: float, width: float = 1.0, shift: float = 0.0) -> float:
    """Return the share of simulated tables of one quantity with a given fault that raise the alarm."""
    if not size:
        return 0.0
    cumulated = rank_law(draws, width, shift).cumsum()
    uniform = np.random.default_rng(_SEED).random((TABLES, size))
    rank = np.searchsorted(cumulated[:-1], uniform, side="right")
    return float(alarm_of(size, draws, threshold).raised(rank).mean())


@lru_cache(maxsize=64)
def least_width(size: int, draws: int, threshold: float) -> Least:
    """Return the factor by which a posterior must be too narrow for an alarm with probability `POWER`."""
    return _least(lambda width: power(size, draws, threshold, width=width), 1.0, LARGEST_WIDTH)


@lru_cache(maxsize=64)
def least_shift(size: int, draws: int, threshold: float) -> Least:
    """Return the shift of a posterior, in its standard deviations, for an alarm with probability `POWER`."""
    return _least(lambda shift: power(size, draws, threshold, shift=shift), 0.0, LARGEST_SHIFT)


@lru_cache(maxsize=64)
def replicates_needed(draws: int, threshold: float, width: float) -> int:
    """Return the number of replicates, in tens, that detects posteriors too narrow by a factor as `POWER` asks."""
    least, most = 0, 1
    while power(10 * most, draws, threshold, width=width) < POWER:
        least, most = most, 2 * most
    while most - least > 1:
        middle = (least + most) // 2
        found = power(10 * middle, draws, threshold, width=width) >= POWER
        least, most = (least, middle) if found else (middle, most)
    return 10 * most


def _least(power_at: Callable[[float], float], low: float, high: float) -> Least:
    if power_at(high) < POWER:
        return Least(math.inf, 0.0)
    none = low
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if power_at(middle) >= POWER else (middle, high)
    step = 0.1 * (high - none)
    slope = (power_at(high + step) - power_at(high - step)) / (2.0 * step)
    return Least(high, math.sqrt(POWER * (1.0 - POWER) / TABLES) / slope)
