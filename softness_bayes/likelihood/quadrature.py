"""The reference for Laplace's method: sums over points of each rater's effects and nodes of the level (model.md 9).

Given mu and fabrics' deviations, raters are independent. A rater's `Points` are values of a_p = mu + s_p (and of the
log exponent and log noise, if raters differ in them) with log weights that contain the density of the rater's rows. All
levels share them: with the law of the scale, N(a_p; mu, tau²), they give the rater's density R_p(mu), and

    log p(rows) = log of the integral of N(mu; centre, spread²) times the product of R_p(mu) over the raters

by the trapezoid rule over evenly spaced mu. Points of a_p alone are evenly spaced, too; points of several effects are
importance draws (fixed Sobol numbers, heavy tails) about the rater's mode, with weights over their density.

Fabrics' deviations connect all raters. The reference takes importance draws of them about Laplace's mode, and sums over
the level and raters' effects at each. What is said of a row or a rater given all others follows from the same points
without its own factor.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from softness_bayes.likelihood.error_laws import student_log_density
from softness_bayes.likelihood.laplace import Laplace, laplace
from softness_bayes.likelihood.pieces import BLOCK, backward, cholesky, forward, log_sum, pieces
from softness_bayes.likelihood.rater_effects import Given, Table
from softness_bayes.likelihood.row_laws import RowLaw

FloatArray = NDArray[np.float64]

SPACING = 0.8
"""Spacing of nodes, in standard deviations of the narrowest density that they may have to resolve."""
REACH = 7.0
"""Distance of the outermost nodes from the mode, in standard deviations of the widest density."""
MOST_NODES = 3000
"""Most nodes of a rater's scale or of the level."""
OWN_DRAWS, BROAD = 1024, 4
"""Importance draws of a rater's effects about the mode, if there are several, and their ratio to draws from the law of
the effects given the other raters: there may be other modes. Both are powers of 2."""
FREEDOM, INFLATION = 6.0, 1.1
"""Degrees of freedom of importance draws about a mode, and their scale [standard deviations without one row]."""
FABRIC_DRAWS = 64
"""Importance draws of fabrics' deviations."""
FABRIC_FREEDOM, FABRIC_INFLATION = 30.0, 1.05
"""Their degrees of freedom and scale [standard deviations without one rater]."""
FINER = 8
"""Points between nodes where effects are drawn, by cubic interpolation of the log density."""

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)
_ROOM = 300_000  # numbers in an array of points at several levels
_LEAST_TAU = 0.01


class Points(NamedTuple):
    """Points of all raters' effects."""

    scale: FloatArray
    """a_p, shape (draws, raters, points)."""
    others: FloatArray
    """Further effects in units of their spreads, shape (draws, raters, points, effects - 1)."""
    log_weight: FloatArray
    """Log density of the rater's rows times the point's weight, without the scale's law, (draws, raters, points)."""


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
        prior = -0.5 * z * z - np.log(spread) - _LOG_ROOT_TWO_PI
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


class Marginal:
    """The density of all rows with the level and raters' effects integrated out, at one draw without `omega`.

    Parameters
    ----------
    table, given
        The rows, and everything but the effects.
    law
        Laplace's approximation, which tells where points and nodes are needed.
    """

    def __init__(self, table: Table, given: Given, law: Laplace) -> None:
        self.table, self.given = table, given
        self._mode = table.effects(given, law.mode)
        self._mu_mode = table.mu(self._mode.level)
        expected, c, spread = table.expectations(given, self._mode)
        slope = RowLaw(table.law, given.rows, expected, spread, given.law_parameters).terms().of_mean
        # information of rows at most so far from the mode as their intervals are wide; none beyond an open end
        information = np.broadcast_to(1.0 / (spread**2 + 0.25 * (given.rows.high - given.rows.low) ** 2), slope.shape)
        self._sharpest = table.count / given.spread**2
        # far below the width of a rater's density or of the level's, tau cannot be told from 0
        finest = np.minimum(self._sharpest.max(axis=-1, keepdims=True) ** -0.5, table.spread)
        self._tau = np.maximum(given.tau, _LEAST_TAU * finest)
        of_rater = np.add.reduceat(information, table.first, axis=-1)
        of_level = 1.0 / (self._tau**2 + 1.0 / np.maximum(of_rater, 1e-300))
        others = of_level.sum(axis=-1, keepdims=True) - of_level
        self._broad = np.sqrt(self._tau**2 + 1.0 / (table.spread**-2 + others))
        """Standard deviation of a_p given all raters but p, if none is an outlier, shape (draws, raters)."""
        if not table.law.concave:  # half of the other raters, and some more, may be far off
            others = 0.5 * others * max(1.0 - 2.0 / max(table.n_raters - 1, 1), 0.0)
        self._without = 1.0 / (table.spread**-2 + others)
        """Variance of the level given all raters but one, at most, shape (draws, raters)."""
        self._width = np.sqrt(self._tau**2 + self._without)
        """Standard deviation of a_p given all raters but p, at most, shape (draws, raters)."""
        ends = self._ends(slope, information, of_rater, c)
        self.points = self._evenly_spaced(*ends) if len(given.effects) == 1 else self._drawn_points(law)
        moved = np.abs(np.add.reduceat(slope, table.first, axis=-1)) * self._without
        half = (REACH * np.sqrt(self._without) + moved).max(axis=-1)
        # the sharpest density of the level and a rater's scale together
        sharp = self._sharpest / (1.0 + self._tau**2 * self._sharpest)
        narrow = (table.spread**-2 + sharp.sum(axis=-1) + self._tau[:, 0] ** -2) ** -0.5
        number = _number(2.0 * half, narrow)
        self.mu = self._mu_mode[:, None] + half[:, None] * np.linspace(-1.0, 1.0, number)
        """Nodes of the level, shape (draws, nodes)."""

    def _ends(
        self, slope: FloatArray, information: FloatArray, of_rater: FloatArray, c: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the range of each rater's a_p outside of which it has no density, whichever row is left out."""
        first, mid = self.table.first, self._mu_mode[:, None]
        centre = mid + self.given.tau * self._mode.own[..., 0]
        least = of_rater - np.maximum.reduceat(information, first, axis=-1)
        width = (least + self._width**-2) ** -0.5
        shift = np.maximum.reduceat(np.abs(slope), first, axis=-1) * width**2
        low, high = centre - REACH * width - shift, centre + REACH * width + shift
        if not self.table.law.concave:  # any row may be an outlier or a lapse, or all but one
            own, reach = self.given.middles[0] - c, REACH * np.minimum(self._sharpest**-0.5, self._width)
            low = np.minimum(low, mid - REACH * self._width)
            high = np.maximum(high, mid + REACH * self._width)
            low = np.minimum(low, np.minimum.reduceat(own, first, axis=-1) - reach)
            high = np.maximum(high, np.maximum.reduceat(own, first, axis=-1) + reach)
        return low, high

    def _evenly_spaced(self, low: FloatArray, high: FloatArray) -> Points:
        """Return evenly spaced points of each rater's scale between these ends."""
        number = _number(high - low, (self._sharpest + self._tau**-2) ** -0.5)
        scale = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, number)
        others = np.empty((*scale.shape, 0))
        weight = np.log((high - low) / (number - 1))[..., None]
        return Points(scale, others, weight + self.table.of_raters(self.given, scale, others))

    def _drawn_points(self, law: Laplace) -> Points:
        """Return importance draws of each rater's scale, log exponent and log noise."""
        given, own = self.given, self._mode.own
        size = own.shape[-1]
        # a = mu + tau z instead of z: its derivatives with respect to z and to the level
        root = backward(law.own_root, np.broadcast_to(np.eye(size), law.own_root.shape))  # of A⁻¹ = root' ... root
        covariance = np.einsum("dpik,dpjk->dpij", root, root)
        follows = -backward(law.own_root, law.coupling)[..., 0] / law.shared_root[:, None, 0, 0, None]
        unit = np.ones((*own.shape[:2], size))
        unit[..., 0] = given.tau
        covariance = covariance * unit[..., :, None] * unit[..., None, :]
        follows = follows * unit
        follows[..., 0] += self.table.spread / law.shared_root[:, None, 0, 0]
        covariance = covariance + follows[..., :, None] * follows[..., None, :]
        scales = np.sqrt(np.einsum("dpii->dpi", covariance))
        factor = scales[..., None] * cholesky(covariance / (scales[..., :, None] * scales[..., None, :]), 1e-6)
        centre = own.copy()
        centre[..., 0] = self._mu_mode[:, None] + given.tau * own[..., 0]
        broad = np.ones_like(centre)
        broad[..., 0] = self._broad
        aim = np.zeros_like(centre)
        aim[..., 0] = self._mu_mode[:, None]
        # a row fewer leaves a wider law
        wider = INFLATION * np.sqrt(1.0 + 1.0 / np.maximum(self.table.count - 1.0, 1.0))
        values, density = importance_draws(centre, factor, wider, OWN_DRAWS, FREEDOM, (aim, broad))
        prior = -0.5 * (values[..., 1:] ** 2).sum(axis=-1) - (size - 1) * _LOG_ROOT_TWO_PI
        with np.errstate(over="ignore"):
            rows = self.table.of_raters(given, values[..., 0], values[..., 1:])
        weight = np.nan_to_num(prior + rows, nan=-np.inf) - density
        return Points(values[..., 0], values[..., 1:], weight)

    @cached_property
    def levels(self) -> LevelNodes:
        """Log densities at the nodes of the level."""
        weight = self.points.log_weight[:, :, None]
        parts = [log_sum(weight + self._law_of_scale(some), axis=-1) for some in self._some_levels]
        return LevelNodes.of(self.mu, np.concatenate(parts, axis=-1), self.table.centre, self.table.spread)

    @property
    def _some_levels(self) -> list[slice]:
        """Nodes of the level in groups whose arrays of points do not become too large."""
        return pieces(self.mu.shape[-1], self.points.scale.size, _ROOM)

    def _law_of_scale(self, nodes: slice) -> FloatArray:
        """Return log N(a_p; mu, tau²) of all points at nodes of the level, (draws, raters, nodes, points)."""
        tau = self._tau[..., None, None]
        z = (self.points.scale[:, :, None] - self.mu[:, None, nodes, None]) / tau
        return np.asarray(-0.5 * z * z - np.log(tau) - _LOG_ROOT_TWO_PI)

    @cached_property
    def _given_others(self) -> FloatArray:
        """Log weight of each rater's points given all rows of the other raters, (draws, raters, points)."""
        rest = self.levels.without_one
        parts = [log_sum(rest[..., some, None] + self._law_of_scale(some), axis=2) for some in self._some_levels]
        return log_sum(np.array(parts), axis=0)

    def of_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the log density of each row given all others, and the probability below it, each (draws, rows)."""
        table, given, points = self.table, self.given, self.points
        weight = points.log_weight + self._given_others
        law, value = table.row_values(given, points.scale, points.others)
        own = np.swapaxes(weight, -1, -2)[..., table.rater]
        with np.errstate(invalid="ignore"):
            rest = np.where(value > -np.inf, own - value, -np.inf)
        density = log_sum(own, axis=1) - log_sum(rest, axis=1)
        share = np.exp(rest - log_sum(rest, axis=1)[:, None])
        return density, (share * law.below()).sum(axis=1)

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return draws of mu, (draws,), and of raters' effects less the level in units of their spreads, as `own`."""
        points, tau = self.points, self._tau
        mu = draw_on_nodes(rng, self.mu, self.levels.joint)
        if points.others.shape[-1]:
            z = (points.scale - mu[:, None, None]) / tau[..., None]
            weight = points.log_weight - 0.5 * z * z
            chosen = (weight + rng.gumbel(size=weight.shape)).argmax(axis=-1)[..., None]
            scale = np.take_along_axis(points.scale, chosen, axis=-1)
            others = np.take_along_axis(points.others, chosen[..., None], axis=-2)[..., 0, :]
            return mu, np.concatenate([(scale - mu[:, None, None]) / tau[..., None], others], axis=-1)
        at, weight = _between(points.scale), _between(points.log_weight)
        z = (at - mu[:, None, None]) / tau[..., None]
        scale = _draw_near(rng, at, weight - 0.5 * z * z)
        return mu, ((scale - mu[:, None]) / tau)[..., None]


def _number(extent: FloatArray, narrow: FloatArray) -> int:
    """Return the number of evenly spaced nodes that all extents need, given the narrowest standard deviations."""
    return int(np.clip(np.ceil((extent / (SPACING * narrow)).max()) + 1, 9, MOST_NODES))


def _between(values: FloatArray) -> FloatArray:
    """Return values at evenly spaced nodes (..., nodes), and at `FINER` - 1 points between neighbours, by cubics."""
    from scipy.interpolate import CubicSpline  # imported here because it takes a fifth of a second

    nodes = np.arange(values.shape[-1])
    at = np.linspace(0.0, nodes[-1], FINER * nodes[-1] + 1)
    return np.asarray(CubicSpline(nodes, values, axis=-1)(at))


def draw_on_nodes(rng: np.random.Generator, nodes: FloatArray, log_density: FloatArray) -> FloatArray:
    """Return a draw from a density that is known at evenly spaced nodes, by cubics of its logarithm between them.

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
    return _draw_near(rng, _between(nodes), _between(log_density))


def _draw_near(rng: np.random.Generator, nodes: FloatArray, log_density: FloatArray) -> FloatArray:
    """Return a draw about one of many evenly spaced nodes, chosen in proportion to the density there."""
    cumulative = np.cumsum(np.exp(log_density - log_density.max(axis=-1, keepdims=True)), axis=-1)
    at = rng.random(cumulative.shape[:-1])[..., None] * cumulative[..., -1:]
    chosen = np.minimum((cumulative < at).sum(axis=-1, keepdims=True), nodes.shape[-1] - 1)
    step = nodes[..., 1] - nodes[..., 0]
    return np.take_along_axis(nodes, chosen, axis=-1)[..., 0] + step * (rng.random(step.shape) - 0.5)


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
        normal = -0.5 * (u**2).sum(axis=-1) - size * _LOG_ROOT_TWO_PI - volume
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


class Drawn(NamedTuple):
    """Draws of all effects given the rows."""

    mu: FloatArray
    """Shape (draws,)."""
    own: FloatArray
    """Raters' effects in units of their spreads, shape (draws, raters, effects)."""
    fabric: FloatArray
    """Fabrics' h, shape (draws, fabrics)."""


class _Parts(NamedTuple):
    """Marginal densities at importance draws of fabrics' deviations, for one draw of everything else."""

    log_weight: FloatArray  # of each importance draw, their sum being the density of all rows, (importance draws,)
    h: FloatArray  # (importance draws, fabrics)
    marginals: list[Marginal]

    def without(self, density: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the density of each column given all else, and each importance draw's weight without the column.

        `density` is that at each importance draw, (importance draws, columns).
        """
        log_odds = self.log_weight[:, None] - log_sum(self.log_weight, axis=0) - density
        found = -log_sum(log_odds, axis=0)
        return found, np.exp(log_odds + found)


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
        every = pieces(len(given.drive), self.table.rater.size, BLOCK)
        return np.concatenate([laplace(self.table, given.part(one)).log_density for one in every])

    def log_density(self, given: Given) -> FloatArray:
        """Return the log density of all rows by the reference, shape (draws,)."""
        return np.array([log_sum(parts.log_weight, axis=0) for parts in self._parts(given)])

    def of_rows(self, given: Given) -> tuple[FloatArray, FloatArray]:
        """Return the log density of each row given all others and the probability below it, each (draws, rows)."""
        found = []
        for parts in self._parts(given):
            density, smaller = np.concatenate([np.stack(m.of_rows()) for m in parts.marginals], axis=1)
            alone, weight = parts.without(density)
            found.append((alone, (weight * smaller).sum(axis=0)))
        density, smaller = np.stack(found, axis=1)
        return density, smaller

    def of_raters(self, given: Given) -> FloatArray:
        """Return the log density of each rater's rows given all others', shape (draws, raters)."""
        every = (
            (parts, np.concatenate([m.levels.given_others for m in parts.marginals])) for parts in self._parts(given)
        )
        return np.stack([parts.without(density)[0] for parts, density in every])

    def draw(self, rng: np.random.Generator, given: Given) -> Drawn:
        """Return draws of all effects given the rows, one for each draw of everything else."""
        found = []
        for parts in self._parts(given):
            k = int((parts.log_weight + rng.gumbel(size=parts.log_weight.shape)).argmax())
            mu, own = parts.marginals[k].draw(rng)
            found.append(Drawn(mu[0], own[0], parts.h[k]))
        return Drawn(*(np.stack(part) for part in zip(*found, strict=True)))

    def _parts(self, given: Given) -> Iterator[_Parts]:
        """Yield, for each draw of everything else, importance draws of fabrics' deviations: one if they have none."""
        if given.omega is None:
            for marginal in self._marginals(given):
                yield _Parts(marginal.levels.log_density, np.zeros((1, self.table.n_fabrics)), [marginal])
        else:
            yield from (self._over_fabrics(given.part(slice(k, k + 1))) for k in range(len(given.drive)))

    def _marginals(self, given: Given, start: FloatArray | None = None) -> Iterator[Marginal]:
        """Yield the marginal density of each draw; their numbers of nodes differ."""
        for block in pieces(len(given.drive), self.table.rater.size, BLOCK):
            part = given.part(block)
            law = laplace(self.table, part, None if start is None else start[block])
            for k in range(len(part.drive)):
                one = slice(k, k + 1)
                yield Marginal(self.table, part.part(one), law.part(one))

    def _over_fabrics(self, given: Given) -> _Parts:
        """Return importance draws of fabrics' deviations for one draw of everything else."""
        law = laplace(self.table, given)
        fabrics = self.table.n_fabrics
        inverse = forward(law.shared_root, np.eye(1 + fabrics)[None])[0]
        root = cholesky((inverse.T @ inverse)[1:, 1:], 1e-12)
        last = law.mode.shape[1] - fabrics
        # a rater fewer leaves a wider law
        wider = np.asarray(FABRIC_INFLATION * (1.0 + 1.0 / max(self.table.n_raters - 1, 1)) ** 0.5)
        h, density = importance_draws(law.mode[0, last:], root, wider, FABRIC_DRAWS, FABRIC_FREEDOM)
        prior = -0.5 * (h**2 + np.log(2.0 * np.pi)).sum(axis=-1)
        many = np.zeros(FABRIC_DRAWS, np.intp)
        inner = given.part(many).with_fabrics(h, self.table.fabric)
        marginals = list(self._marginals(inner, law.mode[many, :last]))
        rows = np.concatenate([marginal.levels.log_density for marginal in marginals])
        return _Parts(rows + prior - density, h, marginals)
