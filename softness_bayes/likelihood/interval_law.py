"""Log probability of intervals, or log density of exact numbers, and its derivatives with respect to their expectation.

A rating represents an interval on the additive scale, such as the logs of all numbers that a rater would round to it.
An exact number is an interval of width 0. All functions work on arrays whose last axis is the rows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.interval_rule import LEAST, by_rule, in_any_draw
from softness_bayes.likelihood.log_derivatives import derivatives_of_log
from softness_bayes.likelihood.narrow_series import STEEPEST

FloatArray = NDArray[np.float64]

NARROW = 1e-3
"""Width of an interval, in spreads of the errors, below which its probability is width times density in its middle,
with the first correction: a difference of two distribution functions would lose digits."""

SINGLE_LEAST = 1e-30
"""Least probability, relative to the density at 0, that is computed in single precision."""

ROWS_WIDEST = 0.45
"""Largest half-width of intervals for which each row's probability is a series (`narrow_intervals`), in the smooth
length of the law. It is smaller than `narrow_series.WIDEST`, because normal errors have only two derivatives here."""

FAR = 6.0
"""Normal score of both ends beyond which probabilities are computed from logarithms."""

OPEN = 1e40
"""Finite error used in place of an infinite end."""

FARTHEST = -1e10
"""Log probability below which rounding leaves no digits of its ratio to the density."""

OUTLYING = 100.0
"""Distance from an interval [spreads] beyond which derivatives of a normal law are series in its inverse (Mills).
Differences of moments lose their digits there: at 1e5, the second derivative would be -6000 instead of -1."""

MOST_BY_RULE = 2.8
"""Widest interval, in spreads, up to which the rule is faster than normal distribution functions."""

MOST_OTHERS = 0.5
"""Largest share of rows computed by distribution functions; if it is exceeded, all rows are."""

SIGNS = -1.0, 1.0, -1.0, 1.0, -1.0, 1.0
"""Signs of derivatives with respect to the expectation, relative to those with respect to the error."""

_TINY_LOG = -600.0


def of_rows(values: FloatArray, index: Any) -> FloatArray:
    """Return some of the last axis, unless its length is 1: then all rows have the same value."""
    return values if values.shape[-1] == 1 else values[..., index]


def in_single(values: FloatArray) -> Any:
    """Return values in single precision."""
    return values.astype(np.float32)


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

    def in_spreads(self, expected: FloatArray, spread: FloatArray, single: bool) -> tuple[FloatArray, FloatArray]:
        """Return middles of finite intervals less their expectation, and half-widths, each (..., rows), in spreads."""
        half = 0.5 * (self.high - self.low)
        middle = ((self.low + half) - expected) / spread
        half = half / spread
        # differences of ends in single precision would lose digits
        return (in_single(middle), in_single(half)) if single else (middle, half)

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
        Spread of the errors, shape (..., 1), or (..., rows) if it differs between rows.
    parameters
        Parameters of the law, of batch shape (...).
    """
    return _with_lapses(law, rows, expected, spread, parameters)[0]


def derivatives(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, ...]:
    """Return `log_probability` and its first four derivatives with respect to the expectation, each (..., rows)."""
    value, *each = scaled_derivatives(law, rows, expected, spread, parameters)
    return value, *(part / spread**k for k, part in enumerate(each, 1))


def scaled_derivatives(
    law: ErrorLaw,
    rows: Rows,
    expected: FloatArray,
    spread: FloatArray,
    parameters: Any,
    single: bool = False,
    orders: int = 4,
    wide: bool = False,
) -> tuple[FloatArray, ...]:
    """Return the same as `derivatives`, with the expectation in units of the spread, and possibly fewer.

    Parameters
    ----------
    law, rows, expected, spread, parameters
        As for `log_probability`.
    single
        True to compute most probabilities in single precision: twice as fast, or more, with errors of about 1e-6. The
        third and fourth derivative are then left out where they are negligible, of narrow intervals and normal errors.
    orders
        Number of derivatives, 4 or 6.
    wide
        True for rows among which no series is tried, because their intervals are wide.
    """
    served = orders == 4 and not wide and law.averaged is not None
    if served and (single or (law != NORMAL and (rows.low == rows.high).all())):
        found = _averaged(law, rows, expected, spread, parameters, single)
        if found is not None:
            return found
    return _unaveraged(law, rows, expected, spread, parameters, single, orders)


def _unaveraged(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, single: bool, orders: int
) -> tuple[FloatArray, ...]:
    """Return `scaled_derivatives` without the series of narrow intervals."""
    value, *slopes = _with_lapses(law, rows, expected, spread, parameters, orders, single)
    slopes = derivatives_of_log(slopes)
    if law == NORMAL and value.min(initial=0.0) < -0.5 * OUTLYING**2:
        _set_outlying(rows, expected, spread, slopes)
    return value, *slopes


def _averaged(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, single: bool
) -> tuple[FloatArray, ...] | None:
    """Return `scaled_derivatives` by the series of narrow intervals, and those of wider ones by the other methods.

    None if most intervals are wider than `ROWS_WIDEST`.
    """
    assert law.averaged is not None
    half = 0.5 * (rows.high - rows.low)
    others = in_any_draw(half > ROWS_WIDEST * float((spread * law.smooth(parameters)).min()))
    if others.sum() > MOST_OTHERS * others.size:
        return None
    errors = expected - (rows.low + half)  # the law is symmetric
    errors /= spread
    own, kind = (parameters.single(), np.float32) if single else (parameters, float)
    errors, log_spread = errors.astype(kind), np.log(spread).astype(kind)
    if not half.any():
        value, *slopes = law.averaged(errors, None, own)
        return value - log_spread, *slopes
    square = np.square(half.astype(kind) * (1.0 / spread).astype(kind))
    with np.errstate(over="ignore", invalid="ignore"):  # far from an interval its series is not used
        value, *slopes = law.averaged(errors, square, own)
        steep = slopes[0] * slopes[0]
        steep *= square
        if not steep.max() <= STEEPEST:
            others |= in_any_draw(~(steep <= STEEPEST))
    value += np.log(np.where(half > 0.0, 2.0 * half, 1.0)).astype(kind)
    value -= log_spread
    if others.any():
        rest = np.flatnonzero(others)
        some = rows.take(rest), expected[..., rest], of_rows(spread, rest)
        few = _unaveraged(law, *some, parameters, single, 4)
        for whole, part in zip((value, *slopes), few, strict=False):
            whole[..., rest] = part
    return value, *slopes


def _set_outlying(rows: Rows, expected: FloatArray, spread: FloatArray, slopes: list[FloatArray]) -> None:
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
    for slope, value in zip(slopes, of_c, strict=False):
        slope[far] = value
    for slope in slopes[len(of_c) :]:
        slope[far] = 0.0


def two_derivatives_beyond(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the first three of `scaled_derivatives`, for rows that all have one finite end."""
    value, one, two = _mixed(law, rows, _beyond(law, rows, expected, spread, parameters, 2), parameters)
    return value, one, two - one * one


def _with_lapses(
    law: ErrorLaw,
    rows: Rows,
    expected: FloatArray,
    spread: FloatArray,
    parameters: Any,
    orders: int = 0,
    single: bool = False,
) -> list[FloatArray]:
    """Return the log probability of the rows, and its derivatives over the probability itself.

    The derivatives have orders 1 to `orders`, with respect to the expectation in units of the spread.
    """
    exact = rows.low == rows.high
    if exact.all():
        return _of_exact(law, rows, (rows.low - expected) / spread, spread, parameters, orders)
    open_ended = in_any_draw(np.isinf(rows.low) | np.isinf(rows.high))
    if open_ended.all():
        one = (np.isinf(rows.low) ^ np.isinf(rows.high)).all()
        how = _beyond if one else _by_functions
        return _mixed(law, rows, how(law, rows, expected, spread, parameters, orders), parameters)
    if open_ended.any():
        found = [np.empty(expected.shape) for _ in range(1 + orders)]
        for some in (open_ended, ~open_ended):
            inputs = rows.take(some), expected[..., some], of_rows(spread, some)
            parts = _with_lapses(law, *inputs, parameters, orders, single)
            for whole, part in zip(found, parts, strict=True):
                whole[..., some] = part
        return found
    middle, half = rows.in_spreads(expected, spread, single)
    own = parameters.single() if single else parameters
    if law.normal_scores is NORMAL.normal_scores and 2.0 * float(half.max()) > MOST_BY_RULE:
        return _mixed(law, rows, _by_functions(law, rows, expected, spread, parameters, orders), parameters)
    served = by_rule(law, middle, half, NARROW, own, SINGLE_LEAST if single else LEAST, max(orders - 4, 0))
    rest = np.flatnonzero(~served.good)
    if rest.size > MOST_OTHERS * served.good.size:
        return _mixed(law, rows, _by_functions(law, rows, expected, spread, parameters, orders), parameters)
    probability = served.probability if not rest.size else np.where(served.good, served.probability, 1.0)
    found = _weighed(law, rows, probability, list(served.slopes[:orders]), parameters)
    if rest.size:
        few = rows.take(rest)
        others = _by_functions(law, few, expected[..., rest], of_rows(spread, rest), parameters, orders)
        for whole, part in zip(found, _mixed(law, few, others, parameters), strict=True):
            whole[..., rest] = part
    return found


def _of_exact(
    law: ErrorLaw, rows: Rows, errors: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return the same as `_with_lapses` for exact numbers."""
    slopes = law.slopes(errors, parameters, orders) if orders else ()
    slopes = tuple(sign * part for sign, part in zip(SIGNS, slopes, strict=False))
    if law.lapses:
        density = law.kernel(errors, parameters)
        found = _weighed(law, rows, density, [density * part for part in slopes], parameters, -np.log(spread))
        if found[0].min(initial=0.0) > _TINY_LOG:
            return found
    return _mixed(law, rows, [law.log_density(errors, parameters) - np.log(spread), *slopes], parameters)


def _weighed(
    law: ErrorLaw,
    rows: Rows,
    probability: FloatArray,
    slopes: list[FloatArray],
    parameters: Any,
    constant: FloatArray | float = 0.0,
) -> list[FloatArray]:
    """Return the same as `_with_lapses`, from a probability without lapses and its derivatives.

    They are divided by the density at 0, and multiplied here by the exponential of a constant.
    """
    constant = constant + law.log_peak(parameters)
    if not law.lapses:
        inverse = 1.0 / probability
        return [np.log(probability) + constant, *(part * inverse for part in slopes)]
    lapse = np.asarray(parameters.lapse, float)[..., None]
    kept = ((1.0 - lapse) * np.exp(constant)).astype(probability.dtype)
    whole = kept * probability
    whole += (lapse * np.exp(rows.lapse)).astype(probability.dtype)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = kept / whole
        return [np.log(whole), *(part * share for part in slopes)]


def _beyond(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return the same as `_with_lapses`, without lapses, for intervals with one finite end and a symmetric law."""
    lower = np.isinf(rows.low)
    side = np.where(lower, 1.0, -1.0)
    error = clipped((np.where(lower, rows.high, rows.low) - expected) / spread)
    found = law.log_below(side * error, parameters)
    if not orders:
        return [found]
    ratio = law.log_density(error, parameters) - found
    # far out the ratio is |error| (Mills; only normal tails are so thin), and the difference of logarithms is rounding
    weight = side * np.exp(np.where(found < FARTHEST, np.log(np.maximum(np.abs(error), 1.0)), ratio))
    # the weight is minus the first slope over the error, and takes less time than all four slopes
    few = [1.0, -law.weight(error, parameters) * error]
    slopes: list[Any] = few[:orders] if orders <= len(few) else [1.0, *law.slopes(error, parameters, orders - 1)]
    return [found, *(sign * weight * part for sign, part in zip(SIGNS, slopes, strict=False))]


def _by_functions(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return the same as `_with_lapses`, without lapses, by distribution functions."""
    exact = rows.low == rows.high
    low, high = (clipped((end - expected) / spread) for end in (rows.low, rows.high))
    found = [_log_between(law.normal_scores(low, parameters), law.normal_scores(high, parameters))]
    width = high - low
    narrow = width < NARROW
    some = bool(narrow.any())
    if some:
        middle = np.where(narrow, 0.5 * (low + high), 0.0)
        slopes = law.slopes(middle, parameters, max(orders, 2))
        size = np.where(exact, 1.0 / spread, np.where(narrow, width, 1.0))
        correction = np.where(exact, 0.0, slopes[1] * size**2 / 24.0)
        value = law.log_density(middle, parameters) + np.log(size) + correction
        found[0] = np.where(narrow, value, found[0])
    if orders:
        ends = []
        for end in (low, high):
            weight = np.exp(np.where(found[0] < FARTHEST, -np.inf, law.log_density(end, parameters) - found[0]))
            ends.append([weight, *(weight * part for part in law.slopes(end, parameters, orders - 1))])
        found += [sign * (above - below) for sign, below, above in zip(SIGNS, *ends, strict=False)]
    if orders and some:
        each = zip(SIGNS, slopes, found[1:], strict=False)
        found[1:] = [np.where(narrow, sign * part, wide) for sign, part, wide in each]
    return found


def clipped(errors: FloatArray) -> FloatArray:
    """Return errors with infinite ends at `OPEN`."""
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


def _mixed(law: ErrorLaw, rows: Rows, attentive: list[FloatArray], parameters: Any) -> list[FloatArray]:
    """Return the same as `_with_lapses`, from the log probability without lapses and its relative derivatives."""
    if not law.lapses:
        return attentive
    lapse = np.asarray(parameters.lapse, float)[..., None]
    with np.errstate(divide="ignore"):
        kept = np.log1p(-lapse) + attentive[0]
        whole = np.logaddexp(kept, np.log(lapse) + rows.lapse)
    share = np.exp(kept - whole)
    return [whole, *(share * part for part in attentive[1:])]
