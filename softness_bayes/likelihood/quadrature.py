"""The reference for Laplace's method: sums over points of each rater's effects and nodes of the level (model.md 9).

Given mu and fabrics' deviations, raters are independent. A rater's `Points` are values of a_p = mu + s_p (and of the
log exponent and log noise, if raters differ in them) with log weights that contain the density of the rater's rows. All
levels share them: with the law of the scale, N(a_p; mu, tau²), they give the rater's density R_p(mu), and

    log p(rows) = log of the integral of N(mu; centre, spread²) times the product of R_p(mu) over the raters

by the trapezoid rule over evenly spaced mu. Points of a_p alone are evenly spaced, too, and the same for all raters;
points of several effects are importance draws (fixed Sobol numbers, heavy tails) about the rater's mode, with weights
over their density.

Fabrics' deviations connect all raters. The reference takes importance draws of them about Laplace's mode, and sums over
the level and raters' effects at each. What is said of a row or a rater given all others follows from the same points
without its own factor.

The trapezoid rule gives the same sum wherever its nodes begin. Nodes that begin at a random place, one of which is then
chosen by its density, are therefore exact draws (`draw_on_nodes`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.likelihood.design import FloatArray, IndexArray
from softness_bayes.likelihood.error_laws import student_log_density
from softness_bayes.likelihood.laplace import Laplace, laplace
from softness_bayes.likelihood.pieces import BLOCK, backward, cholesky, forward, log_sum, pieces
from softness_bayes.likelihood.rater_effects import Given, Points, Table
from softness_bayes.likelihood.row_laws import RowLaw

SPACING = 1.2
"""Spacing of nodes, in standard deviations of the narrowest density that they may have to resolve."""
REACH = 5.2
"""Distance of the outermost nodes from the mode, in standard deviations of the widest density."""
MOST_NODES = 3000
"""Most nodes of a rater's scale or of the level."""
OWN_DRAWS, BROAD = 1024, 4
"""Importance draws of a rater's effects about the mode, if there are several, and their ratio to draws from the law of
the effects given the other raters: there may be other modes. Both are powers of 2."""
LARGEST = 38.0
"""Largest effect with a density in the range of numbers, in its standard deviations."""
FREEDOM, INFLATION = 6.0, 1.1
"""Degrees of freedom of importance draws about a mode, and their scale [standard deviations without one row]."""
FABRIC_DRAWS = 64
"""Importance draws of fabrics' deviations."""
FABRIC_FREEDOM, FABRIC_INFLATION = 30.0, 1.05
"""Their degrees of freedom and scale [standard deviations without one rater]."""

_ROOM = 200_000  # numbers in an array of points
_LEAST_TAU = 0.01
_FARTHEST = 1e4  # log density below the largest at which a node has no weight


class LevelNodes(NamedTuple):
    """Log densities of raters' rows at nodes of the level, which all raters share."""

    mu: FloatArray
    """The nodes, shape (..., nodes)."""
    of_raters: FloatArray
    """Log density of each rater's rows given the level, shape (..., raters, nodes)."""
    joint: FloatArray
    """Log density of the level and all rows, times the spacing of the nodes, shape (..., nodes)."""

    @classmethod
    def of(cls, mu: FloatArray, of_raters: FloatArray, centre: float, spread: float) -> LevelNodes:
        """Return the densities at evenly spaced nodes, with the level's prior mean and standard deviation."""
        z = (mu - centre) / spread
        log_step = np.log(mu[..., 1:2] - mu[..., :1])
        prior = -0.5 * z * z - np.log(spread) - 0.5 * LOG_TWO_PI
        return cls(mu, of_raters, of_raters.sum(axis=-2) + prior + log_step)

    @property
    def log_density(self) -> FloatArray:
        """Log density of all rows, shape (...)."""
        return log_sum(self.joint, axis=-1)

    @property
    def without_one(self) -> FloatArray:
        """Log density of the level and the rows of all raters but one, times the spacing, (..., raters, nodes)."""
        return np.asarray(self.joint[..., None, :] - self.of_raters)

    @property
    def given_others(self) -> FloatArray:
        """Log density of each rater's rows given all others', shape (..., raters)."""
        whole = self.log_density[..., None]
        return whole if self.of_raters.shape[-2] == 1 else whole - log_sum(self.without_one, axis=-1)


class Extent(NamedTuple):
    """Ranges of the points of raters' scales and of the nodes of the level, in each draw without `omega`."""

    tau: FloatArray
    """Spread of raters' scales, shape (draws, 1); far below the width of a rater's density it is not told from 0."""
    mu: FloatArray
    """Middle of the nodes of the level, shape (draws,)."""
    half: FloatArray
    """Half-width of the nodes of the level, shape (draws,)."""
    levels: IndexArray
    """Number of these nodes, shape (draws,)."""
    low: FloatArray
    """Smallest point of each rater's a_p, shape (draws, raters)."""
    high: FloatArray
    """Largest point, same shape."""
    points: IndexArray
    """Number of evenly spaced points of a_p, shape (draws,)."""
    shared: NDArray[np.bool_]
    """True if all raters have the same points, shape (draws,): rows of one answer are then evaluated once."""
    broad: FloatArray
    """Standard deviation of a_p given all raters but p, if none is an outlier, shape (draws, raters)."""

    @classmethod
    def of(cls, table: Table, given: Given, law: Laplace) -> Extent:
        """Return what a table needs about Laplace's mode, whichever row or rater is left out."""
        effects, first, concave = table.effects(given, law.mode), table.first, table.law.concave
        mu = table.mu(effects.level)
        expected, c, spread = table.expectations(given, effects)
        slope = RowLaw(table.law, given.rows, expected, spread, given.law_parameters).terms().of_mean
        # information of rows at most so far from the mode as their intervals are wide; none beyond an open end
        information = np.broadcast_to(1.0 / (spread**2 + 0.25 * (given.rows.high - given.rows.low) ** 2), slope.shape)
        sharpest = table.count / given.spread**2
        tau = np.maximum(given.tau, _LEAST_TAU * np.minimum(sharpest.max(axis=-1, keepdims=True) ** -0.5, table.spread))
        of_rater = table.by_rater(information)
        of_level = 1.0 / (tau**2 + 1.0 / np.maximum(of_rater, 1e-300))
        others = of_level.sum(axis=-1, keepdims=True) - of_level
        broad = np.sqrt(tau**2 + 1.0 / (table.spread**-2 + others))
        if not concave:  # half of the other raters, and some more, may be far off
            others = 0.5 * others * max(1.0 - 2.0 / max(table.n_raters - 1, 1), 0.0)
        # variances of the level and of a_p given all raters but one, at most
        without = 1.0 / (table.spread**-2 + others)
        wide = np.sqrt(tau**2 + without)

        mid, centre = mu[:, None], mu[:, None] + given.tau * effects.own[..., 0]
        width = (of_rater - np.maximum.reduceat(information, first, axis=-1) + wide**-2) ** -0.5
        away = REACH * width + np.maximum.reduceat(np.abs(slope), first, axis=-1) * width**2
        low, high = centre - away, centre + away
        if not concave:  # any row may be an outlier or a lapse, or all but one
            own, reach = table.middles(given)[0] - c, REACH * np.minimum(sharpest**-0.5, wide)
            low = np.minimum(np.minimum(low, mid - REACH * wide), np.minimum.reduceat(own, first, axis=-1) - reach)
            high = np.maximum(np.maximum(high, mid + REACH * wide), np.maximum.reduceat(own, first, axis=-1) + reach)
        narrow = (sharpest.max(axis=-1) + tau[:, 0] ** -2) ** -0.5
        least, most = low.min(axis=-1), high.max(axis=-1)
        together, apart = _number(most - least, narrow), _number((high - low).max(axis=-1), narrow)
        shared = together * table.answers.size <= apart * table.rater.size
        low, high = np.where(shared[:, None], least[:, None], low), np.where(shared[:, None], most[:, None], high)

        moved = np.abs(table.by_rater(slope)) * without
        half = (REACH * np.sqrt(without) + moved).max(axis=-1)
        # the sharpest density of the level and a rater's scale together
        sharp = (sharpest / (1.0 + tau**2 * sharpest)).sum(axis=-1)
        narrow_level = (table.spread**-2 + sharp + tau[:, 0] ** -2) ** -0.5
        levels, points = _number(2.0 * half, narrow_level), np.where(shared, together, apart)
        return cls(tau, mu, half, levels, low, high, points, shared, broad)

    def part(self, draws: Any) -> Extent:
        """Return some of the draws."""
        return Extent(*(value[draws] for value in self))


class Marginal:
    """The density of all rows with the level and raters' effects integrated out, at draws without `omega`.

    Parameters
    ----------
    table, given
        The rows, and everything but the effects.
    law
        Laplace's approximation, about which the effects are drawn if there are several.
    extent
        Where points and nodes are needed; their numbers are the same in all draws.
    """

    def __init__(self, table: Table, given: Given, law: Laplace, extent: Extent) -> None:
        self.table, self.given, self.extent = table, given, extent
        self.points = self._evenly_spaced() if len(given.effects) == 1 else self._drawn_points(law)
        self.weight = self.points.log_weight + table.of_raters(given, self.points)
        """Log density of each rater's rows, times the points' weight, without the law of the scale."""

    def _evenly_spaced(self) -> Points:
        """Return evenly spaced points of raters' scales."""
        some, number = slice(1 if self.extent.shared[0] else None), self.extent.points[0]
        low, high = self.extent.low[:, some, None], self.extent.high[:, some, None]
        scale = low + (high - low) * np.linspace(0.0, 1.0, number)
        return Points(scale, np.empty((*scale.shape, 0)), np.log((high - low) / (number - 1)))

    def _drawn_points(self, law: Laplace) -> Points:
        """Return importance draws of each rater's scale, log exponent and log noise."""
        effects, tau = self.table.effects(self.given, law.mode), self.given.tau
        own, mu, size = effects.own, self.extent.mu[:, None], effects.own.shape[-1]
        # a = mu + tau z instead of z: its derivatives with respect to z and to the level
        root = backward(law.own_root, np.broadcast_to(np.eye(size), law.own_root.shape))  # of A⁻¹ = root' ... root
        covariance = np.einsum("dpik,dpjk->dpij", root, root)
        follows = -backward(law.own_root, law.coupling)[..., 0] / law.shared_root[:, None, 0, 0, None]
        unit = np.ones((*own.shape[:2], size))
        unit[..., 0] = tau
        covariance = covariance * unit[..., :, None] * unit[..., None, :]
        follows = follows * unit
        follows[..., 0] += self.table.spread / law.shared_root[:, None, 0, 0]
        covariance = covariance + follows[..., :, None] * follows[..., None, :]
        scales = np.sqrt(np.einsum("dpii->dpi", covariance))
        factor = scales[..., None] * cholesky(covariance / (scales[..., :, None] * scales[..., None, :]), 1e-6)
        centre, broad, aim = own.copy(), np.ones_like(own), np.zeros_like(own)
        centre[..., 0], broad[..., 0], aim[..., 0] = mu + tau * own[..., 0], self.extent.broad, mu
        # a row fewer leaves a wider law
        wider = INFLATION * np.sqrt(1.0 + 1.0 / np.maximum(self.table.count - 1.0, 1.0))
        values, density = importance_draws(centre, factor, wider, OWN_DRAWS, FREEDOM, (aim, broad))
        prior = -0.5 * (values[..., 1:] ** 2).sum(axis=-1) - (size - 1) * 0.5 * LOG_TWO_PI
        # where the normal density underflows the exponential of an effect may overflow: no weight, at any place
        far = (np.abs(values[..., 1:]) > LARGEST).any(axis=-1)
        others = np.clip(values[..., 1:], -LARGEST, LARGEST)
        return Points(values[..., 0], others, np.where(far, -np.inf, prior - density))

    @cached_property
    def levels(self) -> LevelNodes:
        """Log densities at the nodes of the level."""
        number, half = self.extent.levels[0], self.extent.half[:, None]
        mu = self.extent.mu[:, None] + half * np.linspace(-1.0, 1.0, number)
        of_raters = _log_product(self.weight[:, :, None], self._law_of_scale(mu), -1)
        return LevelNodes.of(mu, of_raters, self.table.centre, self.table.spread)

    def _law_of_scale(self, mu: FloatArray) -> FloatArray:
        """Return log N(a_p; mu, tau²) of all points at levels (draws, nodes), (draws, raters or 1, nodes, points)."""
        tau = self.extent.tau[..., None, None]
        z = (self.points.scale[:, :, None] - mu[:, None, :, None]) / tau
        return np.asarray(-0.5 * z * z - np.log(tau) - 0.5 * LOG_TWO_PI)

    def of_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the log density of each row given all others, and the probability below it, each (draws, rows)."""
        table, rest = self.table, self.levels.without_one[..., None]
        # weight of each rater's points given all rows of the other raters
        own = self.weight + _log_product(rest, self._law_of_scale(self.levels.mu), -2)
        law, rater = table.row_law(self.given, self.points), table.rater
        column = table.answer if self.points.shared else slice(None)
        value, below = (np.swapaxes(part, -1, -2)[:, column] for part in (law.log_probability(), law.below()))
        with np.errstate(invalid="ignore"):
            rest = np.where(value > -np.inf, own[:, rater] - value, -np.inf)
        whole = log_sum(rest, axis=-1)
        share = np.exp(rest - whole[..., None])
        density = log_sum(own, axis=-1)[:, rater] - whole
        return density, (share * below).sum(axis=-1)

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return draws of mu, (draws,), and of raters' effects less the level in units of their spreads, as `own`."""
        points, tau = self.points, self.extent.tau
        mu = draw_on_nodes(rng, self.levels.mu, self.levels.joint)
        if points.others.shape[-1]:
            chosen = _chosen(rng, self.weight + self._law_of_scale(mu[:, None])[:, :, 0])[..., None]
            scale = np.take_along_axis(points.scale, chosen, axis=-1)[..., 0]
            others = np.take_along_axis(points.others, chosen[..., None], axis=-2)[..., 0, :]
            return mu, np.concatenate([((scale - mu[:, None]) / tau)[..., None], others], axis=-1)
        scale = draw_on_nodes(rng, points.scale, self.weight + self._law_of_scale(mu[:, None])[:, :, 0])
        return mu, ((scale - mu[:, None]) / tau)[..., None]


def _number(extent: FloatArray, narrow: FloatArray) -> IndexArray:
    """Return numbers of evenly spaced nodes for these extents and narrowest standard deviations, a power of 2^(1/4)."""
    needed = np.clip(extent / (SPACING * narrow) + 1.0, 9, MOST_NODES)
    return np.ceil(2.0 ** (np.ceil(4.0 * np.log2(needed)) / 4.0)).astype(np.intp)


def _log_product(log_weight: FloatArray, log_law: FloatArray, axis: int) -> FloatArray:
    """Return the log of a sum of products along an axis, of arrays (draws, raters, nodes, points) that broadcast."""
    top = log_weight.max(axis=axis, keepdims=True)
    sums = "drnp,drnp->" + ("drn" if axis == -1 else "drp")
    with np.errstate(divide="ignore"):
        found = np.log(np.einsum(sums, np.exp(log_weight - top), np.exp(log_law))) + np.squeeze(top, axis)
    lost = np.isneginf(found).any(axis=(1, 2))
    if lost.any():  # where no point has weight in both, the product is below the smallest number
        found[lost] = log_sum(log_weight[lost] + log_law[lost], axis)
    return np.asarray(found)


def _chosen(rng: np.random.Generator, log_weight: FloatArray) -> IndexArray:
    """Return an index along the last axis, drawn in proportion to the weights (..., n)."""
    cumulative = np.cumsum(np.exp(log_weight - log_weight.max(axis=-1, keepdims=True)), axis=-1)
    at = rng.random(cumulative.shape[:-1])[..., None] * cumulative[..., -1:]
    return np.minimum((cumulative < at).sum(axis=-1), log_weight.shape[-1] - 1)


def draw_on_nodes(rng: np.random.Generator, nodes: FloatArray, log_density: FloatArray) -> FloatArray:
    """Return a draw from a density that is known at evenly spaced nodes, by cubics of its logarithm between them.

    All nodes are moved by the same random part of their distance. One of them is a draw.

    Parameters
    ----------
    rng
        Random generator.
    nodes, log_density
        The nodes, and the log density there up to a constant, shape (..., nodes).

    Returns
    -------
    ndarray, shape (...)
    """
    share = rng.random(log_density.shape[:-1])[..., None]
    log_density = np.maximum(log_density, log_density.max(axis=-1, keepdims=True) - _FARTHEST)
    last = log_density.shape[-1] - 3
    moved = np.zeros((*log_density.shape[:-1], last))
    for k in range(4):  # Lagrange's polynomials of the nodes at -1, 0, 1, 2
        others = [j for j in range(4) if j != k]
        moved += log_density[..., k : k + last] * math.prod((share + 1.0 - j) / (k - j) for j in others)
    nodes, chosen = np.broadcast_to(nodes, log_density.shape), _chosen(rng, moved)[..., None]
    return (np.take_along_axis(nodes, 1 + chosen, axis=-1) + share * (nodes[..., 1:2] - nodes[..., :1]))[..., 0]


def importance_draws(
    centre: FloatArray,
    factor: FloatArray,
    wider: FloatArray,
    number: int,
    freedom: float,
    far: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return fixed heavy-tailed draws about a mode, (..., draws, effects), and the log of their density and number.

    The density is relative to the mean weight of the normal law at the same points, whose integral is known to be 1.

    Parameters
    ----------
    centre, factor
        Mode, (..., effects), and lower factor of the covariance, (..., effects, effects).
    wider
        Scale of the draws in that of the normal law, shape (...).
    number
        Number of draws, a power of 2.
    freedom
        Degrees of freedom of the draws.
    far
        Centre and scales, each (..., effects), of 1 / `BROAD` as many further draws: there may be other modes.
    """
    size = centre.shape[-1]
    x = heavy_tailed(number, size, freedom)
    values = centre[..., None, :] + wider[..., None, None] * (x @ np.swapaxes(factor, -1, -2))
    if far is not None:
        outer = heavy_tailed(number // BROAD, size, freedom)
        values = np.concatenate([values, far[0][..., None, :] + far[1][..., None, :] * outer], axis=-2)
    with np.errstate(over="ignore"):
        u = np.swapaxes(forward(factor, np.swapaxes(values - centre[..., None, :], -1, -2)), -1, -2)
        volume = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)[..., None]
        density = log_heavy_tailed(u / wider[..., None, None], freedom) - size * np.log(wider)[..., None] - volume
        if far is not None:
            outer = log_heavy_tailed((values - far[0][..., None, :]) / far[1][..., None, :], freedom)
            outer -= np.log(far[1]).sum(axis=-1)[..., None]
            density = np.logaddexp(np.log(BROAD) + density, outer) - np.log(BROAD + 1.0)
        normal = -0.5 * (u**2).sum(axis=-1) - size * 0.5 * LOG_TWO_PI - volume
    return values, density + log_sum(normal - density, axis=-1)[..., None]


@cache
def heavy_tailed(number: int, dimension: int, freedom: float) -> FloatArray:
    """Return fixed draws of independent Student's t from Sobol numbers, shape (number, dimension)."""
    from scipy.stats import qmc  # imported here because it takes a third of a second

    uniform = np.clip(qmc.Sobol(dimension, seed=1).random(number), 1e-12, 1.0 - 1e-12)
    found = np.asarray(stdtrit(freedom, uniform))
    found.flags.writeable = False
    return found


def log_heavy_tailed(x: FloatArray, freedom: float) -> FloatArray:
    """Return the log density of `heavy_tailed` at x (..., dimension)."""
    return np.asarray(student_log_density(x, np.array(freedom)).sum(axis=-1))


class _Inner(NamedTuple):
    """Importance draws of fabrics' deviations for draws of everything else: one, of 0, if they have none."""

    log_weight: FloatArray  # (draws, importance draws)
    h: FloatArray  # (draws, importance draws, fabrics)
    given: Given  # for all of them, as one axis, without omega
    start: FloatArray | None = None  # of the search for the mode, with the same axis


class Integrals:
    """Integrals over all effects, for one table.

    Parameters
    ----------
    table
        The rows.
    """

    def __init__(self, table: Table) -> None:
        self.table = table

    def laplace(self, given: Given) -> FloatArray:
        """Return the log density of all rows by Laplace's method, shape (draws,), given everything but the effects."""
        return self._law(given).log_density

    def log_density(self, given: Given) -> FloatArray:
        """Return the log density of all rows by the reference, shape (draws,)."""
        return np.concatenate([log_sum(weight, axis=1) for _, weight, _ in self._each(given, lambda marginal: ())])

    def of_rows(self, given: Given) -> tuple[FloatArray, FloatArray]:
        """Return the log density of each row given all others and the probability below it, each (draws, rows)."""
        found = []
        for _, weight, (density, below) in self._each(given, Marginal.of_rows):
            alone, share = _given_others(weight, density)
            found.append((alone, (share * below).sum(axis=1)))
        densities, smaller = zip(*found, strict=True)
        return np.concatenate(densities), np.concatenate(smaller)

    def of_raters(self, given: Given) -> FloatArray:
        """Return the log density of each rater's rows given all others', shape (draws, raters)."""
        every = self._each(given, lambda marginal: (marginal.levels.given_others,))
        return np.concatenate([_given_others(weight, density)[0] for _, weight, (density,) in every])

    def draw(self, rng: np.random.Generator, given: Given) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return draws of all effects given the rows, one for each draw of everything else.

        They are mu, (draws,), raters' effects in units of their spreads, (draws, raters, effects), and h of fabrics,
        (draws, fabrics).
        """
        h = np.zeros((len(given.drive), self.table.n_fabrics))
        if given.omega is not None:
            every = self._each(given, lambda marginal: ())
            h = np.concatenate(
                [
                    np.take_along_axis(inner.h, _chosen(rng, weight)[:, None, None], axis=1)[:, 0]
                    for inner, weight, _ in every
                ]
            )
            given = given.with_fabrics(h, self.table.fabric)
        drawn = [found for *_, found in self._each(given, lambda marginal: marginal.draw(rng))]
        mu, own = (np.concatenate(part)[:, 0] for part in zip(*drawn, strict=True))
        return mu, own, h

    def _law(self, given: Given, start: FloatArray | None = None) -> Laplace:
        """Return Laplace's approximation, in blocks of draws."""
        every = pieces(len(given.drive), self.table.rater.size, 2 * BLOCK)  # rows have single precision
        parts = (laplace(self.table, given.part(k), None if start is None else start[k]) for k in every)
        return Laplace(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _each(
        self, given: Given, work: Callable[[Marginal], tuple[FloatArray, ...]]
    ) -> Iterator[tuple[_Inner, FloatArray, list[FloatArray]]]:
        """Yield parts of the draws: log densities of rows and fabrics' importance draws, and ``work`` of these.

        Their arrays have the shape (draws, importance draws, ...).
        """
        many = 1 if given.omega is None else FABRIC_DRAWS
        for piece in pieces(len(given.drive), self.table.rater.size * many):
            inner = self._inner(given.part(piece))
            values = self._of_draws(inner, lambda marginal: (marginal.levels.log_density, *work(marginal)))
            density, *others = (value.reshape(*inner.log_weight.shape, *value.shape[1:]) for value in values)
            yield inner, inner.log_weight + density, others

    def _inner(self, given: Given) -> _Inner:
        """Return importance draws of fabrics' deviations about Laplace's mode."""
        draws, fabrics = len(given.drive), self.table.n_fabrics
        if given.omega is None:
            return _Inner(np.zeros((draws, 1)), np.zeros((draws, 1, fabrics)), given)
        law = self._law(given)
        inverse = forward(law.shared_root, np.broadcast_to(np.eye(1 + fabrics), law.shared_root.shape))
        root = cholesky((np.swapaxes(inverse, -1, -2) @ inverse)[:, 1:, 1:], 1e-12)
        last = law.mode.shape[1] - fabrics
        # a rater fewer leaves a wider law
        wider = np.full(draws, FABRIC_INFLATION * (1.0 + 1.0 / max(self.table.n_raters - 1, 1)) ** 0.5)
        h, density = importance_draws(law.mode[:, last:], root, wider, FABRIC_DRAWS, FABRIC_FREEDOM)
        prior = -0.5 * (h**2 + np.log(2.0 * np.pi)).sum(axis=-1)
        many = np.repeat(np.arange(draws), FABRIC_DRAWS)
        inner = given.part(many).with_fabrics(h.reshape(-1, fabrics), self.table.fabric)
        return _Inner(prior - density, h, inner, law.mode[many, :last])

    def _of_draws(self, inner: _Inner, work: Callable[[Marginal], tuple[FloatArray, ...]]) -> list[FloatArray]:
        """Return ``work`` of the marginal density of every draw; draws that need as many nodes share arrays."""
        table, given = self.table, inner.given
        law = self._law(given, inner.start)
        extent = Extent.of(table, given, law)
        numbers = np.column_stack([extent.points, extent.levels, extent.shared])
        found: dict[int, tuple[FloatArray, ...]] = {}
        for points, levels, shared in np.unique(numbers, axis=0):
            draws = np.flatnonzero((numbers == (points, levels, shared)).all(axis=1))
            width = points * max(table.answers.size, table.n_raters * (1 if shared else levels))
            if len(given.effects) > 1:
                width = (1 + BROAD) * OWN_DRAWS // BROAD * max(table.rater.size, table.n_raters * levels)
            for some in (draws[k] for k in pieces(draws.size, width, _ROOM)):
                values = work(Marginal(table, given.part(some), law.part(some), extent.part(some)))
                found |= dict(zip(some.tolist(), zip(*values, strict=True), strict=True))
        return [np.stack(part) for part in zip(*(found[k] for k in range(len(found))), strict=True)]


def _given_others(log_weight: FloatArray, density: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the density of columns given all else, and the weight of each importance draw without the column.

    Parameters
    ----------
    log_weight
        Log of the weight of each importance draw, their sum being the density of all rows, (draws, importance draws).
    density
        Log density of each column given all else at these, (draws, importance draws, columns).
    """
    log_odds = (log_weight - log_sum(log_weight, axis=1)[:, None])[..., None] - density
    found = -log_sum(log_odds, axis=1)
    return found, np.exp(log_odds + found[:, None])
