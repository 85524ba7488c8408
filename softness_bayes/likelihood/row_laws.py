"""Log probabilities of rows and their derivatives with respect to expectation and noise (model.md 9).

A rating represents an interval on the additive scale, such as the logs of all numbers that a rater would round to it.
An exact number is an interval of width 0, with a density instead of a probability.

With F the distribution function of the errors, f its density, and t = (end - expectation) / spread, the probability of
an interval is P = F(t_high) - F(t_low). All derivatives of P follow from f and f' at the two ends. Student's F takes
ten times as long as f: there, P of a narrow interval is a sum of f at Gauss-Legendre points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from softness_bayes.likelihood.design import FloatArray
from softness_bayes.likelihood.error_laws import ErrorLaw

POINTS, WIDEST = 4, 0.4
"""Number of Gauss points of narrow intervals, and their largest half-width [spreads]: errors are below 1e-5."""
NARROWEST = 1e-4
"""Half-width below which a difference of distribution functions would lose digits, whatever the law."""
LEAST = 1e-6
"""Probability of an interval below which it is computed from logarithms, unless it is far below that of a lapse."""
LOST, COVERED = 1e-17, 1e-8
"""Rounding error of a probability, and probability of the row as a lapse that hides it."""
FAR = 6.0
"""Normal score of both ends beyond which probabilities are computed from logarithms."""
OPEN = 1e40
"""Finite error used in place of an infinite end."""
FARTHEST = -1e10
"""Log probability below which rounding leaves no digits of a density's ratio to it."""
_TINY = 1e-290


class Rows(NamedTuple):
    """Intervals on the additive scale, and the probability of their rows as lapses."""

    low: FloatArray
    """Lower ends, shape (rows,), or (draws, rows) if they depend on parameters; minus infinity if unbounded."""
    high: FloatArray
    """Upper ends; that of an exact number is its lower end."""
    lapse: FloatArray
    """Log probability (of an exact number, log density) of the row if it is a lapse; minus infinity if it cannot be."""

    def take(self, index: Any) -> Rows:
        """Return some of the rows."""
        return Rows(*(part[..., index] for part in self))

    def part(self, draws: Any) -> Rows:
        """Return the rows of some draws, if the ends differ between draws."""
        return Rows(*(part if part.ndim == 1 else part[draws] for part in self))

    def at_points(self) -> Rows:
        """Return the rows with an axis of points after that of draws."""
        return Rows(*(part if part.ndim == 1 else part[:, None] for part in self))


class RowTerms(NamedTuple):
    """Log probability of each row and its derivatives; arrays (..., rows), None if they were not asked for."""

    value: FloatArray
    of_mean: FloatArray
    """First derivative with respect to the expectation."""
    of_mean2: FloatArray
    """Second derivative with respect to the expectation."""
    of_noise: Any = None
    """First derivative with respect to the log spread."""
    of_both: Any = None
    """Mixed second derivative."""
    of_noise2: Any = None
    """Second derivative with respect to the log spread."""


class RowLaw:
    """The law of rows at given expectations.

    Parameters
    ----------
    law
        Law of the errors.
    rows
        The intervals.
    expected
        Expectations, shape (..., rows).
    spread
        Spread of the errors, shape (..., 1), or (..., rows) if it differs between rows.
    parameters
        Parameters of the law, of batch shape (...).
    """

    def __init__(self, law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> None:
        self.law, self.rows, self.expected, self.spread, self.parameters = law, rows, expected, spread, parameters
        self._inverse = 1.0 / spread

    def log_probability(self) -> FloatArray:
        """Return the log probability of each row; of exact numbers, the log density per unit of the additive scale."""
        return self._by_kind(0)[0]

    def terms(self, noise: bool = False) -> RowTerms:
        """Return `log_probability` and its first two derivatives, with those in the log spread if `noise` is true."""
        return RowTerms(*self._by_kind(5 if noise else 2))

    def below(self) -> FloatArray:
        """Return the probability below each exact number, or below each interval plus half its own; without lapses."""
        low, high = (ndtr(self._score(end)) for end in self._ends())
        return np.asarray(0.5 * (low + high))

    def scores(self, share: FloatArray) -> FloatArray:
        """Return normal scores of the rows, (..., rows); an interval's is taken at a given `share` of its probability.

        With uniform random shares, the scores of intervals are also standard normal under the model.
        """
        low, high = (self._score(end) for end in self._ends())
        flip, near, far = _towards_zero(low, high)
        part = np.where(flip, 1.0 - share, share)
        p, q = ndtr(near), ndtr(far)
        score = ndtri(np.clip(p + part * (q - p), _TINY, None))
        score = np.where(self.rows.low == self.rows.high, far, np.clip(score, near, far))
        return np.where(flip, -score, score)

    def _ends(self) -> tuple[FloatArray, FloatArray]:
        """Return the errors at the ends of the intervals, in units of their spread, with infinite ones at `OPEN`."""
        low, high = (np.clip(end, -OPEN, OPEN) - self.expected for end in self.rows[:2])
        return low * self._inverse, high * self._inverse

    @property
    def _lapse(self) -> FloatArray:
        """Share of lapses, shape (..., 1)."""
        return np.asarray(self.parameters.lapse, float)[..., None]

    @property
    def _log_lapse(self) -> FloatArray:
        """Log probability that a row is a lapse and as it is, shape (..., rows)."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self._lapse) + self.rows.lapse)

    def _score(self, errors: FloatArray) -> FloatArray:
        return self.law.normal_scores(errors, self.parameters)

    def _log_density(self, errors: FloatArray) -> FloatArray:
        return self.law.log_density(errors, self.parameters)

    def _by_kind(self, orders: int) -> list[FloatArray]:
        """Return the log probability and as many derivatives as asked, each row by the method for its interval."""
        half = 0.5 * (self.rows.high - self.rows.low)
        exact = half == 0.0
        narrow = (half <= self.spread * (WIDEST if self.law.slow_functions else NARROWEST)) & ~exact
        kinds = [(RowLaw._of_numbers, exact), (RowLaw._by_points, narrow), (RowLaw._by_functions, ~(narrow | exact))]
        kinds.sort(key=lambda kind: -int(kind[1].sum()))
        # the method of most rows takes all, without copies; the others overwrite theirs
        with np.errstate(all="ignore"):
            parts = kinds[0][0](self, orders)
            for method, chosen in kinds[1:]:
                self._overwrite(parts, chosen, method, orders)
        return self._with_lapses(parts)

    def _overwrite(
        self,
        parts: list[FloatArray],
        chosen: NDArray[np.bool_],
        method: Callable[[RowLaw, int], list[FloatArray]],
        orders: int,
    ) -> None:
        """Replace results for chosen rows by those of another method, each as the only row of a draw of its own."""
        if not chosen.any():
            return
        shape = parts[0].shape
        some = np.nonzero(np.broadcast_to(chosen, shape))

        def of(values: FloatArray) -> FloatArray:
            return np.broadcast_to(values, shape)[some][:, None]

        own = self.parameters.each(lambda value: np.broadcast_to(value, shape[:-1])[some[:-1]])
        rows = Rows(*(of(part) for part in self.rows))
        found = method(RowLaw(self.law, rows, of(self.expected), of(self.spread), own), orders)
        for whole, part in zip(parts, found, strict=True):
            whole[some] = part[:, 0]

    def _of_numbers(self, orders: int) -> list[FloatArray]:
        """Return log densities of exact numbers and their derivatives."""
        inverse = self._inverse
        t = (self.rows.low - self.expected) * inverse
        parts = [self._log_density(t) - np.log(self.spread)]
        if orders:
            first, second = self.law.slopes(t, self.parameters)
            parts += [-first * inverse, np.broadcast_to(second * (inverse * inverse), t.shape).copy()]
            if orders > 2:
                parts += [-1.0 - t * first, (second * t + first) * inverse, t * (first + t * second)]
        return parts

    def _by_points(self, orders: int) -> list[FloatArray]:
        """Return log probabilities of narrow intervals and their derivatives, from the density at Gauss points."""
        half = 0.5 * (self.rows.high - self.rows.low) * self._inverse
        middle = (self.rows.low - self.expected) * self._inverse + half
        centre, whole = self._log_density(middle), np.zeros_like(middle)
        for x, weight in zip(*leggauss(POINTS), strict=True):
            share = self._log_density(middle + x * half)
            share -= centre  # relative to the density in the middle nothing underflows
            whole += weight * np.exp(share, out=share)
        parts = [centre + np.log(whole * half)]
        if not orders:
            return parts
        ends = middle - half, middle + half
        return parts + self._derivatives([(end, np.exp(self._log_density(end) - parts[0])) for end in ends], orders)

    def _by_functions(self, orders: int) -> list[FloatArray]:
        """Return log probabilities of intervals and their derivatives, from distribution functions."""
        ends = self._ends()
        whole = ndtr(self._score(ends[1]))
        whole -= ndtr(self._score(ends[0]))
        small = whole < LEAST
        if self.law.lapses:
            small &= self._log_lapse < np.log(COVERED)
            whole = np.where(small, whole, np.maximum(whole, LOST))
        parts = [np.log(whole)]
        if orders:
            parts += self._derivatives([(end, np.exp(self._log_density(end)) / whole) for end in ends], orders)
        self._overwrite(parts, small, RowLaw._by_logarithms, orders)
        return parts

    def _by_logarithms(self, orders: int) -> list[FloatArray]:
        """Return what `_by_functions` does, for probabilities so small that digits would be lost."""
        low, high = ends = self._ends()
        value = _log_between(*(self._score(end) for end in ends))
        width = (self.rows.high - self.rows.low) * self._inverse
        lost = np.isneginf(value) & np.isfinite(width)
        if (
            lost.any()
        ):  # so far out that scores of both ends are equal; the density is not below that of the farther end
            value = np.where(lost, np.minimum(*(self._log_density(end) for end in ends)) + np.log(width), value)
        if not orders:
            return [value]
        # far out a ratio is the slope of the log density (Mills), and the difference of logarithms is rounding
        near = value > FARTHEST
        ratios = [np.exp(np.where(near, self._log_density(end) - value, -np.inf)) for end in ends]
        nearest = np.where(low + high > 0.0, 0, 1)
        for k, end in enumerate(ends):
            slope = np.abs(self.law.slopes(end, self.parameters)[0])
            ratios[k] = np.where(~near & (nearest == k), slope, ratios[k])
        return [value, *self._derivatives(list(zip(ends, ratios, strict=True)), orders)]

    def _derivatives(self, ends: list[tuple[FloatArray, FloatArray]], orders: int) -> list[FloatArray]:
        """Return derivatives of log P from each end's t and f(t) / P."""
        if not orders:
            return []
        (low, of_low), (high, of_high) = ends
        inverse = self._inverse
        slope_low, slope_high = (self.law.slopes(end, self.parameters)[0] for end in (low, high))
        mean = (of_low - of_high) * inverse
        bend_low, bend_high = of_low * slope_low, of_high * slope_high
        mean2 = (bend_high - bend_low) * (inverse * inverse) - mean * mean
        if orders == 2:
            return [mean, mean2]
        noise = low * of_low - high * of_high
        both = (high * bend_high + of_high - low * bend_low - of_low) * inverse - mean * noise
        noise2 = high * (of_high + high * bend_high) - low * (of_low + low * bend_low) - noise * noise
        return [mean, mean2, noise, both, noise2]

    def _with_lapses(self, parts: list[FloatArray]) -> list[FloatArray]:
        """Return the log probability of a mixture with lapses, and its derivatives, from those without."""
        if not self.law.lapses:
            return parts
        with np.errstate(divide="ignore"):
            kept = np.log1p(-self._lapse) + parts[0]
            value = np.logaddexp(kept, self._log_lapse)
        if len(parts) == 1:
            return [value]
        share = np.exp(kept - value)
        mixed = share * (1.0 - share)
        mean, mean2 = parts[1:3]
        found = [value, share * mean, share * mean2 + mixed * mean * mean]
        if len(parts) > 3:
            noise, both, noise2 = parts[3:]
            found += [share * noise, share * both + mixed * mean * noise, share * noise2 + mixed * noise * noise]
        return found


def _towards_zero(low: FloatArray, high: FloatArray) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Return True where an interval is mirrored, and its ends in the tail in which both probabilities are small."""
    flip = low + high > 0
    return flip, np.where(flip, -high, low), np.where(flip, -low, high)


def _log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return log(Phi(high) - Phi(low))."""
    _, near, far = _towards_zero(low, high)
    with np.errstate(divide="ignore"):
        value = np.log(ndtr(far) - ndtr(near))
    tail = far < -FAR
    if tail.any():
        outer = log_ndtr(far[tail])
        with np.errstate(divide="ignore"):
            value[tail] = outer + np.log1p(-np.exp(log_ndtr(near[tail]) - outer))
    return np.asarray(value)
