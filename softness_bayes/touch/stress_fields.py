"""From the skin to the contacts and stress fields of a scene's conditions (model.md 2-5).

Stress fields come from the tables of the loads and are ready to be evaluated at any stress. For given fabrics and
loads, the reduced modulus and the stress on the axis depend on the skin alone, that is on b and m, and are smooth
functions of ln b and of the root of m, which needs fewer terms than ln m or m itself. Over the range of a prior, one
polynomial each for the place in the table of the stress fields and for the logarithm of the peak stress replaces the
search for the skin's modulus, where its error is small enough.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.base.errors import NumericalError
from softness_bayes.touch.contact import (
    Contact,
    Finger,
    Fingertip,
    Fingertips,
    Indentation,
    Load,
    Loads,
    SkinDisplacement,
    log_compliance_ratio,
    reduced_modulus,
    skin_modulus,
)
from softness_bayes.touch.neuron.polynomials import TotalDegree, chebyshev_values
from softness_bayes.touch.population import WIDE, Profile
from softness_bayes.touch.stress_table import StressTable, restricted, touched, values_to_coefficients

Array = NDArray[np.float64]
Index = NDArray[np.intp]


_INSIDE = 1.0 + 1e-9  # largest coordinate of a table, scaled to [-1, 1]


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
        self._order = max(part.shape[1] for part in shapes)
        self._near = WIDE ** self._tables[0].root
        self._whole_shapes = shapes
        pairs = zip(self._tables, shapes, strict=True)
        self._near_shapes = [table.restriction(self._near) @ whole for table, whole in pairs]

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

    def profile(self, peak: Array, place: Array, condition: Index, stops: Sequence[int], near: bool) -> Profile:
        """Return the profile of places in the tables.

        Parameters
        ----------
        peak, place, condition
            Stresses on the axis [Pa], places and conditions, shape (n,), in the order of `by_load`.
        stops
            Where the places of each load begin, and the end of all.
        near
            True for the shorter series of stresses from `WIDE` of the peak on.
        """
        every, least = (self._near_shapes, self._near) if near else (self._whole_shapes, 0.0)
        shape, sizes = np.zeros((max(one.shape[1] for one in every), place.size)), np.empty(place.size)
        beyond = np.flatnonzero(np.abs(place) > _INSIDE)
        basis = chebyshev_values(np.minimum(np.maximum(place, -1.0), 1.0) if beyond.size else place, len(self._peak))
        for table, series, (first, last) in zip(self._tables, every, self._groups, strict=True):
            _, order, terms = series.shape
            for one, (start, stop) in zip(series, pairwise(stops[first : last + 1]), strict=True):
                np.matmul(one, basis[:terms, start:stop], out=shape[:order, start:stop])
            whole = slice(stops[first], stops[last])
            relative, decay = self._contacts(table, place[whole], condition[whole])
            sizes[whole] = relative**2 / (1.0 + decay)
        if beyond.size:
            exact = self._exact(place[beyond], condition[beyond])[:, 1:]
            shape[:, beyond] = restricted(self._order, least)[: len(shape)] @ exact.T
        sizes += 1.0
        sizes *= self._finger.receptor_depth**2
        shape *= sizes
        return Profile(peak, shape, least)

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

    def among(self, mask: NDArray[np.bool_], near: bool) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, load by load, and their profile."""
        of, (batch, conditions) = self._of, self.peak.shape
        found = np.flatnonzero(mask.T.take(of.by_load, axis=0))
        row, vector = np.divmod(found, batch)
        condition = of.by_load.take(row)
        at = vector * conditions + condition
        stops = found.searchsorted(batch * of._stops).tolist()
        return at, of.profile(self.peak.take(at), self.place.take(at), condition, stops, near)


SKIN_SHARE = 0.03
"""Error allowed in the place in a table and in ln of the peak stress, as a share of the stress fields' tolerance."""


DEGREES = {18: tuple(range(6, 15)), 28: (16, 18, 20, 22, 24)}
"""Total degrees of the polynomials, the first sufficient of which is taken, for each number of nodes in each parameter
to which they are fitted."""


FAR = 1e4
"""Error, relative to the sufficient one, above which polynomials of higher degrees are not tried."""


_AT_THE_EDGE = 1e-9  # relative to the box's half-width: allows for rounding at a prior's end


class SkinBox(NamedTuple):
    """Ranges of the skin's parameters, with positive ends."""

    b: tuple[float, float]
    """Modulus at rest [Pa]."""
    m: tuple[float, float]
    """Stiffening exponent, as the reading of the skin's compression has it."""


class SkinSeries:
    """Polynomials in ln b and the root of m, one for each column, fitted to a function over a box.

    Parameters
    ----------
    box
        The range that the polynomials cover.
    function
        Values (points, columns) of skins b and m, each of shape (points,).
    enough
        Error at which no higher degree is tried.

    Attributes
    ----------
    error
        Largest error at the points to which they were fitted. It was up to 1.5 times that at the box's corners.
    """

    def __init__(self, box: SkinBox, function: Callable[[Array, Array], Array], enough: float) -> None:
        ends = self._coordinates(*np.array(box))
        self._middle, self._half = ends.mean(axis=1)[:, None], np.maximum(0.5 * np.diff(ends, axis=1), 1e-6)
        for nodes, degrees in DEGREES.items():
            grid = np.array(np.meshgrid(*2 * (chebyshev.chebpts1(nodes),), indexing="ij")).reshape(2, -1)
            of_b, of_m = self._middle + self._half * grid
            exact = function(np.exp(of_b), of_m**2)
            to_series = values_to_coefficients(nodes)
            series = np.einsum("ij,kl,jlc->ikc", to_series, to_series, exact.reshape(nodes, nodes, -1), optimize=True)
            for degree in degrees:
                self._terms = TotalDegree(2, degree)
                self._coefficients = series[*self._terms.exponents]
                self.error = float(np.abs(self._terms.basis(grid) @ self._coefficients - exact).max())
                if self.error <= enough:
                    return
            if self.error > FAR * enough:
                return

    @staticmethod
    def _coordinates(b: Array, m: Array) -> Array:
        # a negative m, which is refused later, lies outside any box
        return np.array([np.log(b), np.sqrt(np.maximum(m, 0.0))])

    def __call__(self, b: Array, m: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the values, shape (batch, columns), and which of the skins b and m (batch,) lie outside the box."""
        x = self._coordinates(b, m)
        x -= self._middle
        x /= self._half
        outside = np.logical_not((np.abs(x) <= 1.0 + _AT_THE_EDGE).all(axis=0))  # NaN is outside
        if outside.any():
            x = np.minimum(np.maximum(x, -1.0), 1.0)
        return self._terms.basis(x) @ self._coefficients, outside


class Mechanics:
    """The contacts and stress fields of all conditions.

    Parameters
    ----------
    modulus, poisson
        E_fab [Pa] and nu_fab of each condition.
    loads
        The load of each condition.
    finger, displacement
        The usual finger, and the reading of the skin's compression.
    fields
        The stress fields.
    box
        Skins that polynomials cover; None for no polynomials.
    tolerance
        The tolerance of the stress fields.
    """

    def __init__(
        self,
        modulus: Array,
        poisson: Array,
        loads: Sequence[Load],
        finger: Finger,
        displacement: SkinDisplacement,
        fields: StressFields,
        box: SkinBox | None,
        tolerance: float,
    ) -> None:
        self._modulus, self._poisson, self._loads = modulus, poisson, Loads(loads)
        self._finger, self._displacement, self._fields = finger, displacement, fields
        self._log_k = log_compliance_ratio(modulus, poisson, finger)
        self._compression = self._loads.compression(finger, displacement)
        self._series: SkinSeries | None = None
        # E_star rises with both b and m; beyond a table every point is inverted, which is slow
        if box is not None and fields.covers(self._solved(np.array(box.b), np.array(box.m))[:, : modulus.size]):
            series = SkinSeries(box, self._solved, SKIN_SHARE * tolerance)
            self._series = series if series.error <= SKIN_SHARE * tolerance else None

    def contact(self, b: Array, m: Array, modulus: Array | None, finger: Fingertip) -> Contact:
        """Return the contacts, with fields of shape (batch, conditions).

        Parameters
        ----------
        b, m
            The skin's modulus at rest [Pa] and exponent, shape (batch,).
        modulus
            E_fab [Pa] that replaces the conditions' moduli, shape (batch, conditions), or None.
        finger
            The usual finger, or one for each row.
        """
        log_k = self._log_k
        if modulus is None:
            modulus = self._modulus
        else:
            log_k = log_k - np.log(modulus / self._modulus)
        same = finger is self._finger
        compression = self._compression if same else self._loads.compression(finger, self._displacement)
        skin = skin_modulus(*compression, log_k, b[:, None], m[:, None])
        return self._loads.contact(skin, reduced_modulus(skin, modulus, self._poisson, self._finger), finger)

    def fields(self, b: Array, m: Array, modulus: Array | None, finger: Fingertip) -> FieldsAt | Profile:
        """Return the stress fields; arguments as `contact` takes them."""
        if self._series is None or modulus is not None or finger is not self._finger:
            contact = self.contact(b, m, modulus, finger)
            return self._fields.at(contact.reduced_modulus, contact.radius, finger)
        found, outside = self._series(b, m)
        if outside.any():
            found[outside] = self._solved(b[outside], m[outside])
        n = self._modulus.size
        return FieldsAt(self._fields, found[:, :n], np.exp(found[:, n:]))

    def _solved(self, b: Array, m: Array) -> Array:
        """Return the places in the tables, then ln of the stress on the axis [Pa], shape (batch, 2 × conditions)."""
        contact = self.contact(b, m, None, self._finger)
        fields = self._fields.at(contact.reduced_modulus, contact.radius, self._finger)
        assert isinstance(fields, FieldsAt), "polynomials are for one finger"
        return np.concatenate([fields.place, np.log(np.maximum(fields.peak, 1e-300))], axis=1)
