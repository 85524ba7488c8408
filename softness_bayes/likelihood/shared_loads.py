"""Magnitude estimates with shared load errors: one factor per load, common to all its touches (model.md 9).

The factor of a load is log-normal. The response is linearised in the logarithm of the factor, with its mean and slope
under the distribution of the factor; the factors are then integrated out in closed form, like the other effects.
`OverFactors` uses the responses without linearisation and is the reference of the exactness check.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters
from softness_bayes.likelihood.design import Design, IndexArray
from softness_bayes.likelihood.erring_loads import ErringLoads
from softness_bayes.likelihood.load_errors import NODE, OUTER, LoadErrors
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.normal_rows import LeaveOneOut

FloatArray = NDArray[np.float64]

POINTS = 256
"""Number of vectors of factors in the reference sum, a power of two."""

FINE_NODES = (-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0)
"""Loads of the reference other than the stated one, in standard deviations of the log load."""


class SharedEffects(NamedTuple):
    """Effects as in `random_effects.Effects`, and the errors of the loads."""

    mu: FloatArray
    participant: FloatArray
    fabric: FloatArray
    load: FloatArray
    """Log ratio of each load to the stated one, in its standard deviations, shape (..., loads)."""


class _Factors(NamedTuple):
    """The normal law of the factors given the ratings, and their effects."""

    middle: FloatArray  # drive over the factors' law, (..., conditions)
    slope: FloatArray  # derivative of the drive with respect to the log factor, (..., loads, conditions)
    mean: FloatArray  # of the factors, (..., loads)
    information: FloatArray  # of the ratings on the factors, (..., loads, loads)
    pull: FloatArray  # gradient of the log density where the factors are 1, (..., loads)
    base: FloatArray  # log density of the log ratings there, (...)


class SharedLoads(ErringLoads):
    """Positive ratings under a `RatingModel`, with one factor per load integrated out besides all other effects.

    Parameters
    ----------
    ratings, design, model, over
        As for `LogRatings`.
    errors
        The additional loads; touches are the conditions, each with the error of its load.
    load
        Index of each condition's load, shape (conditions,).
    """

    effect = "move"

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: RatingModel,
        errors: LoadErrors,
        load: IndexArray,
        over: Design | None = None,
    ) -> None:
        super().__init__(ratings, design, model, errors, over)
        self.load = np.asarray(load)
        self._member = np.eye(self.load.max() + 1)[:, self.load]

    @classmethod
    def of(cls, observed: LogRatings, log_sd: float, load: ArrayLike) -> SharedLoads:
        """Return the likelihood of the same ratings with shared load errors.

        Parameters
        ----------
        observed
            Ratings of exact loads.
        log_sd
            Standard deviation of the logarithm of each load, positive.
        load
            Index of each condition's load, shape (conditions,).
        """
        conditions = np.arange(observed.design.n_conditions)
        errors = LoadErrors(
            conditions, np.full(conditions.size, log_sd), observed.design.condition, observed.design.n_conditions
        )
        return cls(observed.values, observed.design, observed.model, errors, np.asarray(load))

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self.errors, self.load, self._over)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows."""
        errors = self.errors.without(rows)
        return type(self)(self.values[~rows], self.design.without(rows), self.model, errors, self.load, self._over)

    def finer(self) -> OverFactors:
        """Return the reference likelihood, summed over the factors without linearisation."""
        errors = self.errors.at_nodes(FINE_NODES)
        return OverFactors(self.values, self.design, self.model, errors, self.load, self._over)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log density of all ratings together, shape (...)."""
        law = self._factors(mean_rate, parameters)
        inside = np.eye(law.mean.shape[-1]) + law.information
        explained = 0.5 * (law.pull * law.mean).sum(axis=-1)
        return np.asarray(law.base + explained - 0.5 * np.linalg.slogdet(inside)[1] - self._log.sum())

    def leave_one_out(self, mean_rate: FloatArray, parameters: Parameters) -> LeaveOneOut:
        """The normal law of each log rating given all the others, arrays of shape (..., rows)."""
        law = self._factors(mean_rate, parameters)
        left = self._rows.leave_one_out(self._law_of(law.middle, parameters))
        # rows of the inverse covariance, applied to the residuals and to the effects of the factors
        diagonal = left.sd**-2
        solved = (self._log - left.mean) * diagonal
        columns = []
        for k in range(self._member.shape[0]):
            moved = self._rows.leave_one_out(self._law_of(law.middle + law.slope[..., k, :], parameters))
            columns.append(solved - (self._log - moved.mean) * diagonal)
        reach = np.stack(columns, axis=-1)  # (..., rows, loads)
        covariance = np.linalg.inv(np.eye(reach.shape[-1]) + law.information)
        diagonal = diagonal - np.einsum("...ri,...ij,...rj->...r", reach, covariance, reach)
        solved = solved - (reach * law.mean[..., None, :]).sum(axis=-1)
        return LeaveOneOut(self._log - solved / diagonal, diagonal**-0.5)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each participant's ratings given all others', shape (..., participants)."""
        return Likelihood.log_likelihood_participants(self, mean_rate, parameters)

    def new_effects(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        shape: tuple[int, ...],
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Return effects of new participants, fabrics and loads, of batch ``shape``."""
        effects = super().new_effects(rng, parameters, shape, levels)
        factor = rng.standard_normal((*shape, self._member.shape[0]))
        return SharedEffects(effects.mu, effects.participant, effects.fabric, factor)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Exact draws of all effects given the ratings, one for each point of the batch; the factors come first."""
        law = self._factors(mean_rate, parameters)
        root = np.linalg.cholesky(np.linalg.inv(np.eye(law.mean.shape[-1]) + law.information))
        factor = law.mean + (root @ rng.standard_normal(law.mean.shape)[..., None])[..., 0]
        drive = law.middle + (factor[..., None] * law.slope).sum(axis=-2)
        others = self._rows.draw_effects(rng, self._law_of(drive, parameters))
        return SharedEffects(others.mu, others.participant, others.fabric, factor)

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating given the effects, shape (..., rows)."""
        design = self.design
        touched = self._touched(mean_rate, parameters, effects)
        expected = effects.mu[..., None] + (touched + effects.fabric[..., design.fabric])[..., design.condition]
        return self.model.error.normal_scores(
            self._log - expected - effects.participant[..., design.participant], parameters
        )

    def replicate(
        self,
        rng: np.random.Generator,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        mean_rate: FloatArray | None = None,
    ) -> FloatArray:
        """Return one rating for every row, shape (..., rows), for the loads in `effects` and these mean rates.

        Raises
        ------
        TypeError
            Without mean rates.
        """
        rates = self._needed(mean_rate)
        moved = self._touched(rates, parameters, effects) - self.drive(rates, parameters)
        return super().replicate(rng, drive + moved, parameters, effects, mean_rate)

    def _touched(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the drive of each condition for the loads in `effects`."""
        middle, slope = self._line(mean_rate, parameters)
        return np.asarray(middle + (effects.load[..., None] * slope).sum(axis=-2))

    def _line(self, mean_rate: FloatArray, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
        """Return mean and slope of the drive over the law of the factors, the slope (..., loads, conditions)."""
        lower, stated, higher = self.drives(mean_rate, parameters)
        middle = stated + OUTER * (higher + lower - 2.0 * stated)
        return middle, (OUTER * NODE * (higher - lower))[..., None, :] * self._member

    def _factors(self, mean_rate: FloatArray, parameters: Parameters) -> _Factors:
        """Return the law of the factors.

        The log density is quadratic in the factors, so values at 0, at each factor and at pairs of factors determine
        it.
        """
        middle, slope = self._line(mean_rate, parameters)
        loads = slope.shape[-2]
        one = [slope[..., k, :] for k in range(loads)]
        pairs = [(i, j) for i in range(loads) for j in range(i)]
        moves = [np.zeros_like(middle), *one, *(-each for each in one), *(one[i] + one[j] for i, j in pairs)]
        values = self._rows.log_density(self._law_of(middle + np.stack(moves), parameters))
        base, up, down = values[0], values[1 : 1 + loads], values[1 + loads : 1 + 2 * loads]
        pull = np.moveaxis(up - down, 0, -1) / 2.0
        information = np.zeros((*base.shape, loads, loads))
        for k in range(loads):
            information[..., k, k] = np.maximum(2.0 * base - up[k] - down[k], 0.0)
        for (i, j), both in zip(pairs, values[1 + 2 * loads :], strict=True):
            information[..., i, j] = information[..., j, i] = up[i] + up[j] - base - both
        mean = np.asarray(np.linalg.solve(np.eye(loads) + information, pull[..., None])[..., 0], float)
        return _Factors(middle, slope, mean, information, pull, base)


class OverFactors(SharedLoads):
    """The same ratings summed over vectors of factors, without linearisation: the reference of `SharedLoads`.

    The drive is interpolated between the loads of `errors.nodes`. The vectors are a weighted low-discrepancy sample of
    the normal law of the factors under linearisation; if the response is linear, the sum is exact.
    """

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log density of all ratings together, shape (...)."""
        from scipy.stats import qmc

        law = self._factors(mean_rate, parameters)
        loads = law.mean.shape[-1]
        root = np.linalg.cholesky(np.linalg.inv(np.eye(loads) + law.information))
        z = ndtri(qmc.Sobol(loads, seed=1).random(POINTS))
        knots = np.sort(np.append(self.errors.nodes, 0.0))
        every = self.drives(mean_rate, parameters)
        terms = []
        for step in z:
            factor = law.mean + root @ step
            drive = between(knots, every, factor[..., self.load])
            density = self._rows.log_density(self._law_of(drive, parameters))
            # ratio of the prior of the factors to their sampling density
            terms.append(density - 0.5 * (factor**2).sum(axis=-1) + 0.5 * (step**2).sum())
        terms_of = np.array(terms)
        largest = terms_of.max(axis=0)
        total = largest + np.log(np.exp(terms_of - largest).mean(axis=0))
        return np.asarray(total + np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1) - self._log.sum())

    def _line(self, mean_rate: FloatArray, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
        knots = np.sort(np.append(self.errors.nodes, 0.0))
        every = self.drives(mean_rate, parameters)
        weight = np.exp(-0.5 * knots**2)
        weight /= weight.sum()
        middle = np.tensordot(weight, every, 1)
        return middle, np.tensordot(weight * knots, every, 1)[..., None, :] * self._member


def between(knots: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate values (knots, ..., columns) at points (..., columns), by cubics through four evenly spaced knots."""
    place = np.clip((at - knots[0]) / (knots[1] - knots[0]), 0.0, knots.size - 1.0)
    first = np.clip(place.astype(int), 1, knots.size - 3)
    t = place - first
    four = (np.take_along_axis(values, first[None] + k, 0)[0] for k in (-1, 0, 1, 2))
    weights = (
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    )
    return np.asarray(sum(weight * value for weight, value in zip(weights, four, strict=True)))
