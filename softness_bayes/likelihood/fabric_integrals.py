"""Fabrics' own deviations integrated out by Laplace's method, about the integrals over raters' scales (model.md 9).

A fabric's deviation omega z, z ~ N(0, 1), is added to the expectation of all its rows, and connects all raters. Given
z, the level and raters' scales are integrated by `rater_integrals`, with the result Z(z). Newton's method finds the
mode of z, the level and all scales together. With g and -H the slope and the curvature of log Z(z) - |z|²/2 there,

    log ∫ N(z; 0, I) Z(z) dz ≈ log Z(z) - |z|²/2 + g' H^-1 g / 2 - log |H| / 2.

Only the law of z is approximated, not that of raters' scales. The term in g corrects for a mode that is not exact. g
and H follow from the first four derivatives of each row's log probability: given z, raters' scales are taken as normal,
and a row's slope and curvature are averaged over them. For exact numbers with normal errors everything is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.fabric_laws import FabricLaw, Point, Sums, law_of, marginal_law
from softness_bayes.likelihood.interval_law import scaled_derivatives
from softness_bayes.likelihood.mu_nodes import draw_index, log_sum
from softness_bayes.likelihood.pieces import blocks, pieces
from softness_bayes.likelihood.quadrature import Quadrature
from softness_bayes.likelihood.rater_integrals import RaterIntegrals
from softness_bayes.likelihood.rater_rows import RowParameters, WidthGroup, groups_by_width

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

SETTLED, SETTLED_TAILS = 0.3, 0.1
"""Newton's method stops once its step is shorter than this, in standard deviations; the second is for heavy tails. The
quadrature's limit holds too."""

PROPOSALS = 4
"""Number of draws from the normal approximation among which one is chosen by weight, to draw deviations."""

REFERENCE, FINE_PAIRS = 64, 4
"""Number of draws from the normal approximation over which the reference averages, and number of pairs of opposite ones
among them at which finer integrals over raters' scales replace those of the run."""

_STEPS = 25  # limit for Newton's method, halved steps included
_LEAST_CURVATURE = 0.5  # of the rows in a Newton step, relative to their secants
_LOSS = 1e-9  # relative decrease of the log density that may be rounding
_LEAST_GAP = 1e-6  # distance from the middle of an interval, in spreads, below which there is no secant
_SEED = 0  # seed of the draws of the reference


class FabricIntegrals:
    """The integrals over the level, raters' scales and fabrics' deviations for one table of ratings.

    Parameters
    ----------
    integrals
        The integrals over the level and raters' scales.
    fabric
        Fabric of each row, rows sorted by rater, shape (rows,).
    n_fabrics
        Number of fabrics.
    width, times
        As for `RaterIntegrals`.
    rough
        The approximation for which this is a reference; None for Laplace's method itself.
    """

    def __init__(
        self,
        integrals: RaterIntegrals,
        fabric: IndexArray,
        n_fabrics: int,
        width: FloatArray,
        times: FloatArray,
        rough: Rough | None = None,
    ) -> None:
        self.integrals, self.fabric, self.n_fabrics, self._rough = integrals, fabric, n_fabrics, rough
        cell = integrals.rater * n_fabrics + fabric
        self._order = np.argsort(cell, kind="stable")
        self._cells, self._of_row = np.unique(cell[self._order], return_inverse=True)
        self._groups = groups_by_width(self._of_row, width[self._order], times[self._order])
        self._open = [group for group in self._groups if not np.isfinite(width[self._order][group.rows]).any()]
        self._count = np.bincount(cell, minlength=integrals.count.size * n_fabrics).astype(float)
        self._count = self._count.reshape(-1, n_fabrics)

    @property
    def width(self) -> int:
        """Numbers that are kept in memory for each draw."""
        return (self.integrals.count.size + self.n_fabrics) * self.n_fabrics

    def shifted(self, given: RowParameters, z: FloatArray) -> RowParameters:
        """Return the parameters given deviations z (draws, fabrics), which are part of the drive."""
        return given._replace(drive=given.drive + given.omega * z[:, self.fabric], omega=np.zeros_like(given.omega))

    def log_density(self, given: RowParameters, quadrature: Quadrature) -> FloatArray:
        """Return the log density of all rows, shape (draws,)."""
        if not given.deviating:
            return self.integrals.log_density(given, quadrature)
        if self._rough is not None:
            return self._averaged(self._rough, given, quadrature)
        normal = self.normal(given, quadrature.settled, quadrature.fast)
        return self.integrals.log_density(self.shifted(given, normal.z), quadrature) + normal.log_factor

    def draw(
        self, rng: np.random.Generator, given: RowParameters, quadrature: Quadrature
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return draws of the level, of raters' scales (as `RaterIntegrals.draw`) and of the deviations.

        Deviations are those of one of several draws from the normal approximation, chosen by weight (importance
        resampling), of shape (draws, fabrics).
        """
        if not given.deviating:
            return *self.integrals.draw(rng, given, quadrature), np.zeros((len(given.drive), self.n_fabrics))
        normal = self.normal(given, quadrature.settled, quadrature.fast)
        x = rng.standard_normal((len(normal.z), PROPOSALS, self.n_fabrics))
        chosen = draw_index(rng, self._log_weights(given, normal, x, quadrature).T)
        z = normal.at(x)[np.arange(len(x)), chosen]
        level, own = self.integrals.draw(rng, self.shifted(given, z), quadrature)
        return level, own, given.omega * z

    def _averaged(self, rough: Rough, given: RowParameters, quadrature: Quadrature) -> FloatArray:
        """Return the log of the mean weight of draws from the normal approximation, the same at all parameters.

        The mean over all draws, with the run's integrals over raters' scales, is multiplied by the ratio of the means
        over some of them, with finer integrals and with the run's.
        """
        normal = rough.fabrics.normal(given, rough.quadrature.settled, rough.quadrature.fast)
        x = standard_draws(REFERENCE, self.n_fabrics)
        some = np.concatenate([np.arange(FINE_PAIRS), REFERENCE // 2 + np.arange(FINE_PAIRS)])
        every = np.broadcast_to(x, (len(normal.z), *x.shape))
        coarse = rough.fabrics._log_weights(given, normal, every, rough.quadrature)
        fine = self._log_weights(given, normal, every[:, some], quadrature)
        return log_sum(coarse, axis=1) - np.log(len(x)) + log_sum(fine, axis=1) - log_sum(coarse[:, some], axis=1)

    def _log_weights(
        self, given: RowParameters, normal: FabricLaw, x: FloatArray, quadrature: Quadrature
    ) -> FloatArray:
        """Return log weights of the deviations `FabricLaw.at` x (draws, points, fabrics), shape (draws, points).

        They are the log density of the rows and of the deviations, over that of the normal approximation.
        """
        z, draws = normal.at(x), len(x)
        found = np.empty(x.shape[:2])
        for piece in pieces(x.shape[1], draws * (self.fabric.size + self.width)):
            each = z[:, piece].reshape(-1, self.n_fabrics)
            part = self.shifted(given.part(np.repeat(np.arange(draws), len(each) // draws)), each)
            found[:, piece] = self.integrals.log_density(part, quadrature).reshape(draws, -1)
        return np.asarray(found + 0.5 * (x**2 - z**2).sum(axis=-1) - normal.log_root[:, None])

    def normal(self, given: RowParameters, settled: float, single: bool = False) -> Any:
        """Return the normal approximation about the joint mode of the level, all scales and all deviations.

        Arguments are those of `RaterIntegrals.modes`.
        """
        settled = min(settled, self._settled(given))
        given, trial = self._sorted(given), self._start(given)
        single = single and given.in_single(self.integrals.law, self.integrals.widest)
        kept, sums = trial.copy(), self._empty_sums(len(trial.z))
        best, active = np.full(len(trial.z), -np.inf), np.arange(len(trial.z))
        for _ in range(_STEPS):
            here = trial.part(active)
            found = self._sums(given.part(active), here, single=single)
            value = found.value.sum(axis=(-2, -1)) + here.log_prior(self.integrals.mean, self.integrals.sd)
            good = ~(value < best[active] - _LOSS * np.abs(value))
            up, down = active[good], active[~good]
            best[up] = value[good]
            for one, last in zip(trial, kept, strict=True):
                last[up] = one[up]
                one[down] = 0.5 * (one[down] + last[down])
            for whole, own in zip(sums, found, strict=True):
                whole[up] = own[good]
            new = self._newton(given.part(up), kept.part(up), sums.part(up))
            far = new.distance(kept.part(up), given.part(up)) > settled
            for one, moved in zip(trial, new.mean, strict=True):
                one[up[far]] = moved[far]
            active = np.sort(np.concatenate([up[far], down]))
            if not active.size:
                break
        return self._marginal(given, kept, sums)

    def _settled(self, given: RowParameters) -> float:
        """Return the largest step after which a search stops, in standard deviations."""
        return SETTLED if self.integrals.law == NORMAL else SETTLED_TAILS

    def _empty_sums(self, draws: int) -> Any:
        return Sums(*np.empty((len(Sums._fields), draws, *self._count.shape)))

    def _marginal(self, given: RowParameters, point: Any, sums: Any) -> Any:
        """Return the normal law of the deviations with all other effects integrated out."""
        return marginal_law(given, self.integrals.mean, self.integrals.sd, point, sums)

    def _sorted(self, given: RowParameters) -> RowParameters:
        """Return the parameters with rows sorted by rater and fabric."""
        order = self._order
        return given._replace(drive=given.drive[:, order], rows=given.rows.take(order), middle=given.middle[..., order])

    def _newton(self, given: RowParameters, point: Any, sums: Any) -> Any:
        """Return the law that a Newton step makes of slopes and curvatures."""
        curvature = np.maximum(-sums.second, _LEAST_CURVATURE * sums.secant)
        return law_of(given, self.integrals.mean, self.integrals.sd, point, sums.slope, curvature)[0]

    def _start(self, given: RowParameters) -> Any:
        """Return a point near the mode: from midpoints of intervals first, then with those that have one end added."""
        weight = self.integrals.weight
        weighted = (weight * (given.middle - given.drive))[:, self._order]
        size, square = self._count.size, given.spread[..., None] ** 2
        first = np.searchsorted(self._of_row, np.arange(self._cells.size))
        pull, curvature = np.zeros((len(weighted), size)), np.zeros(size)
        pull[:, self._cells] = np.add.reduceat(weighted, first, axis=-1)
        curvature[self._cells] = np.add.reduceat(weight[self._order], first)
        shape = len(weighted), *self._count.shape
        slope, second = pull.reshape(shape) / square, np.broadcast_to(-curvature.reshape(shape[1:]) / square, shape)
        point = Point(np.zeros((shape[0], 1)), np.zeros(shape[:2]), np.zeros((shape[0], shape[2])))
        point = self._newton(given, point, Sums.of(slope, second)).mean
        if self._open:
            beyond = self._sums(self._sorted(given), point, self._open)
            slope = slope + second * point.expectations(given) + beyond.slope
            second = second + np.minimum(beyond.second, 0.0)
            point = self._newton(given, point, Sums.of(slope, second)).mean
        return point

    def _sums(
        self, given: RowParameters, point: Point, groups: Sequence[WidthGroup] | None = None, single: bool = False
    ) -> Sums:
        """Return sums over the rows of every rater and fabric, or over some groups of rows; rows are sorted by both."""
        law, shape = self.integrals.law, (len(point.z), *self._count.shape)
        shift = point.expectations(given).reshape(shape[0], -1)[:, self._cells]
        found = np.zeros((6, *shift.shape))
        for group in self._groups if groups is None else groups:
            for block in blocks(shape[0], group.size):
                part = given.part(block)
                expected = group.of_rows(shift[block])
                expected += part.drive[:, group.rows]
                rows = part.rows.take(group.rows)
                each = scaled_derivatives(law, rows, expected, part.spread, part.parameters, single)
                # a normal law has concave log probabilities, so that its steps need no limit
                if law != NORMAL:
                    each = *each, secants(each[1], (part.middle[..., group.rows] - expected) / part.spread)
                for k, own in enumerate(each):
                    found[k][block, group.raters] += group.of_raters(own, exactly=k == 0)
        found /= given.spread ** np.array([0, 1, 2, 3, 4, 2])[:, None, None]
        if self._cells.size < self._count.size:
            every = np.zeros((6, shape[0], self._count.size))
            every[:, :, self._cells] = found
            found = every
        return Sums(*found.reshape(6, *shape))


class Rough(NamedTuple):
    """An approximation that is to be compared with a reference."""

    fabrics: FabricIntegrals
    """The integrals of the run."""
    quadrature: Quadrature
    """Their resolution."""


def secants(slope: FloatArray, gap: FloatArray) -> FloatArray:
    """Return slopes over distances to the middle of the intervals, in units of the errors' spread; 0 if negative.

    With heavy tails, log probabilities are convex functions of the squared distance. A quadratic with this curvature is
    then nowhere above the log probability, so that its maximum is an improvement.
    """
    found = np.divide(slope, gap, out=np.zeros_like(slope), where=np.abs(gap) > _LEAST_GAP)
    return np.asarray(np.maximum(found, 0.0))


def standard_draws(size: int, dimension: int) -> FloatArray:
    """Return standard normal draws, each with its opposite, shape (size, dimension).

    If there are enough of them, their covariance is made the unit matrix, so that they integrate squares exactly.
    """
    half = np.random.default_rng(_SEED).standard_normal((size // 2, dimension))
    if len(half) >= 2 * dimension:
        half = half @ np.linalg.inv(np.linalg.cholesky(half.T @ half / len(half))).T
    return np.concatenate([half, -half])
