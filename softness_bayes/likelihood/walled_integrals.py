"""Integrals for tables with raters whose answers all lie in intervals with an open end (model.md 9).

Where all answers of a rater are 0, or in the first or last category, the rater's density is constant up to a wall, and
falls beyond it over the spread of single errors. With little noise it is far from normal about its mode. Its logarithm
is tabulated about the wall; for each level it is then integrated over panels that become narrower towards the mode and
the wall. All other raters are treated as in `rater_integrals`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.box_integrals import innermost
from softness_bayes.likelihood.interval_law import Rows, two_derivatives_beyond
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.pieces import blocks
from softness_bayes.likelihood.quadrature import FINEST, Quadrature
from softness_bayes.likelihood.rater_integrals import RaterIntegrals, ScaleModes
from softness_bayes.likelihood.rater_rows import RowParameters

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


class Resolution(NamedTuple):
    """Resolution of the table of a rater's log density, and of the panels."""

    at: FloatArray
    """Distances from the wall, in error spreads, at which the log density is computed."""
    panels: int
    """Panels to either side of a mode."""
    nodes: int
    """Gauss-Legendre nodes of each panel."""


USUAL = Resolution(3.0 * np.sinh(0.2 * np.arange(-16, 33)), 8, 4)
FINER = Resolution(3.0 * np.sinh(0.1 * np.arange(-32, 65)), 12, 6)
"""Reference for the error of `USUAL`, used with `quadrature.FINEST`."""

EDGES = np.array([-5.0, -3.5, -2.5, -1.5, -0.5, 1.0, 3.0])
"""Edges of panels about a wall, in its widths."""

NEAREST, FARTHEST = 0.7, 7.0
"""End of the innermost panel, in standard deviations of the mode; that of the outermost, in those of the prior."""

LEAST_LEVELS = 9
"""Smallest number of nodes of the level, whose density is skewed by such raters."""

_MODE_STEPS, _LEVEL_STEPS = 10, 8  # limits for Newton's method
_SETTLED = 0.05  # change of a mode, in its standard deviations, at which Newton's method stops
_NO_SPREAD = 0.05  # tau, relative to the width of a density for the rater's rows, below which moments lose digits
_LEAST_TAU = 1e-4  # replaces a smaller tau, relative to the spread of errors
_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Walls(NamedTuple):
    """Log densities of raters with open ends only, tabulated about their walls."""

    place: FloatArray
    """Tightest end of each side's intervals less the drive, shape (draws, sides)."""
    sign: FloatArray
    """1 for upper ends, -1 for lower ends, shape (sides,)."""
    rater: IndexArray
    """Each side's rater, counted among these raters, shape (sides,)."""
    first: IndexArray
    """First side of each rater."""
    coefficients: FloatArray
    """Coefficients of the polynomial in each interval of the table, and beyond, shape (6, draws, sides, intervals)."""
    resolution: Resolution
    spread: FloatArray
    """Spread of single errors, shape (draws, 1)."""
    tau: FloatArray
    """Not exactly 0, shape (draws, 1)."""
    rows: FloatArray
    """Number of each rater's rows, shape (raters,)."""
    kind: IndexArray
    """Number of the law of each rater, shape (raters,); raters with equal rows have the same."""

    def part(self, piece: Any) -> Walls:
        """Return the tables of some draws."""
        return self._replace(
            place=self.place[piece],
            coefficients=self.coefficients[:, piece],
            spread=self.spread[piece],
            tau=self.tau[piece],
        )

    def only(self, raters: IndexArray) -> Walls:
        """Return the tables of some raters."""
        sides = np.flatnonzero(np.isin(self.rater, raters))
        rater = np.searchsorted(raters, self.rater[sides])
        return self._replace(
            place=self.place[:, sides],
            sign=self.sign[sides],
            rater=rater,
            first=np.flatnonzero(np.diff(rater, prepend=-1)),
            coefficients=self.coefficients[:, :, sides],
            rows=self.rows[raters],
            kind=np.arange(raters.size),
        )

    def distinct(self) -> Walls:
        """Return the tables of one rater of each kind."""
        raters = np.unique(self.kind, return_index=True)[1]
        return self if raters.size == self.kind.size else self.only(np.sort(raters))

    def slopes(self, a: FloatArray, orders: int = 3) -> list[FloatArray]:
        """Return l_p and its derivatives at a (draws, levels, raters, nodes), each of the same shape."""
        at = (slice(None), None, slice(None), None)
        sign, spread = self.sign[:, None], self.spread[:, :, None, None]
        x = sign * (a[:, :, self.rater] - self.place[at]) / spread
        table = self.resolution.at
        step = np.append(np.diff(table), 1.0)
        k = np.clip(np.searchsorted(table, x.ravel()).reshape(x.shape) - 1, 0, table.size - 1)
        t, step = np.maximum(x - table[k], 0.0) / step[k], step[k]
        draws, sides, intervals = self.coefficients.shape[1:]
        beyond = k == intervals - 1
        k += (np.arange(draws * sides) * intervals).reshape(draws, 1, sides, 1)
        c0, c1, c2, c3, c4, c5 = (one.ravel()[k] for one in self.coefficients)
        value = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
        # the log density falls from the wall outward, also between points that do not resolve it
        following = np.where(beyond, -np.inf, np.take(self.coefficients[0], k + 1, mode="clip"))
        found = [np.clip(value, following, c0)]
        if orders > 1:
            scale = sign / (spread * step)
            falls = np.minimum(c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))), 0.0)
            found.append(scale * falls)
            found.append(scale**2 * (2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))))
        if self.first.size == self.rater.size:
            return found
        return [np.add.reduceat(one, self.first, axis=2) for one in found]

    def integrated(self, level: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the log density of each rater's rows at levels (draws, levels), and mean and variance of zeta there.

        Each has the shape (draws, levels, raters).
        """
        few = self.distinct()
        if few is not self:
            whole, mean, variance = (one[..., self.kind] for one in few.integrated(level))
            return whole, mean, variance
        tau, here = self.tau[:, :, None], np.repeat(level[:, :, None], self.rows.size, axis=2)
        mode, width = self._mode(here)
        edges = [panels_about(mode, width, FARTHEST * tau + np.abs(mode - here), self.resolution)]
        walls = self.place[:, :, None] + (self.sign * self.spread)[:, :, None] * EDGES
        for side in range(2):
            # a rater with one side only has its wall twice
            own = np.minimum(self.first + side, np.append(self.first[1:], self.rater.size) - 1)
            edges.append(np.clip(walls[:, None, own], edges[0][..., :1], edges[0][..., -1:]))
            if self.first.size == self.rater.size:
                break
        points, weight = nodes_of(np.sort(np.concatenate(edges, axis=-1), axis=-1), self.resolution)
        zeta = (points - here[..., None]) / tau[..., None]
        value = np.where(weight > 0.0, self.slopes(points, 1)[0] - 0.5 * zeta * zeta, -np.inf)
        most = value.max(axis=-1, keepdims=True)
        share = weight * np.exp(value - most)
        whole = share.sum(axis=-1)
        mean = (share * zeta).sum(axis=-1) / whole
        variance = (share * (zeta - mean[..., None]) ** 2).sum(axis=-1) / whole
        return np.log(whole / tau) + most[..., 0] - _LOG_ROOT_TWO_PI, mean, variance

    def _mode(self, level: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mode of a_p at each level (draws, levels, raters), and the normal approximation's width there."""
        margin = 10.0 * self.spread[:, :, None]
        inner = (self.place - 10.0 * self.sign * self.spread)[:, None]
        # the mode lies between the level and the flat part of the density
        least = np.minimum(np.minimum.reduceat(inner, self.first, axis=2), level) - margin
        most = np.maximum(np.maximum.reduceat(inner, self.first, axis=2), level) + margin
        a, inverse = level.copy(), 1.0 / self.tau[:, :, None] ** 2
        for _ in range(_MODE_STEPS):
            _, slope, bend = (one[..., 0] for one in self.slopes(a[..., None]))
            precision = np.maximum(-bend, 0.0) + inverse
            step = (slope - (a - level) * inverse) / precision
            if (np.abs(step) * np.sqrt(precision) < _SETTLED).all():
                break
            a = np.clip(a + step, least, most)
        return a, precision**-0.5


def panels_about(mode: FloatArray, width: FloatArray, reach: FloatArray, resolution: Resolution) -> FloatArray:
    """Return edges of panels about modes (...), whose lengths grow geometrically, shape (..., edges)."""
    least = NEAREST * width
    ratio = np.maximum(reach / least, 1.0)[..., None] ** np.linspace(0.0, 1.0, resolution.panels)
    offset = least[..., None] * ratio
    return mode[..., None] + np.concatenate([-offset[..., ::-1], np.zeros((*mode.shape, 1)), offset], axis=-1)


def nodes_of(edges: FloatArray, resolution: Resolution) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights over panels with sorted edges (..., edges), each (..., nodes)."""
    x, weight = np.polynomial.legendre.leggauss(resolution.nodes)
    half, middle = 0.5 * np.diff(edges), 0.5 * (edges[..., 1:] + edges[..., :-1])
    shape = (*half.shape[:-1], -1)
    points = (middle[..., None] + half[..., None] * x).reshape(shape)
    return points, (half[..., None] * weight).reshape(shape)


class WalledIntegrals(RaterIntegrals):
    """The integrals for a table in which some raters' intervals all have an infinite end."""

    def modes(self, given: RowParameters, settled: float, single: bool = False) -> ScaleModes:
        """Return the modes, with such raters' mean and variance given the level in place of mode and curvature."""
        found = super().modes(given, settled, single)
        walls, own = self._walls(given), self.walled
        tau = walls.tau
        curvature, pull, shrink, a = (v.copy() for v in (found.curvature, found.pull, found.shrink, found.a))
        prior, mu = self.sd**-2.0, found.mu
        rest = np.delete(shrink * curvature, own, axis=1).sum(axis=1, keepdims=True) + prior
        drawn = np.delete(shrink * pull, own, axis=1).sum(axis=1, keepdims=True) + self.mean * prior
        digits = tau > _NO_SPREAD * given.spread / np.sqrt(walls.rows)
        for _ in range(_LEVEL_STEPS):
            _, mean, variance = (one[:, 0] for one in walls.integrated(mu))
            part = np.clip(variance, 1e-12, 1.0 - 1e-12)
            shrink[:, own] = np.where(digits, part, found.shrink[:, own])
            precise = np.where(digits, (1.0 - part) / tau**2, (found.shrink * found.curvature)[:, own])
            steep = np.where(digits, mean / tau, (shrink * (pull - curvature * mu))[:, own])
            precision = rest + precise.sum(axis=1, keepdims=True)
            before, mu = mu, (drawn + (steep + precise * mu).sum(axis=1, keepdims=True)) / precision
            if (np.abs(mu - before) * np.sqrt(precision) < _SETTLED).all():
                break
        curvature[:, own] = precise / shrink[:, own]
        pull[:, own] = (steep + precise * before) / shrink[:, own]
        a[:, own] = before + tau * mean
        slopes = tuple(one.copy() for one in found.slopes)
        at = found.at.copy()
        at[:, own] = a[:, own]
        for one in slopes[3:]:
            one[:, own] = 0.0  # these raters need no expansion
        return ScaleModes(at, slopes, a, pull, curvature, shrink, mu, precision**-0.5, walls)

    def least_curvature(self, given: RowParameters, a: FloatArray, slope: FloatArray) -> FloatArray:
        """Equivalent of `RaterIntegrals.least_curvature`; a step towards a wall does not go beyond it.

        Beyond a wall, heavy tails are hardly curved, and on its flat side nothing is.
        """
        found = np.broadcast_to(super().least_curvature(given, a, slope), a.shape).copy()
        low, high = innermost(given, self.first)
        distance = np.maximum(np.maximum(a - high, low - a), given.spread)
        found[:, self.walled] = (np.abs(slope) / distance)[:, self.walled]
        return found

    def curve(
        self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature
    ) -> Callable[[FloatArray], FloatArray]:
        """Equivalent of `RaterIntegrals.curve`, from tables for raters with a wall."""
        others, walls = super().curve(given, modes, quadrature), self._walls_of(given, modes, quadrature)

        def evaluate(a: FloatArray) -> FloatArray:
            found = others(a)
            own = a.reshape(a.shape[0], -1, *a.shape[-2:])[:, :, self.walled]
            found[..., self.walled, :] = walls.slopes(own, 1)[0].reshape(*a.shape[:-2], *own.shape[-2:])
            return found

        return evaluate

    def at_levels(
        self,
        given: RowParameters,
        modes: ScaleModes,
        curve: Callable[[FloatArray], FloatArray],
        level: FloatArray,
        quadrature: Quadrature,
    ) -> FloatArray:
        """Equivalent of `RaterIntegrals.at_levels`."""
        found = super().at_levels(given, modes, curve, level, quadrature)
        found[..., self.walled] = self._walls_of(given, modes, quadrature).integrated(level)[0]
        return found

    def at_walls(self, given: RowParameters) -> Callable[[FloatArray], FloatArray]:
        """Equivalent of `RaterIntegrals.at_walls`."""
        walls, one_sided = self._walls(given), ~self._boxes.both[self.walled]
        return lambda level: walls.integrated(level)[0][..., one_sided]

    def _summed_at_once(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        if self.walled.size < self.count.size:
            levels = max(quadrature.levels, LEAST_LEVELS)
            return super()._summed_at_once(given, modes, quadrature._replace(levels=levels))
        # only the prior of the level and walls are left
        walls = self._walls_of(given, modes, quadrature)
        few, resolution = walls.distinct(), walls.resolution
        times = np.bincount(walls.kind)
        reach = FARTHEST * self.sd + np.abs(modes.mu - self.mean)
        edges = panels_about(modes.mu, modes.sd, reach, resolution)[:, 0]
        width = np.hypot(given.tau, given.spread)
        around = (few.place[..., None] + (few.sign * width)[..., None] * EDGES).reshape(len(edges), -1)
        edges = np.sort(np.hstack([edges, np.clip(around, edges[:, :1], edges[:, -1:])]), axis=-1)
        level, weight = nodes_of(edges, resolution)
        size = level.shape[1] * few.rows.size * resolution.nodes * (edges.shape[1] - 1)
        each = [few.part(one).integrated(level[one])[0] @ times for one in blocks(len(level), size)]
        with np.errstate(divide="ignore"):
            terms = np.concatenate(each) + self.log_prior(level) + np.log(weight)
        return log_sum(terms, axis=-1)

    def _walls_of(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> Walls:
        """Return the tables with which the modes were found, or finer ones."""
        usual = modes.tables if isinstance(modes.tables, Walls) else None
        if usual is None or quadrature.points == FINEST.points:
            return self._walls(given, FINER)
        return usual

    def _walls(self, given: RowParameters, resolution: Resolution = USUAL) -> Walls:
        """Return the tables of the raters with a wall."""
        rows = np.flatnonzero(np.isin(self.rater, self.walled) & (self._times > 0))
        upper = np.isinf(given.rows.low.reshape(-1, self.rater.size)[0, rows])
        rows = rows[np.lexsort((upper, self.rater[rows]))]
        ends = given.rows.take(rows)
        upper = np.isinf(ends.low.reshape(-1, rows.size)[0])
        key = 2 * self.rater[rows] + upper
        first = np.flatnonzero(np.diff(key, prepend=-1))
        side = np.cumsum(np.diff(key, prepend=key[0]) != 0)
        sign, rater = np.where(upper[first], 1.0, -1.0), np.searchsorted(self.walled, self.rater[rows][first])
        drive = given.drive[:, rows]
        edge = np.where(upper, ends.high, ends.low) - drive
        place = sign * np.minimum.reduceat(sign[side] * edge, first, axis=-1)
        points = place[:, None] + given.spread[:, None] * sign * resolution.at[:, None]
        each = two_derivatives_beyond(
            self.law,
            ends.at_points(),
            drive[:, None] + points[..., side],
            given.spread[:, None],
            given.parameters.at_points(),
        )
        value, slope, bend = (np.add.reduceat(one * self._times[rows], first, axis=-1) for one in each)
        coefficients = _polynomials(resolution.at, *(np.moveaxis(one, 1, 2) for one in (value, slope * sign, bend)))
        start = np.flatnonzero(np.diff(rater, prepend=-1))
        raters = self.count[self.walled]
        tau = np.maximum(given.tau, _LEAST_TAU * given.spread)
        own = np.split(np.arange(rows.size), np.flatnonzero(np.diff(self.rater[rows])) + 1)
        kind = _numbered([(drive[:, k], ends.take(k), self._times[rows[k]]) for k in own])
        return Walls(place, sign, rater, start, coefficients, resolution, given.spread, tau, raters, kind)


def _numbered(laws: list[tuple[FloatArray, Rows, FloatArray]]) -> IndexArray:
    """Return numbers of laws in order of appearance, equal ones for equal drives, intervals and multiplicities."""
    keys = [b"".join(np.ascontiguousarray(one).tobytes() for one in (drive, *rows, n)) for drive, rows, n in laws]
    number = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    return np.array([number[key] for key in keys])


def _polynomials(at: FloatArray, value: FloatArray, slope: FloatArray, bend: FloatArray) -> FloatArray:
    """Return coefficients of the quintics through values and two derivatives (..., points)."""
    step = np.diff(at)
    c0, c1, c2 = value[..., :-1], step * slope[..., :-1], 0.5 * step**2 * bend[..., :-1]
    one = value[..., 1:] - c0 - c1 - c2
    two = step * slope[..., 1:] - c1 - 2.0 * c2
    three = step**2 * bend[..., 1:] - 2.0 * c2
    inner = [c0, c1, c2, 10.0 * one - 4.0 * two + 0.5 * three, 7.0 * two - 15.0 * one - three]
    inner.append(6.0 * one - 3.0 * two + 0.5 * three)
    last = [value[..., -1:], slope[..., -1:], 0.5 * bend[..., -1:]]
    last += [np.zeros_like(last[0])] * 3
    return np.stack([np.concatenate(pair, axis=-1) for pair in zip(inner, last, strict=True)])
