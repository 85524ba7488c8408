"""Magnitude estimates of touches whose loads have errors, of each rating or shared by all of a load (model.md 9).

The logarithm of a touch's load is the stated one plus log_sd z, z ~ N(0, 1), and its drive is d(z). An error of each
rating's own is approximated as normal: the row has the mean and, beside varsigma², the variance of d under the law of
z. An error shared by all ratings of a load is a common effect: d is approximated by its mean plus its slope times z,
and z is integrated out in closed form, like the other effects. Means, variances and slopes are sums over few loads
(Gauss-Hermite). `OverLoads` integrates d(z) without these approximations and is the reference of the exactness check.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp, ndtri

from softness_bayes.likelihood.contract import Effects, Levels, Parameters, Shape
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray, LoadErrors
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.normal_rows import EffectLaw, NormalRows
from softness_bayes.likelihood.pieces import over_draws
from softness_bayes.likelihood.quadrature import Integrals
from softness_bayes.likelihood.rater_effects import Given, Table
from softness_bayes.likelihood.row_laws import Rows

FINE_KNOTS = (-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0)
"""Loads between which the reference interpolates."""

POINTS = np.linspace(-4.5, 4.5, 51)
"""Points z of the reference integral over the load of one rating."""

VECTORS = 256
"""Number of vectors z in the reference sum over shared errors, a power of two."""


class UncertainLoads(LogRatings):
    """Positive ratings under a `RatingModel`, with mu, participants, fabrics and errors of loads integrated out.

    A further effect is z of each shared error, `load` of shape (..., loads); without columns if errors are independent.

    Parameters
    ----------
    ratings, design, model, over
        As for `LogRatings`.
    errors
        The errors of the loads. Mean rates are given at the stated loads, then at the further ones of `LoadErrors`.
    """

    def __init__(
        self, ratings: ArrayLike, design: Design, model: RatingModel, errors: LoadErrors, over: Design | None = None
    ) -> None:
        super().__init__(ratings, design, model, over)
        self.errors = self.load_errors = errors

    @cached_property
    def _rows(self) -> NormalRows:
        errors, design = self.errors, self.design
        touches = Design(errors.of_row, design.participant, design.fabric[errors.condition], design.n_participants)
        return NormalRows(touches, self._log, self.model.level.mean)

    @property
    def condition_of_rate(self) -> IndexArray:
        """Condition of each column of the mean rates."""
        touches = np.tile(self.errors.condition, len(self.errors.further))
        return np.concatenate([super().condition_of_rate, touches])

    def _arguments(self, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return the errors of the loads of all ratings, or of some."""
        return {"errors": self.errors if rows is None else replace(self.errors, of_row=self.errors.of_row[rows])}

    def finer(self) -> OverLoads:
        """Return the reference likelihood, which integrates over loads without approximation."""
        errors = replace(self.errors, knots=FINE_KNOTS)
        return OverLoads(self.values, self.design, self.model, errors, self._over)

    def new_effects(self, rng: Generator, parameters: Parameters, shape: Shape, levels: Levels = None) -> Effects:
        """Return effects of new participants, fabrics and loads, of batch ``shape``."""
        effects = super().new_effects(rng, parameters, shape, levels)
        return effects.replace(load=rng.standard_normal((*shape, len(self.errors.member))))

    def with_new_participants(self, rng: Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Return these effects with the same number of new participants, under the same loads."""
        return super().with_new_participants(rng, parameters, effects).replace(load=effects.load)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of all effects given the ratings, one for each point of the batch."""
        effects, z = self._drawn(rng, self._at(mean_rate, parameters), parameters)
        return effects.replace(load=z)

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating given the effects, shape (..., rows), scaled for the checks.

        It is multiplied by varsigma and divided by the row's standard deviation, so that all residuals have standard
        deviation varsigma.
        """
        expected, sd = self._given_loads(self.drive(mean_rate, parameters), parameters, effects)
        own = self.model.error_sd(parameters)[..., None]
        return (self._log - expected) * (own / sd)

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return one rating for every row, shape (..., rows), under loads with errors."""
        expected, sd = self._given_loads(drive, parameters, effects)
        return self.model.scale.natural(expected + sd * self.model.error.draw(rng, expected.shape, parameters))

    def _drives(self, drive: FloatArray) -> FloatArray:
        """Return the drive of each touch at all knots, shape (knots, ..., touches)."""
        errors = self.errors
        stated, others = np.split(drive, [self.design.n_conditions], axis=-1)
        others = others.reshape(*others.shape[:-1], len(errors.further), errors.condition.size)
        middle = errors.knots.index(0.0)
        return np.insert(np.moveaxis(others, -2, 0), middle, stated[..., errors.condition], axis=0)

    def _law(self, drive: FloatArray, parameters: Parameters) -> EffectLaw:
        """Return the law of the log ratings; the z of shared errors are the last shared effects."""
        drives, errors = self._drives(drive), self.errors
        mean, slope = (np.tensordot(weights, drives, 1) for weights in (errors.weights, errors.weights * errors.knots))
        variance = self.model.error_sd(parameters)[..., None] ** 2
        if errors.load is None:
            variance = variance + np.tensordot(errors.weights, (drives - mean) ** 2, 1)
        along = slope[..., None] * errors.member.T
        shared = self._shared(self.design.fabric[errors.condition], parameters, along)
        return EffectLaw.of(mean, variance, parameters.tau, *shared)

    def _given_loads(
        self, drive: FloatArray, parameters: Parameters, effects: Effects
    ) -> tuple[FloatArray, FloatArray]:
        """Return the expected log rating of each row for the effects, and the standard deviation of its error."""
        law, design, loads = self._law(drive, parameters), self.design, len(self.errors.member)
        slope = law.shared[..., law.shared.shape[-1] - loads :]
        touched = law.offset + (slope * effects.load[..., None, :]).sum(axis=-1)
        touched = touched + effects.fabric[..., design.fabric[self.errors.condition]]
        sd = np.broadcast_to(np.sqrt(law.variance), (*law.variance.shape[:-1], touched.shape[-1]))
        own = effects.mu[..., None] + effects.participant[..., design.participant]
        return own + touched[..., self.errors.of_row], sd[..., self.errors.of_row]


class OverLoads(UncertainLoads):
    """The same ratings, the drive being interpolated between many loads: the reference of `UncertainLoads`."""

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all ratings together, shape (...)."""
        density = self._over_each if self.errors.load is None else self._over_shared
        return density(mean_rate, parameters) + self._jacobian

    def _over_each(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of log ratings, the law of a row being a mixture over its load."""
        drives = self._drives(self.drive(mean_rate, parameters))
        knots, *batch, touches = drives.shape
        shape = parameters.batch_shape(tuple(batch))
        drives = np.broadcast_to(drives, (knots, *shape, touches)).reshape(knots, -1, touches)
        order = np.argsort(self.design.participant, kind="stable")
        of_row = self.errors.of_row[order]

        def column(value: ArrayLike) -> FloatArray:
            return over_draws(value, shape)[:, None]

        spread, omega = column(self.model.error_sd(parameters)), column(parameters.omega)
        points = self._between(drives, np.broadcast_to(POINTS[:, None, None], (POINTS.size, *drives.shape[1:])))
        stated = drives[self.errors.knots.index(0.0)]
        shift = np.moveaxis(points - stated, 0, -1)[:, of_row] / spread[..., None]
        _, rater = np.unique(self.design.participant[order], return_inverse=True)
        fabric, level = self.design.fabric[self.errors.condition[of_row]], self.model.level
        log, none = self._log[order], np.zeros(order.size)
        given = Given(
            stated[:, of_row], Rows(log, log, none), spread, column(parameters.tau), Parameters(shift=shift),
            omega=omega if (omega > 0.0).any() else None,
        )  # fmt: skip
        table = Table(_LOADED, rater, fabric, self.design.n_fabrics, level.mean, level.sd, np.ones(order.size))
        return Integrals(table).log_density(given).reshape(shape)

    def _over_shared(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of log ratings by a weighted sum over low-discrepancy vectors z.

        They follow the normal law of z under the linear approximation; if the response is linear, the sum is exact.
        """
        from scipy.stats import qmc  # imported here because it takes a third of a second

        drive, loads = self.drive(mean_rate, parameters), len(self.errors.member)
        drives, law = self._drives(drive), self._law(drive, parameters)
        given_all = self._rows.shared(law)
        centre, root = given_all.mean[..., -loads:], np.linalg.cholesky(given_all.covariance[..., -loads:, -loads:])
        terms = []
        for step in ndtri(qmc.Sobol(loads, seed=1).random(VECTORS)):
            z = centre + root @ step
            moved = self._between(drives, z[..., self.errors.load])
            # ratio of the prior of z to its sampling density
            weight = 0.5 * (step**2).sum() - 0.5 * (z**2).sum(axis=-1)
            given = law._replace(offset=moved, shared=law.shared[..., :-loads], sd=law.sd[..., :-loads])
            terms.append(self._rows.log_density(given) + weight)
        total = logsumexp(terms, axis=0) - math.log(VECTORS)
        return np.asarray(total + np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))

    def _between(self, drives: FloatArray, z: FloatArray) -> FloatArray:
        """Return drives (knots, ..., touches) interpolated at z (..., touches), by cubic splines."""
        from scipy.interpolate import CubicSpline  # imported here because it takes a third of a second

        knots = np.array(self.errors.knots)
        share = CubicSpline(knots, np.eye(knots.size))(np.clip(z, knots[0], knots[-1]))
        return np.asarray((np.moveaxis(drives, 0, -1) * share).sum(axis=-1))


class _LoadedLaw(ErrorLaw):
    """Density of errors of exact ratings whose loads err: a normal one, mixed over z.

    The parameter `shift`, of shape (draws, rows, points), is d(z) - d(0) in units of varsigma.
    """

    concave = False

    def log_density(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return the log of the mean density of error - shift."""
        logs, weight = super().log_density(errors[..., None] - parameters.shift, parameters), np.exp(-0.5 * POINTS**2)
        return np.asarray(logsumexp(logs, b=weight / weight.sum(), axis=-1))

    def slopes(self, errors: FloatArray, parameters: Any) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the slopes of the parts, the latter less 1."""
        away = errors[..., None] - parameters.shift
        share = np.exp(-0.5 * (away**2 + POINTS**2 - (away**2 + POINTS**2).min(axis=-1, keepdims=True)))
        share /= share.sum(axis=-1, keepdims=True)
        first = -(share * away).sum(axis=-1)
        return first, (share * away**2).sum(axis=-1) - first**2 - 1.0


_LOADED = _LoadedLaw("loads with errors", "normal, mixed over errors of loads")
