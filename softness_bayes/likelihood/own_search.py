"""The joint mode of all effects where raters have exponents or noise of their own, and the normal law about it.

Fabrics' deviations are integrated out by Laplace's method as in `fabric_integrals`, about the integrals over raters'
effects (`own_integrals`). The search is the same without deviations: all rows then belong to one fabric, of omega 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.answer_nodes import AnswerSpreads, RaterStatistics, find_modes
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.fabric_integrals import FabricIntegrals, secants
from softness_bayes.likelihood.fabric_laws import MOST_AVERAGED
from softness_bayes.likelihood.interval_law import scaled_derivatives
from softness_bayes.likelihood.own_laws import OwnLaw, OwnPoint, OwnSums, factor, own_law
from softness_bayes.likelihood.pieces import blocks
from softness_bayes.likelihood.rater_rows import RowParameters, WidthGroup

FloatArray = NDArray[np.float64]

_SETTLED = 0.25  # step after which a search without deviations stops, in standard deviations
_STEP = 0.1  # of the log noise, for differences instead of derivatives
_ROUNDS = 3  # Newton steps of each rater's exponent and noise from midpoints of intervals
_LEAST_CURVATURE = 0.5  # of the rows in a Newton step, relative to their secants
_LEAST_STEP = 0.02  # of the log noise, over which slopes and curvatures are averaged
_THREE = np.sqrt(3.0)


class OwnSearch(FabricIntegrals):
    """Integrals over all effects of one table, fabrics' deviations included, where raters' answers differ.

    Parameters are those of `FabricIntegrals`.
    """

    integrals: Any  # OwnIntegrals

    def _settled(self, given: RowParameters) -> float:
        # without deviations the mode only places nodes
        return super()._settled(given) if given.deviating else _SETTLED

    def _empty_sums(self, draws: int) -> OwnSums:
        return OwnSums(*np.empty((len(OwnSums._fields), draws, *self._count.shape)))

    def _newton(self, given: RowParameters, point: Any, sums: Any) -> OwnLaw:
        return own_law(given, self.integrals.mean, self.integrals.sd, point, sums, safe=True)[0]

    def _marginal(self, given: RowParameters, point: Any, sums: Any) -> OwnLaw:
        """Return the normal law with slopes and curvatures averaged over raters' effects, to first order."""
        mean, sd = self.integrals.mean, self.integrals.sd
        if not given.deviating:
            return own_law(given, mean, sd, point, sums)[0]
        plain, _ = own_law(given, mean, sd, point, sums)
        found, good = own_law(given, mean, sd, point, self._sums(given, point, about=plain))
        return found if good.all() else found.replaced(plain, ~good)

    def _start(self, given: RowParameters) -> OwnPoint:
        """Return a point near the mode, as if all intervals that have two ends were their midpoints."""
        of_raters, weight = self.integrals.of_raters, self.integrals.weight
        total = np.maximum(of_raters(weight), 1e-3)
        mean, centre = of_raters(weight * given.middle) / total, of_raters(weight * given.drive) / total
        y = given.middle - np.repeat(mean, self.integrals.sizes, axis=-1)
        d = given.drive - np.repeat(centre, self.integrals.sizes, axis=-1)
        squares, products = of_raters(weight * y * y), of_raters(weight * y * d)
        sums = RaterStatistics(total, mean - self.integrals.mean, squares, centre, of_raters(weight * d * d), products)
        own = given.own
        assert own is not None
        spreads = AnswerSpreads(given.tau, given.spread, own.exponent, own.noise)
        modes = find_modes(sums, spreads, self.integrals.sd, _ROUNDS)
        g, variance = factor(own.exponent * modes.u), (given.spread * factor(own.noise * modes.w)) ** 2
        precision = total / (variance + total * given.tau**2)
        scale = given.tau * precision * (mean - self.integrals.mean - g * centre - modes.mu)
        zero = np.zeros((len(g), self.n_fabrics))
        point = OwnPoint(modes.mu + self.integrals.mean, scale, modes.u, modes.w, zero)
        if not given.deviating:
            return point
        sums_of = self._midpoint_sums(given, point)
        return self._newton(given, point, sums_of).mean

    def _midpoint_sums(self, given: RowParameters, point: OwnPoint) -> OwnSums:
        """Return sums of normal laws of the midpoints of intervals; `given` is not sorted by fabric."""
        own = given.own
        assert own is not None
        order, weight = self._order, self.integrals.weight[self._order]
        cell_of = self._cells[self._of_row]
        rater = cell_of // self.n_fabrics
        g, h = factor(own.exponent * point.u), factor(own.noise * point.w)
        variance = (given.spread * h)[:, rater] ** 2
        drive = given.drive[:, order]
        left = given.middle[..., order] - point.a(given.tau)[:, rater] - g[:, rater] * drive
        first = np.searchsorted(self._of_row, np.arange(self._cells.size))
        shape = (len(g), *self._count.shape)

        def cells(values: FloatArray) -> FloatArray:
            every = np.zeros((len(g), self._count.size))
            every[:, self._cells] = np.add.reduceat(values, first, axis=-1)
            return every.reshape(shape)

        slope, curvature = weight * left / variance, weight / variance
        nothing = np.zeros(shape)
        return OwnSums(
            nothing,
            cells(slope),
            cells(slope * drive),
            cells(curvature),
            cells(curvature * drive),
            cells(curvature * drive * drive),
            nothing,
            nothing,
            nothing,
            nothing,
        )

    def _sums(  # type: ignore[override]
        self,
        given: RowParameters,
        point: OwnPoint,
        groups: Sequence[WidthGroup] | None = None,
        single: bool = False,
        about: OwnLaw | None = None,
    ) -> OwnSums:
        """Return the sums over rows sorted by rater and fabric, averaged over the raters' effects `about` a law."""
        own = given.own
        assert own is not None
        if not self.integrals.noisy:
            return self._with_noise(self._cell_sums(given, point, 0.0, single, about), None, 1.0, 0.0)
        step: FloatArray = np.full(own.noise.shape, _STEP)
        variance: FloatArray | float = 0.0
        if about is not None:
            variance = own.noise**2 * about.covariance[..., 2, 2]
            step = np.maximum(_THREE * np.sqrt(variance), _LEAST_STEP)
        middle = self._cell_sums(given, point, 0.0, single, about)
        sides = [self._cell_sums(given, point, sign * step, single, about) for sign in (1.0, -1.0)]
        return self._with_noise(middle, sides, step, variance)

    def _with_noise(
        self, middle: FloatArray, sides: list[FloatArray] | None, step: FloatArray | float, variance: FloatArray | float
    ) -> OwnSums:
        """Return sums with differences between noise that is larger and smaller by `step` in the log."""
        nothing = np.zeros(middle.shape[1:])
        if sides is None:
            return OwnSums(*(*middle, nothing, nothing, nothing, nothing))
        more, less = sides
        step = np.asarray(step)[..., None]
        bend = (more - 2.0 * middle + less) / step**2
        slope = (more - less) / (2.0 * step)
        middle[1:] += 0.5 * np.asarray(variance)[..., None] * bend[1:] if np.ndim(variance) else 0.0
        return OwnSums(*(*middle, slope[0], -bend[0], slope[1], slope[2]))

    def _cell_sums(
        self,
        given: RowParameters,
        point: OwnPoint,
        louder: FloatArray | float,
        single: bool,
        about: OwnLaw | None,
    ) -> FloatArray:
        """Return the first six of `OwnSums`, for log noise that is larger by `louder`, (6, draws, raters, fabrics)."""
        own, law = given.own, self.integrals.law
        assert own is not None
        cells, n = self._cells, self.n_fabrics
        rater, fabric = cells // n, cells % n
        g = factor(own.exponent * point.u)[:, rater]
        extra = (given.omega * point.z)[:, fabric]
        shift = point.a(given.tau)[:, rater] + g * extra
        noisy = self.integrals.noisy
        relative = factor(own.noise * point.w + louder)[:, rater] if noisy else np.ones((1, 1))
        spread = given.spread * relative
        variances = None if about is None else _Variances.of(given, point, about, rater)
        found = np.zeros((9, *shift.shape))
        for group in self._groups:
            for block in blocks(len(shift), group.size):
                part = given.part(block)
                drive = part.drive[:, group.rows]
                expected = group.of_rows(g[block]) * drive
                expected += group.of_rows(shift[block])
                here = group.of_rows(spread[block]) if noisy else spread[block]
                rows = part.rows.take(group.rows)
                value, one, two, *more = scaled_derivatives(law, rows, expected, here, part.parameters, single)
                whole = drive + group.of_rows(extra[block])
                two = -two
                if variances is not None:
                    half = 0.5 * np.minimum(variances.at(group, block, whole) / here**2, MOST_AVERAGED)
                    one, two = one + half * more[0], two - half * more[1]
                each = [value, one, one * whole, two, two * whole, two * whole * whole]
                if law != NORMAL and variances is None:
                    middle = part.middle[..., group.rows]
                    secant = secants(one, (middle - expected) / here)
                    each += [secant, secant * whole, secant * whole * whole]
                for k, values in enumerate(each):
                    found[k][block, group.raters] += group.of_raters(values, exactly=k == 0)
        found[1:3] /= spread
        found[3:] /= spread * spread
        if law != NORMAL and variances is None:
            # where the density is hardly concave, secants make steps that cannot overshoot
            flat = (found[3] < _LEAST_CURVATURE * found[6]) | (found[5] < _LEAST_CURVATURE * found[8])
            found[3:6] = np.where(flat, found[6:], found[3:6])
        found = found[:6]
        if cells.size < self._count.size:
            every = np.zeros((6, len(shift), self._count.size))
            every[:, :, cells] = found
            found = every
        return found.reshape(6, len(shift), *self._count.shape)


class _Variances(NamedTuple):
    """Variance of expectations given the deviations, a quadratic function of D, for each cell; each (draws, cells)."""

    own: FloatArray  # of the scale given the level
    along: FloatArray  # covariance of scale and exponent
    exponent: FloatArray
    level: FloatArray  # change of a_p with the level
    tilt: FloatArray  # change of the exponent with the level
    of_level: FloatArray  # variance of the level, (draws, 1)

    @classmethod
    def of(cls, given: RowParameters, point: OwnPoint, law: OwnLaw, rater: NDArray[np.intp]) -> _Variances:
        """Return the variances for cells of these raters under a law."""
        assert given.own is not None
        lean, cov, tau = given.own.exponent * factor(given.own.exponent * point.u), law.covariance, given.tau
        every = (
            tau**2 * cov[..., 0, 0],
            tau * lean * cov[..., 0, 1],
            lean**2 * cov[..., 1, 1],
            1.0 - tau * law.to_level[..., 0],
            -lean * law.to_level[..., 1],
        )
        return cls(*(*(one[:, rater] for one in every), 1.0 / law.precision))

    def at(self, group: WidthGroup, block: slice, d: FloatArray) -> FloatArray:
        """Return the variance of some rows with these D, (draws, rows)."""
        own, along, exponent, level, tilt = (group.of_rows(one[block]) for one in self[:5])
        found = own + d * (2.0 * along + d * exponent) + (level + d * tilt) ** 2 * self.of_level[block]
        return np.asarray(found)
