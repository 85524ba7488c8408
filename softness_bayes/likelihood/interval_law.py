"""Log probability of intervals, or log density of exact numbers, and its derivatives with respect to their expectation.

A rating represents an interval on the additive scale, such as the logs of all numbers that a rater would round to it.
An exact number is an interval of width 0. All functions work on arrays whose last axis is the rows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.interval_rule import by_rule

FloatArray = NDArray[np.float64]

NARROW = 1e-3
"""Width of an interval, in spreads of the errors, below which its probability is width times density in its middle,
with the first correction: a difference of two distribution functions would lose digits."""

FAR = 6.0
"""Normal score of both ends beyond which probabilities are computed from logarithms."""

OPEN = 1e40
"""Finite error used in place of an infinite end."""

FARTHEST = -1e10
"""Log probability below which rounding leaves no digits of its ratio to the density."""

OUTLYING = 100.0
"""Distance from an interval [spreads] beyond which derivatives of a normal law are series in its inverse (Mills).
Differences of moments lose their digits there: at 1e5, the second derivative would be -6000 instead of -1."""

MOST_OTHERS = 0.5
"""Largest share of rows computed by distribution functions; if it is exceeded, all rows are."""

SIGNS = -1.0, 1.0, -1.0, 1.0
"""Signs of derivatives with respect to the expectation, relative to those with respect to the error."""

_TINY = 1e-290


class Rows(NamedTuple):
    """Intervals on the additive scale, and the ranges of their raters' lapses."""

    low: FloatArray
    """Lower ends, shape (rows,), or (draws, rows) if they depend on parameters; minus infinity if unbounded."""
    high: FloatArray
    """Upper ends; that of an exact number is its lower end."""
    lapse: FloatArray
    """Log probability (of an exact number, log density) of the row if it is a lapse; minus infinity if it cannot be."""

    def take(self, index: Any) -> Rows:
        """Return some of the rows."""
        return Rows(*(part[..., index] for part in self))

    def part(self, piece: Any) -> Rows:
        """Return the rows of some draws, if the interval ends differ between draws."""
        return Rows(*(part if part.ndim == 1 else part[piece] for part in self))

    def at_points(self) -> Rows:
        """Return the rows with an axis of points after that of draws, if the interval ends differ between draws."""
        return Rows(*(part if part.ndim == 1 else part[:, None] for part in self))


def log_probability(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the log probability of each row; for exact numbers, the log density per unit of the additive scale.

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
    return _with_lapses(law, rows, _attentive(law, rows, expected, spread, parameters)[0], parameters)[0]


def derivatives(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, ...]:
    """Return `log_probability` and its first four derivatives with respect to the expectation, each (..., rows)."""
    value, *each = scaled_derivatives(law, rows, expected, spread, parameters)
    return value, *(part / spread**k for k, part in enumerate(each, 1))


def scaled_derivatives(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, ...]:
    """Return the same as `derivatives`, with the expectation in units of the spread."""
    if law.log_slopes and not law.lapses and (rows.low == rows.high).all():
        value, one, two, three, four = law.log_slopes((rows.low - expected) / spread, parameters)
        return value - np.log(spread), -one, two, -three, four
    attentive, *slopes = _attentive(law, rows, expected, spread, parameters, 4)
    value, share = _with_lapses(law, rows, attentive, parameters)
    if law.lapses:
        slopes = [share * part for part in slopes]
    # from moments to cumulants
    one, two, three, four = slopes
    square = one * one
    two -= square
    three -= one * (3.0 * two + square)
    four -= 4.0 * one * three + 3.0 * two * (two + 2.0 * square) + square * square
    if law == NORMAL and value.min(initial=0.0) < -0.5 * OUTLYING**2:
        _set_outlying(rows, expected, spread, (one, two, three, four))
    return value, one, two, three, four


def _set_outlying(rows: Rows, expected: FloatArray, spread: FloatArray, slopes: tuple[FloatArray, ...]) -> None:
    """Set derivatives under the normal law far from intervals, where only the nearer end matters."""
    low, high = ((end - expected) / spread for end in (rows.low, rows.high))
    near = np.maximum(low, -high)
    # there, the other end's density is e^-40 or less; an end may be infinite, and `near` zero
    far = (near > OUTLYING) & ((high - low) * np.maximum(near, 1.0) > 40.0)
    side, c = np.where(low > 0, 1.0, -1.0)[far], np.minimum(near[far], OPEN)
    inverse = 1.0 / (c * c)
    of_c = (
        side * c * (1.0 + inverse * (1.0 - 2.0 * inverse)),
        inverse * (1.0 - 6.0 * inverse) - 1.0,
        side * 2.0 * inverse / c * (1.0 - 12.0 * inverse),
        6.0 * inverse**2 * (1.0 - 20.0 * inverse),
    )
    for slope, value in zip(slopes, of_c, strict=True):
        slope[far] = value


def two_derivatives_beyond(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the first three of `scaled_derivatives`, for rows that all have one finite end."""
    attentive, one, two = _beyond(law, rows, expected, spread, parameters, 2)
    value, share = _with_lapses(law, rows, attentive, parameters)
    one = share * one
    return value, one, share * two - one * one


def weights(law: ErrorLaw, rows: Rows, errors: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the weights, (..., rows), of the observations in the most probable mean, given their errors.

    Intervals count as their midpoints. With lapses, the weight includes the probability that the row is not a lapse.
    """
    scaled = errors / spread
    found = law.weight(scaled, parameters)
    if not law.lapses:
        return found
    lapse = np.asarray(parameters.lapse, float)[..., None]
    width = rows.high - rows.low
    width = np.where((width > 0) & (width < np.inf), width, 1.0)
    kept = (1.0 - lapse) * np.exp(law.log_density(scaled, parameters)) * width / spread
    lapsed = lapse * np.exp(rows.lapse)
    return found * np.divide(kept, kept + lapsed, out=np.ones(np.shape(kept)), where=lapsed > 0)


def below(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the probability below each exact number, or below each interval plus half its own; without lapses."""
    ends = [_clipped((end - expected) / spread) for end in (rows.low, rows.high)]
    low, high = (ndtr(law.normal_scores(end, parameters)) for end in ends)
    return np.asarray(0.5 * (low + high))


def score_at(
    law: ErrorLaw, rows: Rows, share: FloatArray, expected: FloatArray, spread: FloatArray, parameters: Any
) -> FloatArray:
    """Return normal scores of the rows, (..., rows); an interval's is taken at a given `share` of its probability.

    With uniform random shares, the scores of intervals are also standard normal under the model.
    """
    ends = [_clipped((end - expected) / spread) for end in (rows.low, rows.high)]
    low, high = (law.normal_scores(end, parameters) for end in ends)
    # computed from the tail in which both probabilities are small
    flip = low + high > 0
    near, far = np.where(flip, -high, low), np.where(flip, -low, high)
    part = np.where(flip, 1.0 - share, share)
    p, q = ndtr(near), ndtr(far)
    found = ndtri(np.clip(p + part * (q - p), _TINY, None))
    found = np.where(rows.low == rows.high, far, np.clip(found, near, far))
    return np.where(flip, -found, found)


def _attentive(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int = 0
) -> list[FloatArray]:
    """Return the log probability of the rows without lapses, and its derivatives over the probability itself.

    The derivatives have orders 1 to `orders`, with respect to the expectation in units of the spread.
    """
    exact = rows.low == rows.high
    if exact.all():
        errors = (rows.low - expected) / spread
        slopes = law.slopes(errors, parameters)[:orders] if orders else ()
        found = [law.log_density(errors, parameters) - np.log(spread)]
        return [*found, *(sign * part for sign, part in zip(SIGNS, slopes, strict=False))]
    if (np.isinf(rows.low) ^ np.isinf(rows.high)).all():
        return _beyond(law, rows, expected, spread, parameters, orders)
    low, high = (_clipped((end - expected) / spread) for end in (rows.low, rows.high))
    served = by_rule(law, low, high, NARROW, parameters)
    rest = np.flatnonzero(~served.good)
    if rest.size > MOST_OTHERS * served.good.size:
        return _by_functions(law, exact, low, high, spread, parameters, orders)
    probability = served.probability if not rest.size else np.where(served.good, served.probability, 1.0)
    constant = law.log_density(np.zeros((*low.shape[:-1], 1)), parameters)
    found = [np.log(probability) + constant]
    if orders:
        inverse = 1.0 / probability
        found += [part * inverse for part in served.slopes[:orders]]
    if rest.size:
        ends = low[..., rest], high[..., rest]
        others = _by_functions(law, exact[..., rest], *ends, spread, parameters, orders)
        for whole, part in zip(found, others, strict=True):
            whole[..., rest] = part
    return found


def _beyond(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return the same as `_attentive` for intervals with one finite end."""
    lower = np.isinf(rows.low)
    side = np.where(lower, 1.0, -1.0)
    error = _clipped((np.where(lower, rows.high, rows.low) - expected) / spread)
    found = log_ndtr(side * law.normal_scores(error, parameters))
    if not orders:
        return [found]
    ratio = law.log_density(error, parameters) - found
    # far out the ratio is |error| (Mills; only normal tails are so thin), and the difference of logarithms is rounding
    weight = side * np.exp(np.where(found < FARTHEST, np.log(np.maximum(np.abs(error), 1.0)), ratio))
    # the weight is minus the first slope over the error, and takes less time than all four slopes
    few = [1.0, -law.weight(error, parameters) * error]
    slopes: list[Any] = few[:orders] if orders <= len(few) else [1.0, *law.slopes(error, parameters)[: orders - 1]]
    return [found, *(sign * weight * part for sign, part in zip(SIGNS, slopes, strict=False))]


def _by_functions(
    law: ErrorLaw,
    exact: NDArray[np.bool_],
    low: FloatArray,
    high: FloatArray,
    spread: FloatArray,
    parameters: Any,
    orders: int,
) -> list[FloatArray]:
    """Return the same as `_attentive` for intervals with two finite ends, by distribution functions."""
    found = [_log_between(law.normal_scores(low, parameters), law.normal_scores(high, parameters))]
    width = high - low
    narrow = width < NARROW
    some = bool(narrow.any())
    if some:
        middle = np.where(narrow, 0.5 * (low + high), 0.0)
        slopes = law.slopes(middle, parameters)
        size = np.where(exact, 1.0 / spread, np.where(narrow, width, 1.0))
        correction = np.where(exact, 0.0, slopes[1] * size**2 / 24.0)
        value = law.log_density(middle, parameters) + np.log(size) + correction
        found[0] = np.where(narrow, value, found[0])
    if orders:
        ends = []
        for end in (low, high):
            weight = np.exp(np.where(found[0] < FARTHEST, -np.inf, law.log_density(end, parameters) - found[0]))
            ends.append([weight, *(weight * part for part in law.slopes(end, parameters)[:3])])
        found += [sign * (above - below) for sign, below, above in zip(SIGNS, *ends, strict=True)]
    if orders and some:
        each = zip(SIGNS, slopes, found[1:], strict=True)
        found[1:] = [np.where(narrow, sign * part, wide) for sign, part, wide in each]
    return found


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
    """Return the log probability with lapses, and the share of the probability without a lapse."""
    if not law.lapses:
        return attentive, 1.0
    lapse = np.asarray(parameters.lapse, float)[..., None]
    with np.errstate(divide="ignore"):
        kept = np.log1p(-lapse) + attentive
        whole = np.logaddexp(kept, np.log(lapse) + rows.lapse)
    return whole, np.exp(kept - whole)
