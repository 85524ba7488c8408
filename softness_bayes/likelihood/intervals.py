"""Magnitude estimates as people give them: on grids of numbers, with zeros and outliers (model.md 9).

The latent log rating is that of `magnitude`; a rating has the probability of the interval it represents. Errors
are normal, Student's t, or normal with lapses. The level and raters' scales are integrated out by `rater_integrals`,
fabrics' deviations by `fabric_integrals`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.likelihood.dense_integrals import DenseIntegrals
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.fabric_integrals import FabricIntegrals, Rough
from softness_bayes.likelihood.fabric_left_out import below_left_out, log_density_left_out
from softness_bayes.likelihood.group_conditionals import block_log_likelihood
from softness_bayes.likelihood.interval_law import Rows
from softness_bayes.likelihood.lapses import Lapses, RaterRange, WholeScale
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.pieces import batch_shape, in_pieces, is_number, over_draws
from softness_bayes.likelihood.quadrature import DENSE, DENSER, FINE, SAMPLING, Quadrature, finer_than, quadrature_for
from softness_bayes.likelihood.random_effects import Effects
from softness_bayes.likelihood.rater_grids import below_rows, log_of_raters, log_of_rows
from softness_bayes.likelihood.rater_integrals import LEVELS, RaterIntegrals
from softness_bayes.likelihood.rater_rows import LawParameters, RowParameters, robust_weights, times_of
from softness_bayes.likelihood.ratings import RatingParameters, RatingsLikelihood
from softness_bayes.likelihood.row_scores import score_at
from softness_bayes.likelihood.scales import SLIDER, Scale
from softness_bayes.likelihood.stated import Stated
from softness_bayes.likelihood.walled_integrals import WalledIntegrals

FloatArray = NDArray[np.float64]

_OF_DRAWS = "tau", "varsigma", "omega", "nu", "lapse"  # parameters that the integrals use
_LEAST_SPREAD = 1e-8
_SEED = 0  # seed of the random shares of intervals at which residuals are taken


@dataclass(frozen=True)
class IntervalModel(RatingModel):
    """A `RatingModel` for ratings that represent intervals and for other error laws.

    Parameters
    ----------
    law
        Law of the errors of log ratings.
    """

    law: ErrorLaw = NORMAL
    end: ClassVar[float] = np.inf
    """Upper end of the scale."""

    @property
    def error(self) -> ErrorLaw:  # type: ignore[override]
        """The law of the errors."""
        return self.law

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's parameters."""
        return (*RatingModel.needs, *self.law.needs)

    def take(self, values: Mapping[str, ArrayLike]) -> RatingParameters:
        """Return the model's parameters from values by name; without omega, fabrics have no deviations."""
        return super().take({"omega": 0.0, **values})

    def draw_ratings(
        self,
        rng: np.random.Generator,
        design: Design,
        drive: FloatArray,
        parameters: RatingParameters,
        effects: Effects,
    ) -> FloatArray:
        """One number for every row of a design, shape (..., rows), before rounding to a grid."""
        numbers = super().draw_ratings(rng, design, drive, parameters, effects)
        return self.with_lapses(rng, numbers, design, parameters)

    def with_lapses(
        self,
        rng: np.random.Generator,
        numbers: FloatArray,
        design: Design,
        parameters: RatingParameters,
        stated: Stated | None = None,
    ) -> FloatArray:
        """Return numbers (..., rows), a share `lapse` of them replaced by lapses.

        Their range is that of the intervals of `stated`, by default of the numbers themselves.
        """
        if not self.law.lapses:
            return numbers
        low, high = (numbers, numbers) if stated is None else stated.ends(stated.rounded(numbers))
        share = np.asarray(parameters.lapse, float)[..., None]
        elsewhere = self.lapses(low, high, design).draw(rng, numbers.shape, self.scale)
        return np.where(rng.random(numbers.shape) < share, elsewhere, numbers)

    def lapses(self, low: FloatArray, high: FloatArray, design: Design) -> Lapses:
        """Return the distribution of lapses of raters whose numbers represent these intervals, each (..., rows)."""
        return RaterRange.of(low, high, design, self.scale)

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
    """Ratings under an `IntervalModel`, with mu, raters' scales and fabrics' deviations integrated out.

    A rating that represents an interval contributes a probability; an exact rating contributes a density [1/unit].

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
    quadrature
        Resolution of the integrals; by default chosen from the number of ratings per rater.
    lapses
        Distribution of lapses; by default that of raters with these ratings.
    rough
        The approximation for which this is a reference; by default none.

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
        quadrature: Quadrature | None = None,
        lapses: Lapses | None = None,
        rough: Rough | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)
        scale = model.scale
        self._stated = self._understood(stated)
        low, high = self._stated.ends(self.values)
        self._exact = low == high
        self._lapses = lapses or model.lapses(low, high, design)
        order = np.argsort(design.participant, kind="stable")
        self._order, self._back = order, np.argsort(order)
        self._condition = design.condition[order]
        self._raters, rater = np.unique(design.participant[order], return_inverse=True)
        with np.errstate(divide="ignore"):
            lapse = self._lapses.log_probability(low, high, scale)
            self._rows = Rows(scale.additive(low), scale.additive(high), lapse).take(order)
        narrow = self._rows.high - self._rows.low < 1.0
        self._middle = scale.additive(self.values)[order]
        self._middle[narrow] = 0.5 * (self._rows.low + self._rows.high)[narrow]
        weight = np.ones(order.size) if model.law == NORMAL else robust_weights(self._middle, rater, self._condition)
        self._quadrature = quadrature or quadrature_for(np.bincount(rater).astype(float))
        walled = np.bincount(rater, np.isfinite(self._widths())).min() == 0.0
        times = times_of(rater, self._condition, self._rows.low, self._rows.high, self._middle)
        level, ends = model.level, self._finite_ends()
        how = model.law, rater, weight, level.mean, level.sd, self._widths(), times, ends
        self._integrals, kind = self._kinds(bool(walled), how)
        fabric = design.fabric[self._condition]
        self._fabrics = kind(self._integrals, fabric, design.n_fabrics, self._widths(), times, rough)
        self._slope = np.where(self._exact, scale.log_slope(self.values), 0.0)
        self._log = float(self._slope.sum())

    def _kinds(self, walled: bool, how: tuple[Any, ...]) -> tuple[RaterIntegrals, type[FabricIntegrals]]:
        """Return the integrals over raters' effects, and the kind of those over fabrics' deviations.

        Parameters
        ----------
        walled
            True if a rater has no interval with two ends.
        how
            Arguments of `RaterIntegrals`.
        """
        kind: type[RaterIntegrals] = WalledIntegrals if walled else RaterIntegrals
        kind = DenseIntegrals if self._quadrature in (DENSE, DENSER) else kind
        return kind(*how), FabricIntegrals

    def _understood(self, stated: Stated | None) -> Stated:
        """Return the intervals of the ratings, after a check that the ratings lie on the scale."""
        scale, zero, end = self.model.scale, np.zeros(self.design.n_rows), self.model.end
        with np.errstate(divide="ignore", invalid="ignore"):
            wrong = ~np.isfinite(scale.additive(self.values))
        if wrong.any():
            raise InputError(f"ratings: {wrong.sum()} of {wrong.size} are not {scale.suitable} numbers")
        return stated or Stated(self.values, zero, zero, zero + end, end)

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self._over, self._stated, self._quadrature)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings; centring of x and lapses still use all rows."""
        rest = self._stated.take(~rows)
        # derivatives alone need many rows
        own = None if self._quadrature.fast else self._quadrature
        lapses = self._lapses.take(~rows)
        return type(self)(self.values[~rows], self.design.without(rows), self.model, self._over, rest, own, lapses)

    @property
    def ends(self) -> tuple[FloatArray, FloatArray] | None:
        """Ends of the ratings' intervals, each (rows,); None if the ratings are exact numbers."""
        return None if self._exact.all() else self._stated.ends(self.values)

    @property
    def discrete(self) -> NDArray[np.bool_]:
        """True for ratings that represent an interval, shape (rows,)."""
        return ~self._exact

    def finer(self) -> Self:
        """Return the same likelihood with finer integrals."""
        walled = self._integrals.walled.size > 0
        quadrature = finer_than(self._quadrature, self._integrals.count, self.model.law, walled)
        return self.with_quadrature(quadrature, Rough(self._fabrics, self._quadrature))

    def for_sampling(self) -> Self:
        """Equivalent of `Likelihood.for_sampling`."""
        return self.with_quadrature(SAMPLING) if self._quadrature.fast else self

    def with_quadrature(self, quadrature: Quadrature, rough: Rough | None = None) -> Self:
        """Return the same likelihood with integrals of another resolution, as a reference of `rough` if given."""
        how = self._stated, quadrature, self._lapses, rough
        return type(self)(self.values, self.design, self.model, self._over, *how)

    def log_likelihood(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings together, shape (...); arguments as `LogRatings.log_likelihood`."""

        def whole(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            given, shape = self._given(mean_rate, parameters)
            return self._fabrics.log_density(given, self._quadrature).reshape(*shape, 1) - self._log

        points = max(self._quadrature.points, 4)
        return in_pieces(whole, points * self.design.n_rows + self._fabrics.width, mean_rate, parameters)[..., 0]

    def log_likelihood_loo(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of each rating given all the others, shape (..., rows).

        The level's distribution given the other raters is approximated as normal, and with fabrics' deviations that of
        a row's expectation.
        """

        def alone(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            given, shape = self._given(mean_rate, parameters)
            return (self._log_left_out(given)[:, self._back] - self._slope).reshape(*shape, -1)

        return in_pieces(alone, self._loo_width, mean_rate, parameters)

    def below_loo(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Probability of a rating below each observed one, given all the others, shape (..., rows).

        Half the probability of an equal one is added. Lapses are left out.
        """

        def smaller(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            given, shape = self._given(mean_rate, parameters)
            return self._below_left_out(given)[:, self._back].reshape(*shape, -1)

        return in_pieces(smaller, self._loo_width, mean_rate, parameters)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings of each participant given all other participants', shape (draws, participants).

        The level's distribution given the other raters is approximated as normal. With fabrics' deviations, it is the
        difference of the log densities with and without them.
        """
        if (np.asarray(parameters.omega) > 0.0).any():
            return block_log_likelihood(self, mean_rate, parameters, self.design.participant)

        def whole(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            given, shape = self._given(mean_rate, parameters)
            density = log_of_raters(self._integrals, given)
            found = np.zeros((len(density), self.design.n_participants))
            found[:, self._raters] = density
            found -= np.bincount(self.design.participant, self._slope, self.design.n_participants)
            return found.reshape(*shape, -1)

        return in_pieces(whole, self._loo_width, mean_rate, parameters)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: RatingParameters) -> Effects:
        """Draws of all effects given the ratings: of fabrics by `FabricIntegrals`, of the others from grids."""
        shape = np.broadcast_shapes(mean_rate.shape[:-1], *(np.shape(v) for v in parameters))
        width = self.design.n_rows + LEVELS * FINE.scales * self.design.n_participants + self._fabrics.width
        found = in_pieces(lambda rate, p: self._drawn(rng, rate, p), width, mean_rate, parameters)
        tau = np.broadcast_to(np.asarray(parameters.tau, float), shape)[..., None]
        participant = tau * rng.standard_normal((*shape, self.design.n_participants))
        last = 1 + self._raters.size
        participant[..., self._raters] = found[..., 1:last]
        return Effects(found[..., 0], participant, found[..., last:])

    def _drawn(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Return draws of mu, of the raters with ratings and of fabrics, (..., 1 + raters + fabrics)."""
        given, shape = self._given(mean_rate, parameters)
        drawn = self._fabrics.draw(rng, given, self._quadrature)
        return np.concatenate(drawn, axis=-1).reshape(*shape, -1)

    def replicate(
        self,
        rng: np.random.Generator,
        drive: FloatArray,
        parameters: RatingParameters,
        effects: Effects,
        mean_rate: FloatArray | None = None,
    ) -> FloatArray:
        """Return one rating for every row, shape (..., rows), on its rater's grid."""
        numbers = self.model.draw_attentive(rng, self.design, drive, parameters, effects)
        return self._stated.rounded(self.model.with_lapses(rng, numbers, self.design, parameters, self._stated))

    def residual(self, mean_rate: FloatArray, parameters: RatingParameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating as a normal score times the spread, shape (..., rows).

        An interval's residual is taken at a random share of its probability, drawn once per row.
        """
        drive, design = self.drive(mean_rate, parameters), self.design
        expected = effects.mu[..., None] + (drive + effects.fabric[..., design.fabric])[..., design.condition]
        expected = expected + effects.participant[..., design.participant]
        spread = self.model.error_sd(parameters)[..., None]
        rows = self._rows_at(parameters).take(self._back)
        return spread * score_at(self.model.law, rows, self._shares, expected, spread, parameters)

    @cached_property
    def _shares(self) -> FloatArray:
        return np.random.default_rng(_SEED).uniform(size=self.design.n_rows)

    @property
    def _loo_width(self) -> int:
        return 100 * self.design.n_rows

    def _given(self, mean_rate: FloatArray, parameters: RatingParameters) -> tuple[RowParameters, tuple[int, ...]]:
        """Return the parameters with one axis of draws, and their batch shape."""
        drive = self.drive(mean_rate, parameters)
        shape = batch_shape(drive.shape[:-1], parameters)
        flat = RatingParameters(*(v if is_number(v) else over_draws(v, shape) for v in parameters))
        drive = np.broadcast_to(drive, (*shape, drive.shape[-1])).reshape(-1, drive.shape[-1])
        tau, varsigma, omega, nu, lapse = (over_draws(getattr(flat, name), drive.shape[:1]) for name in _OF_DRAWS)
        drive = drive.T.take(self._condition, axis=0).T  # rows of draws are copied as a whole
        spread, rows = np.maximum(varsigma, _LEAST_SPREAD)[:, None], self._rows_at(flat)
        own = LawParameters(nu, lapse), rows, self._middle_of(rows, spread)
        return RowParameters(drive, tau[:, None], spread, *own, omega[:, None]), shape

    def _rows_at(self, parameters: RatingParameters) -> Rows:
        """Return every row's interval, sorted by rater; in this class independent of the parameters."""
        return self._rows

    def _widths(self) -> FloatArray:
        """Return the typical width of every row's interval, infinite if an end is, sorted by rater."""
        return self._rows.high - self._rows.low

    def _finite_ends(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return True for rows whose interval has a finite lower (upper) end, sorted by rater."""
        return np.isfinite(self._rows.low), np.isfinite(self._rows.high)

    def _middle_of(self, rows: Rows, spread: FloatArray) -> FloatArray:
        """Return a number inside of each interval."""
        return self._middle

    def _log_left_out(self, given: RowParameters) -> FloatArray:
        """Return the log probability of each row given all others, (draws, rows), sorted by rater."""
        return log_density_left_out(self._fabrics, given) if given.deviating else log_of_rows(self._integrals, given)

    def _below_left_out(self, given: RowParameters) -> FloatArray:
        """Return the probability below each row given all others, likewise."""
        return below_left_out(self._fabrics, given) if given.deviating else below_rows(self._integrals, given)
