"""Ratings as people give them: on grids of numbers, with zeros and outliers, by raters who may differ (model.md 9).

The latent log rating is that of `magnitude`; a rating has the probability of the interval it represents. Errors
are normal, Student's t, or normal with lapses. Raters may differ in exponents and noise: with standard normal u_p and
w_p, gamma_p = gamma exp(tau_gamma u_p) and varsigma_p = varsigma exp(tau_varsigma w_p), where gamma and varsigma are
those of the typical (median) rater. A rater's exponent multiplies the drive and fabrics' deviations: both belong to
what is felt, which the rater's numbers exaggerate or compress. `quadrature` integrates over all effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.contract import (
    RATER_EFFECTS,
    RATER_SPREADS,
    Effects,
    Levels,
    Parameters,
    RatingsLikelihood,
    RowsLeftOut,
    Shape,
)
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray, Stated
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw, Lapses, RaterRange, WholeScale
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.pieces import over_draws
from softness_bayes.likelihood.quadrature import Integrals
from softness_bayes.likelihood.rater_effects import Given, NormalTable, Table
from softness_bayes.likelihood.row_laws import RowLaw, Rows
from softness_bayes.likelihood.scales import CATEGORIES, SLIDER, Scale

_LEAST_SPREAD = 1e-8
_SEED = 0  # seed of the random shares of intervals at which residuals are taken


@dataclass(frozen=True)
class IntervalModel(RatingModel):
    """A `RatingModel` for ratings that represent intervals, for other error laws, and for raters who differ.

    Parameters
    ----------
    law
        Law of the errors of log ratings.
    differ
        The quantities in which raters differ: gamma, varsigma, both or none. If any, there are two further effects,
        `log_gamma` and `log_varsigma`: deviations of log exponents and log noise from the typical rater's, each
        (..., participants).
    """

    law: ErrorLaw = NORMAL
    differ: tuple[str, ...] = ()
    end: ClassVar[float] = np.inf
    """Upper end of the scale."""
    beyond: ClassVar[float] = 3.0
    """Width taken for an interval without an end where the search for the mode starts [spreads of the errors]."""

    @property
    def error(self) -> ErrorLaw:  # type: ignore[override]
        """The law of the errors."""
        return self.law

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's parameters."""
        return (*RatingModel.needs, *self.law.needs, *(RATER_SPREADS.values() if self.differ else ()))

    def rater_spreads(self, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
        """Return the spreads of log exponents and log noise, (...); 0 for a quantity that does not differ."""
        exponent = parameters.tau_gamma if "gamma" in self.differ else 0.0
        noise = parameters.tau_varsigma if "varsigma" in self.differ else 0.0
        return np.asarray(exponent, float), np.asarray(noise, float)

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new raters and fabrics of batch ``shape``; mu from its prior unless in `levels`."""
        effects = super().draw_effects(rng, parameters, shape, people, fabrics, levels)
        if not self.differ:
            return effects
        spreads = zip(("log_gamma", "log_varsigma"), self.rater_spreads(parameters), strict=True)
        own = {name: spread[..., None] * rng.standard_normal((*shape, people)) for name, spread in spreads}
        return effects.replace(**own)

    def felt(self, design: Design, drive: FloatArray, effects: Effects) -> FloatArray:
        """Return the contribution of the response and of the fabric to every row, shape (..., rows)."""
        felt = super().felt(design, drive, effects)
        return np.exp(effects.log_gamma)[..., design.participant] * felt if self.differ else felt

    def error_spread(self, design: Design, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the spread of every row's error, shape (..., 1), or (..., rows) if raters differ."""
        typical = super().error_spread(design, parameters, effects)
        return typical * np.exp(effects.log_varsigma[..., design.participant]) if self.differ else typical

    def draw_ratings(
        self,
        rng: Generator,
        design: Design,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        stated: Stated | None = None,
    ) -> FloatArray:
        """Return one number for every row of a design, shape (..., rows), on the grid of `stated`, if given.

        A share `lapse` of them are lapses, whose range is that of the intervals, or of the numbers themselves.
        """
        numbers = super().draw_ratings(rng, design, drive, parameters, effects)
        if self.law.lapses:
            low, high = (numbers, numbers) if stated is None else stated.ends(stated.rounded(numbers))
            elsewhere = self.lapses(low, high, design).draw(rng, numbers.shape, self.scale)
            lapsed = rng.random(numbers.shape) < np.asarray(parameters.lapse, float)[..., None]
            numbers = np.where(lapsed, elsewhere, numbers)
        return numbers if stated is None else stated.rounded(numbers)

    def lapses(self, low: FloatArray, high: FloatArray, design: Design) -> Lapses:
        """Return the distribution of lapses of raters whose numbers represent these intervals, each (..., rows)."""
        return RaterRange.of(low, high, design, self.scale)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return effects by their names in files, each with its axes after the batch axes."""
        values = {"gamma": "log_gamma", "varsigma": "log_varsigma"}
        own = {RATER_EFFECTS[name]: (getattr(effects, values[name]), ("participant",)) for name in self.differ}
        return {**super().named_effects(effects), **own}

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> IntervalRatings:
        """Return the likelihood of these ratings: exact numbers, unless `stated` gives their intervals."""
        return IntervalRatings(ratings, design, self, stated=stated)


@dataclass(frozen=True)
class SliderModel(IntervalModel):
    """An `IntervalModel` of slider positions: log odds replace log ratings, and the ends have probability mass.

    mu ~ N(0, spread²), with half the spread of magnitude estimates' levels.
    """

    scale: ClassVar[Scale] = SLIDER
    end: ClassVar[float] = 1.0
    centre: float = 1.0
    spread: float = 1.5

    def lapses(self, low: FloatArray, high: FloatArray, design: Design) -> Lapses:
        """Return the distribution of lapses, over the whole slider."""
        return WholeScale(self.end)


class IntervalRatings(RatingsLikelihood):
    """Ratings under an `IntervalModel`, with the level and all effects of raters and fabrics integrated out.

    A rating that represents an interval contributes a probability; an exact rating contributes a density [1/unit].
    Densities are those of the reference (`quadrature`), but for the likelihood that the sampler uses.

    Parameters
    ----------
    ratings
        y of every row of the design, shape (rows,): `Stated.values`.
    design
        Participant, fabric and load of every row.
    model
        The rating model.
    over
        Design over whose rows the response is centred; by default `design`.
    stated
        Intervals that the ratings represent; by default they are exact.
    lapses
        Distribution of lapses; by default that of raters with these ratings.

    Raises
    ------
    InputError
        If a rating is not a positive finite number, or their number is not that of the design's rows.
    """

    model: IntervalModel

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: IntervalModel = IntervalModel(),
        over: Design | None = None,
        stated: Stated | None = None,
        lapses: Lapses | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)
        scale = model.scale
        self._stated = self._understood(stated)
        low, high = self._stated.ends(self.values)
        self._exact = low == high
        self._lapses = lapses or model.lapses(low, high, design)
        with np.errstate(divide="ignore"):
            lapse = self._lapses.log_probability(low, high, scale)
            every = Rows(scale.additive(low), scale.additive(high), lapse)
        # rows of the table are the different answers of each rater, sorted by rater
        answer = _numbers_of(design.condition, self.values, low, high, np.where(lapse > -np.inf, lapse, 0.0))
        self._place = _numbers_of(design.participant, answer)
        self._first, times = np.unique(self._place, return_index=True, return_counts=True)[1:]
        self._rows = every.take(self._first)
        self._condition = design.condition[self._first]
        self._raters, rater = np.unique(design.participant[self._first], return_inverse=True)
        latent, level = scale.additive(self.values), model.level
        trust = np.ones(latent.size) if model.law == NORMAL else _trust(latent, design.participant, design.condition)
        fabric, trust, answer = design.fabric[self._condition], trust[self._first], answer[self._first]
        how = model.law, rater, fabric, design.n_fabrics, level.mean, level.sd, trust, model.beyond, times, answer
        by_sums = model.law == NORMAL and self._exact.all()
        self._table = NormalTable(*how, values=latent[self._first]) if by_sums else Table(*how)
        self._integrals = Integrals(self._table)
        self._density = self._integrals.log_density
        self._slope = np.where(self._exact, scale.log_slope(self.values), 0.0)
        self._log = float(self._slope.sum())

    def _understood(self, stated: Stated | None) -> Stated:
        """Return the intervals of the ratings."""
        zero, end = np.zeros(self.design.n_rows), self.model.end
        return stated or Stated(self.values, zero, zero, zero + end, end)

    def _arguments(self, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return further arguments of the constructor; lapses of some rows are those of all, of new values others."""
        if rows is None:
            return {"stated": self._stated}
        return {"stated": self._stated.take(rows), "lapses": self._lapses.take(rows)}

    @property
    def ends(self) -> tuple[FloatArray, FloatArray] | None:
        """Ends of the ratings' intervals, each (rows,); None if the ratings are exact numbers."""
        return None if self._exact.all() else self._stated.ends(self.values)

    @property
    def discrete(self) -> NDArray[np.bool_]:
        """True for ratings that represent an interval, shape (rows,)."""
        return ~self._exact

    def for_sampling(self) -> Self:
        """Return the likelihood of which the density of all ratings is by Laplace's method."""
        by_laplace = copy(self)
        by_laplace._density = self._integrals.laplace
        return by_laplace

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all ratings together, shape (...); arguments as in `Likelihood`."""
        given, shape = self._given(mean_rate, parameters)
        return self._density(given).reshape(shape) - self._log

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each rating given all the others at its observation, arrays of shape (..., rows).

        Half the probability of an equal rating counts as below. Lapses are left out of that.
        """
        given, shape = self._given(mean_rate, parameters)
        density, below = (part[:, self._place].reshape(*shape, -1) for part in self._integrals.of_rows(given))
        return RowsLeftOut(density - self._slope, below)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all ratings of each participant given all others', shape (..., participants)."""
        given, shape = self._given(mean_rate, parameters)
        found = np.zeros((*shape, self.design.n_participants))
        found[..., self._raters] = self._integrals.of_raters(given).reshape(*shape, -1)
        return found - np.bincount(self.design.participant, self._slope, self.design.n_participants)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return draws of all effects given the ratings, one for each point of the batch."""
        given, shape = self._given(mean_rate, parameters)
        mu, drawn, fabric = self._integrals.draw(rng, given)
        effects = self.new_effects(rng, parameters, shape)
        found = {"mu": mu.reshape(shape)}
        if given.omega is not None:
            found["fabric"] = (given.omega * fabric).reshape(effects.fabric.shape)
        every = {"participant": given.tau, "log_gamma": given.tau_gamma, "log_varsigma": given.tau_varsigma}
        present = ((name, spread) for name, spread in every.items() if spread is not None)
        for k, (name, spread) in enumerate(present):
            own = np.array(getattr(effects, name))  # of participants without ratings, those of new ones
            own[..., self._raters] = (spread * drawn[..., k]).reshape(*shape, -1)
            found[name] = own
        return effects.replace(**found)

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return one rating for every row, shape (..., rows), on its rater's grid."""
        return self.model.draw_ratings(rng, self.design, drive, parameters, effects, self._stated)

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating as a normal score times the typical spread, shape (..., rows).

        An interval's residual is taken at a random share of its probability, drawn once per row.
        """
        model, design = self.model, self.design
        expected = model.expected_log(design, self.drive(mean_rate, parameters), effects)
        rows, spread = self._rows_at(parameters).take(self._place), model.error_spread(design, parameters, effects)
        typical = model.error_sd(parameters)[..., None]
        return typical * RowLaw(model.law, rows, expected, spread, parameters).scores(self._shares)

    @cached_property
    def _shares(self) -> FloatArray:
        return np.random.default_rng(_SEED).uniform(size=self.design.n_rows)

    def _given(self, mean_rate: FloatArray, parameters: Parameters) -> tuple[Given, tuple[int, ...]]:
        """Return everything but the effects for a flat batch, and the batch shape."""
        drive = self.drive(mean_rate, parameters)
        shape = parameters.batch_shape(drive.shape[:-1])

        def column(value: ArrayLike) -> FloatArray:
            return over_draws(value, shape)[:, None]

        def present(value: ArrayLike) -> FloatArray | None:
            return column(value) if (np.asarray(value) > 0.0).any() else None

        def flat(values: FloatArray) -> FloatArray:
            return np.broadcast_to(values, (*shape, values.shape[-1])).reshape(-1, values.shape[-1])

        spread = np.maximum(column(parameters.varsigma), _LEAST_SPREAD)
        law = Parameters(**{name: over_draws(getattr(parameters, name), shape) for name in self.model.law.needs})
        rows = Rows(*(part if part.ndim == 1 else flat(part) for part in self._rows_at(parameters)))
        more = (present(value) for value in (*self.model.rater_spreads(parameters), parameters.omega))
        given = Given(flat(drive).take(self._condition, axis=1), rows, spread, column(parameters.tau), law, *more)
        if isinstance(self._table, NormalTable):
            given = self._table.with_moments(given)
        return given, shape

    def _rows_at(self, parameters: Parameters) -> Rows:
        """Return the intervals of the different ratings; in this class independent of the parameters."""
        return self._rows


def _numbers_of(*columns: NDArray[Any]) -> IndexArray:
    """Return numbers of rows, shape (rows,): equal rows have the same, without gaps, in ascending order of columns."""
    found: IndexArray = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].ravel()
    return found


def _trust(values: FloatArray, rater: IndexArray, condition: IndexArray) -> FloatArray:
    """Return weights of rows that fall with their distance from the medians of their raters and conditions."""
    left = values.copy()
    for _ in range(2):
        for index in (rater, condition):
            order = np.argsort(index, kind="stable")
            parts = np.split(order, np.flatnonzero(np.diff(index[order])) + 1)
            for part in parts:
                left[part] -= np.median(left[part])
    scale = 1.5 * np.median(np.abs(left))
    return np.ones(values.size) if not scale > 0 else 1.0 / (1.0 + (left / scale) ** 2 / 12.0)


@dataclass(frozen=True)
class CategoryModel(IntervalModel):
    """An `IntervalModel` for ratings that are category numbers, from 1.

    The first category ends at 0; each further one except the last has the width of its `gap`; mu ~ N(0, spread²). The
    upper ends of all categories but the last are among the effects, as `threshold` (..., categories - 1).

    Parameters
    ----------
    categories
        Number of categories.
    """

    scale: ClassVar[Scale] = CATEGORIES
    centre: float = 1.0
    beyond: ClassVar[float] = 30.0  # expectations lie farther beyond the last threshold than beyond a zero
    categories: int = 7

    @property
    def gaps(self) -> tuple[str, ...]:
        """Names of the parameters for the widths of categories."""
        return tuple(f"gap_{k}" for k in range(2, self.categories))

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's parameters."""
        return (*super().needs, *self.gaps)

    def thresholds(self, parameters: Parameters) -> FloatArray:
        """Return the upper thresholds of all categories except the last, shape (..., categories - 1)."""
        shape = parameters.batch_shape()
        gaps = [np.broadcast_to(np.asarray(getattr(parameters, name), float), shape) for name in self.gaps]
        return np.cumsum(np.stack([np.zeros(shape), *gaps], axis=-1), axis=-1)

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the category chosen by a typical participant (s = 0) for a response term ``drive``, shape (..., k)."""
        return _category(effects.mu[..., None] + drive, effects.threshold)

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new participants, of batch ``shape``; mu from its prior unless in `levels`."""
        drawn = super().draw_effects(rng, parameters, shape, people, fabrics, levels)
        found = self.thresholds(parameters)
        return drawn.replace(threshold=np.broadcast_to(found, (*shape, found.shape[-1])))

    def draw_ratings(
        self,
        rng: Generator,
        design: Design,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        stated: Stated | None = None,
    ) -> FloatArray:
        """Return one category for every row of a design, shape (..., rows)."""
        latent = RatingModel.draw_ratings(self, rng, design, drive, parameters, effects)
        found = _category(latent, effects.threshold)
        if not self.law.lapses:
            return found
        lapsed = rng.random(found.shape) < np.asarray(parameters.lapse, float)[..., None]
        return np.where(lapsed, rng.integers(1, self.categories + 1, found.shape), found)

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> CategoryRatings:
        """Return the likelihood of these categories."""
        return CategoryRatings(ratings, design, self)


class CategoryRatings(IntervalRatings):
    """Categories under a `CategoryModel`, mu and raters' scales integrated out; arguments as for `IntervalRatings`.

    Raises
    ------
    InputError
        If a rating is not the number of a category, or their number is not that of the design's rows.
    """

    model: CategoryModel

    def _understood(self, stated: Stated | None) -> Stated:
        wrong = ~np.isin(self.values, np.arange(1, self.model.categories + 1))
        if wrong.any():
            raise InputError(
                f"ratings: {wrong.sum()} of {wrong.size} are not categories from 1 to {self.model.categories}, the "
                f"first is {self.values[wrong][0]}"
            )
        # a step of 1, so that no rating counts as exact; the thresholds follow from the parameters
        step = np.ones(wrong.size)
        return Stated(self.values, step, 0.5 * step, np.inf * step)

    @property
    def ends(self) -> tuple[FloatArray, FloatArray] | None:
        """None, because the thresholds of categories are sampled."""
        return None

    def _rows_at(self, parameters: Parameters) -> Rows:
        ends = self.model.thresholds(parameters)
        shape = (*ends.shape[:-1], 1)
        ends = np.concatenate([np.full(shape, -np.inf), ends, np.full(shape, np.inf)], axis=-1)
        category = self.values[self._first].astype(np.intp)
        lapse = np.full(category.size, -np.log(self.model.categories))
        return Rows(ends[..., category - 1], ends[..., category], lapse)


def _category(latent: FloatArray, threshold: FloatArray) -> FloatArray:
    """Return the category of latent values (..., k) for thresholds (..., categories - 1)."""
    return 1.0 + (latent[..., None] > threshold[..., None, :]).sum(axis=-1)
