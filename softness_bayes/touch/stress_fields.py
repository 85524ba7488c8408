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
    Load,
    Loads,
    SkinDisplacement,
    log_compliance_ratio,
    reduced_modulus,
    skin_modulus,
)
from softness_bayes.touch.neuron.polynomials import TotalDegree
from softness_bayes.touch.population import WIDE, Profile
from softness_bayes.touch.stress_table import INSIDE, StressTable, TablePart, touched, values_to_coefficients

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class StressFields:
    """The stress fields of some conditions.

    Parameters
    ----------
    tables
        The table of each load.
    loads
        The load of each condition.
    finger
        The finger, where it does not vary.
    """

    def __init__(self, tables: Mapping[Load, StressTable], loads: Sequence[Load], finger: Finger) -> None:
        own = [tables[load] for load in loads]
        self._tables, self._finger = [*{id(table): table for table in own}.values()], finger
        self._columns = [np.flatnonzero([one is table for one in own]) for table in self._tables]
        self._loads = [Loads([loads[k] for k in columns.tolist()]) for columns in self._columns]
        self.by_table = np.concatenate(self._columns)
        self._stops = np.cumsum([0, *(columns.size for columns in self._columns)])
        self.across = self._places_across(finger)
        near, rows = WIDE ** self._tables[0].root, [np.eye(table.table.shape[-1]) for table in self._tables]
        self._peaks = [TablePart(table, row[:1]) for table, row in zip(self._tables, rows, strict=True)]
        self._profiles = {
            True: (
                near,
                [TablePart(t, t.restriction(near) @ row[1:]) for t, row in zip(self._tables, rows, strict=True)],
            ),
            False: (0.0, [TablePart(table, row[1:]) for table, row in zip(self._tables, rows, strict=True)]),
        }

    def _places_across(self, finger: Fingertip) -> Array:
        """Return the places across the tables, shape (conditions,), or (batch, conditions) of individual fingers."""
        places = [
            table.scaled(table.across(loads, finger), 1) for table, loads in zip(self._tables, self._loads, strict=True)
        ]
        found = np.empty((*places[0].shape[:-1], self.by_table.size))
        for columns, place in zip(self._columns, places, strict=True):
            found[..., columns] = place
        return found

    def at(self, modulus: Array, radius: Array, finger: Fingertip) -> FieldsAt:
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
        across = self.across if finger is self._finger else self._places_across(finger)
        every, along, peak = np.broadcast_to(across, modulus.shape), np.empty(modulus.shape), np.empty(modulus.shape)
        for table, unit_peak, columns in zip(self._tables, self._peaks, self._columns, strict=True):
            place = table.scaled(table.along(relative[:, columns], decay[:, columns]), 0)
            unit = unit_peak(place.ravel(), every[:, columns].ravel())
            along[:, columns], peak[:, columns] = place, unit.reshape(place.shape)
        peak *= readings.pressure.amplitude(modulus, radius, finger)
        return FieldsAt(self, along, across, peak, finger.receptor_depth)

    def covers(self, place: Array) -> bool:
        """Return whether the tables cover some places along them."""
        return bool((np.abs(place) <= INSIDE).all())

    def profile(self, at: FieldsAt, lanes: Index, stops: Sequence[int], near: bool) -> Profile:
        """Return the profile of some touches.

        Parameters
        ----------
        at
            The fields of a batch.
        lanes
            Indices into the flattened batch, table by table.
        stops
            Where the touches of each table begin, and the end of all.
        near
            True for the shorter series of stresses from `WIDE` of the peak on.
        """
        least, every = self._profiles[near]
        vector, condition = np.divmod(lanes, at.peak.shape[1])
        along = at.along.take(lanes)
        across = at.across.take(condition) if at.across.ndim == 1 else at.across.take(lanes)
        depth = np.take(at.depth, vector) if np.ndim(at.depth) else at.depth
        shape, sizes = np.zeros((max(len(part.matrix) for part in every), lanes.size)), np.empty(lanes.size)
        for part, some in zip(every, (slice(*ends) for ends in pairwise(stops)), strict=True):
            shape[: len(part.matrix), some] = part(along[some], across[some])
            relative, decay = part.table.contacts(along[some], across[some])
            sizes[some] = 1.0 + relative**2 / (1.0 + decay)
        shape *= sizes * depth**2
        return Profile(at.peak.take(lanes), shape, least)


class FieldsAt:
    """The fields of a batch of touches, with profiles only where they are asked for.

    Parameters
    ----------
    fields
        The fields.
    along, across
        Places of the contacts in the tables, which end at -1 and 1, shape (batch, conditions); those across may have
        the shape (conditions,).
    peak
        Stress on the axis [Pa], shape (batch, conditions).
    depth
        Depth of the receptors [m], a number or of shape (batch, 1).
    """

    def __init__(self, fields: StressFields, along: Array, across: Array, peak: Array, depth: Array | float) -> None:
        self._of, self.along, self.across, self.peak, self.depth = fields, along, across, peak, depth

    def among(self, mask: NDArray[np.bool_], near: bool) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, table by table, and their profile."""
        of, (batch, conditions) = self._of, self.peak.shape
        found = np.flatnonzero(mask.T.take(of.by_table, axis=0))
        row, vector = np.divmod(found, batch)
        lanes = vector * conditions + of.by_table.take(row)
        return lanes, of.profile(self, lanes, found.searchsorted(batch * of._stops).tolist(), near)


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

    def fields(self, b: Array, m: Array, modulus: Array | None, finger: Fingertip) -> FieldsAt:
        """Return the stress fields; arguments as `contact` takes them."""
        if self._series is None or modulus is not None or finger is not self._finger:
            contact = self.contact(b, m, modulus, finger)
            return self._fields.at(contact.reduced_modulus, contact.radius, finger)
        found, outside = self._series(b, m)
        if outside.any():
            found[outside] = self._solved(b[outside], m[outside])
        n = self._modulus.size
        return FieldsAt(
            self._fields, found[:, :n], self._fields.across, np.exp(found[:, n:]), self._finger.receptor_depth
        )

    def _solved(self, b: Array, m: Array) -> Array:
        """Return the places in the tables, then ln of the stress on the axis [Pa], shape (batch, 2 × conditions)."""
        contact = self.contact(b, m, None, self._finger)
        fields = self._fields.at(contact.reduced_modulus, contact.radius, self._finger)
        return np.concatenate([fields.along, np.log(np.maximum(fields.peak, 1e-300))], axis=1)
