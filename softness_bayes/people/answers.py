"""Answers as functions of free means: single ratings, pairs, and orders of lists.

An answer depends on a vector of effects: the mean of each condition (additive scale of the ratings), then the scale of
each rater. `FreeMeans` needs the log probability of all answers with its derivatives in the effects, and that of each
answer given the others, at many points at once: effects (points, effects) with parameters of shape (points,).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from scipy.special import expit, logsumexp, ndtr

from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import LAPSES, ErrorLaw
from softness_bayes.likelihood.intervals import IntervalModel, SliderModel
from softness_bayes.likelihood.lists import RankedLists
from softness_bayes.likelihood.row_laws import RowLaw, Rows
from softness_bayes.likelihood.scales import AGGREGATED, CATEGORIES, PAIRS, RANKS, SLIDER, Scale
from softness_bayes.model.options import ModelOptions

if TYPE_CHECKING:
    from softness_bayes.model.interpretation import Interpretation

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

NODES = 21
"""Gauss-Hermite nodes over the expectation of an answer that is left out."""

TINY = 1e-12
"""Smallest variance of an answer's expectation, that of a pair of touches with a common mean."""

STEP = 1e-3
"""Step of the differences that give derivatives of the probability of an order."""

WIDE = 5.0
"""Prior standard deviation of free means: in spreads of the ratings, or in units of the noise of comparisons."""

LEAST_SPREAD = 0.2
"""Smallest spread of the ratings of which the means have five times as much."""

ROUNDS, TRIES = 16, 16
"""Largest number of times that a mean is drawn again, and number of values each time."""

ORDER_DRAWS = 400
"""Draws of the effects for the probability of orders that are left out."""

UNKNOWN = 1e-6
"""Standard error that stands for one that the table does not show."""


class Terms(NamedTuple):
    """Log probability of all answers (points,), and its derivatives in the effects."""

    value: Array
    slope: Array
    """First derivatives, shape (points, effects)."""
    bend: Array
    """Minus the second derivatives, shape (points, effects, effects)."""


@dataclass(frozen=True)
class SingleAnswers:
    """Answers that depend on one sum of effects each: ratings, and answers to pairs.

    Parameters
    ----------
    design
        Weight of each effect in each answer, shape (answers, effects).
    rows
        The answers' intervals; of categories, their numbers as `low`.
    scale, law
        Scale of the ratings and law of their errors.
    conditions, raters
        Number of means, which are the first effects, and of raters' scales.
    needs
        Names of the parameters of the observation model.
    centre, wide
        Prior mean and standard deviation of the means.
    spread
        Known spread of each error, shape (answers,), if it is not a parameter.
    jacobian
        Added to the log density of each answer, shape (answers,), so that it is one per unit of the ratings.
    categories
        Number of categories; 0 on other scales.
    ends
        Ends of a slider, in the file.
    met
        Weight of each condition among those compared with another one, shape (conditions, conditions); for pairs.
    """

    design: csr_array
    rows: Rows
    scale: Scale
    law: ErrorLaw
    conditions: int
    raters: int
    needs: tuple[str, ...]
    centre: float
    wide: float
    jacobian: Array
    spread: Array | None = None
    categories: int = 0
    ends: tuple[float, float] = (0.0, 1.0)
    met: Array = field(default_factory=lambda: np.zeros((0, 0)))
    winner: IntArray | None = None
    """1 for answers that a comparison is softer than its reference, 0 for the opposite, 2 for pairs without one, shape
    (answers,), if there is a guess rate."""

    def _law(self, given: Mapping[str, Array]) -> tuple[Rows, Array, Parameters]:
        """Return intervals, spread and the error law's parameters."""
        spread = given["varsigma"][:, None] if self.spread is None else self.spread[None]
        if self.winner is not None:
            # guesses at different rates for two answers are lapses that give one of them more often
            floors = np.stack([0.5 * given["lapse"] if "lapse" in given else 0.0 * given["guess"], given["guess"]], -1)
            total = np.maximum(floors.sum(axis=-1), TINY)
            shares = np.column_stack([floors / total[:, None], np.full(total.shape, 0.5)])
            with np.errstate(divide="ignore"):
                rows = self.rows._replace(lapse=np.log(shares[:, self.winner]))
            return rows, spread, Parameters(lapse=total)
        if not self.categories:
            return self.rows, spread, Parameters(**given)
        inner, of = self._thresholds(given), self.rows.low.astype(int)
        ends = np.pad(inner, ((0, 0), (1, 1)), constant_values=(-np.inf, np.inf))
        return Rows(ends[:, of - 1], ends[:, of], self.rows.lapse), spread, Parameters(**given)

    def _thresholds(self, given: Mapping[str, Array]) -> Array:
        """Return the thresholds between categories, the first of which is 0, shape (points, categories - 1)."""
        gaps = [given[f"gap_{k}"] for k in range(2, self.categories)]
        return np.cumsum([np.zeros_like(given["varsigma"]), *gaps], axis=0).T

    @cached_property
    def _products(self) -> csr_array:
        """Products of the weights of each two effects in each answer, shape (effects², answers)."""
        turned = self.design.T.tocsr()
        return vstack([turned.multiply(turned[[k]]) for k in range(turned.shape[0])], format="csr")

    def terms(self, effects: Array, given: Mapping[str, Array]) -> Terms:
        """Return the log probability of all answers and its derivatives."""
        rows, spread, law = self._law(given)
        found = RowLaw(self.law, rows, (self.design @ effects.T).T, spread, law).terms()
        bend = (self._products @ -found.of_mean2.T).T.reshape(*effects.shape, -1)
        return Terms(found.value.sum(axis=-1), (self.design.T @ found.of_mean.T).T, bend)

    def left_out(self, effects: Array, covariance: Array, given: Mapping[str, Array]) -> Array:
        """Return the log density of each answer given all others, from the normal law of the effects given all.

        The law of an answer's expectation loses the answer's own part: with the variance v given all answers, and the
        slope g and the bend w of the answer's log density, it has the variance 1 / (1/v - w), and its mean is lower by
        this variance times g (Vehtari et al., JMLR 17, 103, 2016).
        """
        rows, spread, law = self._law(given)
        expected = (self.design @ effects.T).T
        variance = np.maximum((self._products.T @ covariance.reshape(len(effects), -1).T).T, TINY)
        found = RowLaw(self.law, rows, expected, spread, law).terms()
        others = 1.0 / np.maximum(1.0 / variance + found.of_mean2, 0.02 / variance)
        middle, sd = expected - others * found.of_mean, np.sqrt(others)
        at, weight = np.polynomial.hermite_e.hermegauss(NODES)
        density = [RowLaw(self.law, rows, middle + sd * x, spread, law).log_probability() for x in at]
        return np.asarray(logsumexp(density, axis=0, b=(weight / weight.sum())[:, None, None]) + self.jacobian)

    @cached_property
    def unanimous(self) -> IntArray:
        """Conditions all of whose ratings are one category, or open on one and the same side; none for pairs."""
        if self.scale == PAIRS:
            return np.zeros(0, np.intp)
        low, high = self.rows[:2]
        same = [low == k + 1 for k in range(self.categories)] or [low == -np.inf, high == np.inf]
        own = (self.design[:, : self.conditions] != 0).astype(int)
        return np.flatnonzero(np.any([own.T @ side == own.sum(axis=0) for side in same], axis=0))

    def redraw(self, rng: np.random.Generator, effects: Array, condition: int, given: Mapping[str, Array]) -> Array:
        """Return draws of the mean of one condition given all other effects (draws, effects), shape (draws,).

        Values drawn from the prior are kept with the probability of the answers: the law of a mean that is open to one
        side, or equally probable between two thresholds, is not normal. Where none is kept, as where raters contradict
        each other, the given effect stays. Parameters are those of one point, shape (1,).
        """
        mine = np.flatnonzero(self.design[:, [condition]].toarray().ravel())
        rows, spread, law = self._law(given)
        rows, own = rows.take(mine), spread if spread.shape[-1] == 1 else spread[:, mine]
        others = effects @ self.design[mine].T.toarray() - effects[:, [condition]]
        found, left = effects[:, condition].copy(), np.arange(len(effects))
        for _ in range(ROUNDS):
            if not left.size:
                break
            mean = self.centre + self.wide * rng.standard_normal((left.size, TRIES))
            expected = (others[left, None] + mean[..., None]).reshape(-1, mine.size)
            density = RowLaw(self.law, rows, expected, own, law).log_probability().sum(axis=-1)
            fits = np.log(rng.random(mean.shape)) <= density.reshape(mean.shape)
            kept = fits.any(axis=1)
            found[left[kept]], left = mean[kept, fits[kept].argmax(axis=1)], left[~kept]
        return found

    def natural(self, means: Array, given: Mapping[str, Array]) -> Array:
        """Return means (draws, conditions) as ratings, expected categories or shares won, for parameters (draws,)."""
        if self.scale == PAIRS:
            return _share_below(means, self.met, ndtr)
        if self.categories:
            below = (means[..., None] - self._thresholds(given)[:, None]) / given["varsigma"][:, None, None]
            return np.asarray(1.0 + ndtr(below).sum(axis=-1))
        low, high = self.ends
        return np.asarray(low + (high - low) * self.scale.natural(means))


@dataclass(frozen=True)
class Orders:
    """Orders of lists, under the Plackett-Luce model; means are log worths.

    Parameters
    ----------
    lists
        The places, by list.
    condition
        Condition of every slot of the lists, shape (lists, slots).
    owner
        Participant of each list, whose lists together are one answer, shape (lists,).
    conditions
        Number of conditions.
    met
        As for `SingleAnswers`.
    """

    lists: RankedLists
    condition: IntArray
    owner: IntArray
    conditions: int
    met: Array
    raters: int = 0
    needs: tuple[str, ...] = ()
    centre: float = 0.0
    wide: float = WIDE

    def _value(self, worth: Array) -> Array:
        return np.asarray(self.lists.log_factors(worth).sum(axis=-1))

    def terms(self, effects: Array, given: Mapping[str, Array]) -> Terms:
        """Return log probability and derivatives, by central differences in the slots of all lists at once."""
        worth, width = effects[:, self.condition], self.lists.width
        shift, middle = STEP * np.eye(width), self._value(worth)
        up, down = (np.stack([self._value(worth + sign * one) for one in shift], axis=-1) for sign in (1.0, -1.0))
        bend = np.zeros((*middle.shape, width, width))
        for k, j in zip(*np.tril_indices(width), strict=True):
            both = self._value(worth + shift[k] + shift[j]) + self._value(worth - shift[k] - shift[j])
            apart = (up + down)[..., k] + (up + down)[..., j] - both - 2.0 * middle
            bend[..., k, j] = bend[..., j, k] = apart / (2.0 * STEP**2)
        of = ((self.condition[..., None] == np.arange(self.conditions)) & self.lists.filled[..., None]).astype(float)
        slope = np.einsum("plk,lkc->pc", (up - down) / (2.0 * STEP), of)
        return Terms(middle.sum(axis=-1), slope, np.einsum("plkj,lkc,ljd->pcd", bend, of, of, optimize=True))

    def left_out(self, effects: Array, covariance: Array, given: Mapping[str, Array]) -> Array:
        """Return the log probability of each participant's lists given all others, from draws of the effects."""
        rng, of = np.random.default_rng(0), self.owner[:, None] == np.unique(self.owner)
        drawn = [
            rng.multivariate_normal(*law, ORDER_DRAWS, method="cholesky")
            for law in zip(effects, covariance, strict=True)
        ]
        by_list = [np.stack([self._value(draw[self.condition]) for draw in one]) for one in drawn]
        return np.stack([left_out_of_draws(one @ of) for one in by_list])

    def natural(self, means: Array, given: Mapping[str, Array]) -> Array:
        """Return means (draws, conditions) as expected shares of a list below each condition."""
        return _share_below(means, self.met, expit)


Answers = SingleAnswers | Orders


def left_out_of_draws(log_density: Array) -> Array:
    """Return the log density of each answer given all others from its density at draws given all, (draws, answers).

    Draws are weighted by one over the density, with truncated weights (Ionides, J. Comp. Graph. Stat. 17, 295, 2008).
    """
    log_n = np.log(len(log_density))
    ceiling = logsumexp(-log_density, axis=0) - 0.5 * log_n
    return np.asarray(log_n - logsumexp(np.minimum(-log_density, ceiling), axis=0))


def _share_below(means: Array, met: Array, chance: np.ufunc) -> Array:
    """Return the mean probability of a higher place than the conditions met, shape (draws, conditions)."""
    found = np.full(means.shape, 0.5)
    for c, weight in enumerate(met):
        if weight.any():
            found[:, c] = chance(means[:, [c]] - means) @ (weight / weight.sum())
    return found


def answers_of(ratings: Ratings, meaning: Interpretation, options: ModelOptions, condition: IntArray) -> Answers:
    """Return the answers of a table.

    Parameters
    ----------
    ratings, meaning, options
        The table, the interpretation of its numbers, and the options with the scale and its ends.
    condition
        Index of each rating's condition, shape (n,).
    """
    scale, law, intervals, count = options.scale, meaning.law, meaning.intervals, int(condition.max()) + 1
    if scale in (RANKS, PAIRS):
        return _of_lists(ratings, meaning, scale, condition, count)
    people, categories, none = len(ratings.participants), meaning.categories, np.zeros(len(ratings))
    own = scale.own_units and people > 1 and scale != AGGREGATED
    needs, spread = (*(["tau"] if own else []), "varsigma", *law.needs), None
    low, high = (intervals.values,) * 2 if intervals.exact else intervals.ends(intervals.values)
    with np.errstate(divide="ignore"):
        rows = Rows(scale.additive(low), scale.additive(high), none - np.inf)
    if scale == CATEGORIES:
        rows = Rows(ratings.rating, ratings.rating, none - np.log(categories))
        needs = (*needs, *(f"gap_{k}" for k in range(2, categories)))
    elif law.lapses:
        design = Design(condition, ratings.participant, np.arange(count), people)
        model = SliderModel(law=law) if scale == SLIDER else IntervalModel(law=law)
        rows = rows._replace(lapse=model.lapses(low, high, design).log_probability(low, high, scale))
    if scale == AGGREGATED:
        needs, spread = (), _error_of_means(ratings)
    columns = [condition, *([count + ratings.participant] if own else [])]
    at = np.tile(np.arange(len(ratings)), len(columns)), np.concatenate(columns)
    middle = scale.additive(intervals.values)
    return SingleAnswers(
        csr_array((np.ones(at[0].size), at), shape=(len(ratings), count + own * people)),
        rows,
        scale,
        law,
        count,
        people if own else 0,
        needs,
        float(np.mean(middle)),
        WIDE * max(float(np.std(middle)), LEAST_SPREAD),
        none if scale == CATEGORIES else np.where(low == high, -scale.log_slope(intervals.values), 0.0),
        spread,
        categories,
        options.slider_ends,
    )


def _error_of_means(ratings: Ratings) -> Array:
    """Return the standard error of each geometric mean from the spread of its raters; `UNKNOWN` if no spread is given.

    The spread contains that of the raters' scales, which all means share, so that differences are known better.
    """
    assert ratings.cells is not None
    if ratings.cells.geometric_sd is None:
        return np.full(len(ratings), UNKNOWN)
    known = np.log(ratings.cells.geometric_sd)
    return np.where(np.isnan(known), np.nanmedian(known), known) / np.sqrt(ratings.cells.raters)


def _of_lists(ratings: Ratings, meaning: Interpretation, scale: Scale, condition: IntArray, count: int) -> Answers:
    """Return the answers of places in lists: of pairs that are no ties, or of whole lists."""
    lists = np.unique(ratings.own_lists, return_inverse=True)[1]
    places = RankedLists.of(ratings.rating, lists)
    of = condition[places.row]
    met = np.zeros((count, count))
    for row, there in zip(of, places.filled, strict=True):
        own = row[there]
        np.add.at(met, (own[:, None], own), (1.0 - np.eye(own.size)) / max(own.size - 1, 1))
    if scale == RANKS:
        owner = np.zeros(lists.max() + 1, np.intp)
        owner[lists] = ratings.participant
        return Orders(places, of, owner, count, met)
    told, law, needs, winner = told_pairs(ratings), meaning.law, meaning.law.needs, None
    if meaning.intervals.reference is not None:
        sides = meaning.intervals.reference[told]
        winner = np.where(sides.any(axis=1), sides[:, 1], 2)
        law, needs = LAPSES, ("guess", *needs)
    pairs = condition[told]
    at = np.tile(np.arange(len(pairs)), 2), pairs.T.ravel()
    weights = csr_array((np.repeat([1.0, -1.0], len(pairs)), at), shape=(len(pairs), count))
    none = np.zeros(len(pairs))
    rows = Rows(none, none + np.inf, none + np.log(0.5))
    return SingleAnswers(
        weights, rows, scale, law, count, 0, needs, 0.0, WIDE, none, none + 1.0, met=met, winner=winner
    )


def told_pairs(ratings: Ratings) -> IntArray:
    """Return the rows of the winner and of the loser of each pair that is no tie, shape (pairs, 2)."""
    lists = np.unique(ratings.own_lists, return_inverse=True)[1]
    order = np.lexsort((-ratings.rating, lists))
    first = np.flatnonzero(np.bincount(lists)[lists[order]] == 2)[::2]
    rows = np.stack([order[first], order[first + 1]], axis=-1) if first.size else np.zeros((0, 2), np.intp)
    return np.asarray(rows[ratings.rating[rows[:, 0]] > ratings.rating[rows[:, 1]]])
