"""Standardised ratings: linear regression of z-scores on the response (model.md 9)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtr, owens_t

from softness_bayes.base.laws import LOG_TWO_PI, HalfNormal, Normal, Prior
from softness_bayes.likelihood.contract import (
    Effects,
    Levels,
    Parameters,
    RatingsLikelihood,
    RatingsModel,
    RowsLeftOut,
    Shape,
)
from softness_bayes.likelihood.design import Design, FloatArray, Stated
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.normal_rows import EffectLaw, NormalRows
from softness_bayes.likelihood.pieces import left_out_in_pieces
from softness_bayes.likelihood.scales import RISES, STANDARDISED, RatingDirection, Scale

_CONSTANT = 1e-9  # relative differences of rates below this are rounding errors


@dataclass(frozen=True)
class StandardisedModel(RatingsModel):
    """y = c0 ± c1 x + e, x = N/N_ref standardised over the rows (0 if it does not vary).

    c0 ~ N(0, 1), c1 ~ HalfNormal(1), e ~ N(0, varsigma²). Standardisation removes the participants' scales and
    origins, so that the model has neither participants nor an exponent. The sign is + under
    ``rises-with-firing``, - under ``falls-with-firing``. The effects are c0 and c1, each (...).

    Parameters
    ----------
    direction
        The sign of c1.
    """

    scale: ClassVar[Scale] = STANDARDISED
    error: ClassVar[ErrorLaw] = NORMAL
    needs: ClassVar[tuple[str, ...]] = ("varsigma",)
    direction: RatingDirection = RISES

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of a rating about the line, shape (...)."""
        return np.asarray(parameters.varsigma, float)

    def drive_at(
        self, elsewhere: FloatArray, design: Design, mean_rate: FloatArray, parameters: Parameters
    ) -> FloatArray:
        """Return `drive` at other mean rates [Hz], shape (..., k), standardised over the rows of the design."""
        stated = mean_rate[..., : design.n_conditions]
        centre = (stated @ design.weight)[..., None]
        spread = np.sqrt((stated - centre) ** 2 @ design.weight)[..., None]
        varies = spread > _CONSTANT * centre
        return self.direction.sign * np.where(varies, (elsewhere - centre) / np.where(varies, spread, 1.0), 0.0)

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Prior draws of the line, of batch ``shape``; c0 and c1 in `levels` are used as given."""
        known = {name: np.broadcast_to(np.asarray(value, float), shape) for name, value in (levels or {}).items()}
        drawn = {"c0": rng.standard_normal(shape), "c1": np.abs(rng.standard_normal(shape))}
        return Effects(**{name: known.get(name, value) for name, value in drawn.items()})

    def draw_ratings(
        self, rng: Generator, design: Design, drive: FloatArray, parameters: Parameters, effects: Effects
    ) -> FloatArray:
        """Return one rating for every row of a design, shape (..., rows), given the line and `drive`."""
        expected = self.typical(effects, drive)[..., design.condition]
        noise = self.error.draw(rng, expected.shape, parameters)
        return expected + self.error_sd(parameters)[..., None] * noise

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the expected rating for a response term ``drive``, shape (..., k)."""
        return effects.c0[..., None] + effects.c1[..., None] * drive

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return effects by their names in files, each with its axes after the batch axes."""
        return {"c0": (effects.c0, ()), "c1": (effects.c1, ())}

    @property
    def levels(self) -> Mapping[str, Prior]:
        """The priors, by name, of quantities shared by all ratings and drawn after a run."""
        return {"c0": Normal(0.0, 1.0), "c1": HalfNormal(1.0)}

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> StandardisedRatings:
        """Return the likelihood of these ratings under this model."""
        return StandardisedRatings(ratings, design, self)


class StandardisedRatings(RatingsLikelihood):
    """z-scores under a `StandardisedModel`, with the line integrated out.

    If c1 were normal instead of half-normal, (c0, c1) would be normal given the ratings, with a mean of c1 of
    t standard deviations. The constraint c1 >= 0 multiplies the joint density by 2 Phi(t).

    Parameters
    ----------
    ratings
        y of every row of the design, shape (rows,).
    design
        Condition and participant of every row.
    model
        The rating model.
    over
        Design over whose rows the response is standardised; by default `design`.

    Raises
    ------
    InputError
        If a rating is not finite, or their number is not that of the design's rows.
    """

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: StandardisedModel = StandardisedModel(),
        over: Design | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)

    @cached_property
    def _rows(self) -> NormalRows:
        return NormalRows(self.design, self.values, 0.0)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all ratings together, shape (...); only varsigma is used of the parameters."""
        fit = self._fit(mean_rate, parameters)
        return self._rows.log_density(fit.law) + math.log(2.0) + log_ndtr(fit.deviate)

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each rating given all the others at its observation, arrays of shape (..., rows).

        Given the others, rating and c1 are jointly normal, truncated to positive c1: the density is the normal one for
        c1 of either sign, times Phi(t) / Phi(t without the rating).
        """

        def alone(mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
            fit, row = self._fit(mean_rate, parameters), self.design.condition
            mean, sd = self._rows.leave_one_out(fit.law)
            # rating and c1 given the others: their covariance follows from that given all
            along = (fit.law.shared @ fit.covariance)[..., 1][..., row] * (sd**2 / fit.law.variance)
            score, spread = (self.values - mean) / sd, np.sqrt(fit.covariance[..., 1, 1, None] + (along / sd) ** 2)
            without = (fit.line[..., 1, None] - along * score / sd) / spread
            normal, positive = -0.5 * score**2 - np.log(sd) - 0.5 * LOG_TWO_PI, log_ndtr(without)
            joint = bivariate_below(score, without, -along / (sd * spread))
            density = normal + log_ndtr(fit.deviate)[..., None] - positive
            return RowsLeftOut(density, np.clip(joint * np.exp(-positive), 0.0, 1.0))

        return left_out_in_pieces(alone, self.design.n_rows, mean_rate, parameters)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each participant's ratings given all others', shape (..., participants).

        It is the normal one for c1 of either sign, times Phi(t) / Phi(t without the participant).
        """
        fit = self._fit(mean_rate, parameters)
        given = self._rows.without_participants(fit.law)
        covariance = np.linalg.inv(given.precision)
        without = (fit.line[..., None, 1] + given.moved[..., 1]) / np.sqrt(covariance[..., 1, 1])
        return given.log_density + log_ndtr(fit.deviate)[..., None] - log_ndtr(without)

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return ± x, shape (..., conditions): a slope is in z-scores per standard deviation of the response."""
        return self.drive(mean_rate, parameters)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of the line given the ratings, one for each point of the batch: c1, then c0."""
        from scipy.stats import truncnorm  # imported here because the import takes a third of a second

        fit = self._fit(mean_rate, parameters)
        (a, b), (_, c) = np.moveaxis(fit.covariance, (-2, -1), (0, 1))
        shape, slope = fit.deviate.shape, fit.line[..., 1]
        c1 = truncnorm.rvs(-fit.deviate, np.inf, loc=slope, scale=np.sqrt(c), size=shape, random_state=rng)
        c0 = fit.line[..., 0] + b / c * (c1 - slope) + np.sqrt(a - b**2 / c) * rng.standard_normal(shape)
        return Effects(c0=c0, c1=np.maximum(c1, 0.0))

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each rating, shape (..., rows)."""
        drive = self.drive(mean_rate, parameters)
        return self.values - self.model.typical(effects, drive)[..., self.design.condition]

    def _fit(self, mean_rate: FloatArray, parameters: Parameters) -> _Fit:
        """Return the law of a line whose c1 may have either sign."""
        drive = self.drive(mean_rate, parameters)
        shape = np.broadcast_shapes(drive.shape[:-1], np.shape(parameters.varsigma))
        basis = np.ones((*shape, drive.shape[-1], 2))
        basis[..., 1] = drive
        variance = np.broadcast_to(np.square(parameters.varsigma), shape)[..., None]
        law = EffectLaw.of(np.zeros(drive.shape[-1]), variance, 0.0, basis)
        line, covariance = self._rows.shared(law)
        return _Fit(law, line, covariance, line[..., 1] / np.sqrt(covariance[..., 1, 1]))


class _Fit(NamedTuple):
    """The normal law of the line given the ratings, before truncation to positive c1."""

    law: EffectLaw  # of the ratings, c0 and c1 being shared effects with the weights 1 and ± x
    line: FloatArray  # means of c0 and c1, (..., 2)
    covariance: FloatArray  # (..., 2, 2)
    deviate: FloatArray  # mean of c1 in standard deviations, (...)


def bivariate_below(h: FloatArray, k: FloatArray, correlation: FloatArray) -> FloatArray:
    """Return P(X < h, Y < k) of two standard normal variables by Owen's function (Ann. Math. Stat. 27, 1075, 1956)."""
    root = np.sqrt(np.maximum(1.0 - correlation**2, 1e-300))
    with np.errstate(divide="ignore", invalid="ignore"):
        tails = sum(
            np.where(one == 0.0, 0.25 * np.sign(other), owens_t(one, (other / one - correlation) / root))
            for one, other in ((h, k), (k, h))
        )
    apart = (h * k < 0.0) | ((h * k == 0.0) & (h + k < 0.0))
    return 0.5 * (ndtr(h) + ndtr(k)) - tails - 0.5 * apart
