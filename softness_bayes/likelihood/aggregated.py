"""Cell means and standard deviations of magnitude estimates, over n raters who each rated every cell (model.md 9).

The mean of n log ratings has the distribution of one rater's log rating, with both standard deviations divided by the
square root of n: the mean of the raters' scales is common to all cells of a panel, and the errors are averaged within
each cell.

In a cell, the sum of squares of n raters' log ratings about their mean is varsigma² times a noncentral chi-square
variable with n - 1 degrees of freedom and noncentrality u / varsigma², where u is the sum of squares of the raters'
scales about their mean. All cells of a panel share u and are independent given u; u / tau² is chi-square. The joint
density of a panel's standard deviations is therefore one integral over u, and is independent of the means of the cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.special import chndtr, gammaln, ive, logsumexp, ndtri

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LOG_TWO_PI, Prior
from softness_bayes.likelihood.contract import (
    Effects,
    Levels,
    Likelihood,
    Parameters,
    RatingsLikelihood,
    RowsLeftOut,
    Shape,
)
from softness_bayes.likelihood.design import Design, FloatArray, Stated
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.normal_rows import EffectLaw
from softness_bayes.likelihood.pieces import in_pieces, left_out_in_pieces
from softness_bayes.likelihood.quadrature import draw_on_nodes
from softness_bayes.likelihood.scales import AGGREGATED, LOG_SD, Scale

SPREADS = "spreads"
"""Name of the standard deviations among the terms of a posterior."""

STEP = 0.75
"""Node spacing of the integral over u, in standard deviations of log u given the data."""

LARGE_ORDER = 20.0
"""Order of a Bessel function above which Debye's expansion is used (Abramowitz and Stegun 9.7.7): errors below 1e-8."""

_LEAST = 1e-8  # below this argument the function is constant to machine precision
_FAR = 1e7  # above this argument two terms of the asymptotic series are exact to machine precision
_DEBYE = (
    (24.0, (3.0, -5.0)),
    (1152.0, (81.0, -462.0, 385.0)),
    (414720.0, (30375.0, -369603.0, 765765.0, -425425.0)),
    (39813120.0, (4465125.0, -94121676.0, 349922430.0, -446185740.0, 185910725.0)),
)
"""Polynomials u_k(p): a divisor, and the coefficients of p^k, p^(k+2) and so on."""
_LEAST_VARIANCE = 1e-100
_NEWTON = 25
_LARGEST_MOVE, _SMALLEST_MOVE = 0.7, 1e-3


@dataclass(frozen=True)
class AggregatedModel(RatingModel):
    """log m = mu + s_panel ± gamma (x - mean x over the rows) + f_fabric + e, m the geometric mean of n raters.

    s ~ N(0, tau²/n), e ~ N(0, varsigma²/n); mu and f are as for single ratings. A participant of the design is a panel
    of n raters, each of whom rated all cells of the panel once; tau and varsigma refer to single raters and ratings.

    Parameters
    ----------
    raters
        Number n of raters per panel.
    """

    scale: ClassVar[Scale] = AGGREGATED
    raters: int = 20

    @property
    def of_one_rater(self) -> RatingModel:
        """Model of single ratings by raters of the same population."""
        return RatingModel(self.direction, self.centre, self.spread)

    def of_means(self, parameters: Parameters) -> Parameters:
        """Return the parameters with tau and varsigma replaced by those of means over n raters."""
        root = math.sqrt(self.raters)
        return parameters.replace(
            tau=np.asarray(parameters.tau, float) / root, varsigma=np.asarray(parameters.varsigma, float) / root
        )

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of a log mean about its panel's, shape (...)."""
        return super().error_sd(self.of_means(parameters))

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new panels and fabrics, of batch ``shape``."""
        drawn: Effects = super().draw_effects(rng, self.of_means(parameters), shape, people, fabrics, levels)
        return drawn

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> RatingsLikelihood:
        """Return the likelihood of these means under this model."""
        return AggregatedRatings(ratings, design, self)


class AggregatedRatings(LogRatings):
    """Geometric means under an `AggregatedModel`, with mu, panels and fabrics integrated out.

    Arguments are those of `LogRatings`; the participants of the design are panels.
    """

    def _law(self, drive: FloatArray, parameters: Parameters) -> EffectLaw:
        """Return the normal law of the log means."""
        law = super()._law(drive, parameters)
        return law._replace(participant=law.participant / math.sqrt(self.model.raters))

    @property
    def raters(self) -> int:
        """Number of raters of a panel."""
        return int(self.model.raters)

    @property
    def single(self) -> RatingModel:
        """The model of single raters."""
        return self.model.of_one_rater


@dataclass(frozen=True)
class SpreadModel:
    """(n - 1) S² = varsigma² noncentral chi-square(n - 1, u / varsigma²), u = tau² chi-square(n - 1).

    S is the standard deviation of a cell's log ratings; u, the sum of squares of raters' scales about their mean,
    belongs to its panel. The only effects are u as `scatter`, shape (..., panels).

    Parameters
    ----------
    raters
        Number n of raters per panel.
    """

    scale: ClassVar[Scale] = LOG_SD
    error: ClassVar[ErrorLaw] = NORMAL
    needs: ClassVar[tuple[str, ...]] = ("tau", "varsigma")
    levels: ClassVar[Mapping[str, Prior]] = MappingProxyType({})
    raters: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom of a standard deviation, n - 1."""
        return self.raters - 1

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return 1: residuals are normal scores."""
        return np.ones_like(np.asarray(parameters.varsigma, float))

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the standard deviation of the raters' scales, shape (..., k)."""
        return np.sqrt(effects.scatter.mean(axis=-1) / self.freedom)[..., None] + 0.0 * drive

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return the panels' scatter by its name, with its axis after the batch axes."""
        return {"scatter": (effects.scatter, ("participant",))}


class _Nodes(NamedTuple):
    """Nodes of the integrals over u, each field of shape (..., panels, nodes)."""

    scatter: FloatArray  # u, whose logarithms are evenly spaced
    log_density: FloatArray  # log density of u and the panel's rows, times the node spacing


class RaterSpreads(Likelihood):
    """Standard deviations of log ratings under a `SpreadModel`, with the raters' scales integrated out.

    Parameters
    ----------
    log_sd
        S of every row, shape (rows,), with the denominator n - 1.
    design
        Panel (as participant) and condition of every row.
    model
        The model.

    Raises
    ------
    InputError
        If a standard deviation is not positive, there is not one for each row, or a panel has one rater.
    """

    name: ClassVar[str] = SPREADS

    def __init__(self, log_sd: ArrayLike, design: Design, model: SpreadModel) -> None:
        self.values = np.array(log_sd, float)
        self.values.flags.writeable = False
        if self.values.shape != (design.n_rows,):
            raise InputError(f"spreads: shape {self.values.shape}, expected one for each of {design.n_rows} rows")
        if not (np.isfinite(self.values) & (self.values > 0)).all():
            raise InputError("spreads: a standard deviation is not a positive number")
        if model.raters < 2:
            raise InputError(f"spreads: {model.raters} raters, expected at least 2")
        self.design, self.model = design, model
        self._squares = model.freedom * self.values**2
        self._log_slope = np.log(2.0 * model.freedom * self.values)
        self._member = np.eye(design.n_participants)[design.participant]
        self._n_nodes = math.ceil((13.0 + 38.5 / math.sqrt(2.0 * model.freedom)) / STEP)

    @property
    def _width(self) -> int:
        return (self.design.n_rows + self.design.n_participants) * self._n_nodes

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other standard deviations of the same cells."""
        return type(self)(values, self.design, self.model)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other rows."""
        return type(self)(self.values[~rows], self.design.without(rows), self.model)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all standard deviations together, shape (...)."""
        return self.log_likelihood_participants(mean_rate, parameters).sum(axis=-1)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each panel's standard deviations, (..., panels); panels are independent."""
        return in_pieces(self._by_panel, self._width, mean_rate, parameters)

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each standard deviation given all the others at its observation, shape (..., rows) each."""

        def alone(mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
            whole, variance = self._by_panel(mean_rate, parameters), _variance(parameters)[..., None]
            density, below = [], []
            for k, panel in enumerate(self.design.participant.tolist()):
                scatter, rest = (part[..., panel, :] for part in self._nodes(mean_rate, parameters, k)[:2])
                total = logsumexp(rest, axis=-1, keepdims=True)
                smaller = chndtr(self._squares[k] / variance, self.model.freedom, scatter / variance)
                density.append(whole[..., panel] - total[..., 0])
                below.append((np.exp(rest - total) * smaller).sum(axis=-1))
            return RowsLeftOut(np.stack(density, axis=-1), np.clip(np.stack(below, axis=-1), 0.0, 1.0))

        return left_out_in_pieces(alone, self._width, mean_rate, parameters)

    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return 0 for each condition: standard deviations do not depend on the response."""
        return np.zeros((*mean_rate.shape[:-1], self.design.n_conditions))

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return 0 for each condition."""
        return self.drive(mean_rate, parameters)

    def new_effects(self, rng: Generator, parameters: Parameters, shape: Shape, levels: Levels = None) -> Effects:
        """Return the scatter of scales for the same number of new panels, of batch ``shape``."""
        drawn = rng.chisquare(self.model.freedom, (*shape, self.design.n_participants))
        return Effects(scatter=np.asarray(parameters.tau, float)[..., None] ** 2 * drawn)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return draws of the scatter given the standard deviations, one for each point of the batch."""
        nodes = self._nodes(mean_rate, parameters)
        return Effects(scatter=np.exp(draw_on_nodes(rng, np.log(nodes.scatter), nodes.log_density)))

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return a standard deviation for every row, shape (..., rows)."""
        variance = _variance(parameters)[..., None]
        noncentrality = effects.scatter[..., self.design.participant] / variance
        squares = variance * rng.noncentral_chisquare(self.model.freedom, noncentrality)
        return np.asarray(np.sqrt(squares / self.model.freedom))

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the normal score of each standard deviation given its panel's scatter, shape (..., rows)."""
        variance = _variance(parameters)[..., None]
        noncentrality = effects.scatter[..., self.design.participant] / variance
        below = chndtr(self._squares / variance, self.model.freedom, noncentrality)
        return np.asarray(ndtri(np.clip(below, 1e-300, 1.0 - 1e-16)))

    def _by_panel(self, mean_rate: FloatArray, parameters: Parameters, left_out: int | None = None) -> FloatArray:
        """Return the log density of each panel's rows, optionally without one row, shape (..., panels)."""
        return np.asarray(logsumexp(self._nodes(mean_rate, parameters, left_out).log_density, axis=-1))

    def _nodes(self, mean_rate: FloatArray, parameters: Parameters, left_out: int | None = None) -> _Nodes:
        """Return the nodes of the trapezoidal rule in s = log(u / tau²) / 2, about the most probable s of each panel.

        The density falls off like exp((n - 1) s) to the left, where only the prior matters, and faster elsewhere.
        """
        shape = np.broadcast_shapes(mean_rate.shape[:-1], np.shape(parameters.tau), np.shape(parameters.varsigma))
        variance = np.broadcast_to(_variance(parameters), shape)[..., None]
        tau = np.broadcast_to(np.asarray(parameters.tau, float), shape)[..., None]
        freedom, order = self.model.freedom, 0.5 * self.model.freedom - 1.0
        member = (
            self._member if left_out is None else self._member * (np.arange(len(self._member)) != left_out)[:, None]
        )
        # z = unit e^s is the argument of the Bessel function of each row
        unit = tau * np.sqrt(self._squares) / variance
        middle, sd = self._peak(unit, tau**2 / variance, member)
        start = middle - 6.5 * sd - 35.0 * sd**2
        step = (middle + 6.5 * sd - start) / (self._n_nodes - 1)
        s = start[..., None] + step[..., None] * np.arange(self._n_nodes)
        square = np.exp(2.0 * s)
        constant = (1.0 - 0.5 * freedom) * math.log(2.0) - float(gammaln(0.5 * freedom))
        log_weight = constant + freedom * s - 0.5 * square + np.log(step)[..., None]
        person = self.design.participant
        scaled = (self._squares / variance)[..., None]
        noncentrality = (tau**2 / variance)[..., None] * square[..., person, :]
        rows = log_bessel(order, unit[..., None] * np.exp(s[..., person, :])) - 0.5 * (scaled + noncentrality)
        rows += order * np.log(scaled) + (self._log_slope - np.log(variance))[..., None] - math.log(2.0)
        return _Nodes(tau[..., None] ** 2 * square, log_weight + member.T @ rows)

    def _peak(self, unit: FloatArray, ratio: FloatArray, member: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return approximations of the most probable s of each panel and its standard deviation, (..., panels).

        Parameters
        ----------
        unit
            Argument of each row's Bessel function at s = 0, shape (..., rows).
        ratio
            tau² / varsigma², shape (..., 1).
        member
            1 if a row belongs to a panel, else 0, shape (rows, panels).
        """
        freedom, order = self.model.freedom, 0.5 * self.model.freedom - 1.0
        pull = 1.0 + ratio * member.sum(axis=0)
        pushed = unit @ member
        some = np.maximum(freedom - member.sum(axis=0) * (order + 0.5), 0.25)
        s = np.log((pushed + np.sqrt(pushed**2 + 4.0 * pull * some)) / (2.0 * pull))
        curvature, moving = np.ones_like(s), np.ones(s.shape, bool)
        for _ in range(_NEWTON):
            z = unit * np.exp(s)[..., self.design.participant]
            slope, bend = (part @ member for part in log_bessel_slope(order, z))
            square = pull * np.exp(2.0 * s)
            curvature = np.where(moving, np.maximum(2.0 * square - bend, 0.1 * square), curvature)
            move = np.clip((freedom - square + slope) / curvature, -_LARGEST_MOVE, _LARGEST_MOVE)
            s = s + np.where(moving, move, 0.0)
            moving &= np.abs(move) > _SMALLEST_MOVE
            if not moving.any():
                break
        return s, np.minimum(curvature**-0.5, 1.1 / math.sqrt(2.0 * freedom))


def _variance(parameters: Parameters) -> FloatArray:
    return np.maximum(np.asarray(parameters.varsigma, float) ** 2, _LEAST_VARIANCE)


def log_bessel(order: float, z: FloatArray) -> FloatArray:
    """Return log(I_order(z) / z^order) for z >= 0 and an order of -1/2 or more."""
    if order > LARGE_ORDER:
        return _debye(order, z)
    value = np.asarray(z + _near_bessel(order)(np.log1p(np.minimum(z, _FAR))))
    if (far := z > _FAR).any():
        z = z[far]
        value[far] = z - (order + 0.5) * np.log(z) - 0.5 * LOG_TWO_PI - (4.0 * order**2 - 1.0) / (8.0 * z)
    return value


@cache
def _near_bessel(order: float) -> Callable[[FloatArray], FloatArray]:
    """Return log(I_order(z) / z^order) - z as a spline in log(1 + z), which is a thirtieth of the time of `ive`."""
    from scipy.interpolate import CubicSpline  # imported here because it takes a third of a second

    x = np.linspace(math.log1p(_LEAST), math.log1p(_FAR), 6001)
    z = np.expm1(x)
    spline: Callable[[FloatArray], FloatArray] = CubicSpline(x, np.log(ive(order, z)) - order * np.log(z))
    return spline


def _debye(order: float, z: FloatArray) -> FloatArray:
    root = np.sqrt(1.0 + (z / order) ** 2)
    p = 1.0 / root
    square, series = p * p, np.ones_like(p)
    for k, (divisor, coefficients) in enumerate(_DEBYE, start=1):
        polynomial = np.zeros_like(p)
        for coefficient in reversed(coefficients):
            polynomial = polynomial * square + coefficient
        series = series + (p / order) ** k * polynomial / divisor
    level = order * (root - np.log1p(root) - math.log(order)) - 0.5 * (LOG_TWO_PI + math.log(order))
    return np.asarray(level - 0.5 * np.log(root) + np.log(series))


def log_bessel_slope(order: float, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return approximations of z f'(z), with f = `log_bessel`, and of z times the derivative of z f'(z).

    The ratio of neighbouring orders is approximated by the bound of Amos (Math. Comp. 28, 239, 1974), within a few
    percent.
    """
    square = z * z
    root = np.sqrt((order + 1.5) ** 2 + square)
    below = order + 0.5 + root
    slope = square / below
    return slope, 2.0 * slope - square * square / (root * below**2)
