"""Stress fields of a scene's conditions, from the tables of its loads, ready to be evaluated at any stress."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import NumericalError
from softness_bayes.touch.contact import Finger, Fingertip, Fingertips, Indentation, Load
from softness_bayes.touch.neuron.polynomials import chebyshev_values, clenshaw, horner, in_powers_of
from softness_bayes.touch.stress_table import StressTable, touched

Array = NDArray[np.float64]
Index = NDArray[np.intp]

Y_LEAST = 1e-6
"""Least y, at a thousand times the size of the patch: far beyond any pad."""

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
