"""Stress fields of a scene's loads, inverted and tabulated once (model.md 5).

With the receptors' depth z as the unit of length, a field depends on two numbers, A = a / z and the decay q of the
pressure, and its inverse on the stress relative to that on the axis. If the stress falls like rho^-n far away, then
with y = (sigma / sigma_peak)^(2/n)

    rho² = z² (1 + A² / (1 + q)) S(y; A, q) (1 - y) / y

and S has no singularity at either end of y. The loads, moduli and fingers of a scene cover a band of the plane of A and
q, which two coordinates straighten: one along the moduli, one across the loads and fingers.

    indentation   along: ln(1 + q)   across: ln A
    force         along: ln A        across: ln c,  where q = c q_0(A)

A table is a Chebyshev series in both and in y. One load on one finger has a single place across, which leaves a series
along the moduli; so does every load of a table that covers many, once the finger is known.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.touch.contact import Finger, FingerBox, Fingertip, Fingertips, Force, Indentation, Load, Loads
from softness_bayes.touch.neuron.polynomials import chebyshev_values
from softness_bayes.touch.stress import GAUSS_DENSITY, unit_stress

if TYPE_CHECKING:
    from softness_bayes.touch.readings import Readings

Array = NDArray[np.float64]

SHAPE_NODES = (41, 81, 161, 321)
"""Numbers of Chebyshev nodes in y at which fields are inverted before a series is truncated; the first sufficient one
is used. The largest is needed for the largest principal stress with the printed kernel, which is not symmetric about
the axis: its slope in rho is then confined to a layer near y = 1."""

ALONG_NODES = (24, 48, 96, 160)
"""Numbers of Chebyshev nodes along the moduli; the first sufficient one is used."""

ACROSS_NODES = (3, 5, 7, 9, 12, 15, 20, 26, 34, 44)
"""Numbers of Chebyshev nodes across the loads and fingers; the first sufficient one is used."""

SHARE = 0.1
"""Tolerance of a table as a share of that to which its series are truncated for a scene."""

MANY_LOADS = 24
"""Number of loads of one kind above which they share one table, which takes as long as 20 to 30 loads."""

LEAST_SKIN_MODULUS, STIFFEST_SKIN_MODULUS = 1e3, 1e7
"""Softest skin [Pa] in the tables of force-controlled loads, and the stiffest in all tables, a hundred times the median
at rest; other skin is computed without tables, which is slow."""


BLOCK = 4
"""Number of contacts inverted at once; arrays of more contacts do not fit into the cache."""

FARTHEST = 500.0
"""End of the grid on which the search begins, in sizes of the patch; beyond it the field follows its power law."""

INSIDE = 1.0 + 1e-9
"""Largest coordinate of a table, scaled to [-1, 1]."""

LEAST_EXTENT = 1e-6
"""Extent of a coordinate to which a table of a single value of it is scaled."""

_ROUNDING = 1e-11  # change of ln y below which no slope follows from it


@dataclass(frozen=True)
class Inversion:
    """The stress field of any contact radius and decay, inverted by the secant method.

    Parameters
    ----------
    readings
        Readings of kernel and component.
    tolerance
        Error allowed in S, relative to its maximum.
    """

    readings: Readings
    tolerance: float

    @property
    def root(self) -> float:
        """2/n, the power of sigma / sigma_peak that gives y."""
        component, kernel = self.readings.stress_component, self.readings.stress_kernel
        return 2.0 / (component.far_power or kernel.far_power)

    def unit(self, rho: Array, radius: Array, decay: Array) -> Array:
        """Return the stress at distances rho under a pressure of amplitude 1; all broadcast."""
        density = GAUSS_DENSITY if self.tolerance < 1e-7 else 0.5 * GAUSS_DENSITY
        kernel, component = self.readings.stress_kernel, self.readings.stress_component
        return unit_stress(rho, 1.0, radius, decay, kernel, component, density)

    def rows(self, radius: Array, decay: Array, nodes: int) -> Array:
        """Return [unit peak, coefficients of S in T_k(2 y - 1)] of contacts A and q (n,), shape (n, 1 + nodes)."""
        found = self.values(radius, decay, 0.5 * (chebyshev.chebpts1(nodes) + 1.0))
        found[:, 1:] = found[:, 1:] @ values_to_coefficients(nodes).T
        return found

    def values(self, radius: Array, decay: Array, y: Array) -> Array:
        """Return [unit peak, S at each y] of contacts A and q (n,), shape (n, 1 + len(y))."""
        found = np.empty((radius.size, 1 + y.size))
        for start in range(0, radius.size, BLOCK):
            some = slice(start, start + BLOCK)
            a, q = radius[some], decay[some]
            found[some, 0] = peak = self.unit(np.zeros_like(a), a, q)
            squared = self._distance(y, a, q, peak) ** 2 / (1.0 + a**2 / (1.0 + q))[:, None]
            found[some, 1:] = squared * (y / (1.0 - y))
        return found

    def _distance(self, y: Array, radius: Array, decay: Array, peak: Array) -> Array:
        """Invert the field by the secant method: distances at which it is y^(1/root) of its peak; (n, len(y))."""
        radius, decay, peak, log_y = radius[:, None], decay[:, None], peak[:, None], np.log(y)

        def log_y_at(log_rho: Array) -> Array:
            return self.root * np.log(self.unit(np.exp(log_rho), radius, decay) / peak)

        # cubics through the field start the search, on a grid from near the axis to where the field follows its power
        # law, and finely across the edge of the contact
        everywhere = np.geomspace(1e-4 * (1.0 + radius), FARTHEST * (1.0 + radius), 70, axis=-1)[:, 0]
        edge = radius + np.sinh(np.linspace(-1, 1, 51) * np.arcsinh(0.9 * radius))
        grid = np.log(np.sort(np.concatenate([everywhere, edge], axis=-1), axis=-1))
        known = log_y_at(grid)
        log_rho, slope = np.empty((2, radius.size, y.size))
        for row in range(radius.size):
            falling = np.concatenate([np.diff(known[row]) < -1e-13, [True]])
            x, value = known[row][falling][::-1], grid[row][falling][::-1]
            log_rho[row], slope[row] = _cubic(log_y, x, value)
        before, step, last = 0.0, np.zeros_like(log_rho), np.zeros_like(log_rho)
        for _ in range(12):  # each step usually gains about three digits
            gap = log_y_at(log_rho) - log_y
            change = gap - last
            tells = (np.abs(change) > _ROUNDING) & (step * change < 0.0)
            slope = np.where(tells, step / np.where(tells, change, 1.0), slope)
            excess = slope * gap
            step, last = -np.clip(excess, -1.0, 1.0), gap
            log_rho = log_rho + step
            found = float(np.abs(excess).max())
            # the error shrinks by a similar factor at every step, estimated from two steps; ten times that is safe
            shrinks = min(1.0, 10.0 * found / before) if before else 1.0
            if found * shrinks < 1e-2 * self.tolerance:
                break
            before = found
        return np.exp(log_rho)


def _cubic(at: Array, x: Array, value: Array) -> tuple[Array, Array]:
    """Return values and slopes of cubics through points, with slopes of parabolas at these."""
    slope = np.gradient(value, x)
    k = np.clip(np.searchsorted(x, at), 1, x.size - 1)
    width, low, high = x[k] - x[k - 1], slope[k - 1], slope[k]
    mean, t = (value[k] - value[k - 1]) / width, (at - x[k - 1]) / width
    bend, twist = 3.0 * mean - 2.0 * low - high, low + high - 2.0 * mean
    return value[k - 1] + width * t * (low + t * (bend + t * twist)), low + t * (2.0 * bend + 3.0 * t * twist)


class StressTable:
    """Inverted stress fields under a load, or a range of loads of one kind, for one finger or a range of fingers.

    Parameters
    ----------
    least, greatest
        The ends of the range of loads, both forces or both indentations.
    finger, box
        The finger, and the ranges of radius and depth that the table covers; None for this finger alone.
    readings
        Readings of pressure, kernel and component.
    modulus_range
        Reduced moduli [Pa] that the table covers. Other contacts are computed exactly, which is slow.
    tolerance
        Error allowed in S and in the peak, each relative to its largest value under a load.

    Attributes
    ----------
    reached
        Measured error on the scale of the tolerance: the largest difference from the exact field at the ends of the
        range and between the nodes. A few times the tolerance is normal, because each series is truncated separately.

    Raises
    ------
    InputError
        If the depth is 0; or if the table covers several forces or fingers, and the decay under a force is no product
        of a function of A and one of force and finger.
    """

    def __init__(
        self,
        least: Load,
        greatest: Load,
        finger: Finger,
        box: FingerBox | None,
        readings: Readings,
        modulus_range: tuple[float, float],
        tolerance: float,
    ) -> None:
        if not finger.receptor_depth > 0:
            raise InputError("finger: receptor_depth is 0, expected a positive depth for a stress field")
        self.load, self.finger, self.readings, self.tolerance = Loads(least), finger, readings, tolerance
        self.modulus_range, self._inversion = modulus_range, Inversion(readings, tolerance)
        self._held = isinstance(least, Indentation)
        alone = finger.radius, finger.receptor_depth, finger.force
        radius, depth, force = (np.reshape(one, (-1, 1)) for one in (box.corners if box else alone))
        corners = Fingertips(radius, depth, finger.poisson_ratio, force)
        along, across = [], []
        for load in (least, greatest):
            modulus = np.broadcast_to(np.array(modulus_range), (depth.size, 2))
            along.append(self.along(*touched(Loads(load).radius(modulus, corners), modulus, corners, readings)))
            across.append(self.across(Loads(load), corners))
            for relative in (0.3, 1.0, 10.0) if (box or greatest != least) and not self._held else ():
                usual = self._decay(self.load, self.finger, relative) * np.exp(across[-1])
                if not np.allclose(self._decay(Loads(load), corners, relative), usual, rtol=1e-9, atol=1e-12):
                    raise InputError(
                        f"radius and receptor_depth cannot be sampled with pressure={readings.pressure.name} under "
                        "a given force, because its decay is no product of a function of the contact radius and one of "
                        "the finger; fix the finger"
                    )
        # all indentations have the same limit for soft fabrics, at which the pressure has no decay
        low = 0.0 if self._held else np.min(along)
        self._ends = np.array([[low, np.max(along)], [np.min(across), np.max(across)]])
        self._fit()

    @property
    def root(self) -> float:
        """2/n, the power of sigma / sigma_peak that gives y."""
        return self._inversion.root

    def along(self, relative: Array, decay: Array) -> Array:
        """Return the coordinate along the moduli of contacts A and q."""
        return np.log1p(decay) if self._held else np.log(relative)

    def across(self, loads: Loads, finger: Fingertip) -> Array:
        """Return the coordinate across the table of loads on a finger, which broadcast."""
        if self._held:
            return np.asarray(np.log(loads.radius(np.ones(()), finger) / finger.receptor_depth))
        own, usual = self._decay(loads, finger, 1.0), self._decay(self.load, self.finger, 1.0)
        return np.log(np.maximum(own, 1e-300) / np.maximum(usual, 1e-300))

    def contacts(self, along: Array, across: Array) -> tuple[Array, Array]:
        """Return A and q at scaled coordinates, which broadcast."""
        along, across = (
            0.5 * (low + high + max(high - low, LEAST_EXTENT) * place)
            for (low, high), place in zip(self._ends, (along, across), strict=True)
        )
        if self._held:
            return np.exp(across), np.expm1(np.maximum(along, 0.0))
        relative = np.exp(along)
        return relative, self._decay(self.load, self.finger, relative) * np.exp(across)

    def _decay(self, loads: Loads, finger: Fingertip, relative: Array | float) -> Array:
        """Return q under forces at some A."""
        radius = np.asarray(relative * finger.receptor_depth)
        return self.readings.pressure.decay(
            0.75 * finger.radius * loads.newton * finger.force / radius**3, radius, finger
        )

    def scaled(self, value: Array, side: int) -> Array:
        """Return a coordinate, along (0) or across (1), scaled to [-1, 1] over its range."""
        low, high = self._ends[side]
        return (2.0 * value - (low + high)) / max(high - low, LEAST_EXTENT)

    def _pairs(self, along: Array, across: Array) -> tuple[Array, Array]:
        """Return A and q at all pairs of scaled coordinates, shape (across × along,)."""
        t, s = (x.ravel() for x in np.meshgrid(across, along, indexing="ij"))
        relative, decay = self.contacts(s, t)
        return np.broadcast_to(relative, t.shape), np.broadcast_to(decay, t.shape)

    def _rows(self, along: Array, across: Array) -> Array:
        """Return exact rows at all pairs of scaled coordinates, shape (across, along, 1 + shape_nodes)."""
        rows = self._inversion.rows(*self._pairs(along, across), self.shape_nodes)
        return rows.reshape(across.size, along.size, -1)

    def _fit(self) -> None:
        varies = np.diff(self._ends, axis=1)[:, 0] > 1e-9
        ends = np.array([-1.0, 0.0, 1.0]) if varies[1] else np.zeros(1)
        for self.shape_nodes in SHAPE_NODES:
            rows = self._rows(np.linspace(-0.999, 0.999, 5), ends)
            shape = np.abs(rows[..., 1:])
            tail = shape[..., -(self.shape_nodes // 10) :].sum(axis=-1)
            if (tail.max(axis=1) <= self.tolerance * shape.sum(axis=-1).max(axis=1)).all():
                break
        # errors are relative to the largest values of each load; those of the series, to the largest of all
        scales = np.stack([rows[..., 0].max(axis=1), shape.sum(axis=-1).max(axis=1)])
        tolerance = self.tolerance * float((scales.min(axis=1) / scales.max(axis=1)).min())
        self._scale = np.append(scales[0].max(), np.full(self.shape_nodes, scales[1].max()))
        along = across = np.zeros(1)
        for n in ACROSS_NODES if varies[1] else ():
            across = chebyshev.chebpts1(n)
            size = np.abs(_series(self._rows(chebyshev.chebpts1(5), across), 0)) / self._scale
            if size[-2:].max() <= 0.3 * tolerance:
                break
        for n in ALONG_NODES if varies[0] else ():
            along = chebyshev.chebpts1(n)
            rows = self._rows(along, ends)
            if (np.abs(_series(rows, 1)) / self._scale).max(axis=(0, 2))[-4:].sum() <= tolerance:
                break
        self.table = _series(_series(self._rows(along, across) if varies[1] else rows, 0), 1)
        self._scale *= tolerance / self.tolerance
        self.table = self.cut(self.tolerance).table
        self.reached = self._measure()

    def _measure(self) -> float:
        """Return the largest difference from the exact field, relative to the largest value under the same load."""
        n_across, n_along, _ = self.table.shape
        between = np.cos(np.pi * np.arange(1, n_across) / n_across)
        across = np.concatenate([[-1.0], between, [1.0]]) if n_across > 1 else np.zeros(1)
        along = np.cos(np.pi * (np.arange(9) + 0.3) / 9) if n_along > 1 else np.zeros(1)
        y = np.cos(np.pi * (np.arange(61) + 0.3) / 61)
        exact = self._inversion.values(*self._pairs(along, across), 0.5 * (y + 1.0))
        exact = exact.reshape(across.size, along.size, -1)
        series = np.tensordot(chebyshev_values(across, n_across), self.table, (0, 0))
        found = chebyshev_values(along, n_along).T @ series
        found = np.dstack([found[..., 0], found[..., 1:] @ chebyshev_values(y, found.shape[-1] - 1)])
        apart, largest = np.abs(found - exact).max(axis=1), np.abs(exact).max(axis=1)
        return float(
            max((apart[:, 0] / largest[:, 0]).max(), (apart[:, 1:].max(axis=1) / largest[:, 1:].max(axis=1)).max())
        )

    def cut(self, tolerance: float) -> StressTable:
        """Return the table without orders that sum to less than half a tolerance; `reached` is that of the whole."""
        size = np.abs(self.table) / self._scale[: self.table.shape[-1]]
        part = copy.copy(self)
        across, along = (max(_kept(size.max(axis=others), tolerance), 1) for others in ((1, 2), (0, 2)))
        shape = max(_kept(size[..., 1:].max(axis=(0, 1)), tolerance), 2)
        part.table, part.tolerance = np.ascontiguousarray(self.table[:across, :along, : 1 + shape]), tolerance
        return part

    def restriction(self, start: float) -> Array:
        """Return the matrix from S in T_k(2 y - 1) to its series on [start, 1], cut like the table."""
        matrix = restricted(self.table.shape[-1] - 1, start)
        size = np.abs(self.table[..., 1:] @ matrix.T).max(axis=(0, 1)) / self._scale[-1]
        return matrix[: _kept(size, self.tolerance)]

    def exact(self, along: Array, across: Array) -> Array:
        """Return rows [unit peak, coefficients of S], (n, 1 + order), at scaled coordinates (n,) without the table."""
        return self._inversion.rows(*self.contacts(along, across), self.shape_nodes)[:, : self.table.shape[-1]]


class TablePart:
    """Linear functions of the rows of a table, for contacts anywhere.

    Parameters
    ----------
    table
        The table.
    matrix
        The functions of a row [unit peak, coefficients of S], shape (functions, 1 + order).
    """

    def __init__(self, table: StressTable, matrix: Array) -> None:
        self.table, self.matrix = table, matrix
        self._series = matrix @ np.swapaxes(table.table, 1, 2)

    def __call__(self, along: Array, across: Array) -> Array:
        """Return the values at scaled coordinates (n,), shape (functions, n); beyond the table exactly, and slowly."""
        beyond = np.flatnonzero(np.maximum(np.abs(along), np.abs(across)) > INSIDE)
        inside = np.clip(along, -1.0, 1.0) if beyond.size else along
        orders, functions, terms = self._series.shape
        found = self._series.reshape(-1, terms) @ chebyshev_values(inside, terms)
        if orders > 1:
            weights = chebyshev_values(np.clip(across, -1.0, 1.0), orders)
            found = np.einsum("kfn,kn->fn", found.reshape(orders, functions, -1), weights)
        if beyond.size:
            found[:, beyond] = self.matrix @ self.table.exact(along[beyond], across[beyond]).T
        return found


def _series(values: Array, axis: int) -> Array:
    """Return Chebyshev coefficients from the values at Chebyshev nodes along an axis."""
    return np.moveaxis(np.tensordot(values_to_coefficients(values.shape[axis]), values, (1, axis)), 0, axis)


def _kept(sizes: Array, tolerance: float) -> int:
    """Return the number of orders without the last ones that sum to less than half a tolerance."""
    return int((sizes[::-1].cumsum()[::-1] > 0.5 * tolerance).sum())


def restricted(order: int, start: float) -> Array:
    """Return the matrix from a series in T_k(2 y - 1) to the same polynomial's series on [start, 1]."""
    y = start + 0.5 * (1.0 - start) * (chebyshev.chebpts1(order) + 1.0)
    return values_to_coefficients(order) @ chebyshev.chebvander(2.0 * y - 1.0, order - 1)


def touched(radius: Array, modulus: Array, finger: Fingertip, readings: Readings) -> tuple[Array, Array]:
    """Return A and q of contacts of some radius [m] at reduced moduli [Pa]."""
    return radius / finger.receptor_depth, readings.pressure.decay(modulus, radius, finger)


def covered_moduli(
    modulus: Array, poisson: Array, finger: Finger, modulus_range: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the reduced moduli [Pa] that the stress fields of a scene cover.

    Parameters
    ----------
    modulus, poisson
        E_fab [Pa] and nu_fab of each condition.
    finger
        The finger that touches.
    modulus_range
        Further moduli [Pa] of fabrics.
    """
    softness, least = 1.0 - finger.poisson_ratio**2, modulus.argmin()
    soft, stiff = modulus_range or (np.inf, 0.0)
    stiff /= 1.0 - float(poisson.max()) ** 2
    stiff = max(float((modulus / (1.0 - poisson**2)).max()), stiff)
    high = min(stiff, STIFFEST_SKIN_MODULUS / softness)
    fabric = (1.0 - poisson[least] ** 2) / min(modulus[least], soft)
    low = float(1.0 / (softness / LEAST_SKIN_MODULUS + fabric))
    return min(low, 0.5 * high), high


_table = lru_cache(maxsize=64)(StressTable)


def stress_tables(
    loads: Sequence[Load],
    finger: Finger,
    box: FingerBox | None,
    readings: Readings,
    modulus_range: tuple[float, float],
    tolerance: float,
) -> dict[Load, StressTable]:
    """Return the table of each load, not yet truncated to the tolerance.

    More than `MANY_LOADS` loads of one kind share a table, if their decays allow it. Equal tables are computed once.
    """
    # the field depends on nothing else of the finger
    shape = Finger(finger.radius, finger.poisson_ratio, finger.receptor_depth)
    rest = shape, box, readings, modulus_range, SHARE * tolerance
    found: dict[Load, StressTable] = {}
    for kind in (Indentation, Force):
        own = sorted(load for load in loads if isinstance(load, kind))
        if len(own) > MANY_LOADS:
            try:
                found |= dict.fromkeys(own, _table(own[0], own[-1], *rest))
                continue
            except InputError:
                if box:
                    raise
        found |= {load: _table(load, load, *rest) for load in own}
    return found


def cut_tables(tables: Mapping[Load, StressTable], tolerance: float) -> dict[Load, StressTable]:
    """Return tables truncated to a tolerance; loads with a common table keep it."""
    cut = {id(table): table.cut(tolerance) for table in tables.values()}
    return {load: cut[id(table)] for load, table in tables.items()}


def values_to_coefficients(order: int) -> Array:
    """Return the matrix from values at the Chebyshev nodes of the first kind to coefficients."""
    matrix = np.asarray(chebyshev.chebvander(chebyshev.chebpts1(order), order - 1).T * (2.0 / order), float)
    matrix[0] *= 0.5
    return matrix
