"""Ratings of any error law by raters who have exponents or noise of their own: grids, zeros, outliers, sliders.

The effects are those of `own_effects`, the intervals and error laws those of `intervals`; fabrics may have deviations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.contract import Effects
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings, SliderModel
from softness_bayes.likelihood.own_dense import OwnDenseIntegrals
from softness_bayes.likelihood.own_draws import PROPOSALS
from softness_bayes.likelihood.own_effects import OWN_ANSWERS, OwnEffects, OwnRaters
from softness_bayes.likelihood.own_integrals import OwnIntegrals
from softness_bayes.likelihood.own_left_out import below_left_out, log_density_left_out
from softness_bayes.likelihood.own_search import OwnSearch
from softness_bayes.likelihood.pieces import in_pieces
from softness_bayes.likelihood.quadrature import DENSE, DENSER
from softness_bayes.likelihood.rater_rows import OwnSpreads, RowParameters
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.row_scores import score_at
from softness_bayes.likelihood.stated import Stated

FloatArray = NDArray[np.float64]


class _OfIntervals(OwnRaters):
    """The part that both models below have in common."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the model's parameters."""
        parent: Any = super()
        return (*parent.needs, *OWN_ANSWERS.values())

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> OwnIntervalRatings:
        """Return the likelihood of these ratings: exact numbers, unless `stated` gives their intervals."""
        me: Any = self
        return OwnIntervalRatings(ratings, design, me, stated=stated)


@dataclass(frozen=True)
class OwnIntervalModel(_OfIntervals, IntervalModel):  # type: ignore[override]
    """An `IntervalModel` in which raters have individual exponents or noise.

    Parameters
    ----------
    differ
        The quantities that differ: gamma, varsigma or both.
    """

    differ: tuple[str, ...] = ("gamma",)


@dataclass(frozen=True)
class OwnSliderModel(_OfIntervals, SliderModel):  # type: ignore[override]
    """A `SliderModel` in which raters have individual exponents or noise, as in `OwnIntervalModel`."""

    differ: tuple[str, ...] = ("gamma",)


class OwnIntervalRatings(IntervalRatings):
    """Ratings under an `OwnIntervalModel`, with all effects of raters and fabrics integrated out.

    Parameters and errors are those of `IntervalRatings`.
    """

    model: OwnIntervalModel
    _integrals: OwnIntegrals
    _fabrics: OwnSearch

    def _kinds(self, walled: bool, how: tuple[Any, ...]) -> tuple[OwnIntegrals, type[OwnSearch]]:
        dense = self._quadrature in (DENSE, DENSER)
        return (OwnDenseIntegrals if dense else OwnIntegrals)(self.model.differ, *how), OwnSearch

    def _given(self, mean_rate: FloatArray, parameters: RatingParameters) -> tuple[RowParameters, tuple[int, ...]]:
        given, shape = super()._given(mean_rate, parameters)
        spreads = (np.broadcast_to(one, shape).reshape(-1, 1) for one in self.model.spreads(parameters))
        return given._replace(own=OwnSpreads(*(np.array(one) for one in spreads))), shape

    def _log_left_out(self, given: RowParameters) -> FloatArray:
        return log_density_left_out(self._fabrics, given) if given.deviating else super()._log_left_out(given)

    def _below_left_out(self, given: RowParameters) -> FloatArray:
        return below_left_out(self._fabrics, given) if given.deviating else super()._below_left_out(given)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: RatingParameters) -> Effects:
        """Draws of all effects given the ratings, by importance resampling about the normal law of all effects."""
        shape = np.broadcast_shapes(mean_rate.shape[:-1], *(np.shape(v) for v in parameters))

        def drawn(rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            given, shape = self._given(rate, parameters)
            return np.concatenate(self._fabrics.draw(rng, given, self._quadrature), axis=-1).reshape(*shape, -1)

        count = self._raters.size
        width = PROPOSALS * self.design.n_rows + self._fabrics.width
        found = in_pieces(drawn, width, mean_rate, parameters)
        people = self.design.n_participants
        effects = self.model.draw_effects(rng, parameters, shape, people, self.design.n_fabrics)
        exponent, noise = self.model.spreads(parameters)
        own = [effects.participant, effects.log_gamma, effects.log_varsigma]
        for k, (one, spread) in enumerate(zip(own, (np.ones(()), exponent, noise), strict=True)):
            one[..., self._raters] = spread[..., None] * found[..., 1 + k * count : 1 + (k + 1) * count]
        return OwnEffects(found[..., 0], own[0], found[..., 1 + 3 * count :], *own[1:])

    def residual(self, mean_rate: FloatArray, parameters: RatingParameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating as a normal score times the typical spread, shape (..., rows)."""
        design = self.design
        expected = self.model.expected_log(design, self.drive(mean_rate, parameters), effects)
        spread = self.model.error_sd(parameters)[..., None]
        own = spread * np.exp(effects.log_varsigma[..., design.participant])
        rows = self._rows_at(parameters).take(self._back)
        return spread * score_at(self.model.law, rows, self._shares, expected, own, parameters)
