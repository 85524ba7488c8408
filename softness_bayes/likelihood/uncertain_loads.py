"""Magnitude estimates of touches with independent load errors (model.md 9).

The effect of a load error on a log rating is approximated as normal, with the mean and the variance of the response
under the distribution of the load.
"""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.erring_loads import ErringLoads
from softness_bayes.likelihood.load_errors import OUTER, LoadErrors
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.random_effects import Effects, EffectSpreads, LeaveOneOut
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.weighted_effects import EffectLaw, WeightedEffects, law_of

FloatArray = NDArray[np.float64]


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
        touches = Design(errors.of_row, design.participant, design.fabric[errors.condition], design.n_participants)
        level = float(np.log(model.centre)), model.spread
        self._weighted = WeightedEffects(touches, self._log, *level, design.n_fabrics)

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self.errors, self._over)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows."""
        errors = self.errors.without(rows)
        return type(self)(self.values[~rows], self.design.without(rows), self.model, errors, self._over)

    def moments(self, mean_rate: FloatArray, parameters: RatingParameters) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the drive under the distribution of each touch's load, each (..., touches)."""
        lower, stated, higher = self.drives(mean_rate, parameters)
        up, down = higher - stated, lower - stated
        shift = OUTER * (up + down)
        return stated + shift, OUTER * ((up - shift) ** 2 + (down - shift) ** 2) + (1.0 - 2.0 * OUTER) * shift**2

    def log_likelihood(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings together, shape (...)."""
        return self._weighted.log_density(self._law(mean_rate, parameters)) - self._log.sum()

    def leave_one_out(self, mean_rate: FloatArray, parameters: RatingParameters) -> LeaveOneOut:
        """The normal law of each log rating given all the others, arrays of shape (..., rows)."""
        return self._weighted.leave_one_out(self._law(mean_rate, parameters))

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of each participant's ratings given those of all others, shape (draws, participants)."""
        density = self._weighted.log_density_participants(self._law(mean_rate, parameters))
        return density - np.bincount(self.design.participant, self._log, self.design.n_participants)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: RatingParameters) -> Effects:
        """Exact draws of mu, participants and fabrics given the ratings, one for each point of the batch."""
        return self._weighted.draw_effects(rng, self._law(mean_rate, parameters))

    def residual(self, mean_rate: FloatArray, parameters: RatingParameters, effects: Effects) -> FloatArray:
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
        parameters: RatingParameters,
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

    def _law(self, mean_rate: FloatArray, parameters: RatingParameters) -> EffectLaw:
        mean, variance = self.moments(mean_rate, parameters)
        spreads = EffectSpreads(parameters.tau, parameters.varsigma, parameters.omega)
        return law_of(mean, variance + np.asarray(parameters.varsigma, float)[..., None] ** 2, spreads)
