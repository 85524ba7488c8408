"""Log probabilities of rows and their derivatives with respect to expectation and noise (model.md 9).

A rating represents an interval on the additive scale, such as the logs of all numbers that a rater would round to it.
An exact number is an interval of width 0, with a density instead of a probability.

With F the distribution function of the errors, f its density, and t = (end - expectation) / spread, the probability of
an interval is P = F(t_high) - F(t_low). All derivatives of P follow from f and f' at the two ends.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from softness_bayes.likelihood.design import FloatArray
from softness_bayes.likelihood.error_laws import ErrorLaw

OPEN = 1e15
"""Finite error used in place of an infinite one [spreads]; its square is finite in single precision."""
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
    real
        Type of errors in units of their spread, and of all that follows from them. In single precision exponentials
        and logarithms take a fraction of the time on all processors.
    """

    def __init__(
        self,
        law: ErrorLaw,
        rows: Rows,
        expected: FloatArray,
        spread: FloatArray,
        parameters: Any,
        real: type[np.floating] = np.float64,
    ) -> None:
        self.law, self.rows, self.expected, self.spread, self.real = law, rows, expected, spread, real
        self.parameters = parameters.each(lambda value: np.asarray(value, real))
        self._inverse = np.asarray(1.0 / spread, real)
        self._sliver = float(np.finfo(real).eps ** (1.0 / 3.0))
        """Least width of an interval [spreads]: its square is the error of a mean density, as is rounding over it."""
        self._least = np.finfo(real).tiny ** 0.9
        """Probability below which that of an interval is computed from the logarithm of the density."""

    def log_probability(self) -> FloatArray:
        """Return the log probability of each row; of exact numbers, the log density per unit of the additive scale."""
        return self._terms(0)[0]

    def terms(self, noise: bool = False) -> RowTerms:
        """Return `log_probability` and its first two derivatives, with those in the log spread if `noise` is true."""
        return RowTerms(*self._terms(5 if noise else 2))

    def below(self) -> FloatArray:
        """Return the probability below each exact number, or below each interval plus half its own; without lapses."""
        ends = self._ends()
        tails = (self._tail(end, np.exp(self._log_density(end))) for end in ends)
        low, high = (np.where(end < 0.0, tail, 1.0 - tail) for end, tail in zip(ends, tails, strict=True))
        return np.asarray(0.5 * (low + high))

    def scores(self, share: FloatArray) -> FloatArray:
        """Return normal scores of the rows, (..., rows); an interval's is taken at a given `share` of its probability.

        With uniform random shares, the scores of intervals are also standard normal under the model.
        """
        low, high = (self._score(end) for end in self._ends())
        flip = low + high > 0  # to the tail in which both probabilities are small
        near, far, part = np.where(flip, -high, low), np.where(flip, -low, high), np.where(flip, 1.0 - share, share)
        p, q = ndtr(near), ndtr(far)
        score = ndtri(np.clip(p + part * (q - p), _TINY, None))
        score = np.where(self.rows.low == self.rows.high, far, np.clip(score, near, far))
        return np.where(flip, -score, score)

    def _ends(self) -> tuple[FloatArray, FloatArray]:
        """Return the errors at the ends of the intervals, in units of their spread, with infinite ones at `OPEN`."""
        low, high = (np.clip(self._errors(end), -OPEN, OPEN) for end in self.rows[:2])
        return low, high

    def _errors(self, values: FloatArray) -> FloatArray:
        """Return errors in units of their spread; differences of near values are taken in double precision."""
        return ((values - self.expected) / self.spread).astype(self.real, copy=False)

    @property
    def _lapse(self) -> FloatArray:
        """Share of lapses, shape (..., 1)."""
        return np.asarray(self.parameters.lapse)[..., None]

    @property
    def _log_lapse(self) -> FloatArray:
        """Log probability that a row is a lapse and as it is, shape (..., rows)."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self._lapse) + self.rows.lapse, self.real)

    def _score(self, errors: FloatArray) -> FloatArray:
        return self.law.normal_scores(errors, self.parameters)

    def _log_density(self, errors: FloatArray) -> FloatArray:
        return self.law.log_density(errors, self.parameters)

    def _tail(self, errors: FloatArray, density: FloatArray) -> FloatArray:
        return self.law.tail(errors, density, self.parameters)

    def _terms(self, orders: int) -> list[FloatArray]:
        """Return the log probability and as many derivatives as asked."""
        with np.errstate(all="ignore"):
            width = self.rows.high - self.rows.low
            parts = self._of_intervals(orders, width) if width.any() else self._of_numbers(orders)
        return self._with_lapses(parts)

    def _of_numbers(self, orders: int) -> list[FloatArray]:
        """Return log densities of exact numbers and their derivatives."""
        parts = self._of_densities(self._errors(self.rows.low), orders)
        parts[0] -= np.log(self.spread)
        if orders > 2:
            parts[3] -= 1.0
        return parts

    def _of_densities(self, t: FloatArray, orders: int) -> list[FloatArray]:
        """Return log densities of errors in units of their spread, and their derivatives."""
        inverse = self._inverse
        parts = [self._log_density(t)]
        if orders:
            first, second = self.law.slopes(t, self.parameters)
            parts += [-first * inverse, np.broadcast_to(second * (inverse * inverse), t.shape).copy()]
            if orders > 2:
                parts += [-t * first, (second * t + first) * inverse, t * (first + t * second)]
        return parts

    def _of_intervals(self, orders: int, width: FloatArray) -> list[FloatArray]:
        """Return log probabilities of intervals and their derivatives.

        Exact numbers among them, and narrow intervals, have the mean density of a sliver about their middle. Tails
        are subtracted on the side of zero where they are small, and so lose no digits. An interval whose probability
        underflows has the derivatives of a number at its nearer end, beyond which the density is exponential.
        """
        low, high = self._ends()
        if narrow := bool(width.min() < self._sliver * self.spread.max()):
            missing = (0.5 * np.maximum(self._sliver - width / self.spread, 0.0)).astype(self.real, copy=False)
            low, high = low - missing, high + missing
        of_low, of_high = (np.exp(self._log_density(end)) for end in (low, high))
        whole = np.copysign(self._tail(low, of_low), low) - np.copysign(self._tail(high, of_high), high)
        whole += (low < 0.0) & (high > 0.0)
        parts = [np.log(whole)]
        if orders:
            parts += self._derivatives(low, high, of_low / whole, of_high / whole, orders)
        lost = whole < self._least
        if lost.any():
            near = np.where(low > 0.0, low, high)
            slope = np.abs(self.law.slopes(near, self.parameters)[0])
            tails = self._of_densities(near, orders)
            tails[0] += np.log(-np.expm1(-slope * (high - low)) / slope)
            for part, of_tail in zip(parts, tails, strict=True):
                np.copyto(part, of_tail, where=lost)
        if narrow:
            sliver = self._sliver * self.spread
            parts[0] -= np.log(np.where(width > 0.0, np.maximum(sliver / width, 1.0), sliver))
        return parts

    def _derivatives(
        self, low: FloatArray, high: FloatArray, of_low: FloatArray, of_high: FloatArray, orders: int
    ) -> list[FloatArray]:
        """Return derivatives of log P from each end's t and f(t) / P."""
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
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            kept, lapse = np.log1p(-self._lapse) + parts[0], self._log_lapse
            share = 1.0 / (1.0 + np.exp(lapse - kept))
            value = np.where(share > self._least, kept - np.log(share), lapse)
        if len(parts) == 1:
            return [value]
        mixed = share * (1.0 - share)
        mean, mean2 = parts[1:3]
        found = [value, share * mean, share * mean2 + mixed * mean * mean]
        if len(parts) > 3:
            noise, both, noise2 = parts[3:]
            found += [share * noise, share * both + mixed * mean * noise, share * noise2 + mixed * noise * noise]
        return found
