"""Map of the shape of a density, learnt from a pilot run and fixed before the retained draws.

Ridges of a posterior are often curved, and walkers mix slowly along a curved ridge. The curvature is estimated from a
pilot run and removed by a triangular map, so that the density is nearly standard normal in the coordinates y of the
map. In these coordinates, independent proposals are often accepted, which mixes faster than steps along a ridge. What
the other coordinates leave of each one may be skewed or have a long tail: it is straightened by its quantiles. The map
affects the speed of mixing but not the stationary distribution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

FloatArray = NDArray[np.float64]

_CURVATURE = 0.3  # expected size of a coefficient, in standard deviations
_REACH = 8.0  # standard deviations at which the arguments of curved terms are clipped
_REFITS = 4  # fits, each with a better estimate of the unexplained variance
_LEAST_VARIANCE = 1e-30  # used if all draws are equal
_LOOSE = 1e3  # the same of a coefficient that is not shrunk; keeps the regression solvable if no walker moved
_MOST_DRAWS = 50_000  # many times their effective number; more would need gigabytes in 30 dimensions
_EXACT = 1e-8  # smallest unexplained share of a coordinate's variance

SCORES = np.arange(-2.0, 3.0)
"""Normal scores at whose quantiles the coordinates of a map are straightened."""
_NOISE = np.array([7.0, 2.2, 2.2, 7.0])  # variance of the distance of two quantiles of one normal draw, times draws
_FLATTEST = 1e-3  # smallest ratio of such a distance to its expectation, as of walkers that have hardly moved


@dataclass(frozen=True)
class TriangularMap:
    """z = centre + axes t, with t_k = h_k(y_k) + c_k·(1, t_j, t_i t_j, t_j³) over i <= j < k.

    The axes are principal axes, scaled to unit variance of t and ordered so that earlier ones explain later ones best.
    h_k rises linearly between its values at `SCORES` and beyond them. The map is one-to-one on the whole space.
    """

    centre: FloatArray
    axes: FloatArray
    knots: FloatArray
    """Values of each h_k at `SCORES`, in ascending order, shape (dimension, scores)."""
    bends: tuple[FloatArray, ...]
    """Coefficients of each t_k, the constant first."""

    @classmethod
    def identity(cls, dimension: int) -> TriangularMap:
        """Return the identity map."""
        bends = tuple(np.zeros(_count(k)) for k in range(dimension))
        return cls(np.zeros(dimension), np.eye(dimension), np.tile(SCORES, (dimension, 1)), bends)

    @classmethod
    def affine(cls, centre: FloatArray, axes: FloatArray) -> TriangularMap:
        """Return the map z = centre + axes y."""
        plain = cls.identity(centre.size)
        return cls(centre, axes, plain.knots, plain.bends)

    def log_volume(self, y: FloatArray) -> FloatArray:
        """Return the logarithm of the Jacobian |dz/dy| at map coordinates ``y`` (..., dimension), shape (...)."""
        slopes = np.log(np.diff(self.knots) / np.diff(SCORES))
        of_each = slopes[np.arange(len(slopes)), _segment(y, SCORES)]
        return np.asarray(np.linalg.slogdet(self.axes)[1] + of_each.sum(axis=-1))

    @classmethod
    def fit(cls, draws: FloatArray, effective: float, linear: int = 0) -> TriangularMap:
        """Return the map learnt from draws.

        Parameters
        ----------
        draws
            Points z, shape (draws, dimension).
        effective
            Effective sample size of the draws; the smaller it is, the more the fitted curvature is shrunk.
        linear
            Number of last coordinates that depend linearly on each other, though not on the first ones; they are
            also placed last in the order.
        """
        centre, curved = draws.mean(axis=0), draws.shape[-1] - linear
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        axes = np.diag(np.sqrt(np.maximum(covariance.diagonal(), _LEAST_VARIANCE)))
        size, vectors = np.linalg.eigh(covariance[:curved, :curved])
        axes[:curved, :curved] = vectors * np.sqrt(
            np.maximum(size, max(size.max(initial=0.0) * 1e-12, _LEAST_VARIANCE))
        )
        t = np.linalg.solve(axes, (draws - centre).T).T
        order: list[int] = []
        fitted: list[FloatArray] = []
        if curved:
            bends = _Bends(t[:, :curved], effective)
            order = bends.order()
            fitted = [bends.fit(order[k], order[:k])[0] for k in range(curved)]
        order += range(curved, centre.size)
        t = t[:, order]
        fitted += _partly_straight(t, curved, effective)
        knots = _knots(t - _bent(t, tuple(fitted)), effective)
        return cls(centre, axes[:, order], knots, tuple(fitted))

    def forward(self, y: FloatArray) -> FloatArray:
        """Return points z at map coordinates ``y``, both of shape (..., dimension)."""
        return self.centre + (self._along(y) @ self.axes.T).reshape(y.shape)

    def inverse(self, z: FloatArray) -> FloatArray:
        """Return map coordinates y of points ``z``."""
        t = np.asarray(np.linalg.solve(self.axes, (z - self.centre)[..., None])[..., 0], float)
        return _interpolated(t - _bent(t, self.bends), self.knots, SCORES)

    def _along(self, y: FloatArray) -> FloatArray:
        """Return the coordinates t, shape (points, dimension), of points ``y`` of shape (..., dimension)."""
        t = _interpolated(y.reshape(-1, y.shape[-1]), SCORES, self.knots).T
        near, features = np.empty(t.shape), np.empty((_count(len(t)), t.shape[1]))
        features[0] = 1.0
        for k, bend in enumerate(self.bends):
            t[k] += bend @ features[: bend.size]
            np.minimum(np.maximum(t[k], -_REACH), _REACH, out=near[k])
            _extend(features, near, k)
        return t.T


def learn(walks: FloatArray, log_density: FloatArray, tau: float, linear: int = 0) -> TriangularMap:
    """Learn a map from a pilot run.

    Parameters
    ----------
    walks
        Points z, shape (..., dimension).
    log_density
        Their log density, shape (...).
    tau
        Autocorrelation time: steps per independent draw.
    linear
        As for `TriangularMap.fit`.
    """
    draws, height = walks.reshape(-1, walks.shape[-1]), log_density.ravel()
    # exclude walkers still approaching from poor starts, whose density is too low for a normal law; if all
    # are still approaching, as with very precise data, use the upper half
    low = min(height.max() - max(20.0, 4.0 * draws.shape[-1]), float(np.median(height)))
    draws = draws[height >= low]
    effective = len(draws) / tau
    if len(draws) > _MOST_DRAWS:
        # at random, because equal steps through the array might meet the same walkers again and again
        draws = draws[np.random.default_rng(0).choice(len(draws), _MOST_DRAWS, replace=False)]
    return TriangularMap.fit(draws, effective, linear)


class _Bends:
    """Regressions of each coordinate on linear, quadratic and cubic terms of the others, from one matrix of moments.

    Coefficients have a normal prior with standard deviation `_CURVATURE`, which shrinks those that the draws determine
    poorly. Their precision depends on the unexplained variance, which is estimated jointly: on a thin curved sheet,
    even a few draws determine the curvature well, and shrinkage would leave a bias larger than the thickness of the
    sheet.
    """

    def __init__(self, t: FloatArray, effective: float) -> None:
        features = _features(t)
        self._moments, self._effective = features.T @ features / len(t), effective
        self._with_features, self._square = features.T @ t / len(t), (t**2).mean(axis=0)
        self._dimension = t.shape[-1]

    def fit(self, k: int, others: list[int]) -> tuple[FloatArray, float]:
        """Return coefficients of t_k on the features of the others, and the explained mean square."""
        terms = np.array([0, *(term for i, j in enumerate(others) for term in self._terms(j, others[: i + 1]))])
        moments, moment = self._moments[np.ix_(terms, terms)], self._with_features[terms, k]
        bend = _shrunk(moments, moment, self._square[k], np.where(terms > 0, _CURVATURE, np.inf), self._effective)
        return bend, float(bend @ moment)

    @staticmethod
    def _terms(j: int, earlier: list[int]) -> list[int]:
        """Return the indices of the features in `_features` that are added by t_j, one of the earlier coordinates."""
        pairs = [_count(max(i, j)) + 1 + min(i, j) for i in earlier]
        return [_count(j), *pairs, _count(j + 1) - 1]

    def order(self) -> list[int]:
        """Return the order in which earlier coordinates explain later ones best; the best explained one is last."""
        left, order = list(range(self._dimension)), []
        while left:
            gains = [self.fit(k, [other for other in left if other != k])[1] for k in left]
            order.append(left.pop(int(np.argmax(gains))))
        return order[::-1]


def _partly_straight(t: FloatArray, curved: int, effective: float) -> list[FloatArray]:
    """Return coefficients of each t_k after the first `curved`: linear in those before it, curved in the first ones."""
    features = np.column_stack([_features(t[:, :curved]), np.clip(t[:, curved:], -_REACH, _REACH)])
    first = _count(curved)
    moments, with_features = features.T @ features / len(t), features.T @ t[:, curved:] / len(t)
    places = np.array([*range(first), *(_count(k) for k in range(curved, t.shape[-1]))])
    # these coordinates may be highly correlated with others, so that only their curvature is small
    expected = np.full(len(places), _CURVATURE)
    expected[[0, *(_count(k) for k in range(curved)), *range(first, len(places))]] = _LOOSE
    found = []
    for k, square in enumerate((t[:, curved:] ** 2).mean(axis=0)):
        known = first + k
        coefficients = _shrunk(moments[:known, :known], with_features[:known, k], square, expected[:known], effective)
        bend = np.zeros(_count(curved + k))
        bend[places[:known]] = coefficients
        found.append(bend)
    return found


def _features(t: FloatArray) -> FloatArray:
    """Return the features: 1 and, for every t_k, t_k, t_i t_k for i <= k, and t_k³, with t clipped at `_REACH`.

    The shape is (..., features) for t of shape (..., dimension); features of the first k coordinates come first.
    """
    near = np.clip(t, -_REACH, _REACH).reshape(math.prod(t.shape[:-1]), t.shape[-1]).T
    features = np.empty((_count(len(near)), near.shape[1]))
    features[0] = 1.0
    for k in range(len(near)):
        _extend(features, near, k)
    return features.T.reshape(*t.shape[:-1], len(features))


def _shrunk(
    moments: FloatArray, moment: FloatArray, square: float, expected: FloatArray, effective: float
) -> FloatArray:
    """Return the coefficients of a regression, shrunk towards 0 if the draws determine them poorly.

    Parameters
    ----------
    moments, moment, square
        Mean products of the features, of features and target, and mean square of the target.
    expected
        Standard deviation of the normal prior of each coefficient.
    effective
        Effective sample size of the draws.
    """
    left, bend = 1.0, moment
    for _ in range(_REFITS):
        normal = moments + np.diag(left / (expected**2 * effective))
        solved = np.linalg.solve(normal, np.column_stack([moment, moments]))
        # a copy, because a strided column would be multiplied in a different order, with different rounding
        bend, spent = np.array(solved[:, 0], float), float(np.trace(solved[:, 1:]))
        unexplained = square - 2.0 * bend @ moment + bend @ moments @ bend
        if spent >= effective:
            break
        left = min(1.0, max(float(unexplained) / (1.0 - spent / effective), _EXACT))
    return bend


@cache
def _count(coordinates: int) -> int:
    """Return the number of features for a number of coordinates."""
    return 1 + 2 * coordinates + coordinates * (coordinates + 1) // 2


def _extend(features: FloatArray, near: FloatArray, k: int) -> None:
    """Write the features added by coordinate k to those of the earlier ones; points are on the last axis of both."""
    start, stop = _count(k), _count(k + 1)
    features[start] = near[k]
    np.multiply(near[: k + 1], near[k], out=features[start + 1 : stop - 1])
    np.multiply(features[stop - 2], near[k], out=features[stop - 1])


def _knots(left: FloatArray, effective: float) -> FloatArray:
    """Return values at `SCORES` of functions that make the columns of residuals (draws, dimension) standard normal.

    They are quantiles. The ratios of their distances to those of a normal law are shrunk towards 1 if the draws
    determine them poorly: the prior of their logarithms is standard normal.
    """
    spread = left.std(axis=0)
    # the width along an axis is unknown if no walker moved on it
    straight = np.where(spread > 0, spread, 1.0)[:, None] * np.diff(SCORES)
    quantiles = np.quantile(left, ndtr(SCORES), axis=0).T
    ratio = np.maximum(np.diff(quantiles) / straight, _FLATTEST) ** (1.0 / (1.0 + _NOISE / effective))
    rise = np.concatenate([np.zeros((len(ratio), 1)), np.cumsum(ratio * straight, axis=1)], axis=1)
    middle = SCORES.size // 2
    return np.asarray(quantiles[:, [middle]] + rise - rise[:, [middle]])


def _interpolated(values: FloatArray, given: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return piecewise linear functions of values (..., dimension), through points (dimension, scores) or (scores,)."""
    slope = np.diff(wanted) / np.diff(given)
    start = wanted[..., :-1] - slope * given[..., :-1]
    place = np.arange(len(slope)), _segment(values, given)
    return np.asarray(start[place] + slope[place] * values)


def _segment(values: FloatArray, points: FloatArray) -> NDArray[np.intp]:
    """Return which segment between ascending points, (dimension, scores) or (scores,), each value is on or beyond."""
    return np.asarray((values[..., None] > points[..., 1:-1]).sum(axis=-1))


def _bent(t: FloatArray, bends: tuple[FloatArray, ...]) -> FloatArray:
    """Return the residual of each t_k from its prediction by the earlier ones, of the shape of ``t``."""
    features = _features(t)
    return np.stack([features[..., : bend.size] @ bend for bend in bends], axis=-1)
