"""Ratings of any error law with their common mean and raters' scales integrated out by quadrature (model.md 9).

Given the level mu, raters are independent: a_p = mu + tau zeta with zeta ~ N(0, 1), and a rater's rows have the log
density l_p(a_p). Newton's method finds the mode of all a_p and mu together. About it l_p is a polynomial: by its first
four derivatives there (`quadrature.FAST`), or through values at Chebyshev points (`quadrature.FINE`). Gauss-Hermite
rules about the modes then integrate each rater's zeta and the level.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.likelihood import curvatures, several_maxima
from softness_bayes.likelihood.box_integrals import POINTS, Boxes
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.interval_law import log_probability, of_rows, scaled_derivatives
from softness_bayes.likelihood.mu_nodes import draw_on, log_sum
from softness_bayes.likelihood.narrow_rows import NarrowRows
from softness_bayes.likelihood.pieces import blocks
from softness_bayes.likelihood.quadrature import FAST, FINE, ROUGHLY, Quadrature, gauss_hermite, to_chebyshev
from softness_bayes.likelihood.rater_grids import REACH, Part, law_of_others
from softness_bayes.likelihood.rater_rows import Kept, RowParameters, WidthGroup, groups_by_width, of_two_kinds
from softness_bayes.likelihood.row_columns import ROOM, in_columns
from softness_bayes.likelihood.scale_modes import ScaleModes, over_scales, series
from softness_bayes.likelihood.scale_starts import Start, Starts

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

LEVELS = 33
"""Number of levels at which the level's density is computed to draw from it."""

FOUR, SIX, FEW = 0.02, 0.1, 0.5
"""Largest `ScaleModes.truncation` for which an expansion has four derivatives, and six. With lapses it always has six,
because one lapse more or less changes the higher ones. Beyond, `ROUGHLY` is used, and beyond the third limit `FINE`.
Over draws of the prior of 1080 ratings of 30 raters, errors are then below 1e-3."""

SMOOTH = 0.4
"""Largest `ScaleModes.bend` for which effects are drawn by `FAST`; their grids reach twice as far as the nodes of the
integrals. Of the distributions from which raters' scales are drawn, the total variation distance from exact ones was
at most 1.5e-3 by `FAST` below this limit, and 5e-4 by `ROUGHLY` from here to `ROUGH` (150 prior draws for each error
law)."""
ROUGH = 1.0
"""Largest `ScaleModes.bend` for which they are drawn by `ROUGHLY`, beyond which by `FINE`."""

HEADROOM = 1.0
"""Largest excess of the log density between Chebyshev points over that at them."""

_STEPS = 12  # limit for Newton's method
_LEAST_CURVATURE = 0.1  # in Newton steps, relative to that of as many normal errors
_NO_CURVATURE = 0.002  # same ratio, for the normal approximation about the mode
_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class RaterIntegrals:
    """The integrals over the level and raters' scales for one table of ratings.

    Parameters
    ----------
    law
        Law of the errors.
    rater
        Index of the rater of each row, rows sorted by it, without gaps.
    weight
        Weight of each row where Newton's method starts, shape (rows,).
    mean, sd
        Prior of the level.
    width
        Widths of the rows' intervals, infinite if an end is, shape (rows,); rows of similar width are grouped.
    times
        Multiplicity of each row, shape (rows,): the first of several rows with equal rater, condition and interval has
        their number, the others have 0.
    ends
        True for rows whose interval has a finite lower (upper) end, each (rows,).
    """

    def __init__(
        self,
        law: ErrorLaw,
        rater: IndexArray,
        weight: FloatArray,
        mean: float,
        sd: float,
        width: FloatArray,
        times: FloatArray,
        ends: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    ) -> None:
        self.law, self.rater, self.mean, self.sd = law, rater, mean, sd
        self.first = np.flatnonzero(np.diff(rater, prepend=-1))
        self.sizes = np.diff(np.append(self.first, rater.size))
        self.count = self.sizes.astype(float)
        self._boxes = Boxes(self.first, *ends)
        self._groups = groups_by_width(rater, width, times)
        # where a search starts an interval counts as its midpoint, unless an end is infinite
        closed = np.isfinite(width)
        self.widest = float(width.max(initial=0.0, where=closed))
        certain = np.where(closed, 1.0 / (1.0 + np.where(closed, width, 0.0) ** 2), 0.0)
        self.weight = weight * certain
        """Weight of each row's midpoint where a search starts; 0 if an end is infinite."""
        self.walled = np.flatnonzero(self.of_raters(self.weight) == 0.0)
        self._times, self._closed, self._exact = times, closed, bool((width == 0.0).all())
        self._some: Kept[list[WidthGroup]] = Kept()
        self._columns = in_columns(rater, times)
        self._narrow = NarrowRows(law, self._columns)
        self._starts = Starts(law, self._columns, self.weight, certain, of_two_kinds(rater, closed, ~closed, times))
        self._orders = 6 if law.lapses else 4

    def of_raters(self, values: FloatArray) -> FloatArray:
        """Return the sums of rows by rater, shape (..., raters)."""
        return np.add.reduceat(values, self.first, axis=-1, dtype=float)

    def log_prior(self, level: FloatArray) -> FloatArray:
        """Return the log prior density of the level, same shape."""
        return -0.5 * ((level - self.mean) / self.sd) ** 2 - math.log(self.sd) - _LOG_ROOT_TWO_PI

    def modes(self, given: RowParameters, settled: float, single: bool = False) -> ScaleModes:
        """Return the mode of all scales and the level by Newton's method, each draw until it converges.

        Parameters
        ----------
        given
            Parameters.
        settled
            As in `Quadrature`.
        single
            True for the expansion of the integrals themselves, in single precision where that is enough.
        """
        orders = self._orders if single else 4
        single = single and given.in_single(self.law, self.widest)
        start = self._starts.near(self, given, single)
        a, slopes = start.a.copy(), self._slopes_near(given, start.a, start, single, orders)
        at, active = start.a, np.arange(len(a))
        step = self._steepest(given, a, slopes)
        for _ in range(_STEPS - 1):
            moved = (np.abs(step.a - a[active]) / step.width).max(axis=-1) > settled
            if not moved.any():
                break
            a[active] = step.a
            active = active[moved]
            part, at[active] = given.part(active), a[active]
            slopes[:, active] = self._slopes_near(part, a[active], start.part(active), single, orders)
            step = self._steepest(part, a[active], slopes[:, active])
        return self._about(given, at, slopes)

    def _about(self, given: RowParameters, at: FloatArray, slopes: FloatArray) -> ScaleModes:
        """Return the modes, given l_p and its derivatives at points near them."""
        curvature = np.maximum(-slopes[2], _NO_CURVATURE * self.count / given.spread**2)
        return self.step(given, at, slopes[1], curvature, tuple(slopes))

    def _slopes_near(self, given: RowParameters, a: FloatArray, start: Start, single: bool, orders: int) -> FloatArray:
        """Return the same as `_slopes`, with narrow intervals by their series."""
        served = orders == 4 and self.law.averaged is not None
        if not served or not (single or (self._exact and self.law != NORMAL)):
            return self._slopes(given, a, single, orders)
        found = np.empty((1 + orders, *a.shape))
        for block in blocks(len(a), self._columns.rows.size, ROOM):
            part, here = given.part(block), a[block]
            narrow = self._narrow.slopes(part, start.part(block), here)
            if narrow is None:
                found[:, block] = self._slopes(part, here, single)
                continue
            each, others = narrow
            if others.any():
                groups = self._some(others, partial(of_two_kinds, self.rater, self._closed, others, self._times))
                self._add_slopes(each, part, here, groups, single, wide=True)
            found[:, block] = each / _powers(part.spread, orders)
        return found

    def _slopes(self, given: RowParameters, a: FloatArray, single: bool = False, orders: int = 4) -> FloatArray:
        """Return l_p and its first derivatives at a_p (draws, raters), shape (1 + orders, draws, raters)."""
        found = np.zeros((1 + orders, *a.shape))
        self._add_slopes(found, given, a, self._groups, single)
        found /= _powers(of_rows(given.spread, self.first), orders)
        return found

    def _add_slopes(
        self,
        found: FloatArray,
        given: RowParameters,
        a: FloatArray,
        groups: Sequence[WidthGroup],
        single: bool,
        wide: bool = False,
    ) -> None:
        """Add the value and its derivatives with respect to a_p in spreads, for groups of rows."""
        for group in groups:
            for block in blocks(len(a), group.size):
                part = given.part(block)
                expected = group.of_rows(a[block])
                expected += part.drive[:, group.rows]
                rows, spread = part.rows.take(group.rows), of_rows(part.spread, group.rows)
                orders = len(found) - 1
                each = scaled_derivatives(self.law, rows, expected, spread, part.parameters, single, orders, wide)
                found[: len(each), block, group.raters] += group.sums(each)

    def _steepest(self, given: RowParameters, a: FloatArray, slopes: FloatArray) -> ScaleModes:
        """Return a Newton step, for l_p that far from its mode may not be concave if errors have heavy tails."""
        least = self.least_curvature(given, a, slopes[1])
        return self.step(given, a, slopes[1], np.maximum(-slopes[2], least))

    def least_curvature(self, given: RowParameters, a: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the smallest curvature of l_p for a Newton step from a_p, given its slope there, (draws, raters)."""
        return np.asarray(_LEAST_CURVATURE * self.count / given.spread**2)

    def step(
        self,
        given: RowParameters,
        a: FloatArray,
        slope: FloatArray,
        curvature: FloatArray,
        slopes: tuple[FloatArray, ...] = (),
    ) -> ScaleModes:
        """Return the mode of all scales and the level for quadratic l_p of that slope and curvature at a_p."""
        prior, variance = self.sd**-2.0, given.tau**2
        pull = slope + curvature * a
        shrink = 1.0 / (1.0 + variance * curvature)
        precision = prior + (shrink * curvature).sum(axis=-1, keepdims=True)
        mu = (self.mean * prior + (shrink * pull).sum(axis=-1, keepdims=True)) / precision
        return ScaleModes(a, slopes, shrink * (mu + variance * pull), pull, curvature, shrink, mu, precision**-0.5)

    def log_density(self, given: RowParameters, quadrature: Quadrature) -> FloatArray:
        """Return the log density of all rows, shape (draws,)."""
        modes, few = self.modes(given, quadrature.settled, quadrature.fast), quadrature.points == 0
        none = np.zeros(len(given.drive), dtype=bool)
        several = curvatures.may_have_several_maxima(self, given, modes) if quadrature.maxima else none
        boxed, truncation = self._boxes.needed(given, lambda: modes.bend), modes.truncation
        six = few & ((truncation > FOUR) | curvatures.have_other_sixth(self, given, modes)) & (self._orders < 6)
        rough = few & (truncation > (FOUR if self.walled.size else SIX))
        if not (several.any() or boxed.any() or rough.any() or six.any()):
            return self._summed(given, modes, quadrature)
        found, left = np.empty(boxed.size), np.ones(boxed.size, dtype=bool)
        for chosen, how in (
            (several, self._of_several_maxima),
            (boxed, self._on_points),
            (rough, self._on_few_points),
            (six, self._with_six_derivatives),
            (left, self._summed),
        ):
            now = chosen & left
            if now.any():
                found[now] = how(given.part(now), modes.part(now), quadrature)
            left = left & ~now
        return found

    def _of_several_maxima(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        return several_maxima.log_density(self, given, reference=quadrature.points > 0)

    def _with_six_derivatives(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        return self._summed(given, self._about(given, modes.a, self._slopes(given, modes.a, orders=6)), quadrature)

    def _on_few_points(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        few = modes.truncation <= FEW
        found = np.empty(few.size)
        for chosen, how in ((few, ROUGHLY), (~few, FINE)):
            if chosen.any():
                part = given.part(chosen)
                found[chosen] = self._summed(part, self.modes(part, how.settled), how)
        return found

    def _on_points(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        finer = 1.0 + quadrature.points / FINE.points
        width, found = given.tau * np.sqrt(modes.shrink), np.empty(len(given.drive))
        for one in blocks(len(found), POINTS * self.count.size):
            found[one] = self._boxes.log_density(self, given.part(one), modes.a[one], width[one], finer)
        return found

    def at_walls(self, given: RowParameters) -> Callable[[FloatArray], FloatArray]:
        """Return a function of levels: log densities of the raters whose intervals have one finite end each."""
        raise NotImplementedError  # only `walled_integrals` has such raters

    def _summed(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        width = quadrature.levels * quadrature.scales * self.count.size
        every = blocks(len(given.drive), width)
        return np.concatenate([self._summed_at_once(given.part(one), modes.part(one), quadrature) for one in every])

    def _summed_at_once(self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature) -> FloatArray:
        x, log_weight = gauss_hermite(quadrature.levels)
        level = modes.mu + modes.sd * x
        if quadrature.points or self.walled.size:
            each = self.at_levels(given, modes, self.curve(given, modes, quadrature), level, quadrature).sum(axis=-1)
        else:
            single = given.in_single(self.law, self.widest)
            each = over_scales(modes, given.tau, quadrature.levels, quadrature.scales, single)
        if not quadrature.points:
            each = each + self._sixth(given, modes)
        terms = each + self.log_prior(level) + log_weight + np.log(modes.sd)
        return log_sum(terms, axis=-1)

    def _sixth(self, given: RowParameters, modes: ScaleModes) -> FloatArray | float:
        """Return the mean effect of sixth derivatives that an expansion of four lacks, (draws, 1), from the fourth."""
        ratio = self.law.sixth_over_fourth
        if ratio is None or len(modes.slopes) > 5:
            return 0.0
        return curvatures.effect_of_sixth(ratio(given.parameters), given, modes, modes.slopes[4])[:, None]

    def at_levels(
        self,
        given: RowParameters,
        modes: ScaleModes,
        curve: Callable[[FloatArray], FloatArray],
        level: FloatArray,
        quadrature: Quadrature,
    ) -> FloatArray:
        """Return each rater's log density at levels (draws, levels), shape (draws, levels, raters)."""
        x, log_weight = gauss_hermite(quadrature.scales)
        here, tau = level[..., None], given.tau[..., None]
        centre = tau * modes.shrink[:, None] * (modes.pull[:, None] - modes.curvature[:, None] * here)
        zeta = centre[..., None] + np.sqrt(modes.shrink)[:, None, :, None] * x
        value = curve(here[..., None] + tau[..., None] * zeta) - 0.5 * zeta**2
        found = log_sum(value + (log_weight - _LOG_ROOT_TWO_PI), axis=-1)
        return np.asarray(found + 0.5 * np.log(modes.shrink)[:, None])

    def curve(
        self, given: RowParameters, modes: ScaleModes, quadrature: Quadrature
    ) -> Callable[[FloatArray], FloatArray]:
        """Return l_p as a function of a_p, from arrays (draws, ..., raters, nodes) to the same shape."""
        if not quadrature.points:
            return series(modes)
        x = np.cos(np.pi * (np.arange(quadrature.points) + 0.5) / quadrature.points)
        width = REACH * modes.width
        values = self.values(given, modes.a[:, None] + x[:, None] * width[:, None])
        # between points that do not resolve the function the polynomial may become arbitrarily large
        most = values.max(axis=1)
        coefficients = np.moveaxis(to_chebyshev(quadrature.points) @ values, 1, 0)

        def evaluate(a: FloatArray) -> FloatArray:
            between = (1,) * (a.ndim - 3)
            centre, reach = (v.reshape(v.shape[0], *between, v.shape[1], 1) for v in (modes.a, width))
            each = coefficients.reshape(len(coefficients), *centre.shape)
            at = np.clip((a - centre) / reach, -1.0, 1.0)
            found = chebyshev.chebval(at, each, tensor=False)
            return np.minimum(found, most.reshape(centre.shape) + HEADROOM)

        return evaluate

    def values(self, given: RowParameters, a: FloatArray) -> FloatArray:
        """Return l_p at points (draws, points, raters), of the same shape."""
        found = np.zeros(a.shape)
        for group in self._groups:
            for block in blocks(len(a), a.shape[1] * group.size):
                part = given.part(block)
                for points in blocks(a.shape[1], group.size * (block.stop - block.start)):
                    each = self._row_values(part, group.of_rows(a[block, points]), group.rows)
                    found[block, points, group.raters] += group.of_raters(each)
        return found

    def row_values(self, given: RowParameters, a: FloatArray) -> FloatArray:
        """Return the log probability of every row at a_p (draws, points, raters), shape (draws, points, rows)."""
        return self._row_values(given, a[..., self.rater], slice(None))

    def _row_values(self, given: RowParameters, a: FloatArray, rows: IndexArray | slice) -> FloatArray:
        parameters, intervals = given.parameters.at_points(), given.rows.take(rows).at_points()
        expected = given.drive[:, None, rows] + a
        return log_probability(self.law, intervals, expected, of_rows(given.spread, rows)[:, None], parameters)

    def law_of_others(self, given: RowParameters) -> tuple[FloatArray, FloatArray]:
        """Return points of a_p and their log weights given all other raters' rows, as `rater_grids.law_of_others`."""
        return law_of_others(self, given, self.modes(given, FINE.settled))

    def parts(self, given: RowParameters) -> Iterator[Part]:
        """Return sets of points at which rows and raters are left out: here one."""
        yield Part(given, *self.law_of_others(given))

    def draw(
        self, rng: np.random.Generator, given: RowParameters, quadrature: Quadrature
    ) -> tuple[FloatArray, FloatArray]:
        """Return draws of the level, (draws, 1), and of a_p less the level, (draws, raters), given all rows."""
        modes = self.modes(given, quadrature.settled)
        found = np.empty((len(given.drive), 1 + self.count.size))
        # the grids extend beyond the range of the integrals, so the expansion must be accurate farther out
        few_rows = quadrature.points > 0
        smooth, rough = (modes.bend < SMOOTH) & (not few_rows), (modes.bend > ROUGH) | few_rows
        for chosen, how in ((smooth, FAST), (~(smooth | rough), ROUGHLY), (rough, FINE)):
            if chosen.any():
                found[chosen] = self._drawn(rng, given.part(chosen), modes.part(chosen), how)
        return found[:, :1], found[:, 1:]

    def _drawn(
        self, rng: np.random.Generator, given: RowParameters, modes: ScaleModes, quadrature: Quadrature
    ) -> FloatArray:
        curve = self.curve(given, modes, quadrature)
        level = modes.mu + modes.sd * np.linspace(-REACH, REACH, LEVELS)
        each = self.at_levels(given, modes, curve, level, quadrature)
        mu = draw_on(rng, level, each.sum(axis=-1) + self.log_prior(level))[:, None]
        centre = given.tau * modes.shrink * (modes.pull - modes.curvature * mu)
        x = np.linspace(-REACH, REACH, 2 * LEVELS)
        zeta = centre[..., None] + x * np.sqrt(modes.shrink)[..., None]
        value = curve(mu[..., None] + given.tau[..., None] * zeta) - 0.5 * zeta**2
        return np.concatenate([mu, given.tau * draw_on(rng, zeta, value)], axis=-1)


def _powers(spread: FloatArray, orders: int) -> FloatArray:
    """Return powers of a spread (draws, ...) from 0 on, (1 + orders, draws, ...)."""
    return np.cumprod([np.ones_like(spread), *[spread] * orders], axis=0)
