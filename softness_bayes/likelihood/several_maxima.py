"""Integrals for parameters at which a rater's density has several maxima (model.md 9).

With heavy tails or lapses, and noise much smaller than the residuals, each maximum belongs to some of the rater's rows.
A scan with straight lines between points shows where the level and each scale matter. There, both are integrated on
evenly spaced points, on which the trapezoidal rule converges exponentially.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import student
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.pieces import blocks
from softness_bayes.likelihood.quadrature import gauss_hermite
from softness_bayes.likelihood.rater_rows import LawParameters, RowParameters

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEP, STEP_OF_REFERENCE = 0.6, 0.35
"""Distance of points, in the smallest standard deviation that the density can have there."""

MOST_CURVED = 1.25
"""Largest curvature of a log density, relative to normal errors, as a ratio of inverse standard deviations."""

DROP = 20.0
"""Log density below the maximum, beyond the error of the scan, at which it does not matter."""

REACH, FARTHEST = 6.0, 120.0
"""Extent of the points beyond the rows, in standard deviations; the longest with heavy tails."""

NO_SPREAD = 0.03
"""Value of tau, relative to the smallest standard deviation of a rater's density, below which points are Gauss-Hermite
nodes about each level."""

NODES = 7
"""Their number."""

LEFT_OUT = 1e-6
"""Share of a rater's density that may lie beyond the points."""

MOST_WORK = 5e8
"""Largest number of values in a scan, which takes seconds. Beyond it, rules about the mode are used."""

_ROW = 10.0  # time of a row's log density, relative to that of a value in the scan
_PER_SPREAD, _PER_RATER, _PER_LEVEL = 0.5, 3.0, 2.0  # longest steps of the scan: in spreads, and standard deviations
_LEAST_TAU = 1e-3  # in the scan, relative to the smallest standard deviation of a rater's density
_SLACK = 3.0  # error of the scan for each rater
_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Scales(Protocol):
    """The part of `rater_integrals.RaterIntegrals` that is needed here."""

    law: ErrorLaw
    """Law of the errors."""
    count: FloatArray
    """Number of rows of each rater."""
    sd: float
    """Prior standard deviation of the level."""

    def values(self, given: RowParameters, a: FloatArray) -> FloatArray:
        """Return the log density of each rater's rows at points (draws, points, raters)."""

    def log_prior(self, level: FloatArray) -> FloatArray:
        """Return the log prior density of levels."""


def feasible(scales: Scales, given: RowParameters) -> Mask:
    """Return True for draws whose rows are not too far apart, compared with the noise, for a scan, (draws,)."""
    low, high = _ends(scales, given)
    narrow = given.spread[:, 0] / math.sqrt(scales.count.max())
    points = (high - low) / np.minimum(_PER_SPREAD * given.spread[:, 0], _PER_RATER * narrow)
    width = np.hypot(given.tau[:, 0], narrow)
    levels = (2.0 * REACH * width + high - low) / (_PER_LEVEL * np.minimum(width, scales.sd))
    return np.asarray(points * (_ROW * scales.count.sum() + levels * scales.count.size) < MOST_WORK)


def log_density(scales: Scales, given: RowParameters, reference: bool = False) -> FloatArray:
    """Return the log density of all rows, (draws,).

    Parameters
    ----------
    scales, given
        Integrals and parameters.
    reference
        True for more points, as a reference.
    """
    return np.array([_of_draw(scales, given.part([k]), reference) for k in range(len(given.drive))])


def _of_draw(scales: Scales, given: RowParameters, reference: bool) -> float:
    """Return the log density of all rows in one draw."""
    tau, people, step = float(given.tau[0, 0]), scales.count.size, STEP_OF_REFERENCE if reference else STEP
    narrow = float(given.spread[0, 0]) / math.sqrt(scales.count.max())
    scan = _Scan.of(scales, given, max(tau, _LEAST_TAU * narrow), narrow)
    levels, relevant = scan.where(scales)
    longest = step / math.hypot(math.sqrt(people) / math.hypot(tau, narrow), 1.0 / scales.sd)
    level, apart = _divided(levels, scan.level[1] - scan.level[0], longest)
    if tau < NO_SPREAD * narrow:
        x, log_weight = gauss_hermite(NODES)
        points = level[:, None] + tau * x
        values = scales.values(given, for_all(points.ravel(), people))[0].reshape(*points.shape, people)
        values += (log_weight - 0.5 * x * x - _LOG_ROOT_TWO_PI)[:, None]
        each = log_sum(values, axis=1)
    else:
        longest = step / math.hypot(MOST_CURVED / narrow, 1.0 / tau)
        # each rater's intervals that matter come first; all raters have as many as the one with most
        order = np.argsort(~relevant, axis=0, kind="stable")[: relevant.sum(axis=0).max()]
        points, width = _divided(scan.middles[order], scan.step, longest)
        values = scales.values(given, points[None])[0]
        inside = np.take_along_axis(relevant, order, axis=0)
        values[~np.repeat(inside, len(points) // len(order), axis=0)] = -np.inf
        values += math.log(width / tau) - _LOG_ROOT_TWO_PI
        parts = blocks(level.size, points.size)
        each = np.concatenate([log_sum(values + scan.log_law(points, level[one, None, None]), axis=1) for one in parts])
    return math.log(apart) + float(log_sum(each.sum(axis=1) + scales.log_prior(level), axis=0))


class _Scan(NamedTuple):
    """Log densities of one draw at evenly spaced points, and straight lines between them."""

    points: FloatArray
    """Points of a_p, (points,)."""
    values: FloatArray
    """Log densities there, (points, raters)."""
    level: FloatArray
    """Evenly spaced levels, (levels,)."""
    tau: float
    slack: float
    """Largest error of the scan, for each rater."""

    @classmethod
    def of(cls, scales: Scales, given: RowParameters, tau: float, narrow: float) -> _Scan:
        """Return the scan of one draw.

        Parameters
        ----------
        scales, given
            Integrals and parameters.
        tau, narrow
            Not exactly 0; the smallest standard deviation of a rater's density.
        """
        low, high = (float(end[0]) for end in _ends(scales, given))
        width = math.hypot(tau, narrow)
        points = _evenly(low, high, min(_PER_SPREAD * float(given.spread[0, 0]), _PER_RATER * narrow))
        values = scales.values(given, for_all(points, scales.count.size))[0]
        level = _evenly(low - REACH * width, high + REACH * width, _PER_LEVEL * min(width, scales.sd))
        return cls(points, values, level, tau, _SLACK + math.log1p(tau / narrow))

    @property
    def step(self) -> float:
        """Distance between points."""
        return float(self.points[1] - self.points[0])

    @property
    def middles(self) -> FloatArray:
        """Middles of the intervals between points, (intervals,)."""
        return 0.5 * (self.points[:-1] + self.points[1:])

    def log_law(self, a: FloatArray, level: FloatArray) -> FloatArray:
        """Return the log density of a_p given the level, but for a constant."""
        return -0.5 * np.square((a - level) / self.tau)

    def where(self, scales: Scales) -> tuple[FloatArray, Mask]:
        """Return the levels that matter, and whether the intervals do for each rater, (intervals, raters)."""
        parts = blocks(self.level.size, self.values.size)
        best = np.concatenate([self._largest(self.level[one]).max(axis=1) for one in parts])
        whole = best.sum(axis=1) + scales.log_prior(self.level)
        matter = np.flatnonzero(whole > whole.max() - DROP - self.slack * scales.count.size)
        relevant = np.zeros((self.points.size - 1, scales.count.size), dtype=bool)
        for one in blocks(matter.size, self.values.size):
            some = matter[one]
            relevant |= (self._largest(self.level[some]) > best[some, None] - DROP - self.slack).any(axis=0)
        levels = np.zeros((self.level.size, 1), dtype=bool)
        levels[matter] = True
        return self.level[_widened(levels)[:, 0]], _widened(relevant)

    def _largest(self, level: FloatArray) -> FloatArray:
        """Return the largest log density in each interval, with the law of a_p, (levels, intervals, raters)."""
        slope = np.diff(self.values, axis=0) / self.step
        level, first = level[:, None, None], self.points[:-1, None]
        a = np.clip(level + self.tau**2 * slope, first, self.points[1:, None])
        return self.values[:-1] + slope * (a - first) + self.log_law(a, level)


def _ends(scales: Scales, given: RowParameters) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the range of a_p in which raters' densities may matter, each (draws,)."""
    left, rows = given.middle - given.drive, int(scales.count.min()) - 1
    reach = np.array([reach_of(scales.law, given.parameters, k, rows) for k in range(len(left))])
    beyond = given.spread[:, 0] * reach
    if scales.law.lapses or np.isinf(given.rows.low).any() or np.isinf(given.rows.high).any():
        beyond += REACH * given.tau[:, 0]  # the rows do not bound the scale
    return left.min(axis=1) - beyond, left.max(axis=1) + beyond


def reach_of(law: ErrorLaw, parameters: LawParameters, draw: int, rows: int) -> float:
    """Return how far the density for a number of rows extends beyond them, in error spreads, leaving out `LEFT_OUT`."""
    if "nu" not in law.needs:
        return REACH
    nu = max(float(np.ravel(parameters.nu)[draw]), student.LEAST)
    return float(np.clip(math.sqrt(nu) * LEFT_OUT ** (-1.0 / (rows * (nu + 1.0) - 1.0)), REACH, FARTHEST))


def for_all(points: FloatArray, raters: int) -> FloatArray:
    """Return points (points,) of all raters in one draw, (1, points, raters)."""
    return np.broadcast_to(points[None, :, None], (1, points.size, raters))


def _evenly(low: float, high: float, longest: float) -> FloatArray:
    """Return evenly spaced points from one end to the other, given the longest step."""
    return np.linspace(low, high, max(math.ceil((high - low) / longest), 2) + 1)


def _divided(middles: FloatArray, width: float, longest: float) -> tuple[FloatArray, float]:
    """Return middles of equal parts of intervals, (intervals x parts, ...), and their width.

    Parameters
    ----------
    middles, width
        Middles of the intervals, (intervals, ...), and their width.
    longest
        Largest width of a part.
    """
    parts = math.ceil(width / longest)
    away = ((np.arange(parts) + 0.5) / parts - 0.5) * width
    found = middles[:, None] + away.reshape(-1, *(1,) * (middles.ndim - 1))
    return found.reshape(-1, *middles.shape[1:]), width / parts


def _widened(chosen: Mask) -> Mask:
    """Return a mask (places, ...) with the neighbours of each chosen place."""
    found = chosen.copy()
    found[1:] |= chosen[:-1]
    found[:-1] |= chosen[1:]
    return found
