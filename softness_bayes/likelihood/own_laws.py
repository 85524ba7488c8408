"""Normal law of all effects where raters have exponents or noise of their own, from sums over rows (model.md 9).

Row i of rater p, with fabric j, has the expectation a_p + g_p D_i, where a_p = level + tau scale_p, D_i = drive +
omega z_j and g_p = exp(tau_gamma u_p); its errors have the spread varsigma exp(tau_varsigma w_p). The level is normal;
scales, u, w and z are standard normal. A rater's effects (scale, u, w) are eliminated first, then the level, so that
matrices are not larger than the number of fabrics.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.fabric_laws import deviations_at, log_factor_of, log_root_of, roots
from softness_bayes.likelihood.rater_rows import OwnSpreads, RowParameters

FloatArray = NDArray[np.float64]

_LEAST = 0.1  # smallest precision of an effect, relative to that of its prior
_LEAST_CURVATURE = 0.3  # of a rater's u and w, relative to the expected one
_TIED, _FREE = 0.97, 0.9  # largest correlation of scale and u; largest share of w that they explain
_LONGEST_STEP = 0.7  # in the logarithm of an exponent or of noise
_LARGEST_LOG = 150.0  # of a factor of exponents or noise
_LEAST_VARIANCE = 1e-300


class OwnPoint(NamedTuple):
    """Values of all effects; the first axis is that of draws."""

    level: FloatArray
    """Shape (draws, 1)."""
    scale: FloatArray
    """Raters' scales, in standard deviations tau, shape (draws, raters)."""
    u: FloatArray
    """Log exponents, in standard deviations tau_gamma, shape (draws, raters); 0 if exponents do not differ."""
    w: FloatArray
    """Log noise, in standard deviations tau_varsigma, likewise."""
    z: FloatArray
    """Fabrics' deviations, in standard deviations omega, shape (draws, fabrics)."""

    def part(self, piece: Any) -> OwnPoint:
        """Return some of the draws."""
        return OwnPoint(*(one[piece] for one in self))

    def copy(self) -> OwnPoint:
        """Return a copy."""
        return OwnPoint(*(one.copy() for one in self))

    def a(self, tau: FloatArray) -> FloatArray:
        """Return the level plus each rater's scale, for tau (draws, 1), shape (draws, raters)."""
        return self.level + tau * self.scale

    def log_prior(self, mean: float, sd: float) -> FloatArray:
        """Return the log prior density up to a constant, for a level with this mean and deviation, shape (draws,)."""
        apart = (self.level[:, 0] - mean) / sd
        squares = self.scale**2 + self.u**2 + self.w**2
        return np.asarray(-0.5 * (apart**2 + squares.sum(axis=-1) + (self.z**2).sum(axis=-1)))


class OwnSums(NamedTuple):
    """Sums over the rows of each rater and fabric, each of shape (draws, raters, fabrics).

    Slopes are with respect to the expectation; curvatures are minus the second derivatives.
    """

    value: FloatArray
    slope: FloatArray
    slope_d: FloatArray
    """Of the slopes times D."""
    curvature: FloatArray
    curvature_d: FloatArray
    curvature_dd: FloatArray
    noise: FloatArray
    """Derivative of the log density with respect to the log of the spread."""
    noise_curvature: FloatArray
    """Minus the second one."""
    slope_noise: FloatArray
    """Derivative of `slope` with respect to the log of the spread."""
    slope_d_noise: FloatArray

    def part(self, piece: Any) -> OwnSums:
        """Return some of the draws."""
        return OwnSums(*(one[piece] for one in self))


class OwnLaw(NamedTuple):
    """Normal approximation of all effects; the first axis is that of draws."""

    z: FloatArray
    """Deviations about which the log density is expanded, in standard deviations omega, shape (draws, fabrics)."""
    slope: FloatArray
    """Slope of the log density of the deviations there, shape (draws, fabrics)."""
    root: FloatArray
    """Lower Cholesky factor of minus its second derivative, shape (draws, fabrics, fabrics)."""
    step: FloatArray
    """Mean of the deviations less `z`, shape (draws, fabrics)."""
    mean: OwnPoint
    """Mean of all effects."""
    covariance: FloatArray
    """That of each rater's scale, u and w given the level and the deviations, shape (draws, raters, 3, 3)."""
    to_level: FloatArray
    """Decrease of these for a unit increase of the level, shape (draws, raters, 3)."""
    to_fabrics: FloatArray
    """The same for the deviations, shape (draws, raters, 3, fabrics)."""
    precision: FloatArray
    """Of the level given the deviations, shape (draws, 1)."""
    information: FloatArray
    """Each rater's part of it, shape (draws, raters)."""
    pull: FloatArray
    """Slope of each rater's log density with respect to the level at its mean, shape (draws, raters)."""
    level_to_fabrics: FloatArray
    """Decrease of the level for a unit increase of a deviation, shape (draws, fabrics)."""

    def part(self, piece: Any) -> OwnLaw:
        """Return some of the draws."""
        parts: Any = (one.part(piece) if isinstance(one, OwnPoint) else one[piece] for one in self)
        return OwnLaw(*parts)

    def replaced(self, other: OwnLaw, chosen: NDArray[np.bool_]) -> OwnLaw:
        """Return the law with the chosen draws from another one."""

        def mixed(one: Any, two: Any) -> Any:
            if isinstance(one, OwnPoint):
                return OwnPoint(*map(mixed, one, two))
            return np.where(chosen.reshape(-1, *(1,) * (one.ndim - 1)), two, one)

        return OwnLaw(*map(mixed, self, other))

    @property
    def log_factor(self) -> FloatArray:
        """Log of the approximate integral over the deviations, less the log density at `z`, shape (draws,)."""
        return log_factor_of(self.z, self.slope, self.step, self.log_root)

    @property
    def log_root(self) -> FloatArray:
        """Half the log determinant of minus the second derivative, shape (draws,)."""
        return log_root_of(self.root)

    def distance(self, point: OwnPoint, given: RowParameters) -> FloatArray:
        """Return how far the mean is from a point, in standard deviations of single effects, shape (draws,)."""
        of_fabrics = (self.slope * self.step).sum(axis=-1)
        variance = given.tau**2 * self.covariance[..., 0, 0]
        variance = variance + (1.0 - given.tau * self.to_level[..., 0]) ** 2 / self.precision
        moved = [(self.mean.a(given.tau) - point.a(given.tau)) ** 2 / np.maximum(variance, _LEAST_VARIANCE)]
        for k, (new, old) in enumerate(((self.mean.u, point.u), (self.mean.w, point.w)), 1):
            moved.append((new - old) ** 2 / self.covariance[..., k, k])
        return np.sqrt(np.maximum(of_fabrics, np.max(moved, axis=(0, -1))))

    def at(self, x: FloatArray) -> FloatArray:
        """Return the deviations, of which standard normal draws x (draws, points, fabrics) are the scores."""
        return deviations_at(self.root, self.z + self.step, x)


def factor(log: FloatArray) -> FloatArray:
    """Return the exponential, without overflow."""
    return np.asarray(np.exp(np.minimum(log, _LARGEST_LOG)))


def own_law(
    given: RowParameters, mean: float, sd: float, point: OwnPoint, sums: OwnSums, safe: bool = False
) -> tuple[OwnLaw, NDArray[np.bool_]]:
    """Return the normal law, and whether there is one without changes to the sums, (draws,).

    Parameters
    ----------
    given
        tau, omega, and the spreads of exponents and noise.
    mean, sd
        Prior of the level.
    point
        Point at which the sums are taken.
    sums
        The sums.
    safe
        True for a Newton step, whose curvatures are not smaller than their expectations.
    """
    spreads = given.own
    assert spreads is not None
    g, omega = factor(spreads.exponent * point.u), given.omega
    own = _own_effects(given, spreads, g, point, sums, safe)
    inverse: FloatArray = np.asarray(np.linalg.inv(own.hessian), float)
    curvature = sums.curvature.sum(axis=-1)
    of_fabrics = omega * (g[..., None] * sums.curvature).sum(axis=1)
    slope_of_z = omega * (g[..., None] * sums.slope).sum(axis=1) - point.z
    to_level = (inverse @ own.with_level[..., None])[..., 0]
    to_fabrics = inverse @ own.with_fabrics
    shift = (inverse @ own.slope[..., None])[..., 0]
    prior = sd**-2.0
    information = np.maximum(curvature - (own.with_level * to_level).sum(axis=-1), 0.0)
    precision = prior + information.sum(axis=-1, keepdims=True)
    good = precision[:, 0] > _LEAST * prior
    precision = np.maximum(precision, _LEAST * prior)
    apart = (point.level - mean) * prior
    pull = sums.slope.sum(axis=-1) - (own.slope * to_level).sum(axis=-1)
    slope_of_level = pull.sum(axis=-1, keepdims=True) - apart
    flat = own.with_fabrics.reshape(len(g), 3 * g.shape[1], point.z.shape[1])
    level_with_fabrics = of_fabrics - np.einsum("dk,dkj->dj", to_level.reshape(flat.shape[:2]), flat)
    slope_of_z = slope_of_z - np.einsum("dk,dkj->dj", shift.reshape(flat.shape[:2]), flat)
    hessian = -np.swapaxes(flat, -1, -2) @ to_fabrics.reshape(flat.shape)
    diagonal = np.arange(point.z.shape[-1])
    hessian[:, diagonal, diagonal] += 1.0 + omega**2 * (g[..., None] ** 2 * sums.curvature).sum(axis=1)
    level_to_fabrics = level_with_fabrics / precision
    hessian -= level_with_fabrics[..., None] * level_to_fabrics[:, None]
    slope_of_z = slope_of_z - level_to_fabrics * slope_of_level
    root, positive = roots(hessian)
    good &= positive & (np.diagonal(root, axis1=-2, axis2=-1) > np.sqrt(_LEAST)).all(axis=-1)
    half = np.linalg.solve(root, slope_of_z[..., None])
    step = np.linalg.solve(np.swapaxes(root, -1, -2), half)[..., 0]
    level = slope_of_level / precision - (level_to_fabrics * step).sum(axis=-1, keepdims=True)
    moved = shift - to_level * level[..., None] - (to_fabrics @ step[:, None, :, None])[..., 0]
    # a step is not longer than a factor of two in an exponent or in noise
    logs = np.abs(moved[..., 1] * spreads.exponent), np.abs(moved[..., 2] * spreads.noise)
    longest = np.maximum(np.maximum(*logs).max(axis=-1), _LEAST_VARIANCE)
    part = np.minimum(1.0, _LONGEST_STEP / longest)[:, None]
    level, moved, step = part * level, part[..., None] * moved, part * step
    scale, u, w = (one + moved[..., k] for k, one in enumerate((point.scale, point.u, point.w)))
    new = OwnPoint(point.level + level, scale, u, w, point.z + step)
    of_level = precision, information, pull - information * level, level_to_fabrics
    return OwnLaw(point.z, slope_of_z, root, step, new, inverse, to_level, to_fabrics, *of_level), good


class _OwnEffects(NamedTuple):
    """Slope and minus the second derivatives of the log density of each rater's scale, u and w."""

    slope: FloatArray  # (draws, raters, 3)
    hessian: FloatArray  # (draws, raters, 3, 3)
    with_level: FloatArray  # (draws, raters, 3)
    with_fabrics: FloatArray  # (draws, raters, 3, fabrics)


def _own_effects(
    given: RowParameters, spreads: OwnSpreads, g: FloatArray, point: OwnPoint, sums: OwnSums, safe: bool
) -> _OwnEffects:
    tau, lean, noise = given.tau, spreads.exponent * g, spreads.noise
    each = OwnSums(*(one.sum(axis=-1) for one in sums))
    slope = [tau * each.slope - point.scale, lean * each.slope_d - point.u, noise * each.noise - point.w]
    expected = 1.0 + lean**2 * np.maximum(each.curvature_dd, 0.0)
    least = 1.0 if safe else _LEAST_CURVATURE
    uu = 1.0 + lean**2 * each.curvature_dd - spreads.exponent * lean * each.slope_d
    uu = np.maximum(uu, least * expected)
    ww = np.maximum(1.0 + noise**2 * each.noise_curvature, _LEAST_CURVATURE)
    ss = np.maximum(1.0 + tau**2 * each.curvature, _LEAST)
    root = [np.sqrt(one) for one in (ss, uu, ww)]
    su = np.clip(tau * lean * each.curvature_d / (root[0] * root[1]), -_TIED, _TIED)
    sw = -tau * noise * each.slope_noise / (root[0] * root[2])
    uw = -lean * noise * each.slope_d_noise / (root[1] * root[2])
    # the correlations with w that leave the matrix positive
    lost, free = sw * sw + uw * uw - 2.0 * su * sw * uw, _FREE * (1.0 - su * su)
    kept = np.sqrt(np.minimum(1.0, free / np.maximum(lost, _LEAST_VARIANCE)))
    hessian = np.empty((*g.shape, 3, 3))
    for k in range(3):
        hessian[..., k, k] = root[k] ** 2
    for k, m, one in ((0, 1, su), (0, 2, kept * sw), (1, 2, kept * uw)):
        hessian[..., k, m] = hessian[..., m, k] = one * root[k] * root[m]
    with_level = [tau * each.curvature, lean * each.curvature_d, -noise * each.slope_noise]
    omega = (given.omega * g)[..., None]
    bilinear = 0.0 if safe else 1.0  # exponents multiply deviations
    with_fabrics = [
        omega * tau[..., None] * sums.curvature,
        omega * lean[..., None] * sums.curvature_d - bilinear * (given.omega * lean)[..., None] * sums.slope,
        -omega * noise[..., None] * sums.slope_noise,
    ]
    stacked = (np.stack(one, axis=-1) for one in (slope, with_level))
    own, level = (np.asarray(one) for one in stacked)
    return _OwnEffects(own, hessian, level, np.stack(with_fabrics, axis=-2))
