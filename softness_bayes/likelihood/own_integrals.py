"""Ratings of any error law whose raters have exponents or noise of their own, integrated by quadrature (model.md 9).

Given the level mu, raters are independent. Rows of rater p have the expectation a_p + g_p D_i, with a_p = mu + tau
zeta, g_p = exp(tau_gamma u) and D the drive, and errors of spread varsigma exp(tau_varsigma w); zeta, u and w are
standard normal. Nodes of u and w lie about each rater's mode. At each node of w, the log density of a rater's rows is a
polynomial in a_p and g_p, whose coefficients are sums of the rows' derivatives times powers of D: one pass over the
rows serves all nodes of u. For each node, zeta is then integrated, with derivatives in the level, as in
`rater_integrals`; the nodes are added up, raters multiplied, and the level integrated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.interval_law import of_rows, scaled_derivatives
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.own_draws import draw_effects
from softness_bayes.likelihood.own_expansions import (
    Moments,
    OwnNodes,
    flattened,
    part_of_moments,
    placed_anew,
    recentred,
    summed_over_nodes,
    truncation,
)
from softness_bayes.likelihood.own_laws import OwnLaw, factor
from softness_bayes.likelihood.own_left_out import adaptive_parts
from softness_bayes.likelihood.own_search import OwnSearch
from softness_bayes.likelihood.pieces import blocks
from softness_bayes.likelihood.quadrature import FAST, FINE, FINEST, ROUGHLY, SAMPLING, Quadrature, gauss_hermite
from softness_bayes.likelihood.rater_grids import Part
from softness_bayes.likelihood.rater_integrals import FOUR, SIX, RaterIntegrals
from softness_bayes.likelihood.rater_rows import RowParameters
from softness_bayes.likelihood.scale_modes import ScaleModes, each_over_scales, taylor

FloatArray = NDArray[np.float64]

NODES: Mapping[Quadrature, tuple[int, int]] = MappingProxyType(
    {FAST: (7, 7), SAMPLING: (7, 7), ROUGHLY: (7, 7), FINE: (13, 11), FINEST: (21, 15)}
)
"""Nodes of a rater's exponent and of the noise, by the resolution of the other integrals."""

TAILS, LAPSES = (9, 7), (9, 11)
"""The same in place of the first for errors with heavy tails, and with lapses."""

_MOST_BENT = 0.8  # largest change of the spacing of nodes, relative to that at the mode
_HEADROOM = 3.0  # largest log density of a node, relative to the mode, beyond that of a normal law
_PLACINGS = 3  # times that nodes are placed, at most
_SEARCH = 2  # Newton steps towards the mode of a scale at each node
_NO_CURVATURE = 0.002  # smallest curvature, relative to that of as many normal errors
_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Bends(NamedTuple):
    """Third over three times the second derivative of each rater's log density in u and in w, each (draws, raters).

    In w it is that of a sum of squares; both are of the rows and the prior together.
    """

    u: FloatArray
    w: FloatArray


class OwnIntegrals(RaterIntegrals):
    """The integrals over the level and raters' scales, exponents and noise for one table of ratings.

    Parameters
    ----------
    differ
        The quantities that differ between raters: gamma, varsigma or both.
    others
        As for `RaterIntegrals`.
    """

    def __init__(self, differ: tuple[str, ...], *others: Any) -> None:
        super().__init__(*others)
        self.differ, self.noisy = differ, "varsigma" in differ
        width, times = others[5:7]
        self.search = OwnSearch(self, np.zeros(self.rater.size, int), 1, width, times)

    def counts(self, quadrature: Quadrature) -> tuple[int, int]:
        """Return the numbers of nodes of exponents and of noise."""
        exponents, noises = NODES[quadrature]
        if quadrature.fast and self.law != NORMAL:
            exponents, noises = LAPSES if self.law.lapses else TAILS
        return exponents if "gamma" in self.differ else 1, noises if self.noisy else 1

    def normal(self, given: RowParameters, quadrature: Quadrature) -> OwnLaw:
        """Return the normal law of all effects about their joint mode."""
        law: OwnLaw = self.search.normal(given, quadrature.settled, quadrature.fast)
        return law

    def nodes(self, law: OwnLaw, bends: Bends, quadrature: Quadrature) -> Iterator[OwnNodes]:
        """Return the nodes about a law, one of w at a time."""
        (x, weight_x), (z, weight_z) = (gauss_hermite(count) for count in self.counts(quadrature))
        own, cov = law.mean, law.covariance
        ww, uw, uu = cov[..., 2, 2], cov[..., 1, 2], cov[..., 1, 1]
        every_w = _unskewed(np.sqrt(ww), bends.w, z)
        every_u = _unskewed(np.sqrt(np.maximum(uu - uw**2 / ww, 0.01 * uu)), bends.u, x)
        for moved, log_size, log_weight in zip(*every_w, weight_z, strict=True):
            w, u = own.w + moved, own.u + uw / ww * moved + every_u[0]
            weight = (log_weight + weight_x)[:, None, None] + log_size + every_u[1]
            yield OwnNodes(u, w[None], weight - 0.5 * (u * u + w * w) - 2.0 * _LOG_ROOT_TWO_PI)

    def bends(self, given: RowParameters, law: OwnLaw, moments: Moments | None = None) -> Bends:
        """Return the asymmetry of each rater's log density, from its moments at the mean of the law."""
        spreads, own, cov = given.own, law.mean, law.covariance
        assert spreads is not None
        of_noise = -2.0 / 3.0 * spreads.noise * (1.0 - np.minimum(cov[..., 2, 2], 1.0))
        if "gamma" not in self.differ:
            return Bends(np.zeros(own.u.shape), of_noise)
        m = moments or self.moments_at(given, law)
        one = spreads.exponent * factor(spreads.exponent * own.u)
        along = given.tau * cov[..., 0, 1] / cov[..., 1, 1]  # change of a_p with u
        third = sum(math.comb(3, j) * m[3][j] * along ** (3 - j) * one**j for j in range(4))
        third = third + spreads.exponent * one * (3.0 * (m[2][1] * along + m[2][2] * one) + spreads.exponent * m[1][1])
        return Bends(-np.asarray(third) * cov[..., 1, 1] / 3.0, of_noise)

    def log_density(self, given: RowParameters, quadrature: Quadrature) -> FloatArray:
        """Return the log density of all rows, shape (draws,)."""
        law = self.normal(given, quadrature)
        if quadrature.points:
            return self._by_points(given, law, quadrature)
        single, found = given.in_single(self.law, self.widest), np.empty(len(given.drive))
        moments = self.moments_at(given, law, self._orders, single)
        of_scale, of_exponent = truncation(given, law, moments)
        # one lapse more or less changes the higher derivatives
        few, both = not self.law.lapses, of_scale + of_exponent
        left = np.ones(found.size, bool)
        for orders, each, chosen in (
            (4, False, few & (both <= FOUR)),
            (6, False, few & (both <= SIX)),
            (4, True, few & (of_scale <= SIX)),
            (6, True, of_scale <= SIX),
        ):
            some = np.flatnonzero(chosen & left)
            if some.size:
                parts = part_of_moments(moments, some) if orders == self._orders else None
                found[some] = self._by_derivatives(given.part(some), law.part(some), quadrature, orders, each, parts)
                left[some] = ~np.isfinite(found[some])
        rough = np.flatnonzero(left)
        if rough.size:
            part = given.part(rough)
            found[rough] = self._by_points(part, self.normal(part, ROUGHLY), ROUGHLY)
        return found

    def _by_derivatives(
        self,
        given: RowParameters,
        law: OwnLaw,
        quadrature: Quadrature,
        orders: int,
        each: bool,
        moments: Moments | None = None,
    ) -> FloatArray:
        """Return the log density of all rows by expansions, (draws,); NaN where these are of no use.

        Parameters
        ----------
        given, law, quadrature
            As for `log_density`.
        orders
            Number of derivatives.
        each
            True to expand about each node, False to expand about the mode for all nodes of u.
        moments
            Those at the mode, if they are known.
        """
        single = given.in_single(self.law, self.widest)
        moments = moments or self.moments_at(given, law, orders, single)
        width, found = quadrature.scales * self.count.size * math.prod(self.counts(quadrature)), []
        for block in blocks(len(given.drive), width):
            part = given.part(block), law.part(block), part_of_moments(moments, block)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found.append(self._expanded(*part, quadrature, each, single))
        return np.concatenate(found)

    def _expanded(
        self, given: RowParameters, law: OwnLaw, moments: Moments, quadrature: Quadrature, each: bool, single: bool
    ) -> FloatArray:
        level, sd, spreads = law.mean.level, law.precision**-0.5, given.own
        assert spreads is not None
        at, g, orders = law.mean.a(given.tau), factor(spreads.exponent * law.mean.u), len(moments) - 1
        along = given.tau * law.covariance[..., 0, 1] / law.covariance[..., 1, 1]
        every, weights = [], []
        for nodes in self.nodes(law, self.bends(given, law, moments), quadrature):
            relative = factor(spreads.noise * nodes.w[0]) if self.noisy else np.ones((1, 1))
            own = factor(spreads.exponent * nodes.u)
            centres = np.broadcast_to(at, own.shape)
            if each:
                # a_p follows the exponent
                centres = at + along * (nodes.u - law.mean.u)
                pairs = zip(centres, own, strict=True)
                parts = [self._moments(given, *one, relative, orders, single, 0) for one in pairs]
                slopes = [np.stack([one[k][0] for one in parts]) for k in range(1 + orders)]
            else:
                here = self._moments(given, at, g, relative, orders, single) if self.noisy else moments
                slopes = [recentred(here, k, own - g) for k in range(1 + orders)]
            count = np.broadcast_to(self.count / (given.spread * relative) ** 2, own.shape)
            flat = [flattened(one) for one in (centres, count, *slopes)]
            modes = _modes(flat[0], flat[2:], flat[1], given.tau, level, sd)
            found = each_over_scales(modes, given.tau, quadrature.scales, single)
            every.append([np.moveaxis(one.reshape(len(at), len(own), -1), 1, 0) for one in found])
            weights.append(nodes.log_weight)
        value, *others = (np.concatenate(one, axis=0) for one in zip(*every, strict=True))
        value = value + np.concatenate(weights, axis=0)
        # where an expansion fails it grows without limit
        of_u, of_w = (weight - 0.5 * x**2 for x, weight in map(gauss_hermite, self.counts(quadrature)))
        normal, middle = (of_w[:, None] + of_u).ravel()[:, None, None], len(value) // 2
        part_of = 0.0 if self.law == NORMAL else 0.5 if each else 1.0
        failed = ~(value <= value[middle] + _HEADROOM + part_of * (normal - normal[middle])).all(axis=(0, -1))
        x, log_weight = gauss_hermite(quadrature.levels)
        terms = taylor(summed_over_nodes(value, *others), sd * x) + self.log_prior(level + sd * x)
        return np.where(failed, np.nan, log_sum(terms + log_weight + np.log(sd), axis=-1))

    def moments_at(self, given: RowParameters, law: OwnLaw, orders: int = 4, single: bool = False) -> Moments:
        """Return the moments at the mean of a law."""
        spreads, own = given.own, law.mean
        assert spreads is not None
        relative = factor(spreads.noise * own.w) if self.noisy else np.ones((1, 1))
        return self._moments(given, own.a(given.tau), factor(spreads.exponent * own.u), relative, orders, single)

    def _moments(
        self,
        given: RowParameters,
        a: FloatArray,
        g: FloatArray,
        relative: FloatArray,
        orders: int,
        single: bool,
        powers: int = 6,
    ) -> Moments:
        """Return the moments at a + g D, with errors of the typical spread times `relative`, up to a power of D."""
        spread, powers = given.spread * relative, powers if "gamma" in self.differ else 0
        found = [[np.zeros(a.shape) for _ in range(1 + k)] for k in range(1 + orders)]
        for group in self._groups:
            for block in blocks(len(a), group.size):
                part = given.part(block)
                drive = part.drive[:, group.rows]
                expected = group.of_rows(g[block]) * drive
                expected += group.of_rows(a[block])
                here = group.of_rows(spread[block]) if self.noisy else spread[block]
                rows = part.rows.take(group.rows)
                each = scaled_derivatives(self.law, rows, expected, here, part.parameters, single, orders)
                drive = drive.astype(each[1].dtype)
                # a law whose higher derivatives are negligible leaves them out
                for k, own in enumerate(each):
                    for j in range(1 + min(k, powers)):
                        own = own * drive if j else own
                        found[k][j][block, group.raters] += group.of_raters(own, exactly=k == 0)
        for k, parts in enumerate(found):
            for one in parts:
                one /= spread**k
        return found

    def draw(
        self, rng: np.random.Generator, given: RowParameters, quadrature: Quadrature
    ) -> tuple[FloatArray, FloatArray]:
        """Return draws of the level, and of a_p less the level, u and w, as `own_draws.draw_effects`."""
        return draw_effects(rng, self, given, self.normal(given, quadrature))

    def parts(self, given: RowParameters) -> Iterator[Part]:
        """Return points of all raters' scales at each node, as `own_left_out.adaptive_parts`."""
        return adaptive_parts(self, given)

    def _by_points(self, given: RowParameters, law: OwnLaw, quadrature: Quadrature) -> FloatArray:
        """Return the log density of all rows, from log densities of raters at points of their scale."""
        width = quadrature.levels * quadrature.scales * self.count.size
        every = blocks(len(given.drive), width)
        return np.concatenate([self._at_once(given.part(one), law.part(one), quadrature) for one in every])

    def _at_once(self, given: RowParameters, law: OwnLaw, quadrature: Quadrature) -> FloatArray:
        found, left = np.empty(len(given.drive)), np.arange(len(given.drive))
        x, log_weight = gauss_hermite(quadrature.levels)
        bends = self.bends(given, law)
        for _ in range(_PLACINGS):
            sd = law.precision**-0.5
            level, every = law.mean.level + sd * x, [*self.nodes(law, bends, quadrature)]
            each, middle = self._at_nodes(given, law, level, every, quadrature)
            terms = each.sum(axis=-1) + self.log_prior(level) + log_weight + np.log(sd)
            found[left] = log_sum(terms, axis=-1)
            law, wrong = placed_anew(law, every, middle)
            if not wrong.any():
                break
            given, law, left = given.part(wrong), law.part(wrong), left[wrong]
            bends = Bends(*np.zeros((2, *law.mean.u.shape)))
        return found

    def at_these_levels(
        self, given: RowParameters, law: OwnLaw, level: FloatArray, quadrature: Quadrature
    ) -> FloatArray:
        """Return each rater's log density at levels (draws, levels), shape (draws, levels, raters)."""
        every = [*self.nodes(law, self.bends(given, law), quadrature)]
        return self._at_nodes(given, law, level, every, quadrature)[0]

    def _at_nodes(
        self, given: RowParameters, law: OwnLaw, level: FloatArray, every: list[OwnNodes], quadrature: Quadrature
    ) -> tuple[FloatArray, FloatArray]:
        """Return the same, and the terms of all nodes at the middle level, (nodes, draws, raters)."""
        found, middle = np.full((*level.shape, self.count.size), -np.inf), []
        for nodes in every:
            for u, log_weight in zip(nodes.u, nodes.log_weight, strict=True):
                own = self.at_node(given, u, nodes.w[0])
                modes = self._modes_at(own, law)
                each = self.at_levels(own, modes, self.curve(own, modes, quadrature), level, quadrature)
                each += log_weight[:, None]
                middle.append(each[:, level.shape[1] // 2])
                np.logaddexp(found, each, out=found)
        return found, np.stack(middle)

    def at_node(self, given: RowParameters, u: FloatArray, w: FloatArray) -> RowParameters:
        """Return the parameters given raters' u and w, each (draws, raters), as of raters who do not differ."""
        spreads = given.own
        assert spreads is not None
        drive = given.drive * factor(spreads.exponent * u)[:, self.rater]
        spread = given.spread * factor(spreads.noise * w)[:, self.rater] if self.noisy else given.spread
        return given._replace(drive=drive, spread=spread, own=None)

    def _modes_at(self, given: RowParameters, law: OwnLaw) -> ScaleModes:
        """Return the modes of raters' scales given the level, near a law."""
        a, level, sd = law.mean.a(given.tau), law.mean.level, law.precision**-0.5
        count = self.count / of_rows(given.spread, self.first) ** 2
        for last in range(_SEARCH, -1, -1):
            slopes = self._slopes(given, a)
            modes = _modes(a, list(slopes), count, given.tau, level, sd, 0.1 if last else _NO_CURVATURE)
            a = modes.a
        return modes


def _unskewed(sd: FloatArray, bend: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return distances of nodes from a mode, and logs of their spacing for unit spacing of x, (nodes, draws, raters).

    They are even in v, with distance log(1 + bend v) / bend, in which the log density has no third derivative.
    """
    v = x[:, None, None] * sd
    most = _MOST_BENT / np.maximum(np.abs(x).max() * sd, 1e-300)
    t = np.clip(bend, -most, most) * v
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(np.abs(t) > 1e-8, np.log1p(t) / t, 1.0 - 0.5 * t)
    return v * ratio, np.log(sd) - np.log1p(t)


def _modes(
    at: FloatArray,
    slopes: list[FloatArray],
    count: FloatArray,
    tau: FloatArray,
    level: FloatArray,
    sd: FloatArray,
    least: float = _NO_CURVATURE,
) -> ScaleModes:
    """Return modes of scales given the level, from log densities expanded about points, each (draws, raters)."""
    curvature = np.maximum(-slopes[2], least * count)
    pull = slopes[1] + curvature * at
    shrink = 1.0 / (1.0 + tau**2 * curvature)
    a = shrink * (level + tau**2 * pull)
    return ScaleModes(at, tuple(slopes), a, pull, curvature, shrink, level, sd)
