"""Paired comparisons: choice of the softer of two touches, by a probit of their difference (model.md 9).

A pair is a list of two places, so that tables, checks and files are those of `orders`. The noise is normal, and a share
of the answers may be guesses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr

from softness_bayes.errors import InputError
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.information import Comparisons, pair_information
from softness_bayes.likelihood.orders import LEAST_SPREAD, OrderModel, OrderRatings
from softness_bayes.likelihood.places import RankedLists, index_within
from softness_bayes.likelihood.scales import PAIRS, Scale

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


@dataclass(frozen=True)
class PairModel(OrderModel):
    """Latent softness ± gamma x + e of a touch, x = log(N/N_ref + eps), e ~ N(0, varsigma²).

    With lapses, a share of the answers are guesses, correct with probability 1/2.

    Parameters
    ----------
    law
        Law of the answers: normal, or normal with lapses.
    """

    scale: ClassVar[Scale] = PAIRS
    law: ErrorLaw = NORMAL

    @property
    def error(self) -> ErrorLaw:  # type: ignore[override]
        """The law of the answers."""
        return self.law

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's parameters."""
        return ("gamma", "varsigma", "eps", *self.law.needs)

    def noise_of(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of the difference of two touches' noise, shape (...)."""
        return math.sqrt(2.0) * np.maximum(np.asarray(parameters.varsigma, float), LEAST_SPREAD)

    def chance(self, apart: FloatArray, parameters: Parameters | None = None) -> FloatArray:
        """Return the probability that the first of two touches is judged softer, as `OrderModel.chance`."""
        return np.exp(self.log_chance(apart, parameters))

    def log_chance(self, apart: FloatArray, parameters: Parameters | None = None) -> FloatArray:
        """Return the logarithm of `chance`."""
        told = np.asarray(log_ndtr(apart))
        if parameters is None or not self.law.lapses:
            return told
        guess = self.guesses(parameters)[..., None]
        with np.errstate(divide="ignore"):
            return np.asarray(np.logaddexp(np.log1p(-guess) + told, np.log(0.5 * guess)))

    def information(
        self, compared: Comparisons, drive: FloatArray, slopes: FloatArray, guesses: float = 0.0
    ) -> FloatArray:
        """Return the expected information from answers to pairs, shape (d, d), as `OrderModel.information`."""
        return pair_information(compared, drive, slopes, guesses)

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> PairRatings:
        """Return the likelihood of these answers; by default successive rows of a participant form pairs."""
        lists = _successive(design) if stated is None or stated.lists is None else stated.lists
        return PairRatings(ratings, design, self, lists=lists)


class PairRatings(OrderRatings):
    """Answers to pairs of touches under a `PairModel`; arguments as for `OrderRatings`.

    Raises
    ------
    InputError
        If a list holds more than two touches.
    """

    model: PairModel

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: PairModel = PairModel(),
        over: Design | None = None,
        lists: IndexArray | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over, lists)
        if self._places.width > 2:
            raise InputError(f"ratings: a list holds {self._places.width} touches, expected pairs")

    def _latent(self, rng: np.random.Generator, drive: FloatArray, parameters: Parameters) -> FloatArray:
        """Return simulated latent values whose order is the answer, shape (..., rows); a guess is a random order."""
        latent = super()._latent(rng, drive, parameters)
        guessed = rng.random((*latent.shape[:-1], len(self._list))) < self.model.guesses(parameters)[..., None]
        return np.where(guessed[..., self._of_row], rng.standard_normal(latent.shape), latent)

    def _log_factors(self, places: RankedLists, worth: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of each pair's answer in its first slot; 0 for ties, which tell nothing."""
        told = places.present.all(axis=1) & (places.group[:, -1] > 0)
        answers = self.model.log_chance(worth[..., told, 0] - worth[..., told, -1], parameters)
        found = np.zeros((*answers.shape[:-1], *worth.shape[-2:]))
        found[..., told, 0] = answers
        return found

    def _log_chances(
        self, places: RankedLists, worth: FloatArray, slot: int, parameters: Parameters
    ) -> tuple[FloatArray, FloatArray]:
        """Return log probabilities of the places of one slot's touches, left out in `places`, given the others."""
        both = places.among(places.present | (np.arange(places.width) == slot))
        answer = self._log_factors(both, worth, parameters).sum(axis=-1)
        if slot:
            return answer, np.full(answer.shape, -np.inf)
        with np.errstate(divide="ignore"):
            return np.zeros(answer.shape), np.log(-np.expm1(answer))


def _successive(design: Design) -> IndexArray:
    """Return list indices that pair successive rows of each participant, shape (rows,)."""
    return design.participant * design.n_rows + index_within(design.participant) // 2
