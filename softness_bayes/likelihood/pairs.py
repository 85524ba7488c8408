"""Paired comparisons: choice of the softer of two touches, by a probit of their difference (model.md 9).

A pair is a list of two places, so that tables, checks and files are those of `orders`. The noise is normal, and a share
of the answers may be guesses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr

from softness_bayes.errors import InputError
from softness_bayes.likelihood.comparison_information import Comparisons, pair_information
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.orders import LEAST_SPREAD, OrderModel, OrderRatings
from softness_bayes.likelihood.places import index_within
from softness_bayes.likelihood.scales import PAIRS, Scale
from softness_bayes.likelihood.stated import Stated

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
        told = np.asarray(ndtr(apart))
        if parameters is None or not self.law.lapses:
            return told
        guess = self.guesses(parameters)[..., None]
        return (1.0 - guess) * told + 0.5 * guess

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
        # a tie carries no information
        self._told = self._places.filled.all(axis=1) & (self._places.group[:, -1] > 0)

    def log_likelihood_loo(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log probability of each touch's place given the other touch, that of the pair, shape (..., rows)."""
        return self._by_list(mean_rate, parameters)[..., self._of_row]

    def below_loo(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Probability of a lower place than each touch's, plus half that of the observed place, shape (..., rows)."""
        own = np.exp(self.log_likelihood_loo(mean_rate, parameters))
        return np.where(self._upper, 1.0 - 0.5 * own, 0.5 * own)

    def _latent(self, rng: np.random.Generator, drive: FloatArray, parameters: Parameters) -> FloatArray:
        """Return simulated latent values whose order is the answer, shape (..., rows); a guess is a random order."""
        latent = super()._latent(rng, drive, parameters)
        guessed = rng.random((*latent.shape[:-1], len(self._list))) < self.model.guesses(parameters)[..., None]
        return np.where(guessed[..., self._of_row], rng.standard_normal(latent.shape), latent)

    def _place_among_earlier(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the distribution function of each touch's place given the touch taken before it, shape (..., rows).

        The first touch of a pair has nothing to be compared with; its value is a fixed random number.
        """
        own = np.exp(self.log_likelihood_loo(mean_rate, parameters))
        share = np.where(self._upper, 1.0 - own + self._shares * own, self._shares * own)
        return np.where(self._second, share, self._shares)

    def _by_list(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of each pair's answer, shape (..., pairs); 0 for ties."""
        worth = self._worth(mean_rate, parameters)
        if self._places.width < 2:
            return np.zeros(worth.shape[:-1])
        found = log_ndtr(worth[..., 0] - worth[..., 1])
        guess: Any = self.model.guesses(parameters)[..., None]
        if self.model.law.lapses:
            with np.errstate(divide="ignore"):
                found = np.logaddexp(np.log1p(-guess) + found, np.log(0.5 * guess))
        return np.where(self._told, found, 0.0)

    @cached_property
    def _upper(self) -> NDArray[np.bool_]:
        """True for the row with the higher place of each pair, shape (rows,); False for ties."""
        found = np.zeros(self.design.n_rows, bool)
        found[self._places.row[self._told, 0]] = True
        return found

    @cached_property
    def _second(self) -> NDArray[np.bool_]:
        """True for the row taken as the second of each pair, shape (rows,); False for ties."""
        pair, later = self._places.row[self._told], np.zeros(self.design.n_rows, bool)
        turn = self._turn[pair]
        later[pair[np.arange(len(pair)), turn.argmax(axis=1)]] = True
        return later


def _successive(design: Design) -> IndexArray:
    """Return list indices that pair successive rows of each participant, shape (rows,)."""
    return design.participant * design.n_rows + index_within(design.participant) // 2
