"""Normal law of the level, raters' scales and fabrics' deviations, from slopes and curvatures of rows (model.md 9).

Rows of rater p and fabric j have the expectation a_p + omega z_j, with a_p = level + tau scale_p; the level is normal,
scales and z are standard normal. Sums of the rows' slopes and curvatures make the density normal; scales and the level
are then eliminated, so that matrices are not larger than the number of fabrics.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.interval_law import scaled_derivatives
from softness_bayes.likelihood.rater_rows import RowParameters

FloatArray = NDArray[np.float64]

MOST_AVERAGED = 0.25
"""Largest variance over which slopes and curvatures are averaged, relative to that of single errors: for larger ones
the first order is not accurate."""

MOST_GAIN = 1.0
"""Largest squared distance, in standard deviations, of a mode that is not exact for which the density is corrected:
where Newton's method has not converged, the correction would be arbitrarily large."""

_LEAST = 0.1  # smallest precision of an effect, relative to that of its prior, of a normal law


class Point(NamedTuple):
    """Values of all effects; the first axis is that of draws."""

    level: FloatArray
    """Shape (draws, 1)."""
    scale: FloatArray
    """Raters' scales, in standard deviations tau, shape (draws, raters)."""
    z: FloatArray
    """Fabrics' deviations, in standard deviations omega, shape (draws, fabrics)."""

    def part(self, piece: Any) -> Point:
        """Return some of the draws."""
        return Point(*(one[piece] for one in self))

    def copy(self) -> Point:
        """Return a copy."""
        return Point(*(one.copy() for one in self))

    def a(self, tau: FloatArray) -> FloatArray:
        """Return the level plus each rater's scale, for tau (draws, 1), shape (draws, raters)."""
        return self.level + tau * self.scale

    def expectations(self, given: RowParameters) -> FloatArray:
        """Return the expectation of each rater and fabric less the drive, shape (draws, raters, fabrics)."""
        return self.a(given.tau)[..., None] + (given.omega * self.z)[:, None]

    def log_prior(self, mean: float, sd: float) -> FloatArray:
        """Return the log prior density up to a constant, for a level with this mean and deviation, shape (draws,)."""
        apart = (self.level[:, 0] - mean) / sd
        return np.asarray(-0.5 * (apart**2 + (self.scale**2).sum(axis=-1) + (self.z**2).sum(axis=-1)))


class Sums(NamedTuple):
    """Log density of all rows of each rater and fabric, with derivatives; each of shape (draws, raters, fabrics)."""

    value: FloatArray
    slope: FloatArray
    second: FloatArray
    third: FloatArray
    fourth: FloatArray
    secant: FloatArray
    """Sum of slopes over distances from the middle of the intervals, if errors have heavy tails; otherwise 0."""

    @classmethod
    def of(cls, slope: FloatArray, second: FloatArray) -> Sums:
        """Return the sums of quadratic log densities, whose values are not needed."""
        nothing = np.zeros(slope.shape)
        return cls(nothing, slope, second, nothing, nothing, nothing)

    def part(self, piece: Any) -> Sums:
        """Return some of the draws."""
        return Sums(*(one[piece] for one in self))


class FabricLaw(NamedTuple):
    """Normal approximation of all effects; the first axis is that of draws."""

    z: FloatArray
    """Deviations about which the log density is expanded, in standard deviations omega, shape (draws, fabrics)."""
    slope: FloatArray
    """g, the slope of the log density of the deviations there, shape (draws, fabrics)."""
    root: FloatArray
    """Lower Cholesky factor of H, shape (draws, fabrics, fabrics)."""
    step: FloatArray
    """H^-1 g: the mean of the deviations is `z` + `step`, shape (draws, fabrics)."""
    follow: FloatArray
    """Decrease of each rater's a_p for a unit deviation of a fabric, shape (draws, raters, fabrics)."""
    a: FloatArray
    """Mean of a_p, shape (draws, raters)."""
    variance: FloatArray
    """Variance of a_p given the deviations, shape (draws, raters)."""
    level: FloatArray
    """Mean of the level, shape (draws, 1)."""
    scale: FloatArray
    """Means of raters' scales, in standard deviations tau, shape (draws, raters)."""

    @property
    def mean(self) -> Point:
        """Mean of all effects."""
        return Point(self.level, self.scale, self.z + self.step)

    @property
    def log_factor(self) -> FloatArray:
        """Log of the approximate integral over the deviations, less log Z at `z`, shape (draws,)."""
        return log_factor_of(self.z, self.slope, self.step, self.log_root)

    @property
    def log_root(self) -> FloatArray:
        """Half the log determinant of H, shape (draws,)."""
        return log_root_of(self.root)

    def distance(self, point: Point, given: RowParameters) -> FloatArray:
        """Return how far the mean is from a point, in standard deviations of single effects, shape (draws,)."""
        of_fabrics = (self.slope * self.step).sum(axis=-1)
        of_raters = ((self.a - point.a(given.tau)) ** 2 / np.maximum(self.variance, 1e-300)).max(axis=-1)
        return np.sqrt(np.maximum(of_fabrics, of_raters))

    def at(self, x: FloatArray) -> FloatArray:
        """Return the deviations, of which standard normal draws x (draws, points, fabrics) are the scores."""
        return deviations_at(self.root, self.z + self.step, x)


def log_factor_of(z: FloatArray, slope: FloatArray, step: FloatArray, log_root: FloatArray) -> FloatArray:
    """Return `FabricLaw.log_factor` from the fields of a law."""
    gain = np.minimum((slope * step).sum(axis=-1), MOST_GAIN)
    return np.asarray(0.5 * (gain - (z**2).sum(axis=-1)) - log_root)


def log_root_of(root: FloatArray) -> FloatArray:
    """Return half the log determinant of matrices with these Cholesky factors, shape (draws,)."""
    return np.asarray(np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))


def deviations_at(root: FloatArray, mean: FloatArray, x: FloatArray) -> FloatArray:
    """Return the deviations, of which x (draws, points, fabrics) are the scores; `root` is that of their precision."""
    upper, scores = np.swapaxes(root, -1, -2), np.swapaxes(x, -1, -2)
    return np.asarray(np.swapaxes(np.linalg.solve(upper, scores), -1, -2) + mean[:, None])


def law_of(
    given: RowParameters,
    mean: float,
    sd: float,
    point: Point,
    slope: FloatArray,
    curvature: FloatArray,
) -> tuple[FabricLaw, NDArray[np.bool_]]:
    """Return the normal law, and whether there is one, (draws,).

    Parameters
    ----------
    given
        tau and omega.
    mean, sd
        Prior of the level.
    point
        Point at which slopes and curvatures are taken.
    slope, curvature
        Sums over the rows of each rater and fabric of the slope of the log probability with respect to the
        expectation, and of minus its second derivative, each (draws, raters, fabrics).
    """
    prior, variance = sd**-2.0, given.tau**2
    z, f = point.z, given.omega * point.z
    pull = slope + curvature * point.expectations(given)
    of_rater, pull_of_rater = curvature.sum(axis=-1), pull.sum(axis=-1)
    inverse = 1.0 + variance * of_rater
    good = (inverse > _LEAST).all(axis=-1)
    shrink = 1.0 / np.maximum(inverse, _LEAST)
    precision = prior + (shrink * of_rater).sum(axis=-1, keepdims=True)
    good &= precision[:, 0] > _LEAST * prior
    precision = np.maximum(precision, _LEAST * prior)
    shared = (shrink[..., None] * curvature).sum(axis=1)
    own = curvature * (variance * shrink)[..., None]
    information = -np.swapaxes(own, -1, -2) @ curvature - shared[:, :, None] * (shared / precision)[:, None]
    diagonal = np.arange(z.shape[-1])
    information[:, diagonal, diagonal] += curvature.sum(axis=1)
    centre = (mean * prior + (shrink * pull_of_rater).sum(axis=-1, keepdims=True)) / precision
    aim = pull.sum(axis=1) - (own * pull_of_rater[..., None]).sum(axis=1) - shared * centre
    hessian = given.omega[..., None] ** 2 * information
    hessian[:, diagonal, diagonal] += 1.0
    root, positive = roots(hessian)
    good &= positive & (np.diagonal(root, axis1=-2, axis2=-1) > np.sqrt(_LEAST)).all(axis=-1)
    slope_of_z = given.omega * (aim - (information @ f[..., None])[..., 0]) - z
    half = np.linalg.solve(root, slope_of_z[..., None])
    step = np.linalg.solve(np.swapaxes(root, -1, -2), half)[..., 0]
    left = pull_of_rater - (curvature @ (given.omega * (z + step))[..., None])[..., 0]
    level = (mean * prior + (shrink * left).sum(axis=-1, keepdims=True)) / precision
    scale = given.tau * shrink * (left - of_rater * level)
    follow = shrink[..., None] * ((shared / precision)[:, None] + variance[..., None] * curvature)
    spread = shrink * variance + shrink**2 / precision
    a = level + given.tau * scale
    return FabricLaw(z, slope_of_z, root, np.asarray(step), follow, a, spread, level, scale), good


def marginal_law(given: RowParameters, mean: float, sd: float, point: Point, sums: Sums) -> FabricLaw:
    """Return the normal law with slopes and curvatures averaged over the raters' scales, to first order.

    Curvatures may be negative as long as the law of the deviations is one; otherwise they are taken as 0, without
    averages.

    Parameters
    ----------
    given, mean, sd, point
        As for `law_of`.
    sums
        Derivatives of the log densities at the point.
    """
    plain, _ = law_of(given, mean, sd, point, sums.slope, np.maximum(-sums.second, 0.0))
    half = 0.5 * np.minimum(plain.variance, MOST_AVERAGED * given.spread**2)[..., None]
    found, good = law_of(given, mean, sd, point, sums.slope + half * sums.third, -sums.second - half * sums.fourth)
    if good.all():
        return found
    bad = np.flatnonzero(~good)
    for one, other in zip(found, plain, strict=True):
        one[bad] = other[bad]
    return found


def averaged_slopes(
    law: ErrorLaw, given: RowParameters, expected: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the slope of each row's log probability and minus its second derivative, averaged, each (draws, rows).

    Parameters
    ----------
    law, given
        Law of the errors, and parameters of the draws.
    expected, variance
        Expectation less the drive, and the variance over which derivatives are averaged, to first order.
    """
    variance = np.minimum(variance, MOST_AVERAGED * given.spread**2)
    each = scaled_derivatives(law, given.rows, given.drive + expected, given.spread, given.parameters)
    _, one, two, three, four = (part / given.spread**k for k, part in enumerate(each))
    return one + 0.5 * variance * three, -two - 0.5 * variance * four


def roots(matrices: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return lower Cholesky factors, and whether there is one; the unit matrix where there is none.

    Parameters
    ----------
    matrices
        Symmetric matrices, shape (draws, k, k).
    """
    good = np.ones(len(matrices), bool)
    try:
        return np.asarray(np.linalg.cholesky(matrices)), good
    except np.linalg.LinAlgError:
        found = np.empty_like(matrices)
        for k, one in enumerate(matrices):
            try:
                found[k] = np.linalg.cholesky(one)
            except np.linalg.LinAlgError:
                found[k], good[k] = np.eye(len(one)), False
        return found, good
