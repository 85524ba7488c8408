"""Log probability of intervals, or log density of exact numbers, and its derivatives with respect to their expectation.

A rating stands for an interval of additive numbers, such as the logs of all numbers that a rater would round to it;
a number that was read exactly is an interval without width. All functions work on arrays whose last axis is the rows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from softness_bayes.likelihood.error_laws import ErrorLaw

FloatArray = NDArray[np.float64]

NARROW = 1e-3
"""Width of an interval, in spreads of the errors, below which its probability is width times density in its middle,
with the first correction: a difference of two distribution functions would lose digits."""

FAR = 6.0
"""Normal score of both ends beyond which probabilities are computed from logarithms."""

OPEN = 1e40
"""Error that stands for an end without bound."""

_TINY = 1e-290


class Rows(NamedTuple):
    """Intervals of additive numbers, and where their raters' lapses fall."""

    low: FloatArray
    """Lower ends, shape (rows,), or (draws, rows) if parameters decide; minus infinity where there is none."""
    high: FloatArray
    """Upper ends; that of an exact number is its lower end."""
    lapse: FloatArray
    """Log probability (of an exact number, log density) of the row if it is a lapse; minus infinity if it cannot be."""

    def take(self, index: Any) -> Rows:
        """Return some of the rows."""
        return Rows(*(part[..., index] for part in self))

    def part(self, piece: Any) -> Rows:
        """Return the rows of some draws, where these have ends of their own."""
        return Rows(*(part if part.ndim == 1 else part[piece] for part in self))

    def at_points(self) -> Rows:
        """Return the rows with an axis of points after that of draws, where these have ends of their own."""
        return Rows(*(part if part.ndim == 1 else part[:, None] for part in self))


def log_probability(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the log probability of each row, of exact ones the log density per additive unit.

    Parameters
    ----------
    law
        Law of the errors.
    rows
        The intervals.
    expected
        Expectations, shape (..., rows).
    spread
        Spread of the errors, shape (..., 1).
    parameters
        Parameters of the law, of batch shape (...).
    """
    return _with_lapses(law, rows, _Attentive(law, rows, expected, spread, parameters).log_probability, parameters)[0]


def derivatives(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, ...]:
    """Return `log_probability` and its first four derivatives with respect to the expectation, each (..., rows)."""
    attentive = _Attentive(law, rows, expected, spread, parameters)
    value, share = _with_lapses(law, rows, attentive.log_probability, parameters)
    p1, p2, p3, p4 = (share * part for part in attentive.derivatives())
    square = p1 * p1
    g2 = p2 - square
    g3 = p3 - p1 * (3.0 * p2 - 2.0 * square)
    g4 = p4 - 4.0 * p1 * p3 - 3.0 * p2 * p2 + square * (12.0 * p2 - 6.0 * square)
    inverse = 1.0 / spread
    return value, p1 * inverse, g2 * inverse**2, g3 * inverse**3, g4 * inverse**4


def below(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the probability below each exact number, and below each interval with half its own, without lapses."""
    ends = [_clipped((end - expected) / spread) for end in (rows.low, rows.high)]
    low, high = (ndtr(law.normal_scores(end, parameters)) for end in ends)
    return np.asarray(0.5 * (low + high))


def score_at(
    law: ErrorLaw, rows: Rows, share: FloatArray, expected: FloatArray, spread: FloatArray, parameters: Any
) -> FloatArray:
    """Return normal scores of the rows, (..., rows): of an interval, that of a given `share` of its probability.

    With shares drawn uniformly the scores of intervals are standard normal under the model too.
    """
    ends = [_clipped((end - expected) / spread) for end in (rows.low, rows.high)]
    low, high = (law.normal_scores(end, parameters) for end in ends)
    # from the side on which both probabilities are small
    flip = low + high > 0
    near, far = np.where(flip, -high, low), np.where(flip, -low, high)
    part = np.where(flip, 1.0 - share, share)
    p, q = ndtr(near), ndtr(far)
    found = ndtri(np.clip(p + part * (q - p), _TINY, None))
    found = np.where(rows.low == rows.high, far, np.clip(found, near, far))
    return np.where(flip, -found, found)


class _Attentive:
    """The rows without lapses."""

    def __init__(self, law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> None:
        self._law, self._parameters = law, parameters
        exact = rows.low == rows.high
        self._exact = bool(exact.all())
        if self._exact:
            self._middle = (rows.low - expected) / spread
            self.log_probability = law.log_density(self._middle, parameters) - np.log(spread)
            return
        self._low, self._high = (_clipped((end - expected) / spread) for end in (rows.low, rows.high))
        width = self._high - self._low
        self._narrow = width < NARROW
        self._some_narrow = bool(self._narrow.any())
        self.log_probability = _log_between(
            law.normal_scores(self._low, parameters), law.normal_scores(self._high, parameters)
        )
        if self._some_narrow:
            self._middle = np.where(self._narrow, 0.5 * (self._low + self._high), 0.0)
            self._slopes = law.slopes(self._middle, parameters)
            size = np.where(exact, 1.0 / spread, np.where(self._narrow, width, 1.0))
            correction = np.where(exact, 0.0, self._slopes[1] * size**2 / 24.0)
            narrow = law.log_density(self._middle, parameters) + np.log(size) + correction
            self.log_probability = np.where(self._narrow, narrow, self.log_probability)

    def derivatives(self) -> tuple[FloatArray, ...]:
        """Return the first four derivatives with respect to the expectation over the probability itself."""
        signs = -1.0, 1.0, -1.0, 1.0
        if self._exact:
            slopes = self._law.slopes(self._middle, self._parameters)
            return tuple(sign * part for sign, part in zip(signs, slopes, strict=True))
        ends = []
        for end in (self._low, self._high):
            weight = np.exp(self._law.log_density(end, self._parameters) - self.log_probability)
            ends.append([weight, *(weight * part for part in self._law.slopes(end, self._parameters)[:3])])
        found = tuple(sign * (high - low) for sign, low, high in zip(signs, *ends, strict=True))
        if not self._some_narrow:
            return found
        each = zip(signs, self._slopes, found, strict=True)
        return tuple(np.where(self._narrow, sign * narrow, wide) for sign, narrow, wide in each)


def _clipped(errors: FloatArray) -> FloatArray:
    return np.clip(errors, -OPEN, OPEN)


def _log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return log(Phi(high) - Phi(low)), each end taken from the tail in which both are small."""
    flip = low + high > 0
    near, far = np.where(flip, -high, low), np.where(flip, -low, high)
    with np.errstate(divide="ignore"):
        found = np.log(ndtr(far) - ndtr(near))
    tail = far < -FAR
    if tail.any():
        a, b = np.broadcast_arrays(near, far)
        outer = log_ndtr(b[tail])
        with np.errstate(divide="ignore"):
            found[tail] = outer + np.log1p(-np.exp(log_ndtr(a[tail]) - outer))
    return np.asarray(found)


def _with_lapses(
    law: ErrorLaw, rows: Rows, attentive: FloatArray, parameters: Any
) -> tuple[FloatArray, FloatArray | float]:
    """Return the log probability with lapses, and the share of it that is not lapsed."""
    if not law.lapses:
        return attentive, 1.0
    lapse = np.asarray(parameters.lapse, float)[..., None]
    with np.errstate(divide="ignore"):
        kept = np.log1p(-lapse) + attentive
        whole = np.logaddexp(kept, np.log(lapse) + rows.lapse)
    return whole, np.exp(kept - whole)
