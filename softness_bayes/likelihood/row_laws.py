"""Log probabilities of rows and their derivatives with respect to expectation and noise (model.md 9).

A rating represents an interval on the additive scale, such as the logs of all numbers that a rater would round to it.
An exact number is an interval of width 0, with a density instead of a probability.

With F the distribution function of the errors, f its density, and t = (end - expectation) / spread, the probability of
an interval is P = F(t_high) - F(t_low). All derivatives of P follow from f and f' at the two ends. Student's F takes
ten times as long as f: there, P of a narrow interval is a sum of f at Gauss-Lobatto points, which include the ends.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from softness_bayes.likelihood.error_laws import ErrorLaw

FloatArray = NDArray[np.float64]

POINTS, WIDEST = 6, 0.5
"""Number of Lobatto points of narrow intervals, and their largest half-width [spreads]: errors are below 1e-5."""
NARROWEST = 1e-4
"""Half-width below which a difference of distribution functions would lose digits, whatever the law."""
LEAST = 1e-6
"""Probability of an interval below which it is computed from logarithms."""
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


def log_probability(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the log probability of each row; of exact numbers, the log density per unit of the additive scale.

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
    return _by_kind(law, rows, expected, spread, parameters, 0)[0]


def row_terms(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, noise: bool = False
) -> RowTerms:
    """Return `log_probability` and its first two derivatives, with those in the log spread if `noise` is true."""
    return RowTerms(*_by_kind(law, rows, expected, spread, parameters, 5 if noise else 2))


def below(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the probability below each exact number, or below each interval plus half its own; without lapses."""
    ends = [(_finite(end) - expected) / spread for end in (rows.low, rows.high)]
    low, high = (ndtr(law.normal_scores(end, parameters)) for end in ends)
    return np.asarray(0.5 * (low + high))


def scores_at(
    law: ErrorLaw, rows: Rows, share: FloatArray, expected: FloatArray, spread: FloatArray, parameters: Any
) -> FloatArray:
    """Return normal scores of the rows, (..., rows); an interval's is taken at a given `share` of its probability.

    With uniform random shares, the scores of intervals are also standard normal under the model.
    """
    ends = [(_finite(end) - expected) / spread for end in (rows.low, rows.high)]
    low, high = (law.normal_scores(end, parameters) for end in ends)
    flip, near, far = _towards_zero(low, high)
    part = np.where(flip, 1.0 - share, share)
    p, q = ndtr(near), ndtr(far)
    score = ndtri(np.clip(p + part * (q - p), _TINY, None))
    score = np.where(rows.low == rows.high, far, np.clip(score, near, far))
    return np.where(flip, -score, score)


def _by_kind(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return the log probability and as many derivatives as asked, each row by the method that suits its interval."""
    half = 0.5 * (rows.high - rows.low)
    exact = half == 0.0
    narrow = (half <= spread * (WIDEST if law.slow_functions else NARROWEST)) & ~exact
    kinds = [(_of_numbers, exact), (_by_points, narrow), (_by_functions, ~(narrow | exact))]
    kinds.sort(key=lambda kind: -int(kind[1].sum()))
    # the method of most rows takes all, without copies; the others overwrite theirs
    with np.errstate(all="ignore"):
        parts = kinds[0][0](law, rows, expected, spread, parameters, orders)
        for method, chosen in kinds[1:]:
            _overwrite(parts, chosen, method, law, rows, expected, spread, parameters, orders)
    return _with_lapses(law, rows, parts, parameters)


def _overwrite(
    parts: list[FloatArray],
    chosen: NDArray[np.bool_],
    method: Callable[..., list[FloatArray]],
    law: ErrorLaw,
    rows: Rows,
    expected: FloatArray,
    spread: FloatArray,
    parameters: Any,
    orders: int,
) -> None:
    """Replace results for chosen rows by those of another method."""
    if chosen.any():
        some = np.nonzero(np.broadcast_to(chosen, parts[0].shape))
        found = method(law, *_elements(some, rows, expected, spread, parameters), orders)
        for whole, part in zip(parts, found, strict=True):
            whole[some] = part[:, 0]


def _elements(
    some: tuple[NDArray[np.intp], ...], rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[Rows, FloatArray, FloatArray, Any]:
    """Return single elements of arrays (..., rows), each as the only row of a draw of its own."""
    shape = np.broadcast_shapes(expected.shape, spread.shape)

    def of(values: FloatArray) -> FloatArray:
        return np.broadcast_to(values, shape)[some][:, None]

    own = parameters.each(lambda value: np.broadcast_to(value, shape[:-1])[some[:-1]])
    return Rows(*(of(part) for part in rows)), of(expected), of(spread), own


def _of_numbers(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return log densities of exact numbers and their derivatives."""
    t = (rows.low - expected) / spread
    parts = [law.log_density(t, parameters) - np.log(spread)]
    if orders:
        first, second = law.slopes(t, parameters)
        parts += [-first / spread, np.broadcast_to(second / (spread * spread), t.shape).copy()]
        if orders > 2:
            parts += [-1.0 - t * first, (second * t + first) / spread, t * (first + t * second)]
    return parts


def _by_points(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return log probabilities of narrow intervals and their derivatives, from the density at Lobatto points."""
    inverse = 1.0 / spread
    half = 0.5 * (rows.high - rows.low)
    middle = (rows.low + half - expected) * inverse
    half = half * inverse
    at, weights = lobatto(POINTS)
    centre = law.log_density(middle, parameters)
    whole, ends = np.zeros_like(middle), []
    for x, weight in zip(at, weights, strict=True):
        error = middle + x * half
        share = law.log_density(error, parameters)
        share -= centre  # relative to the density in the middle nothing underflows
        np.exp(share, out=share)
        if abs(x) == 1.0:
            ends.append((error, share))
        whole += weight * share
    whole *= half
    parts = [centre + np.log(whole)]
    if orders:
        ends = [(error, share / whole) for error, share in ends]
        parts += _derivatives(law, ends, inverse, parameters, orders)
    return parts


def _by_functions(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return log probabilities of intervals and their derivatives, from distribution functions."""
    inverse = 1.0 / spread
    low, high = ((_finite(end) - expected) * inverse for end in (rows.low, rows.high))
    whole = ndtr(law.normal_scores(high, parameters))
    whole -= ndtr(law.normal_scores(low, parameters))
    parts = [np.log(whole)]
    if orders:
        ends = [(end, np.exp(law.log_density(end, parameters)) / whole) for end in (low, high)]
        parts += _derivatives(law, ends, inverse, parameters, orders)
    _overwrite(parts, whole < LEAST, _by_logarithms, law, rows, expected, spread, parameters, orders)
    return parts


def _by_logarithms(
    law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any, orders: int
) -> list[FloatArray]:
    """Return what `_by_functions` does, for probabilities so small that digits would be lost."""
    inverse = 1.0 / spread
    low, high = ends = [(_finite(end) - expected) * inverse for end in (rows.low, rows.high)]
    value = _log_between(*(law.normal_scores(end, parameters) for end in ends))
    lost = np.isneginf(value) & np.isfinite(rows.high - rows.low)
    if lost.any():  # so far out that scores of both ends are equal; the density is not below that of the farther end
        least = np.minimum(*(law.log_density(end, parameters) for end in ends))
        value = np.where(lost, least + np.log((rows.high - rows.low) * inverse), value)
    if not orders:
        return [value]
    # far out a ratio is the slope of the log density (Mills), and the difference of logarithms is rounding
    near = value > FARTHEST
    ratios = [np.exp(np.where(near, law.log_density(end, parameters) - value, -np.inf)) for end in ends]
    nearest = np.where(low + high > 0.0, 0, 1)
    for k, end in enumerate(ends):
        ratios[k] = np.where(~near & (nearest == k), np.abs(law.slopes(end, parameters)[0]), ratios[k])
    return [value, *_derivatives(law, list(zip(ends, ratios, strict=True)), inverse, parameters, orders)]


def _derivatives(
    law: ErrorLaw,
    ends: list[tuple[FloatArray, FloatArray]],
    inverse: FloatArray,
    parameters: Any,
    orders: int,
) -> list[FloatArray]:
    """Return derivatives of log P from each end's t and f(t) / P; `inverse` is one over the spread."""
    (low, of_low), (high, of_high) = ends
    slope_low, slope_high = law.slopes(low, parameters)[0], law.slopes(high, parameters)[0]
    mean = (of_low - of_high) * inverse
    bend_low, bend_high = of_low * slope_low, of_high * slope_high
    mean2 = (bend_high - bend_low) * (inverse * inverse) - mean * mean
    if orders == 2:
        return [mean, mean2]
    noise = low * of_low - high * of_high
    both = (high * bend_high + of_high - low * bend_low - of_low) * inverse - mean * noise
    noise2 = high * (of_high + high * bend_high) - low * (of_low + low * bend_low) - noise * noise
    return [mean, mean2, noise, both, noise2]


def _with_lapses(law: ErrorLaw, rows: Rows, parts: list[FloatArray], parameters: Any) -> list[FloatArray]:
    """Return the log probability of a mixture with lapses, and its derivatives, from those without."""
    if not law.lapses:
        return parts
    lapse = np.asarray(parameters.lapse, float)[..., None]
    with np.errstate(divide="ignore"):
        kept = np.log1p(-lapse) + parts[0]
        value = np.logaddexp(kept, np.log(lapse) + rows.lapse)
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


@cache
def lobatto(points: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return Gauss-Lobatto points on [-1, 1], both ends included, and weights: exact to the degree 2 points - 3."""
    last = np.zeros(points)
    last[-1] = 1.0
    inner = np.real(legendre.legroots(legendre.legder(last)))
    at = np.concatenate([[-1.0], np.sort(inner), [1.0]])
    weights = 2.0 / (points * (points - 1) * legendre.legval(at, last) ** 2)
    return tuple(at.tolist()), tuple(weights.tolist())


def _finite(ends: FloatArray) -> FloatArray:
    """Return ends of intervals with infinite ones at `OPEN`."""
    return np.clip(ends, -OPEN, OPEN)


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
