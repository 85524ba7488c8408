"""Magnitude estimates: a log-linear model of the response with participants' own rating scales (model.md 9)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.special import ndtr

from softness_bayes.base.laws import LOG_TWO_PI, Normal, Prior
from softness_bayes.likelihood.contract import (
    Effects,
    Levels,
    Parameters,
    RatingsLikelihood,
    RatingsModel,
    RowsLeftOut,
    Shape,
)
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray, Stated
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.normal_rows import EffectLaw, NormalRows
from softness_bayes.likelihood.scales import MAGNITUDE, RISES, RatingDirection, Scale


@dataclass(frozen=True)
class RatingModel(RatingsModel):
    """log y = mu + s_participant ± gamma (x - mean x over the rows) + f_fabric + e, x = log(N/N_ref + eps).

    s ~ N(0, tau²), f ~ N(0, omega²), e ~ N(0, varsigma²), mu ~ N(log centre, spread²). N/N_ref is the pad's
    mean rate [Hz], the total rate over the number of receptors. The effects are mu (...), s as `participant`
    (..., participants), and f as `fabric` (..., fabrics), 0 in models without it.

    Parameters
    ----------
    direction
        The sign of gamma.
    centre, spread
        Prior median of exp(mu), and prior standard deviation of mu.
    """

    scale: ClassVar[Scale] = MAGNITUDE
    error: ClassVar[ErrorLaw] = NORMAL
    needs: ClassVar[tuple[str, ...]] = ("gamma", "tau", "varsigma", "omega", "eps")
    direction: RatingDirection = RISES
    centre: float = 20.0
    spread: float = 3.0

    @property
    def level(self) -> Normal:
        """The prior of mu."""
        return Normal(math.log(self.centre), self.spread)

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of a log rating about its expectation for the participant, shape (...)."""
        return np.asarray(parameters.varsigma, float)

    def drive_at(
        self, elsewhere: FloatArray, design: Design, mean_rate: FloatArray, parameters: Parameters
    ) -> FloatArray:
        """Return ± gamma (x - mean x) at mean rates [Hz], shape (..., k), x being centred over the design's rows."""
        eps = np.asarray(parameters.eps, float)[..., None]
        logs = np.log(elsewhere + eps)
        stated = mean_rate[..., : design.n_conditions]
        of_rows = logs[..., : design.n_conditions] if elsewhere is mean_rate else np.log(stated + eps)
        gamma = np.asarray(parameters.gamma, float)[..., None]
        return self.direction.sign * gamma * (logs - (of_rows @ design.weight)[..., None])

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new participants and fabrics of batch ``shape``; mu from its prior unless in `levels`."""
        tau, omega = (np.asarray(value, float)[..., None] for value in (parameters.tau, parameters.omega))
        participant, fabric = (rng.standard_normal((*shape, size)) for size in (people, fabrics))
        return Effects(mu=self.draw_level(rng, shape, levels), participant=tau * participant, fabric=omega * fabric)

    def draw_level(self, rng: Generator, shape: Shape, levels: Levels) -> FloatArray:
        """Return values of mu of batch ``shape``, from its prior unless among `levels`."""
        mu = (levels or {}).get("mu")
        if mu is None:
            mu = math.log(self.centre) + self.spread * rng.standard_normal(shape)
        return np.broadcast_to(np.asarray(mu, float), shape)

    def expected_log(self, design: Design, drive: FloatArray, effects: Effects) -> FloatArray:
        """Return the expected log rating of every row given the effects, shape (..., rows)."""
        own = effects.mu[..., None] + effects.participant[..., design.participant]
        return np.asarray(own + self.felt(design, drive, effects))

    def felt(self, design: Design, drive: FloatArray, effects: Effects) -> FloatArray:
        """Return the contribution of the response and of the fabric to every row, shape (..., rows)."""
        stated = drive[..., : design.n_conditions]
        return np.asarray((stated + effects.fabric[..., design.fabric])[..., design.condition])

    def error_spread(self, design: Design, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the spread of every row's error, shape (..., 1), or (..., rows) if raters differ."""
        return self.error_sd(parameters)[..., None]

    def draw_ratings(
        self, rng: Generator, design: Design, drive: FloatArray, parameters: Parameters, effects: Effects
    ) -> FloatArray:
        """Return one rating for every row of a design, shape (..., rows), without lapses and rounding."""
        expected = self.expected_log(design, drive, effects)
        noise = self.error.draw(rng, expected.shape, parameters)
        return self.scale.natural(expected + self.error_spread(design, parameters, effects) * noise)

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the median rating of a typical participant (s = 0) for a response term ``drive``, shape (..., k)."""
        return self.scale.natural(effects.mu[..., None] + drive)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return effects by their names in files, each with its axes after the batch axes."""
        return {
            "mu": (effects.mu, ()),
            "participant_effect": (effects.participant, ("participant",)),
            "fabric_effect": (effects.fabric, ("fabric",)),
        }

    @property
    def levels(self) -> Mapping[str, Prior]:
        """The priors, by name, of quantities shared by all ratings and drawn after a run."""
        return {"mu": self.level}

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> RatingsLikelihood:
        """Return the likelihood of these ratings under this model."""
        return LogRatings(ratings, design, self)


class LogRatings(RatingsLikelihood):
    """Positive ratings under a `RatingModel`, with mu, participants and fabrics integrated out.

    All densities are of the ratings as in the file, not of their logarithms (the Jacobian adds -log y for each).

    Parameters
    ----------
    ratings
        y of every row of the design, shape (rows,).
    design
        Condition and participant of every row.
    model
        The rating model.
    over
        Design over whose rows the response is centred; by default `design`.

    Raises
    ------
    InputError
        If a rating is not a positive finite number, or their number is not that of the design's rows.
    """

    def __init__(
        self, ratings: ArrayLike, design: Design, model: RatingModel = RatingModel(), over: Design | None = None
    ) -> None:
        super().__init__(ratings, design, model, over)
        self._log = self.model.scale.additive(self.values)
        self._jacobian = -float(self._log.sum())

    @cached_property
    def _rows(self) -> NormalRows:
        return NormalRows(self.design, self._log, self.model.level.mean)

    def _law(self, drive: FloatArray, parameters: Parameters) -> EffectLaw:
        """Return the normal law of the log ratings."""
        variance = self.model.error_sd(parameters)[..., None] ** 2
        shared = self._shared(self.design.fabric, parameters, np.empty((self.design.n_conditions, 0)))
        return EffectLaw.of(drive, variance, parameters.tau, *shared)

    def _at(self, mean_rate: FloatArray, parameters: Parameters) -> EffectLaw:
        return self._law(self.drive(mean_rate, parameters), parameters)

    def _shared(self, fabric: IndexArray, parameters: Parameters, loads: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return weights and standard deviations of shared effects: the level, fabrics if they deviate, and loads.

        `fabric` is the fabric of each condition of `_rows`; the weights of loads, whose standard deviation is 1, have
        the shape (..., conditions, loads).
        """
        omega = np.asarray(parameters.omega, float)[..., None]
        fabrics = self.design.n_fabrics if (omega > 0).any() else 0
        own = np.hstack([np.ones((fabric.size, 1)), np.eye(self.design.n_fabrics)[fabric, :fabrics]])
        weights = np.concatenate([np.broadcast_to(own, (*loads.shape[:-1], 1 + fabrics)), loads], axis=-1)
        sd = np.ones((*omega.shape[:-1], weights.shape[-1]))
        sd[..., 0], sd[..., 1 : 1 + fabrics] = self.model.spread, omega
        return weights, sd

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all ratings together, shape (...)."""
        return self._rows.log_density(self._at(mean_rate, parameters)) + self._jacobian

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each rating given all the others at its observation, arrays of shape (..., rows)."""
        mean, sd = self._rows.leave_one_out(self._at(mean_rate, parameters))
        score = (self._log - mean) / sd
        return RowsLeftOut(-0.5 * score**2 - np.log(sd) - 0.5 * LOG_TWO_PI - self._log, ndtr(score))

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each participant's ratings given all others', shape (..., participants)."""
        density = self._rows.without_participants(self._at(mean_rate, parameters)).log_density
        return density - np.bincount(self.design.participant, self._log, self.design.n_participants)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of mu, participants and fabrics given the ratings, one for each point of the batch."""
        return self._drawn(rng, self._at(mean_rate, parameters), parameters)[0]

    def _drawn(self, rng: Generator, law: EffectLaw, parameters: Parameters) -> tuple[Effects, FloatArray]:
        """Return draws of the effects under a law, and those of further shared effects."""
        u, participant = self._rows.draw(rng, law)
        mu, others = self.model.level.mean + self.model.spread * u[..., 0], u[..., 1:]
        omega, size = np.asarray(parameters.omega, float)[..., None], self.design.n_fabrics
        fabric = np.zeros((*mu.shape, size))
        if (omega > 0).any():
            fabric, others = omega * others[..., :size], others[..., size:]
        return Effects(mu=mu, participant=participant, fabric=fabric), others

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating given the effects, shape (..., rows)."""
        expected = self.model.expected_log(self.design, self.drive(mean_rate, parameters), effects)
        return self._log - expected
