"""Stress fields of many loads of one kind, from one table over load and reduced modulus (model.md 5).

A field is a smooth function of its load: the contact radius and the pressure's decay are powers of it. The table adds a
Chebyshev series in the logarithm of the load to those of a `StressField`. Summation over this series gives the table of
each load, so that compilation costs about as much as a dozen separate loads, regardless of their number.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, Force, Indentation, Load
from softness_bayes.touch.field import MODULUS_NODES, SHAPE_NODES, Profile, StressField
from softness_bayes.touch.inversion import Inversion, values_to_coefficients
from softness_bayes.touch.neuron.polynomials import chebyshev_values
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import kink_distances

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LOAD_NODES = (3, 5, 7, 9, 12, 15, 20, 26, 34, 44)
"""Numbers of Chebyshev nodes in the logarithm of the load; the first sufficient one is used."""

LEAST_DECAY = 1e-3
"""Added to the decay of the stiffest fabric to set the modulus beyond which a table's coordinate is logarithmic."""

_MEASURED = 7  # reduced moduli between nodes at which errors are measured under each load


def held(load: Load) -> float:
    """Return the quantity held constant by a load: its force [N] or its indentation [m]."""
    return load.newton if isinstance(load, Force) else load.depth


class LoadTable:
    """The stress fields of a range of loads of one kind.

    Parameters
    ----------
    least, greatest
        The ends of the range, both forces or both indentations.
    finger, readings, modulus_range, tolerance
        As for `StressField`. The tolerance applies to each load, relative to the maximum under that load.

    Attributes
    ----------
    root, reached
        As for `StressField`; the error is the maximum over the ends of the range and loads between the nodes.
    """

    def __init__(
        self,
        least: Load,
        greatest: Load,
        finger: Finger,
        readings: Readings,
        modulus_range: tuple[float, float],
        tolerance: float,
    ) -> None:
        if not finger.receptor_depth > 0:
            raise InputError("finger: receptor_depth is 0, expected a positive depth for a stress field")
        self.kind: type[Force] | type[Indentation] = type(least)
        self.finger, self.readings, self.tolerance = finger, readings, tolerance
        self.modulus_range = modulus_range
        self.log_loads = np.log(held(least)), np.log(held(greatest))
        self._inversion = Inversion(finger.receptor_depth, float(kink_distances(finger)[-1]), readings, tolerance)
        self.root = self._inversion.root
        ends, few = np.array([-1.0, 0.0, 1.0]), np.linspace(-1.0, 1.0, 9)
        touched = self._contacts(few, ends)
        self.y_least = float(self._inversion.y_least(*(part.reshape(-1) for part in touched)).min())
        self._fit()

    def ranges(self, loads: Array) -> tuple[Array, Array, Array]:
        """Return shift and the ends of ln(E_star + shift), as for a `StressField`, for loads [N or m]."""
        low, high = self.modulus_range
        if self.kind is Force:
            return np.zeros_like(loads), np.full_like(loads, np.log(low)), np.full_like(loads, np.log(high))
        radius = np.sqrt(self.finger.radius * loads)
        shift = high / (self.readings.pressure.decay(np.full_like(radius, high), radius, self.finger) + LEAST_DECAY)
        return shift, np.log(shift), np.log(high + shift)

    def _contacts(self, along: Array, across: Array) -> tuple[Array, Array]:
        """Return contact radius [m] and decay at all pairs of scaled coordinates, shape (across, along)."""
        first, last = self.log_loads
        loads = np.exp(0.5 * (first + last) + 0.5 * (last - first) * across)
        shift, low, high = (part[:, None] for part in self.ranges(loads))
        modulus = np.exp(0.5 * (low + high) + 0.5 * (high - low) * along) - shift
        modulus = np.maximum(modulus, 0.0)
        if self.kind is Force:
            radius = np.cbrt(0.75 * self.finger.radius * loads[:, None] / modulus)
        else:
            radius = np.broadcast_to(np.sqrt(self.finger.radius * loads[:, None]), modulus.shape)
        return radius, self.readings.pressure.decay(modulus, radius, self.finger)

    def _rows(self, along: Array, across: Array, shape_nodes: int) -> Array:
        """Return exact rows at all pairs of scaled coordinates, shape (across, along, 1 + shape_nodes)."""
        radius, decay = (part.reshape(-1) for part in self._contacts(along, across))
        rows = self._inversion.rows(radius, decay, shape_nodes, self.y_least)
        return rows.reshape(across.size, along.size, -1)

    def _fit(self) -> None:
        ends, few = np.array([-1.0, 0.0, 1.0]), chebyshev.chebpts1(5)
        for self.shape_nodes in SHAPE_NODES:
            rows = self._rows(np.linspace(-0.999, 0.999, 5), ends, self.shape_nodes)
            shape = np.abs(rows[..., 1:])
            tail = shape[..., -(self.shape_nodes // 10) :].sum(axis=-1)
            if (tail.max(axis=1) <= self.tolerance * shape.sum(axis=-1).max(axis=1)).all():
                break
        # errors are relative to the maximum of each load; those of the series, to the overall maximum
        scales = np.stack([rows[..., 0].max(axis=1), shape.sum(axis=-1).max(axis=1)])
        tolerance = self.tolerance * float((scales.min(axis=1) / scales.max(axis=1)).min())
        for n_across in LOAD_NODES:
            rows = self._rows(few, chebyshev.chebpts1(n_across), self.shape_nodes)
            size = np.abs(np.tensordot(values_to_coefficients(n_across), rows, 1)) / _scale(rows)
            if size[-2:].max() <= 0.3 * tolerance:
                break
        for n_along in MODULUS_NODES:
            rows = self._rows(chebyshev.chebpts1(n_along), ends, self.shape_nodes)
            size = np.abs(np.einsum("ij,tjk->tik", values_to_coefficients(n_along), rows)) / _scale(rows)
            if size.max(axis=(0, 2))[-4:].sum() <= tolerance:
                break
        rows = self._rows(chebyshev.chebpts1(n_along), chebyshev.chebpts1(n_across), self.shape_nodes)
        table = np.tensordot(values_to_coefficients(n_across), rows, 1)
        self._whole = np.einsum("ij,tjk->tik", values_to_coefficients(n_along), table)
        self._size = np.abs(self._whole) / _scale(rows) * (self.tolerance / tolerance)
        self.table = self._within(self.tolerance)
        self.reached = self._measure()

    def _within(self, tolerance: float) -> Array:
        """Return the series truncated where the remaining coefficients sum to less than a tenth of the tolerance."""
        size = self._size

        def kept(sizes: Array) -> int:
            return max(int((sizes[::-1].cumsum()[::-1] > 0.1 * tolerance).sum()), 2)

        across, along = kept(size.max(axis=(1, 2))), kept(size.max(axis=(0, 2)))
        return self._whole[:across, :along, : 1 + kept(size[..., 1:].max(axis=(0, 1)))]

    def _measure(self) -> float:
        """Return the largest difference between table and field, relative to the maximum under the same load."""
        n = self.table.shape[0]
        between = np.cos(np.pi * np.arange(1, n) / n)
        across = np.concatenate([[-1.0], between, [1.0]])
        along = np.cos(np.pi * (np.arange(_MEASURED) + 0.3) / _MEASURED)
        y = np.cos(np.pi * (np.arange(61) + 0.3) / 61)
        radius, decay = (part.reshape(-1) for part in self._contacts(along, across))
        peak, shape = self._inversion.values(radius, decay, y, self.y_least)
        shape = shape.reshape(across.size, along.size, -1)
        peak = peak.reshape(across.size, along.size)
        basis = chebyshev.chebvander(across, n - 1), chebyshev.chebvander(along, self.table.shape[1] - 1)
        rows = np.einsum("li,ak,ikw->law", *basis, self.table, optimize=True)
        found = rows[..., 1:] @ chebyshev.chebvander(y, self.table.shape[2] - 2).T
        of_peak = np.abs(rows[..., 0] - peak).max(axis=1) / peak.max(axis=1)
        of_shape = np.abs(found - shape).max(axis=(1, 2)) / np.abs(shape).max(axis=(1, 2))
        return float(max(of_peak.max(), of_shape.max()))

    def cut(self, tolerance: float) -> LoadTable:
        """Return the table with series truncated at a larger tolerance; `reached` still refers to the full series."""
        if tolerance <= self.tolerance:
            return self
        part = copy.copy(self)
        part.table = self._within(tolerance)
        part.tolerance = tolerance
        return part

    def fields(self, loads: Sequence[Load]) -> list[LoadField]:
        """Return the fields of loads within the range."""
        values = np.array([held(load) for load in loads])
        first, last = self.log_loads
        across = np.clip((2.0 * np.log(values) - (first + last)) / max(last - first, 1e-9), -1.0, 1.0)
        n_across, terms, width = self.table.shape
        # transposed: a matrix product with the polynomials gives rows
        summed = chebyshev.chebvander(across, n_across - 1) @ np.swapaxes(self.table, 1, 2).reshape(n_across, -1)
        side = LoadFields(self, summed.reshape(len(loads), width, terms), *self.ranges(values))
        return [LoadField(side, place, load) for place, load in enumerate(loads)]


class LoadFields(NamedTuple):
    """Tables of single loads, stacked along the first axis of each array."""

    of: LoadTable
    """Table from which they were computed."""
    tables: Array
    """Series of [unit peak, coefficients of Q / size] in the modulus, shape (loads, 1 + order, terms)."""
    shift: Array
    low: Array
    high: Array
    """Shift [Pa], and the ends of ln(E_star + shift)."""

    def scaled(self, places: Index, modulus: Array) -> Array:
        """Return ln(E_star + shift), scaled to [-1, 1], of conditions under the loads at the given indices."""
        low, high = self.low[places], self.high[places]
        return (2.0 * np.log(modulus + self.shift[places]) - (low + high)) / (high - low)


class LoadField(StressField):
    """The field of one load of a `LoadTable`, with the members of any `StressField`."""

    def __init__(self, side: LoadFields, place: int, load: Load) -> None:
        table = side.of
        self.side, self.place = side, place
        self.load, self.finger, self.readings, self.tolerance = load, table.finger, table.readings, table.tolerance
        self._inversion, self.root, self.shape_nodes = table._inversion, table.root, table.shape_nodes
        self.shift, self.y_least, self.reached = float(side.shift[place]), table.y_least, table.reached
        self.log_range = float(side.low[place]), float(side.high[place])
        self.table = side.tables[place].T

    def cut(self, tolerance: float) -> LoadField:
        """Return the field with series truncated at a larger tolerance; `cut_together` is faster for many fields."""
        return self.side.of.cut(tolerance).fields([self.load])[0]


def cut_together(fields: Sequence[LoadField], tolerance: float) -> list[LoadField]:
    """Return fields of one table with series truncated at a larger tolerance."""
    table = fields[0].side.of
    cut = table.cut(tolerance)
    return list(fields) if cut is table else cut.fields([field.load for field in fields])


def profiles_of_loads(fields: Sequence[LoadField], columns: Sequence[Index], modulus: Array, radius: Array) -> Profile:
    """Return the fields of many loads of one table at reduced moduli, concatenated in the order of the columns.

    Parameters
    ----------
    fields
        One for each load, from one `LoadTable.fields`.
    columns
        The conditions under each load, which index the last axis of the moduli.
    modulus, radius
        E_star [Pa] and contact radius [m], shape (batch, conditions).

    Returns
    -------
    Profile
        Profile of the conditions in `np.concatenate(columns)`.

    Raises
    ------
    NumericalError
        If a modulus is not a positive finite number.
    """
    side, where = fields[0].side, np.concatenate(columns)
    modulus, radius = modulus[:, where], radius[:, where]
    if not ((modulus > 0) & np.isfinite(modulus)).all():
        raise NumericalError("stress field: a reduced modulus is not positive and finite")
    places, sizes = np.array([field.place for field in fields]), [part.size for part in columns]
    x = side.scaled(np.repeat(places, sizes), modulus)
    beyond = np.abs(x) > 1 + 1e-12
    batch, n = x.shape
    _, width, terms = side.tables.shape
    # conditions before the batch, so that those of each load form one block
    basis = chebyshev_values(np.minimum(np.maximum(x.T, -1.0), 1.0), terms).reshape(terms, n * batch)
    rows, ends = np.empty((width, n * batch)), np.cumsum([0, *sizes]) * batch
    for place, start, stop in zip(places.tolist(), ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        np.matmul(side.tables[place], basis[:, start:stop], out=rows[:, start:stop])
    rows = np.ascontiguousarray(rows.reshape(width, n, batch).swapaxes(1, 2))
    if beyond.any():
        for field, start, stop in zip(fields, (ends[:-1] // batch).tolist(), (ends[1:] // batch).tolist(), strict=True):
            part = beyond[:, start:stop]
            if part.any():
                rows[:, :, start:stop][:, part] = field.exact_rows(modulus[:, start:stop][part])[:, :width].T
    shape = rows[1:]
    shape *= fields[0].size(modulus, radius)
    finger = fields[0].finger
    return Profile(
        fields[0].readings.pressure.amplitude(modulus, radius, finger) * rows[0], shape, np.full(n, fields[0].y_least)
    )


def _scale(rows: Array) -> Array:
    """Return the scale of errors of [unit peak, coefficients of Q / size]: the maxima over the table."""
    largest = np.abs(rows[..., 1:]).sum(axis=-1).max()
    return np.concatenate([[rows[..., 0].max()], np.full(rows.shape[-1] - 1, largest)])
