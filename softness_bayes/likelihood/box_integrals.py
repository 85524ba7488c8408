"""Integrals for parameters at which raters' densities are far from normal: intervals much wider than the errors.

With little noise, the intervals of a rater's answers bound the rater's scale from both sides, and the density is flat
between two walls. It is computed at evenly spaced points of the range where it matters, and the level's density also.
The trapezoidal rule then converges exponentially once a step is not longer than the spread of single errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.quadrature import gauss_hermite
from softness_bayes.likelihood.rater_rows import RowParameters

FloatArray = NDArray[np.float64]
Function = Callable[[FloatArray], FloatArray]

WIDE, BOX, BENT = 4.0, 6.0, 10.0
"""If the widest interval is wider than the first, in error spreads, evenly spaced points are used if the range that
a rater's intervals have in common is wider than the second, or if third and fourth derivatives change a log density by
more than the third (as `rater_integrals.ROUGH`). Below these limits the rules about the modes err by less than 2e-4 at
432 draws of a run on categories; even points take forty times as long."""

POINTS, LEVELS = 129, 65
"""Number of evenly spaced points of each rater's scale, and of the level."""

SEARCH, TIMES = 17, 3
"""Points of a search for the range where a density matters, and number of searches, each in the former's range."""

DROP = 35.0
"""Log density below its maximum beyond which it does not matter."""

BEYOND = 9.0
"""Extent of the first search beyond the outermost ends of intervals, in error spreads; in tau for the level."""

LONGEST = 1.2
"""Longest step between points, in tau; with longer ones, each level has points of its own."""

SCALES = 7
"""Number of points of each level if tau is smaller than that."""

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Scales(Protocol):
    """The part of `rater_integrals.RaterIntegrals` that is needed here."""

    mean: float
    """Prior mean of the level."""
    sd: float
    """Its prior standard deviation."""

    def values(self, given: RowParameters, a: FloatArray) -> FloatArray:
        """Return the log density of each rater's rows at points (draws, points, raters)."""

    def log_prior(self, level: FloatArray) -> FloatArray:
        """Return the log prior density of levels."""

    def at_walls(self, given: RowParameters) -> Function:
        """Return a function of levels: log densities of the raters whose intervals have one finite end each."""


class Boxes:
    """Integrals at evenly spaced points for one table.

    Parameters
    ----------
    first
        First row of each rater, rows sorted by rater.
    low, high
        True for rows whose interval has a finite lower (upper) end, each (rows,).
    """

    def __init__(self, first: NDArray[np.intp], low: NDArray[np.bool_], high: NDArray[np.bool_]) -> None:
        self._first, self._closed = first, np.flatnonzero(low & high)
        self.both = np.logical_or.reduceat(low, first) & np.logical_or.reduceat(high, first)
        """True for raters whose intervals bound their scale from both sides, shape (raters,)."""

    def needed(self, given: RowParameters, bend: Callable[[], FloatArray]) -> NDArray[np.bool_]:
        """Return True for draws at which densities are too far from normal for rules about their modes, (draws,).

        Parameters
        ----------
        given
            Parameters.
        bend
            Returns the change of the raters' log densities by third and fourth derivatives, (draws,).
        """
        found = np.zeros(len(given.drive), dtype=bool)
        if self._closed.size and self.both.any():
            widest = (given.rows.high - given.rows.low)[..., self._closed].max(axis=-1)
            found |= widest > WIDE * given.spread[:, 0]
        if found.any():
            part = given.part(found)
            low, high = innermost(part, self._first)
            common = (high - low > BOX * part.spread)[:, self.both].any(axis=1)
            found[found] = common | (bend()[found] > BENT)
        return found

    def log_density(
        self, scales: Scales, given: RowParameters, mode: FloatArray, width: FloatArray, finer: float
    ) -> FloatArray:
        """Return the log density of all rows, (draws,).

        Parameters
        ----------
        scales, given
            Integrals and parameters.
        mode, width
            Joint mode of the scales and the level, and standard deviation of a scale given the level, (draws, raters).
        finer
            Factor of the number of points.
        """
        low, high = scale_ranges(partial(scales.values, given), given, self._first)
        # other raters may pull a scale out of the range of its own rows
        outside = (mode < low) | (mode > high)
        low = np.where(outside, np.minimum(low, mode - BEYOND * width), low)
        high = np.where(outside, np.maximum(high, mode + BEYOND * width), high)
        longest = (high - low)[:, self.both].max(axis=1)
        separate, found = longest > LONGEST * (POINTS - 1) * given.tau[:, 0], np.empty(len(low))
        for chosen in (separate, ~separate):
            if chosen.any():
                part = given.part(chosen)
                own = levels_of(
                    partial(scales.values, part), part, low[chosen], high[chosen], finer, chosen is separate
                )
                found[chosen] = self._over_levels(scales, part, own, low[chosen], high[chosen], finer)
        return found

    def _over_levels(
        self, scales: Scales, given: RowParameters, own: Function, low: FloatArray, high: FloatArray, finer: float
    ) -> FloatArray:
        """Return the integral over the level, from the raters' densities at levels."""
        walls = None if self.both.all() else scales.at_walls(given)

        def each(level: FloatArray) -> FloatArray:
            found = own(level)
            if walls is not None:
                found[..., ~self.both] = walls(level)
            return found

        beyond = BEYOND * (given.tau + given.spread)[:, 0]
        least = np.minimum(low.min(axis=1), scales.mean - BEYOND * scales.sd) - beyond
        most = np.maximum(high.max(axis=1), scales.mean + BEYOND * scales.sd) + beyond
        return over_levels(each, scales.log_prior, least, most, finer)


def ranges(function: Function, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the ranges in which log-concave functions are at most `DROP` below their maximum.

    Parameters
    ----------
    function
        Takes points (draws, points, ...) to the log density there, of the same shape.
    low, high
        Ends of ranges that include them, each (draws, ...).
    """
    share = np.linspace(0.0, 1.0, SEARCH).reshape(-1, *(1,) * (low.ndim - 1))
    for _ in range(TIMES):
        step = (high - low) / (SEARCH - 1)
        value = function(low[:, None] + share * (high - low)[:, None])
        inside = value > value.max(axis=1, keepdims=True) - DROP
        first, last = inside.argmax(axis=1), SEARCH - 1 - inside[:, ::-1].argmax(axis=1)
        low, high = low + np.maximum(first - 1, 0) * step, low + np.minimum(last + 1, SEARCH - 1) * step
    return low, high


def innermost(given: RowParameters, first: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Return the largest lower and the smallest upper end of each rater's intervals, less the drive, (draws, raters).

    Parameters
    ----------
    given
        Parameters.
    first
        First row of each rater.
    """
    low = np.maximum.reduceat(given.rows.low - given.drive, first, axis=1)
    return low, np.minimum.reduceat(given.rows.high - given.drive, first, axis=1)


def scale_ranges(values: Function, given: RowParameters, first: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the range of each rater's scale, (draws, raters).

    Parameters
    ----------
    values
        Log density of each rater's rows at points (draws, points, raters).
    given, first
        As for `innermost`.
    """
    ends = [np.broadcast_to(end, given.drive.shape) - given.drive for end in (given.rows.low, given.rows.high)]
    least = np.minimum(*(np.where(np.isfinite(end), end, np.inf) for end in ends))
    most = np.maximum(*(np.where(np.isfinite(end), end, -np.inf) for end in ends))
    beyond = BEYOND * given.spread
    low, high = np.minimum.reduceat(least, first, axis=1) - beyond, np.maximum.reduceat(most, first, axis=1) + beyond
    return ranges(values, low, high)


def levels_of(
    values: Function,
    given: RowParameters,
    low: FloatArray,
    high: FloatArray,
    finer: float = 1.0,
    separate: bool = False,
) -> Function:
    """Return each rater's log density as a function of the level, from (draws, levels) to (draws, levels, raters).

    Parameters
    ----------
    values, given
        As for `scale_ranges`.
    low, high
        Ranges of the raters' scales, each (draws, raters).
    finer
        Factor of the number of points.
    separate
        True if each level has points of its own.
    """
    size = round(finer * POINTS)
    tau = given.tau[:, :, None]
    if separate:
        x, log_weight = gauss_hermite(SCALES)
        law = log_weight - 0.5 * x**2 - _LOG_ROOT_TWO_PI

        def at_own(level: FloatArray) -> FloatArray:
            points = (level[..., None] + tau * x).reshape(len(level), -1, 1)
            found = values(np.repeat(points, low.shape[1], axis=2))
            return log_sum(found.reshape(*level.shape, SCALES, -1) + law[:, None], axis=2)

        return at_own
    points = low[:, None] + np.linspace(0.0, 1.0, size)[:, None] * (high - low)[:, None]
    value = np.moveaxis(values(points), 1, 2)[:, None]
    z = np.moveaxis(points, 1, 2)[:, None] / tau[..., None]
    constant = np.log((high - low) / (size - 1) / given.tau) - _LOG_ROOT_TWO_PI

    def shared(level: FloatArray) -> FloatArray:
        apart = z - (level / given.tau)[:, :, None, None]
        apart *= apart
        apart *= -0.5
        apart += value
        return log_sum(apart, axis=-1) + constant[:, None]

    return shared


def over_levels(function: Function, log_prior: Function, low: FloatArray, high: FloatArray, finer: float) -> FloatArray:
    """Return the log of the integral over the level of the raters' densities times its prior, (draws,).

    Parameters
    ----------
    function
        Raters' log densities at levels, from (draws, levels) to (draws, levels, raters).
    log_prior
        Log prior density of levels.
    low, high
        Ends of a range that includes all levels of any weight, each (draws,).
    finer
        Factor of the number of points.
    """
    size = round(finer * LEVELS)

    def joint(level: FloatArray) -> FloatArray:
        return function(level).sum(axis=-1) + log_prior(level)

    low, high = ranges(joint, low, high)
    level = low[:, None] + np.linspace(0.0, 1.0, size) * (high - low)[:, None]
    return log_sum(joint(level), axis=1) + np.log((high - low) / (size - 1))
