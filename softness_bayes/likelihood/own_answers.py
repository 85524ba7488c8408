"""Magnitude estimates of raters with individual exponents and noise, integrated for each rater (model.md 9).

Given mu and the parameters, raters are independent. Each rater's exponent and noise are integrated by adaptive
quadrature about their mode (`answer_nodes`), the rater's scale in closed form, and mu on nodes common to all raters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from softness_bayes.likelihood.answer_draws import POINTS, draw_own
from softness_bayes.likelihood.answer_nodes import (
    MOST_ROUNDS,
    AnswerModes,
    AnswerSpreads,
    MuNodes,
    RaterStatistics,
    Terms,
    at_mu,
    expanded,
    find_modes,
    mu_nodes,
    over_mu,
    own_nodes,
    terms_at,
)
from softness_bayes.likelihood.contract import Effects
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.own_effects import OWN_ANSWERS, OwnRaters
from softness_bayes.likelihood.pieces import in_pieces
from softness_bayes.likelihood.rater_sums import RaterSums
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.stated import Stated

FloatArray = NDArray[np.float64]


class AnswerNodes(NamedTuple):
    """Numbers of nodes of the integrals."""

    one: int
    """Nodes of a rater's exponent or noise, if only one of them differs."""
    both: int
    """Nodes of each of them, if both differ."""
    mu: int
    """Nodes of mu; 0 for evenly spaced nodes, which are needed with few raters."""

    def finer(self) -> AnswerNodes:
        """Return twice as many nodes; the change in the result measures the error."""
        return AnswerNodes(2 * self.one + 1, 2 * self.both + 1, self.mu and 2 * self.mu + 1)


FAST, FEW = AnswerNodes(11, 9, 7), AnswerNodes(15, 11, 0)
"""Nodes for typical tables, and for tables with few raters or few ratings per rater."""

FEW_RATERS, FEW_ROWS = 8, 8
"""Number of raters, and mean number of ratings per rater, below which `FEW` is used instead of `FAST`."""


@dataclass(frozen=True)
class OwnAnswersModel(OwnRaters, RatingModel):
    """A `RatingModel` without deviations of fabrics, in which raters have individual exponents or noise.

    Parameters
    ----------
    differ
        The quantities that differ: gamma, varsigma or both.
    """

    needs: ClassVar[tuple[str, ...]] = ("gamma", "tau", "varsigma", "eps", *OWN_ANSWERS.values())
    differ: tuple[str, ...] = ("gamma",)

    def take(self, values: Mapping[str, ArrayLike]) -> RatingParameters:
        """Return the model's parameters from values by name; fabrics have no deviations."""
        return super().take({**values, "omega": 0.0})

    def draw_effects(
        self,
        rng: np.random.Generator,
        parameters: RatingParameters,
        shape: tuple[int, ...],
        n_participants: int,
        n_fabrics: int,
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Effects of new raters of batch ``shape``; no random numbers are drawn for fabrics, whose deviations are 0."""
        effects = super().draw_effects(rng, parameters, shape, n_participants, 0, levels)
        return effects._replace(fabric=np.zeros((*shape, n_fabrics)))

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Effects by their names in files, each with its axes after the batch axes; none of fabrics."""
        named = super().named_effects(effects)
        return {name: value for name, value in named.items() if name != "fabric_effect"}

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> OwnAnswers:
        """Return the likelihood of these ratings under this model."""
        return OwnAnswers(ratings, design, self)


class _LeftOut(NamedTuple):
    """Law of each row given all others, with nodes placed for its rater without the row."""

    mu: FloatArray  # nodes, (nodes of mu, points)
    joint: FloatArray  # log density of mu and of all rows there
    others: FloatArray  # log density of mu and of the other raters' rows, (nodes of mu, points, rows)
    terms: Terms  # of the rater's other rows, (nodes, points, rows)
    gap: FloatArray  # log rating minus the rater's drive, likewise
    variance: FloatArray  # of the noise
    between: FloatArray  # tau²
    shape: tuple[int, ...]  # of the batch

    def weight_at(self, k: int) -> FloatArray:
        """Return the log weights of the rater's nodes at node k of mu."""
        terms = self.terms
        return self.others[k] + terms.log_term - 0.5 * terms.precision * (terms.gap - self.mu[k][:, None]) ** 2

    def score_at(self, k: int) -> FloatArray:
        """Return the standard normal score of each row given the rater's nodes at node k of mu."""
        # the scale is shrunk towards the mean of the other rows
        shrunk = self.between * self.terms.precision
        sd = np.sqrt(self.variance + self.between * (1.0 - shrunk))
        mu = self.mu[k][:, None]
        return (self.gap - mu - shrunk * (self.terms.gap - mu)) / sd


class OwnAnswers(LogRatings):
    """Positive ratings under an `OwnAnswersModel`; mu, raters' scales, exponents and noise are integrated out.

    Parameters and errors are those of `LogRatings`; default `nodes` depend on the numbers of raters and ratings.
    """

    model: OwnAnswersModel

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: RatingModel,
        over: Design | None = None,
        nodes: AnswerNodes | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)
        self._asked = nodes
        self._own = RaterSums.of(design, self._log - math.log(self.model.centre))
        raters = self._own.rows.size
        few = raters < FEW_RATERS or design.n_rows < FEW_ROWS * raters
        self._nodes = nodes or (FEW if few else FAST)
        self._shares = self._own.shares

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self._over, self._asked)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows.

        The joint density factorises as p(y) = p(others) p(rows | others).
        """
        return type(self)(self.values[~rows], self.design.without(rows), self.model, self._over, self._asked)

    def finer(self) -> Self:
        """Return the same likelihood with twice as many nodes."""
        return type(self)(self.values, self.design, self.model, self._over, self._nodes.finer())

    def log_likelihood(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings together, shape (...); arguments as for `LogRatings.log_likelihood`."""

        def whole(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            sums, spreads, shape = self._given(mean_rate, parameters)
            if self._nodes.mu:
                modes = find_modes(sums, spreads, self.model.spread)
                found = over_mu(*expanded(sums, spreads, modes, self._counts), self.model.spread, self._nodes.mu)
            else:
                _, nodes, raters = self._joint(sums, spreads)
                found = log_sum(nodes.log_weight + raters.sum(axis=-1), axis=0)
            return (found - self._log.sum()).reshape(*shape, 1)

        return in_pieces(whole, self._count * self._own.rows.size, mean_rate, parameters)[..., 0]

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of each participant's ratings given those of all others, shape (draws, participants)."""

        def alone(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            sums, spreads, shape = self._given(mean_rate, parameters)
            _, nodes, raters = self._joint(sums, spreads)
            joint = nodes.log_weight + raters.sum(axis=-1)
            found = np.zeros((len(joint[0]), self.design.n_participants))
            rest = log_sum(joint[..., None] - raters, axis=0)
            found[:, self._own.participant] = log_sum(joint, axis=0)[:, None] - rest
            found -= np.bincount(self.design.participant, self._log, self.design.n_participants)
            return found.reshape(*shape, -1)

        return in_pieces(alone, self._count * self._own.rows.size, mean_rate, parameters)

    def log_likelihood_loo(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of each rating given all the others, shape (..., rows)."""

        def alone(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            left = self._left_out(mean_rate, parameters)
            # each sum has its own nodes, because an outlying rating shifts the nodes of its rater
            rest = log_sum(np.array([log_sum(left.weight_at(k), axis=0) for k in range(len(left.mu))]), axis=0)
            return (log_sum(left.joint, axis=0)[:, None] - rest - self._log).reshape(*left.shape, -1)

        return in_pieces(alone, self._loo_width, mean_rate, parameters)

    def below_loo(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Probability of a smaller rating than the observed one given all the others, shape (..., rows)."""

        def below(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            left = self._left_out(mean_rate, parameters)
            total, share = [], []
            for k in range(len(left.mu)):
                weight = left.weight_at(k)
                largest = weight.max(axis=0)
                weight = np.exp(weight - largest)
                total.append(largest + np.log(weight.sum(axis=0)))
                share.append((weight * ndtr(left.score_at(k))).sum(axis=0) / weight.sum(axis=0))
            weight = np.exp(np.array(total) - np.max(total, axis=0))
            found = (weight * np.array(share)).sum(axis=0) / weight.sum(axis=0)
            return np.asarray(found).reshape(*left.shape, -1)

        return in_pieces(below, self._loo_width, mean_rate, parameters)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: RatingParameters) -> Effects:
        """Draws of mu, raters' exponents, noise and scales given the ratings, one for each point of the batch.

        Exponents and noise are drawn given a node of mu; mu and the scales are then drawn exactly given these.
        """

        def drawn(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            sums, spreads, shape = self._given(mean_rate, parameters)
            modes, nodes, raters = self._joint(sums, spreads)
            found = draw_own(rng, sums, spreads, modes, nodes, raters, self._counts, self.model.spread)
            return np.concatenate(found, axis=-1).reshape(*shape, -1)

        count, people = self._own.rows.size, self.design.n_participants
        shape = np.broadcast_shapes(mean_rate.shape[:-1], *(np.shape(v) for v in parameters))
        found = in_pieces(drawn, POINTS * max(self._counts) * count, mean_rate, parameters)
        effects = self.model.draw_effects(rng, parameters, shape, people, self.design.n_fabrics)
        for k, each in enumerate((effects.participant, effects.log_gamma, effects.log_varsigma)):
            each[..., self._own.participant] = found[..., 1 + k * count : 1 + (k + 1) * count]
        return effects._replace(mu=found[..., 0] + math.log(self.model.centre))

    def residual(self, mean_rate: FloatArray, parameters: RatingParameters, effects: Effects) -> FloatArray:
        """Return each log rating's residual given the effects, divided by its rater's relative noise."""
        expected = self.model.expected_log(self.design, self.drive(mean_rate, parameters), effects)
        errors = (self._log - expected) * np.exp(-effects.log_varsigma[..., self.design.participant])
        return self.model.error.normal_scores(errors, parameters)

    @property
    def _counts(self) -> tuple[int, int]:
        """Numbers of nodes for exponents and noise."""
        each = self._nodes.both if len(self.model.differ) > 1 else self._nodes.one
        return each if "gamma" in self.model.differ else 1, each if "varsigma" in self.model.differ else 1

    @property
    def _count(self) -> int:
        return self._counts[0] * self._counts[1]

    @property
    def _loo_width(self) -> int:
        return 2 * self.design.n_rows * self._count

    def _given(
        self, mean_rate: FloatArray, parameters: RatingParameters
    ) -> tuple[RaterStatistics, AnswerSpreads, tuple[int, ...]]:
        """Return the raters' sums and the spreads, with the batch flattened to one axis, and the batch shape."""
        drive = self.drive(mean_rate, parameters)
        named = (parameters.tau, parameters.varsigma, *self.model.spreads(parameters))
        shape = np.broadcast_shapes(drive.shape[:-1], *(np.shape(v) for v in named))
        drive = np.broadcast_to(drive, (*shape, drive.shape[-1])).reshape(-1, drive.shape[-1])
        spreads = AnswerSpreads(*(np.broadcast_to(np.asarray(v, float), shape).reshape(-1, 1) for v in named))
        mean = drive @ self._shares.T
        squares = np.maximum((drive * drive) @ self._own.cells.T - self._own.rows * mean**2, 0.0)
        sums = RaterStatistics(
            self._own.rows, self._own.means, self._own.squares, mean, squares, drive @ self._own.sums.T
        )
        return sums, spreads, shape

    def _terms(self, sums: RaterStatistics, spreads: AnswerSpreads, modes: AnswerModes) -> Terms:
        return terms_at(sums, spreads, *own_nodes(modes, *self._counts))

    def _joint(self, sums: RaterStatistics, spreads: AnswerSpreads) -> tuple[AnswerModes, MuNodes, FloatArray]:
        """Return the modes, nodes of mu, and each rater's log density there, (nodes, points, raters)."""
        modes = find_modes(sums, spreads, self.model.spread, MOST_ROUNDS)
        nodes = mu_nodes(modes, self.model.spread, self._own.rows.size)
        return modes, nodes, at_mu(self._terms(sums, spreads, modes), nodes.mu)

    def _left_out(self, mean_rate: FloatArray, parameters: RatingParameters) -> _LeftOut:
        """Return the law of each row given all others."""
        sums, spreads, shape = self._given(mean_rate, parameters)
        modes, nodes, raters = self._joint(sums, spreads)
        joint = nodes.log_weight + raters.sum(axis=-1)
        drive = self.drive(mean_rate, parameters)[..., self.design.condition]
        drive = np.broadcast_to(drive, (*shape, drive.shape[-1])).reshape(-1, drive.shape[-1])
        rest = self._without_each(sums, drive)
        own = find_modes(rest, spreads, self.model.spread, MOST_ROUNDS, modes.mu)
        terms = self._terms(rest, spreads, own)
        others = joint[..., None] - raters[..., self._own.of_row]
        gap = self._own.means[self._own.of_row] + self._own.deviation - np.exp(spreads.exponent * terms.u) * drive
        variance = np.square(spreads.noise * np.exp(spreads.noises * terms.w))
        return _LeftOut(nodes.mu, joint, others, terms, gap, variance, spreads.scale**2, shape)

    def _without_each(self, sums: RaterStatistics, drive: FloatArray) -> RaterStatistics:
        """Return, for every row, the sums of its rater without that row."""
        own = self._own.of_row
        rows: FloatArray = self._own.rows[own]
        left = np.maximum(rows - 1.0, 1.0)
        about = drive - sums.drive[:, own]
        alone, part = rows == 1, rows / left
        squares: FloatArray = np.where(
            alone, 0.0, np.maximum(self._own.squares[own] - part * self._own.deviation**2, 0.0)
        )
        return RaterStatistics(
            rows - 1.0,
            np.where(alone, 0.0, self._own.means[own] - self._own.deviation / left),
            squares,
            np.where(alone, 0.0, sums.drive[:, own] - about / left),
            np.where(alone, 0.0, np.maximum(sums.drive_squares[:, own] - part * about**2, 0.0)),
            np.where(alone, 0.0, sums.products[:, own] - part * about * self._own.deviation),
        )
