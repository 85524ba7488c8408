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
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, FingerBox, Fingertip, Fingertips, Force, Indentation, Load, Loads
from softness_bayes.touch.inversion import Inversion, values_to_coefficients
from softness_bayes.touch.neuron.polynomials import chebyshev_values, clenshaw, horner, in_powers_of
from softness_bayes.touch.readings import Readings

Array = NDArray[np.float64]
Index = NDArray[np.intp]

SHAPE_NODES = (41, 81, 161, 321)
"""Numbers of Chebyshev nodes in y at which fields are inverted before a series is truncated; the first sufficient one
is used. The largest is needed for the largest principal stress with the printed kernel, which is not symmetric about
the axis: its slope in rho is then confined to a layer near y = 1."""

ALONG_NODES = (24, 48, 96, 160)
"""Chebyshev nodes along the moduli, likewise."""

ACROSS_NODES = (3, 5, 7, 9, 12, 15, 20, 26, 34, 44)
"""Chebyshev nodes across the loads and fingers, likewise."""

Y_LEAST = 1e-6
"""Least y, at a thousand times the size of the patch: far beyond any pad."""

SHARE = 0.1
"""Tolerance of a table as a share of that to which its series are truncated for a scene."""

MANY_LOADS = 24
"""Number of loads of one kind above which they share one table, which takes as long as 20 to 30 loads."""

LEAST_SKIN_MODULUS, STIFFEST_SKIN_MODULUS = 1e3, 1e7
"""Softest skin [Pa] in the tables of force-controlled loads, and the stiffest in all tables, a hundred times the median
at rest; other skin is computed without tables, which is slow."""

_INSIDE = 1.0 + 1e-9  # largest coordinate of a table, scaled to [-1, 1]


class Profile(NamedTuple):
    """The field of a batch of touches, ready to be evaluated at any stress."""

    peak: Array
    """Stress on the axis [Pa], shape (...)."""
    shape: Array
    """Coefficients of rho² y / (1 - y) [m²] in T_k(2 y - 1), shape (order, ...)."""
    powers: bool = False
    """True if the coefficients are those of powers of 2 y - 1 instead, which take less time."""

    def among(self, mask: NDArray[np.bool_]) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, and their profile along one axis."""
        at = np.flatnonzero(mask)
        return at, self.take(at)

    def take(self, at: Index) -> Profile:
        """Return the profile of selected elements of the flattened batch, along one axis."""
        return Profile(self.peak.take(at), self.shape.reshape(len(self.shape), -1).take(at, axis=1), self.powers)

    def squared_distance(self, y: Array) -> Array:
        """Return rho² [m²] where the stress is y^(1/root) of its peak, of the shape of `y`: (..., *batch)."""
        return (horner if self.powers else clenshaw)(self.shape, 2.0 * y - 1.0) * (1.0 / y - 1.0)


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
        self.load, self.finger, self.readings, self.tolerance = least, finger, readings, tolerance
        self.modulus_range, self._inversion = modulus_range, Inversion(readings, tolerance)
        self._held = isinstance(least, Indentation)
        radius, depth = box.corners if box else (np.array([finger.radius]), np.array([finger.receptor_depth]))
        corners = Fingertips(radius[:, None], depth[:, None], finger.poisson_ratio)
        along, across = [], []
        for load in (least, greatest):
            modulus = np.broadcast_to(np.array(modulus_range), (depth.size, 2))
            along.append(self.along(*touched(Loads(load).radius(modulus, corners), modulus, corners, readings)))
            across.append(self.across(load, corners))
            if box or greatest != least:
                self._require_product(load, corners, across[-1])
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

    def across(self, load: Load, finger: Fingertip) -> Array:
        """Return the coordinate across the table of a load on a finger, of the shape of the finger."""
        if isinstance(load, Indentation):
            return np.asarray(np.log(Loads(load).radius(np.ones_like(finger.radius), finger) / finger.receptor_depth))
        own, usual = self._decay(load, finger, 1.0), self._decay(self.load, self.finger, 1.0)
        return np.log(np.maximum(own, 1e-300) / np.maximum(usual, 1e-300))

    def contacts(self, along: Array, across: Array | float) -> tuple[Array, Array]:
        """Return A and q at coordinates, which broadcast."""
        if self._held:
            return np.exp(across), np.expm1(np.maximum(along, 0.0))
        relative = np.exp(along)
        return relative, self._decay(self.load, self.finger, relative) * np.exp(across)

    def _decay(self, load: Load, finger: Fingertip, relative: Array | float) -> Array:
        """Return q under a force at some A."""
        assert isinstance(load, Force)
        radius = np.asarray(relative * finger.receptor_depth)
        return self.readings.pressure.decay(0.75 * finger.radius * load.newton / radius**3, radius, finger)

    def _require_product(self, load: Load, fingers: Fingertips, across: Array) -> None:
        for relative in () if self._held else (0.3, 1.0, 10.0):
            usual = self._decay(self.load, self.finger, relative)
            if not np.allclose(self._decay(load, fingers, relative), usual * np.exp(across), rtol=1e-9, atol=1e-12):
                raise InputError(
                    f"radius and receptor_depth cannot be sampled with pressure={self.readings.pressure.name} under "
                    "a given force, because its decay is no product of a function of the contact radius and one of the "
                    "finger; fix the finger"
                )

    def scaled(self, value: Array, side: int) -> Array:
        """Return a coordinate, along (0) or across (1), scaled to [-1, 1] over its range."""
        low, high = self._ends[side]
        return (2.0 * value - (low + high)) / max(high - low, 1e-6)

    def _pairs(self, along: Array, across: Array) -> tuple[Array, Array]:
        """Return A and q at all pairs of scaled coordinates, shape (across × along,)."""
        middle, half = self._ends.mean(axis=1), 0.5 * np.diff(self._ends, axis=1)[:, 0]
        t, s = (x.ravel() for x in np.meshgrid(across, along, indexing="ij"))
        relative, decay = self.contacts(middle[0] + half[0] * s, middle[1] + half[1] * t)
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
        found = chebyshev_values(along, n_along).T @ self.series(across)
        found = np.dstack([found[..., 0], found[..., 1:] @ chebyshev_values(y, found.shape[-1] - 1)])
        apart, largest = np.abs(found - exact).max(axis=1), np.abs(exact).max(axis=1)
        return float(
            max((apart[:, 0] / largest[:, 0]).max(), (apart[:, 1:].max(axis=1) / largest[:, 1:].max(axis=1)).max())
        )

    def cut(self, tolerance: float) -> StressTable:
        """Return the table without orders that sum to less than half a tolerance; `reached` is that of the whole."""
        size = np.abs(self.table) / self._scale[: self.table.shape[-1]]

        def kept(sizes: Array, least: int) -> int:
            return max(int((sizes[::-1].cumsum()[::-1] > 0.5 * tolerance).sum()), least)

        part = copy.copy(self)
        across, along = kept(size.max(axis=(1, 2)), 1), kept(size.max(axis=(0, 2)), 1)
        shape = kept(size[..., 1:].max(axis=(0, 1)), 2)
        part.table, part.tolerance = np.ascontiguousarray(self.table[:across, :along, : 1 + shape]), tolerance
        return part

    def series(self, across: Array) -> Array:
        """Return the series along the moduli at scaled coordinates (n,) across, shape (n, terms, 1 + order)."""
        n_across, terms, width = self.table.shape
        return (chebyshev_values(across, n_across).T @ self.table.reshape(n_across, -1)).reshape(-1, terms, width)

    def exact(self, relative: Array, decay: Array) -> Array:
        """Return rows [unit peak, coefficients of S], (n, 1 + order), of contacts A and q (n,) without the table."""
        return self._inversion.rows(relative, decay, self.shape_nodes)[:, : self.table.shape[-1]]


def _series(values: Array, axis: int) -> Array:
    """Return Chebyshev coefficients from the values at Chebyshev nodes along an axis."""
    return np.moveaxis(np.tensordot(values_to_coefficients(values.shape[axis]), values, (1, axis)), 0, axis)


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


class StressFields:
    """The stress fields of the conditions of a scene.

    Parameters
    ----------
    tables
        The table of each load.
    loads, columns
        The loads, and the conditions under each, as indices.
    finger
        The finger, where it does not vary.
    """

    def __init__(
        self, tables: Mapping[Load, StressTable], loads: Sequence[Load], columns: Sequence[Index], finger: Finger
    ) -> None:
        groups: dict[int, list[int]] = {}
        for k, load in enumerate(loads):
            groups.setdefault(id(tables[load]), []).append(k)
        self._finger, self._loads = finger, [loads[k] for group in groups.values() for k in group]
        self._tables = [tables[loads[group[0]]] for group in groups.values()]
        self._columns = [columns[k] for group in groups.values() for k in group]
        self._groups = list(pairwise(np.cumsum([0, *map(len, groups.values())]).tolist()))
        self.by_load = np.concatenate(self._columns)
        self._stops = np.cumsum([0, *(where.size for where in self._columns)])
        n = self.by_load.size
        self._rise, self._fall, self._across = np.empty((3, n))
        self._held = np.empty(n, dtype=bool)
        self._peak = np.zeros((max(table.table.shape[1] for table in self._tables), n))
        shapes: list[Array] = []
        for table, (start, stop) in zip(self._tables, self._groups, strict=True):
            own = np.array([float(table.across(load, finger)) for load in self._loads[start:stop]])
            series = table.series(np.clip(table.scaled(own, 1), -1.0, 1.0))
            shapes.append(np.swapaxes(series[..., 1:], 1, 2))
            fall, one = table.scaled(np.array([0.0, 1.0]), 0)
            for where, across, peak in zip(self._columns[start:stop], own, series[..., 0], strict=True):
                self._rise[where], self._fall[where], self._across[where] = one - fall, fall, across
                self._held[where] = isinstance(table.load, Indentation)
                self._peak[: peak.size, where] = peak[:, None]
        self._shapes, self.powers = _in_powers(shapes, [table.tolerance for table in self._tables])
        self._order = max(part.shape[1] for part in shapes)

    def at(self, modulus: Array, radius: Array, finger: Fingertip) -> FieldsAt | Profile:
        """Return the fields at E_star [Pa] and contact radius [m], both of shape (batch, conditions).

        Parameters
        ----------
        modulus, radius
            Of contacts with this finger.
        finger
            The finger that touches, or `Fingertips` of shape (batch, 1).

        Raises
        ------
        NumericalError
            If a modulus is not a positive finite number.
        """
        if not ((modulus > 0) & np.isfinite(modulus)).all():
            raise NumericalError("stress field: a reduced modulus is not positive and finite")
        readings = self._tables[0].readings
        relative, decay = touched(radius, modulus, finger, readings)
        amplitude = readings.pressure.amplitude(modulus, radius, finger)
        place = np.log(np.where(self._held, 1.0 + decay, relative)) * self._rise + self._fall
        if isinstance(finger, Fingertips):
            return self._of_fingers(place, relative, decay, amplitude, finger)
        return FieldsAt(self, place, amplitude * self._unit_peak(place))

    def covers(self, place: Array) -> bool:
        """Return whether the tables cover some places."""
        return bool((np.abs(place) <= _INSIDE).all())

    def _unit_peak(self, place: Array) -> Array:
        """Return the stress on the axis under a pressure of amplitude 1."""
        inside = np.minimum(np.maximum(place, -1.0), 1.0)
        unit = np.einsum("kbn,kn->bn", chebyshev_values(inside, len(self._peak)), self._peak)
        beyond = np.nonzero(np.abs(place) > _INSIDE)
        if beyond[0].size:
            unit[beyond] = self._exact(place[beyond], beyond[1])[:, 0]
        return unit

    def shapes(self, place: Array, condition: Index, stops: Sequence[int]) -> Array:
        """Return the series in y of places in the tables, shape (order, n).

        Parameters
        ----------
        place, condition
            Places and conditions, shape (n,), in the order of `by_load`.
        stops
            Where the places of each load begin, and the end of all.
        """
        shape, sizes = np.zeros((self._order, place.size)), np.empty(place.size)
        beyond = np.flatnonzero(np.abs(place) > _INSIDE)
        basis = chebyshev_values(np.minimum(np.maximum(place, -1.0), 1.0) if beyond.size else place, len(self._peak))
        for table, series, (first, last) in zip(self._tables, self._shapes, self._groups, strict=True):
            _, order, terms = series.shape
            for one, (start, stop) in zip(series, pairwise(stops[first : last + 1]), strict=True):
                np.matmul(one, basis[:terms, start:stop], out=shape[:order, start:stop])
            whole = slice(stops[first], stops[last])
            relative, decay = self._contacts(table, place[whole], condition[whole])
            sizes[whole] = relative**2 / (1.0 + decay)
        if beyond.size:
            exact = self._exact(place[beyond], condition[beyond])[:, 1:]
            shape[:, beyond] = (in_powers_of(exact) if self.powers else exact).T
        sizes += 1.0
        sizes *= self._finger.receptor_depth**2
        shape *= sizes
        return shape

    def _contacts(self, table: StressTable, place: Array, condition: Index) -> tuple[Array, Array]:
        along = (place - self._fall.take(condition)) / self._rise.take(condition)
        return table.contacts(along, self._across.take(condition))

    def _exact(self, place: Array, condition: Index) -> Array:
        """Return rows of places beyond the tables, shape (n, 1 + order), one load after another."""
        found = np.zeros((place.size, 1 + self._order))
        of_condition = np.empty(self.by_load.size, dtype=np.intp)
        for k, (start, stop) in enumerate(self._groups):
            of_condition[np.concatenate(self._columns[start:stop])] = k
        of_place = of_condition[condition]
        for k in np.unique(of_place):
            own = of_place == k
            rows = self._tables[k].exact(
                *np.broadcast_arrays(*self._contacts(self._tables[k], place[own], condition[own]))
            )
            found[own, : rows.shape[1]] = rows
        return found

    def _of_fingers(
        self, place: Array, relative: Array, decay: Array, amplitude: Array, fingers: Fingertips
    ) -> Profile:
        """Return the profile of one finger for each row."""
        unit, shape = np.empty_like(place), np.zeros((self._order, *place.shape))
        tables = [t for t, (start, stop) in zip(self._tables, self._groups, strict=True) for _ in range(start, stop)]
        for table, load, where in zip(tables, self._loads, self._columns, strict=True):
            across = table.scaled(table.across(load, fingers), 1)
            along, (_, terms, width) = place[:, where], table.table.shape
            series = table.series(np.clip(across[:, 0], -1.0, 1.0))
            rows = np.moveaxis(chebyshev_values(np.clip(along, -1.0, 1.0), terms), 0, -1) @ series
            beyond = (np.abs(along) > _INSIDE) | (np.abs(across) > _INSIDE)
            if beyond.any():
                rows[beyond] = table.exact(relative[:, where][beyond], decay[:, where][beyond])
            unit[:, where], shape[: width - 1, :, where] = rows[..., 0], np.moveaxis(rows[..., 1:], -1, 0)
        shape *= fingers.receptor_depth**2 * (1.0 + relative**2 / (1.0 + decay))
        return Profile(amplitude * unit, shape)


class FieldsAt:
    """The fields of a batch of touches, with profiles only where they are asked for.

    Parameters
    ----------
    fields
        The fields.
    place
        Places of the contacts in the tables, which end at -1 and 1, shape (batch, conditions).
    peak
        Stress on the axis [Pa], of the same shape.
    """

    def __init__(self, fields: StressFields, place: Array, peak: Array) -> None:
        self._of, self.place, self.peak = fields, place, peak

    def among(self, mask: NDArray[np.bool_]) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, load by load, and their profile."""
        of, (batch, conditions) = self._of, self.peak.shape
        found = np.flatnonzero(mask.T.take(of.by_load, axis=0))
        row, vector = np.divmod(found, batch)
        condition = of.by_load.take(row)
        at = vector * conditions + condition
        shape = of.shapes(self.place.take(at), condition, found.searchsorted(batch * of._stops).tolist())
        return at, Profile(self.peak.take(at), shape, of.powers)


def _in_powers(shapes: Sequence[Array], tolerances: Sequence[float]) -> tuple[list[Array], bool]:
    """Return series in y, shape (loads, order, terms), in powers; as they are if one loses 1 % of its tolerance."""
    found = [np.swapaxes(in_powers_of(np.swapaxes(part, 1, 2)), 1, 2) for part in shapes]
    scale = [np.abs(part).sum(axis=1).max() for part in shapes]
    lost = [np.finfo(float).eps * np.abs(part).sum(axis=(1, 2)).max() for part in found]
    small = all(one <= 0.01 * t * s for one, t, s in zip(lost, tolerances, scale, strict=True))
    return (found, True) if small else ([*shapes], False)
