"""Magnitude estimates of touches with independent load errors (model.md 9).

The effect of a load error on a log rating is approximated as normal, with the mean and the variance of the response
under the distribution of the load. `OverLoads` integrates over each load without this approximation and is the
reference of the exactness check.
"""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.effects import Effects
from softness_bayes.likelihood.erring_loads import ErringLoads
from softness_bayes.likelihood.load_errors import OUTER, LoadErrors
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.normal_rows import EffectLaw, NormalRows
from softness_bayes.likelihood.shared_loads import FINE_NODES, between

FloatArray = NDArray[np.float64]

LOAD_POINTS = np.linspace(-4.5, 4.5, 51)
"""Points of the reference integral over a load, in standard deviations of its logarithm."""

LEVEL_REACH, LEVEL_STEP, MOST_LEVELS = 8.0, 0.3, 401
"""Half-width and spacing of its points over a rater's level, in standard deviations of that level, and their largest
number."""

FABRIC_DRAWS = 16
"""Number of draws of the fabrics' deviations over which the reference averages."""


class UncertainLoads(ErringLoads):
    """Positive ratings under a `RatingModel`, with mu, participants, fabrics and load errors integrated out.

    Parameters
    ----------
    ratings, design, model, over
        As for `LogRatings`.
    errors
        The errors of the loads. Mean rates are given at the stated loads, then at the further loads of `LoadErrors`.
    """

    effect = "spread"

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: RatingModel,
        errors: LoadErrors,
        over: Design | None = None,
    ) -> None:
        super().__init__(ratings, design, model, errors, over)
        self._touches = Design(
            errors.of_row, design.participant, design.fabric[errors.condition], design.n_participants
        )

    @cached_property
    def _rows(self) -> NormalRows:
        level = float(np.log(self.model.centre)), self.model.spread
        return NormalRows(self._touches, self._log, *level, self.design.n_fabrics)

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self.errors, self._over)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows."""
        errors = self.errors.without(rows)
        return type(self)(self.values[~rows], self.design.without(rows), self.model, errors, self._over)

    def finer(self) -> OverLoads:
        """Return the reference likelihood, integrated over each load without approximation as normal."""
        return OverLoads(self.values, self.design, self.model, self.errors.at_nodes(FINE_NODES), self._over)

    def moments(self, mean_rate: FloatArray, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the drive under the distribution of each touch's load, each (..., touches)."""
        lower, stated, higher = self.drives(mean_rate, parameters)
        up, down = higher - stated, lower - stated
        shift = OUTER * (up + down)
        return stated + shift, OUTER * ((up - shift) ** 2 + (down - shift) ** 2) + (1.0 - 2.0 * OUTER) * shift**2

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating given the effects, shape (..., rows), scaled for the checks.

        It is multiplied by varsigma and divided by the row's standard deviation, so that all residuals have standard
        deviation varsigma.
        """
        mean, variance = self.moments(mean_rate, parameters)
        row, design = self.errors.of_row, self.design
        expected = effects.mu[..., None] + mean[..., row] + effects.participant[..., design.participant]
        expected = expected + effects.fabric[..., design.fabric[design.condition]]
        own = self.model.error_sd(parameters)[..., None]
        scaled = (self._log - expected) * (own / np.sqrt(own**2 + variance))[..., row]
        return self.model.error.normal_scores(scaled, parameters)

    def replicate(
        self,
        rng: np.random.Generator,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        mean_rate: FloatArray | None = None,
    ) -> FloatArray:
        """Return one rating for every row, shape (..., rows), including load errors at these mean rates.

        Raises
        ------
        TypeError
            Without mean rates.
        """
        rates = self._needed(mean_rate)
        mean, variance = self.moments(rates, parameters)
        row, design = self.errors.of_row, self.design
        bend = (mean - self.drive(rates, parameters)[..., self.errors.condition])[..., row]
        log_rating = effects.mu[..., None] + (drive + effects.fabric[..., design.fabric])[..., design.condition]
        log_rating = log_rating + bend + effects.participant[..., design.participant]
        sd = np.sqrt(self.model.error_sd(parameters)[..., None] ** 2 + variance)
        noise = self.model.error.draw(rng, log_rating.shape, parameters)
        return np.asarray(self.model.scale.natural(log_rating + sd[..., row] * noise))

    def _law(self, mean_rate: FloatArray, parameters: Parameters) -> EffectLaw:
        mean, variance = self.moments(mean_rate, parameters)
        variance = variance + np.asarray(parameters.varsigma, float)[..., None] ** 2
        return EffectLaw.of(mean, variance, parameters.tau, parameters.omega)


class OverLoads(UncertainLoads):
    """The same ratings, integrated over each load, each rater's level and mu: the reference of `UncertainLoads`.

    The drive is interpolated between the loads of `errors.nodes`. Individual deviations of fabrics (omega) connect all
    raters. With them, the density is that of the normal approximation times the mean, over draws of the deviations in
    this approximation, of the ratio of both densities given the deviations.
    """

    def moments(self, mean_rate: FloatArray, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the drive under the distribution of each touch's load, each (..., touches)."""
        knots = np.sort(np.append(self.errors.nodes, 0.0))
        weight = np.exp(-0.5 * knots**2)
        weight /= weight.sum()
        every = self.drives(mean_rate, parameters)
        mean = np.tensordot(weight, every, 1)
        return mean, np.tensordot(weight, (every - mean) ** 2, 1)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log density of all ratings together, shape (...)."""
        knots = np.sort(np.append(self.errors.nodes, 0.0))
        every, law = self.drives(mean_rate, parameters), self._law(mean_rate, parameters)
        drive = np.stack([between(knots, every, np.full(every.shape[1:], z)) for z in LOAD_POINTS])
        noise = np.asarray(self.model.error_sd(parameters))
        if not (law.fabric > 0).any():
            return self._given(drive, law, noise) - self._log.sum()
        fabric, rng, ratio = self.design.fabric[self.errors.condition], np.random.default_rng(0), []
        for _ in range(FABRIC_DRAWS):
            shift = self._rows.draw_effects(rng, law).fabric[..., fabric]
            given = law._replace(offset=law.offset + shift, fabric=np.zeros_like(law.fabric))
            ratio.append(self._given(drive + shift, given, noise) - self._rows.log_density(given))
        averaged = log_sum(np.array(ratio), axis=0) - np.log(FABRIC_DRAWS)
        return self._rows.log_density(law) + averaged - self._log.sum()

    def _given(self, drive: FloatArray, law: EffectLaw, noise: FloatArray) -> FloatArray:
        """Return the log density of the log ratings, shape (...), if fabrics have no deviations of their own.

        `drive` has shape (points, ..., touches); `law`, the normal approximation, tells where to integrate.
        """
        tau, sd = (np.broadcast_to(v, law.offset.shape[:-1]) for v in (law.participant, noise))
        found = np.empty(tau.shape)
        for at in np.ndindex(found.shape):
            found[at] = self._joint(drive[:, *at], law.offset[at], law.variance[at], float(tau[at]), float(sd[at]))
        return found

    def _joint(self, drive: FloatArray, mean: FloatArray, variance: FloatArray, tau: float, noise: float) -> float:
        """Return the log density of all log ratings for one point of the batch; `drive` is (points, touches)."""
        levels = [
            self._of_rater(self.design.participant == rater, drive, mean, variance, tau, noise)
            for rater in np.unique(self.design.participant)
        ]
        centre, spread = float(np.log(self.model.centre)), self.model.spread
        precision = np.array([1.0 / (width**2 + tau**2) for _, _, _, width in levels])
        middle = np.array([middle for _, _, middle, _ in levels])
        sd = (precision.sum() + spread**-2) ** -0.5
        mu = sd**2 * (precision @ middle + centre / spread**2) + sd * np.arange(-LEVEL_REACH, LEVEL_REACH, LEVEL_STEP)
        total = _normal(mu - centre, spread) + np.log(LEVEL_STEP * sd)
        for level, log_density, _, _ in levels:
            total = total + log_sum(log_density + _normal(mu[:, None] - level, tau), axis=-1)
        return float(log_sum(total, axis=0))

    def _of_rater(
        self,
        rows: NDArray[np.bool_],
        drive: FloatArray,
        mean: FloatArray,
        variance: FloatArray,
        tau: float,
        noise: float,
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """Return levels of a rater, the log density of the ratings at each times their spacing, and its mean and sd."""
        touch, log = self.errors.of_row[rows], self._log[rows]
        precision = 1.0 / variance[touch]
        width = precision.sum() ** -0.5
        middle = float(precision @ (log - mean[touch])) * width**2
        step = min(LEVEL_STEP * width, tau)
        reach = min(int(np.ceil(LEVEL_REACH * width / step)), MOST_LEVELS // 2)
        level = middle + LEVEL_REACH * width * np.linspace(-1.0, 1.0, 2 * reach + 1)
        weight = np.exp(-0.5 * LOAD_POINTS**2)
        total = np.full(level.size, np.log(level[1] - level[0]))
        for one, value in zip(touch, log, strict=True):
            gap = (value - level)[:, None] - drive[:, one]
            total += log_sum(_normal(gap, noise) + np.log(weight / weight.sum()), axis=-1)
        return level, total, middle, float(width)


def _normal(gap: FloatArray, sd: float) -> FloatArray:
    """Return the log density of a normal law with mean 0."""
    return np.asarray(-0.5 * (gap / sd) ** 2 - np.log(sd) - 0.5 * np.log(2.0 * np.pi))
