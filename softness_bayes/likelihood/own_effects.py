"""Raters with exponents and noise of their own: their effects, and what a model of ratings adds for them (model.md 9).

gamma_p = gamma exp(tau_gamma u_p) and varsigma_p = varsigma exp(tau_varsigma w_p), u and w standard normal. gamma and
varsigma are those of the typical (median) rater. A rater's exponent multiplies the drive and fabrics' deviations: both
belong to what is felt, which the rater's numbers exaggerate or compress.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.contract import Effects
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.ratings import RatingParameters

FloatArray = NDArray[np.float64]

OWN_ANSWERS: Mapping[str, str] = MappingProxyType({"gamma": "tau_gamma", "varsigma": "tau_varsigma"})
"""Name of the parameter for the spread between raters, by the quantity that differs."""

EFFECT_OF_ANSWER: Mapping[str, str] = MappingProxyType({"gamma": "rater_log_gamma", "varsigma": "rater_log_varsigma"})
"""Names in files of raters' log deviations from the typical rater, by the quantity that differs."""


class OwnEffects(NamedTuple):
    """Values of the common mean and of the raters' and fabrics' effects."""

    mu: FloatArray
    """Shape (...)."""
    participant: FloatArray
    """Deviations of log ratings, shape (..., participants)."""
    fabric: FloatArray
    """Fabrics' deviations, shape (..., fabrics); 0 in models without them."""
    log_gamma: FloatArray
    """Deviations of log exponents from the typical rater's, shape (..., participants); 0 if exponents do not differ."""
    log_varsigma: FloatArray
    """Deviations of the log noise, likewise."""


class OwnRaters:
    """The part of a model of ratings that concerns raters with exponents or noise of their own, for inheritance."""

    differ: tuple[str, ...]
    scale: Any
    error: Any

    def spreads(self, parameters: RatingParameters) -> tuple[FloatArray, FloatArray]:
        """Return the spreads of log exponents and log noise, (...); 0 for a quantity that does not differ."""
        exponent = parameters.tau_gamma if "gamma" in self.differ else 0.0
        noise = parameters.tau_varsigma if "varsigma" in self.differ else 0.0
        return np.asarray(exponent, float), np.asarray(noise, float)

    def draw_effects(
        self,
        rng: np.random.Generator,
        parameters: RatingParameters,
        shape: tuple[int, ...],
        n_participants: int,
        n_fabrics: int,
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Effects of new raters and fabrics of batch ``shape``; mu from its prior unless given."""
        parent: Any = super()
        effects = parent.draw_effects(rng, parameters, shape, n_participants, n_fabrics, levels)
        return OwnEffects(*effects[:3], *self._answers(rng, parameters, effects.participant.shape))

    def with_new_participants(
        self, rng: np.random.Generator, parameters: RatingParameters, effects: Effects
    ) -> Effects:
        """Replace all raters' effects with those of new raters."""
        parent: Any = super()
        new = parent.with_new_participants(rng, parameters, effects)
        return OwnEffects(*new[:3], *self._answers(rng, parameters, new.participant.shape))

    def _answers(
        self, rng: np.random.Generator, parameters: RatingParameters, shape: tuple[int, ...]
    ) -> list[FloatArray]:
        return [spread[..., None] * rng.standard_normal(shape) for spread in self.spreads(parameters)]

    def draw_attentive(
        self,
        rng: np.random.Generator,
        design: Design,
        drive: FloatArray,
        parameters: RatingParameters,
        effects: Effects,
    ) -> FloatArray:
        """Equivalent of `draw_ratings` without lapses and rounding."""
        me: Any = self
        expected = self.expected_log(design, drive, effects)
        noise = me.error.draw(rng, expected.shape, parameters) * np.exp(effects.log_varsigma[..., design.participant])
        return np.asarray(me.scale.natural(expected + me.error_sd(parameters)[..., None] * noise))

    def expected_log(self, design: Design, drive: FloatArray, effects: Effects) -> FloatArray:
        """Return the expected log rating of every row given the effects, shape (..., rows)."""
        felt = (drive + effects.fabric[..., design.fabric])[..., design.condition]
        own = np.exp(effects.log_gamma)[..., design.participant] * felt
        return np.asarray(effects.mu[..., None] + effects.participant[..., design.participant] + own)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Effects by their names in files, each with its axes after the batch axes."""
        parent: Any = super()
        values = {"gamma": effects.log_gamma, "varsigma": effects.log_varsigma}
        own = {EFFECT_OF_ANSWER[name]: (values[name], ("participant",)) for name in OWN_ANSWERS if name in self.differ}
        return {**parent.named_effects(effects), **own}
