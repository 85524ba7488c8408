"""Rank orders: places of touches in lists under the Plackett-Luce model, and paired comparisons (model.md 9).

Each touch of a list has a latent softness: its drive plus Gumbel noise. The list is sorted by latent softness.
Participants' scales and origins do not affect the order and are therefore not in the model. The probability of an order
has a closed form, also for a partial order, in which the order of tied touches is unknown.

A pair is a list of two places, of which the softer is chosen by a probit of the difference: the noise is normal, and a
share of the answers may be guesses. Against a reference, guesses may favour one side: a comparison is judged softer
with probability guess + (1 - guess - lapse / 2) Phi(z).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, log_ndtr, ndtri

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior
from softness_bayes.likelihood.contract import Effects, Levels, Parameters, RatingsLikelihood, RowsLeftOut, Shape
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray, Stated
from softness_bayes.likelihood.error_laws import GUMBEL, GUMBEL_SD, NORMAL, ErrorLaw
from softness_bayes.likelihood.lists import (
    Comparisons,
    RankedLists,
    index_within,
    order_information,
    pair_information,
    shares,
)
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.pieces import in_pieces, left_out_in_pieces
from softness_bayes.likelihood.scales import PAIRS, RANKS, Scale

FAR = 1e3
"""Latent softness by which the winner of a guess is ahead."""

LEAST_SPREAD = 1e-8
"""Smallest standard deviation of the noise, in the log."""
_SEED = 0  # seed of the order in which residuals take the touches of a list, and of their randomised scores


@dataclass(frozen=True)
class OrderModel(RatingModel):
    """Latent softness ± gamma x + e of a touch, x = log(N/N_ref + eps), e Gumbel with standard deviation varsigma.

    Orders determine only the ratio of gamma to varsigma; gamma keeps the prior and the meaning that it has for
    magnitude estimates. There are no effects but `noise` (...), `noise_of` the parameters.
    """

    scale: ClassVar[Scale] = RANKS
    error: ClassVar[ErrorLaw] = GUMBEL
    needs: ClassVar[tuple[str, ...]] = ("gamma", "varsigma", "eps")

    def noise_of(self, parameters: Parameters) -> FloatArray:
        """Return the scale of the Gumbel distribution, the unit of the noise, shape (...)."""
        return np.asarray(np.maximum(np.asarray(parameters.varsigma, float), LEAST_SPREAD) / GUMBEL_SD)

    @property
    def levels(self) -> Mapping[str, Prior]:
        """Empty: orders have no common level."""
        return {}

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return the scale of the noise, of batch ``shape``: there are no effects to draw."""
        return Effects(noise=np.broadcast_to(self.noise_of(parameters), shape))

    def draw_ratings(
        self, rng: Generator, design: Design, drive: FloatArray, parameters: Parameters, effects: Effects
    ) -> FloatArray:
        """Return the place of every row in the list of all rows of its participant, shape (..., rows)."""
        return shares(self.draw_latent(rng, design, drive, parameters), design.participant)

    def draw_latent(self, rng: Generator, design: Design, drive: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the latent softness of every row of a design, shape (..., rows)."""
        expected = drive[..., design.condition]
        noise = self.error.draw(rng, expected.shape, parameters)
        return expected + self.error_sd(parameters)[..., None] * noise

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the probability of being placed above a touch with the design's mean drive, shape (..., k)."""
        return self.chance(drive / effects.noise[..., None])

    def chance(self, apart: FloatArray, parameters: Parameters | None = None, side: IndexArray | int = 0) -> FloatArray:
        """Return the probability that the first of two touches is placed above the second.

        Parameters
        ----------
        apart
            Difference of their drives, in units of the noise, shape (..., k).
        parameters
            The model's parameters, for laws with guesses; without them, guesses are ignored.
        side
            1 where the first touch is the comparison of a pair, -1 where it is the reference, 0 where neither is one.
        """
        return np.asarray(expit(apart))

    def guesses(self, parameters: Parameters) -> FloatArray:
        """Return the share of guesses, shape (...) or (); laws without lapses have none."""
        return np.asarray(self.floors(parameters).sum(axis=0))

    def floors(self, parameters: Parameters) -> FloatArray:
        """Return the probability of guesses for a comparison, and for its reference, shape (2, ...)."""
        return np.stack(2 * [0.5 * np.asarray(parameters.lapse if self.error.lapses else 0.0, float)])

    def information(
        self, compared: Comparisons, drive: FloatArray, slopes: FloatArray, guesses: float = 0.0
    ) -> FloatArray:
        """Return the expected information about d parameters, shape (d, d), averaged over simulated orders.

        Parameters
        ----------
        compared
            The lists.
        drive
            Drive of each condition in units of the noise, shape (conditions,).
        slopes
            Its slopes, shape (conditions, d).
        guesses
            From `guesses`.
        """
        return order_information(np.random.default_rng(_SEED), compared, drive, slopes)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return an empty mapping: the model has no effects."""
        return {}

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> OrderRatings:
        """Return the likelihood of these places; by default all rows of a participant form one list."""
        lists = design.participant if stated is None or stated.lists is None else stated.lists
        return OrderRatings(ratings, design, self, lists=lists)


class OrderRatings(RatingsLikelihood):
    """Places in lists under an `OrderModel`.

    Parameters
    ----------
    ratings
        Place of every row of the design, shape (rows,): of two touches in a list, the one rated softer has the larger
        number. Equal numbers are ties, whose order is unknown.
    design
        Rater and condition of each rating.
    model
        The model.
    over
        As for `RatingsLikelihood`.
    lists
        Index of each row's list, shape (rows,); by default all rows of a participant are one list.

    Raises
    ------
    InputError
        If a place is not finite, a list is of several participants, or more than `MOST_TIED` touches share a place.
    """

    most: ClassVar[float] = np.inf
    """Largest number of touches in a list."""

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: OrderModel = OrderModel(),
        over: Design | None = None,
        lists: IndexArray | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)
        self.lists = design.participant if lists is None else np.asarray(lists, np.intp)
        self._list, place = np.unique(self.lists, return_inverse=True)
        self._places = RankedLists.of(self.values, place)
        if self._places.width > self.most:
            raise InputError(f"ratings: a list holds {self._places.width} touches, expected pairs")
        owner = np.zeros(self._list.size, np.intp)
        owner[place] = design.participant
        if (owner[place] != design.participant).any():
            raise InputError("ratings: a list holds places of several participants")
        self._owner, self._of_row = owner, place
        # condition of every slot; an arbitrary one for empty slots
        self._condition = design.condition[self._places.row]
        # side of a touch that is compared with each condition
        self._against = np.zeros(design.n_conditions, np.intp)

    @property
    def discrete(self) -> NDArray[np.bool_]:
        """True for every row: places have probabilities."""
        return np.ones(self.values.size, bool)

    def _arguments(self, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return the lists: without some touches, the others have the distribution of a shorter list."""
        return {"lists": self.lists if rows is None else self.lists[rows]}

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of all orders together, shape (...); arguments as `LogRatings.log_likelihood`."""
        return self._by_list(mean_rate, parameters).sum(axis=-1)

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each touch's place given the order of all others of its list, arrays of shape (..., rows).

        Half the probability of the observed place counts as below it.
        """

        def alone(mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
            worth, slots = self._worth(mean_rate, parameters), range(self._places.width)
            whole = self._log_factors(self._places, worth, parameters).sum(axis=-1)
            density, below = [], []
            for k in slots:
                others = self._places.among(np.array(slots) != k)
                density.append(whole - self._log_factors(others, worth, parameters).sum(axis=-1))
                above, lower = self._log_chances(others, worth, k, parameters)
                below.append(0.5 * (np.exp(above) + np.exp(lower)))
            return RowsLeftOut(*(self._places.by_row(np.stack(part, axis=-1)) for part in (density, below)))

        return left_out_in_pieces(alone, self._width, mean_rate, parameters)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of each participant's orders, which are independent, shape (..., participants)."""
        return self._by_list(mean_rate, parameters) @ self._member

    def log_likelihood_answers(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of the order of each list, shape (..., lists); lists are independent."""
        return in_pieces(self._by_list, self._width, mean_rate, parameters)

    def expected(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the expected share of its list that is placed below each condition, shape (..., conditions)."""
        return in_pieces(self._expected, self.design.n_conditions**2, mean_rate, parameters)

    def _expected(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        drive = self.drive(mean_rate, parameters)
        return np.stack(
            [self._above(drive[..., [c]], drive, parameters, met)[..., 0] for c, met in enumerate(self._met)], axis=-1
        )

    def typical(
        self,
        mean_rate: FloatArray,
        parameters: Parameters,
        effects: Effects,
        drive: FloatArray,
        among: IndexArray | None = None,
    ) -> FloatArray:
        """Return the expected share below touches with these drives, in lists like those of the conditions `among`."""
        field = self.drive(mean_rate, parameters)
        met = self._met[slice(None) if among is None else among].sum(axis=0)
        return self._above(drive, field, parameters, met)

    def _above(self, drive: FloatArray, field: FloatArray, parameters: Parameters, met: FloatArray) -> FloatArray:
        """Return the weighted mean probability of being placed above the conditions, shape (..., k)."""
        noise, total = self.model.noise_of(parameters)[..., None], 0.0
        for other in np.flatnonzero(met):
            apart = (drive - field[..., [other]]) / noise
            total = total + met[other] * self.model.chance(apart, parameters, self._against[other])
        return np.asarray(total / met.sum() if met.any() else np.full(drive.shape, 0.5))

    @cached_property
    def _met(self) -> FloatArray:
        """Weight of each condition among the touches that share a list with another one, (conditions, conditions)."""
        found = np.zeros((self.design.n_conditions,) * 2)
        for row, there in zip(self._places.row, self._places.filled, strict=True):
            own = self.design.condition[row[there]]
            mates = (1.0 - np.eye(own.size)) / max(own.size - 1, 1)
            np.add.at(found, (own[:, None], own), mates)
        return found

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return the scale of the noise: there are no effects to draw."""
        shape = parameters.batch_shape(mean_rate.shape[:-1])
        return self.new_effects(rng, parameters, shape)

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the places of a simulated order of every list, shape (..., rows); ties keep their places."""
        return self._places.reordered(self._latent(rng, drive, parameters), self.values)

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return a normal score times varsigma for each touch, shape (..., rows).

        The touches of a list are taken one by one, in a fixed random order. The score is that of the place among the
        touches taken before, randomised within the probability of that place by a fixed random number, so that all
        scores are independent and normal under the model.
        """

        def place(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
            worth, found = self._worth(mean_rate, parameters), []
            for k in range(self._places.width):
                earlier = self._places.among(self._turn < self._turn[:, [k]])
                above, lower = (np.exp(part) for part in self._log_chances(earlier, worth, k, parameters))
                found.append(lower + self._shares[self._places.row[:, k]] * (above - lower))
            return self._places.by_row(np.stack(found, axis=-1))

        share = np.clip(in_pieces(place, self._width, mean_rate, parameters), 1e-300, 1.0 - 1e-16)
        return np.asarray(self.model.error_sd(parameters)[..., None] * ndtri(share))

    def _by_list(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of each list's order, shape (..., lists)."""
        return self._log_factors(self._places, self._worth(mean_rate, parameters), parameters).sum(axis=-1)

    def _log_factors(self, places: RankedLists, worth: FloatArray, parameters: Parameters) -> FloatArray:
        """Return log probabilities whose sum over slots is that of each list's order, (..., lists, slots)."""
        return places.log_factors(worth)

    def _log_chances(
        self, places: RankedLists, worth: FloatArray, slot: int, parameters: Parameters
    ) -> tuple[FloatArray, FloatArray]:
        """Return log probabilities of places for the touches of one slot, as `RankedLists.log_chances`."""
        return places.log_chances(worth, slot)

    def _latent(self, rng: Generator, drive: FloatArray, parameters: Parameters) -> FloatArray:
        """Return simulated latent values whose order is the answer, shape (..., rows)."""
        return self.model.draw_latent(rng, self.design, drive, parameters)

    @cached_property
    def _member(self) -> FloatArray:
        """1 if a list belongs to a participant, else 0, shape (lists, participants)."""
        return (self._owner[:, None] == np.arange(self.design.n_participants)).astype(float)

    @property
    def _width(self) -> int:
        """Numbers kept in memory for each draw."""
        return self._places.width * self.design.n_rows

    @cached_property
    def _turn(self) -> IndexArray:
        return np.random.default_rng(_SEED).permutation(self.design.n_rows)[self._places.row]

    @cached_property
    def _shares(self) -> FloatArray:
        return np.random.default_rng(_SEED + 1).uniform(size=self.design.n_rows)

    def _worth(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return each slot's drive in units of the noise, shape (..., lists, slots)."""
        return (self.drive(mean_rate, parameters) / self.model.noise_of(parameters)[..., None])[..., self._condition]


@dataclass(frozen=True)
class PairModel(OrderModel):
    """Latent softness ± gamma x + e of a touch, x = log(N/N_ref + eps), e ~ N(0, varsigma²).

    With lapses, a share of the answers are guesses, correct with probability 1/2.

    Parameters
    ----------
    law
        Law of the answers: normal, or normal with lapses.
    guesses_given
        True if the guess rate is a parameter, `guess`, instead of half the lapses.
    """

    scale: ClassVar[Scale] = PAIRS
    law: ErrorLaw = NORMAL
    guesses_given: bool = False

    @property
    def error(self) -> ErrorLaw:  # type: ignore[override]
        """The law of the answers."""
        return self.law

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's parameters."""
        return ("gamma", "varsigma", "eps", *(["guess"] if self.guesses_given else []), *self.law.needs)

    def floors(self, parameters: Parameters) -> FloatArray:
        """Return the probability of guesses for a comparison, and for its reference, shape (2, ...)."""
        lapses = super().floors(parameters)
        if not self.guesses_given:
            return lapses
        return np.stack(np.broadcast_arrays(np.asarray(parameters.guess, float), lapses[1]))

    def noise_of(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of the difference of two touches' noise, shape (...)."""
        return math.sqrt(2.0) * np.maximum(np.asarray(parameters.varsigma, float), LEAST_SPREAD)

    def chance(self, apart: FloatArray, parameters: Parameters | None = None, side: IndexArray | int = 0) -> FloatArray:
        """Return the probability that the first of two touches is judged softer, as `OrderModel.chance`."""
        return np.exp(self.log_chance(apart, parameters, side))

    def log_chance(
        self, apart: FloatArray, parameters: Parameters | None = None, side: IndexArray | int = 0
    ) -> FloatArray:
        """Return the logarithm of `chance`."""
        told = np.asarray(log_ndtr(apart))
        if parameters is None or not (self.law.lapses or self.guesses_given):
            return told
        of_comparison, of_reference = self.floors(parameters)[..., None]
        guessed = of_comparison + of_reference
        floor = np.select([np.equal(side, 1), np.equal(side, -1)], [of_comparison, of_reference], 0.5 * guessed)
        with np.errstate(divide="ignore"):
            return np.asarray(np.logaddexp(np.log1p(-guessed) + told, np.log(floor)))

    def information(
        self, compared: Comparisons, drive: FloatArray, slopes: FloatArray, guesses: float = 0.0
    ) -> FloatArray:
        """Return the expected information from answers to pairs, shape (d, d), as `OrderModel.information`."""
        return pair_information(compared, drive, slopes, guesses)

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> PairRatings:
        """Return the likelihood of these answers; by default successive rows of a participant form pairs."""
        lists = _successive(design) if stated is None or stated.lists is None else stated.lists
        return PairRatings(ratings, design, self, lists=lists, reference=None if stated is None else stated.reference)


class PairRatings(OrderRatings):
    """Answers to pairs of touches under a `PairModel`; arguments as for `OrderRatings`.

    Parameters
    ----------
    reference
        True for references, shape (rows,), one in each pair; None if no side of a pair is preferred by guesses.

    Raises
    ------
    InputError
        If a list holds more than two touches.
    """

    model: PairModel
    most: ClassVar[float] = 2

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: PairModel = PairModel(),
        over: Design | None = None,
        lists: IndexArray | None = None,
        reference: NDArray[np.bool_] | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over, lists)
        self._reference = reference
        self._side = np.zeros(design.n_rows, np.intp)
        if reference is not None:
            both = np.bincount(self._of_row, reference)[self._of_row] > 0
            self._side = np.where(both, np.where(reference, -1, 1), 0)
            self._against[design.condition] = -self._side

    def _arguments(self, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return the lists and the references."""
        own = self._reference if self._reference is None or rows is None else self._reference[rows]
        return super()._arguments(rows) | {"reference": own}

    def _latent(self, rng: Generator, drive: FloatArray, parameters: Parameters) -> FloatArray:
        """Return simulated latent values whose order is the answer, shape (..., rows); a guess is a random order."""
        latent = super()._latent(rng, drive, parameters)
        share = rng.random((*latent.shape[:-1], len(self._list)))
        of_comparison, of_reference = self.model.floors(parameters)[..., None]
        wins = np.where(share < of_comparison, FAR, -FAR)[..., self._of_row] * self._side
        guessed = (share < of_comparison + of_reference)[..., self._of_row]
        return np.where(guessed, wins + rng.standard_normal(latent.shape), latent)

    def _log_factors(self, places: RankedLists, worth: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log probability of each pair's answer in its first slot; 0 for ties, which tell nothing."""
        told = places.present.all(axis=1) & (places.group[:, -1] > 0)
        side = self._side[places.row[told, 0]]
        answers = self.model.log_chance(worth[..., told, 0] - worth[..., told, -1], parameters, side)
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
