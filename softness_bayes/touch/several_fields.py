"""Stress fields of several loads side by side, evaluated only where receptors fire (model.md 5)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import NumericalError
from softness_bayes.touch.field import Profile, StressField
from softness_bayes.touch.inversion import values_to_coefficients
from softness_bayes.touch.neuron.polynomials import chebyshev_values, in_powers_of, monomials

Array = NDArray[np.float64]
Index = NDArray[np.intp]

ROUNDING = 1e-2
"""Share of a field's tolerance that may be lost when its series in T_k are converted to powers (of y, and also of the
place in the table), and when that of the peak is truncated."""

OF_SIZE = 0.1
"""Share of a field's tolerance that may be lost when the series of Q / size is replaced by one of Q."""

LONGER = 16
"""Number of further terms in which it is looked for; it has to end two of them earlier."""

_THE_END = 1.0 + 1e-12  # largest place in a table


def profiles(fields: Sequence[StressField], columns: Sequence[Index], modulus: Array, radius: Array) -> Profile:
    """Return the fields of several loads at reduced moduli, side by side; arguments as `SeveralFields` takes them."""
    return SeveralFields(fields, columns).at(modulus, radius).whole()


class _Series(NamedTuple):
    """Series of several fields, in y along the first axis and in the place in the table along the second."""

    parts: list[Array]
    """One for each field."""
    allowed: Array
    """Error allowed in each."""
    with_size: bool
    """True if they are of Q [m²], False if of Q / size."""


class SeveralFields:
    """The fields of several loads, side by side.

    Parameters
    ----------
    fields
        One for each load.
    columns
        The conditions under each load.
    fast
        Whether series may be of Q itself, and in powers, where that loses little (`OF_SIZE`, `ROUNDING`).
    """

    def __init__(self, fields: Sequence[StressField], columns: Sequence[Index], fast: bool = False) -> None:
        self.fields, self.columns = fields, columns
        # transposed: a matrix product with the polynomials of the places gives rows
        allowed = np.array([field.tolerance * np.abs(field.table[0, 1]) for field in fields])
        plain = _Series([field.table[:, 1:].T for field in fields], allowed, False)
        forms = [one for one in (_of_q(fields, allowed), plain) if one is not None] if fast else [plain]
        in_y = [_in_powers(one.parts, one.allowed, axis=0) if fast else None for one in forms]
        # powers of y save more than the size does
        best = next((k for k, found in enumerate(in_y) if found is not None), 0)
        of_y, (series, allowed, self.with_size) = in_y[best], forms[best]
        of_both = None if of_y is None else _in_powers(of_y, allowed, axis=1)
        self.powers, self.polynomials = of_y is not None, chebyshev_values if of_both is None else monomials
        self.series = [np.ascontiguousarray(part) for part in of_both or of_y or series]
        self.by_load = np.concatenate(columns)
        self.ends = np.cumsum([0, *(where.size for where in columns)])
        conditions = self.by_load.size
        self.order, self.terms = (max(sizes) for sizes in zip(*(part.shape for part in self.series), strict=True))
        self.shift, self.rise, self.fall, self.y_least = np.empty((4, conditions))
        of_peak = [_peak_series(field) for field in fields]
        self.of_peak = np.zeros((max(part.size for part in of_peak), conditions))
        for field, where, peak in zip(fields, columns, of_peak, strict=True):
            low, high = field.log_range
            # ln(E_star + shift) is scaled to [-1, 1] over the table's range
            self.rise[where], self.fall[where] = 2.0 / (high - low), (low + high) / (high - low)
            self.shift[where], self.y_least[where] = field.shift, field.y_least
            self.of_peak[: peak.size, where] = peak[:, None]

    def at(self, modulus: Array, radius: Array) -> FieldsAt:
        """Return the fields at E_star [Pa] and the contact radius [m], both of shape (batch, conditions).

        Raises
        ------
        NumericalError
            If a modulus is not a positive finite number.
        """
        if not ((modulus > 0) & np.isfinite(modulus)).all():
            raise NumericalError("stress field: a reduced modulus is not positive and finite")
        place = self._places(modulus)
        return FieldsAt(self, place, self._peak(place, modulus, radius))

    def covers(self, modulus: Array) -> bool:
        """Return whether the tables cover all of some E_star [Pa], shape (batch, conditions)."""
        return bool((np.abs(self._places(modulus)) <= _THE_END).all())

    def _places(self, modulus: Array) -> Array:
        """Return the places of moduli [Pa] in the tables: ln(E_star + shift), scaled to [-1, 1] over their range."""
        place = np.log(modulus + self.shift)
        place *= self.rise
        place -= self.fall
        return place

    def _peak(self, place: Array, modulus: Array, radius: Array) -> Array:
        """Return the stress on the axis [Pa]."""
        inside = np.minimum(np.maximum(place, -1.0), 1.0)
        unit = np.einsum("kbn,kn->bn", chebyshev_values(inside, len(self.of_peak)), self.of_peak)
        beyond = np.abs(place) > _THE_END
        if beyond.any():
            for field, where in zip(self.fields, self.columns, strict=True):
                if (outside := beyond[:, where]).any():
                    rows, columns = np.nonzero(outside)
                    unit[rows, where[columns]] = field.exact_rows(modulus[rows, where[columns]])[:, 0]
        first = self.fields[0]
        return first.readings.pressure.amplitude(modulus, radius, first.finger) * unit


class FieldsAt:
    """The fields of several loads, with profiles only where they are asked for.

    Parameters
    ----------
    several
        The fields.
    place
        Places of the reduced moduli in the tables, which end at -1 and 1, shape (batch, conditions).
    peak
        Stress on the axis [Pa], of the same shape.
    """

    def __init__(self, several: SeveralFields, place: Array, peak: Array) -> None:
        self._of, self.place, self.peak = several, place, peak

    def whole(self) -> Profile:
        """Return the profile of all elements."""
        at, part = self.among(np.ones(self.peak.shape, dtype=bool))
        shape = np.empty_like(part.shape)
        shape[:, at] = part.shape
        return Profile(self.peak, shape.reshape(len(shape), *self.peak.shape), self._of.y_least, part.powers)

    def among(self, mask: NDArray[np.bool_]) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, load by load, and their profile."""
        several, (batch, conditions) = self._of, self.peak.shape
        found = np.flatnonzero(mask.T.take(several.by_load, axis=0))
        ends = found.searchsorted(batch * several.ends).tolist()
        row, vector = np.divmod(found, batch)
        condition = several.by_load.take(row)
        at = vector * conditions + condition
        place, shape = self.place.take(at), np.empty((several.order, at.size))
        beyond = np.abs(place) > _THE_END
        far = bool(beyond.any())
        basis = several.polynomials(np.minimum(np.maximum(place, -1.0), 1.0) if far else place, several.terms)
        for field, series, (start, stop) in zip(several.fields, several.series, pairwise(ends), strict=True):
            order, terms = series.shape
            part = shape[:, start:stop]
            np.matmul(series, basis[:terms, start:stop], out=part[:order])
            part[order:] = 0.0
            if not several.with_size:
                part[:order] *= _sizes(field, place[start:stop])
            if far and (outside := np.flatnonzero(beyond[start:stop])).size:
                part[:order, outside] = _exact_shapes(field, place[start:stop].take(outside), order, several.powers).T
        return at, Profile(self.peak.take(at), shape, several.y_least.take(condition), several.powers)


def _sizes(field: StressField, place: Array) -> Array:
    """Return the scale of Q [m²] at places in the table of a field."""
    modulus = field.moduli(place)
    return field.size(modulus, field.load.close(modulus, field.finger).radius)


def _exact_shapes(field: StressField, place: Array, order: int, powers: bool) -> Array:
    """Return coefficients of Q [m²], shape (n, order), computed without the table, at places of shape (n,)."""
    shape = field.exact_rows(field.moduli(place))[:, 1 : order + 1] * _sizes(field, place)[:, None]
    return in_powers_of(shape) if powers else shape


def _of_q(fields: Sequence[StressField], allowed: Array) -> _Series | None:
    """Return series of Q; None if `LONGER` further terms are too few for one.

    Parameters
    ----------
    fields
        The fields.
    allowed
        Error of Q / size allowed for each field.
    """
    found, of_q = [], []
    for field, error in zip(fields, allowed, strict=True):
        terms = field.table.shape[0]
        x = chebyshev.chebpts1(terms + LONGER)
        size = _sizes(field, x)
        values = chebyshev.chebvander(x, terms - 1) @ field.table[:, 1:] * size[:, None]
        series = values_to_coefficients(x.size) @ values
        left = np.abs(series).sum(axis=1)[::-1].cumsum()[::-1]
        of_q.append(error * size.min())
        keep = int((left > OF_SIZE * of_q[-1]).sum())
        if keep > x.size - 2:
            return None
        found.append(series[:keep].T)
    return _Series(found, np.array(of_q), True)


def _in_powers(series: Sequence[Array], allowed: Array, axis: int) -> list[Array] | None:
    """Return series in powers along an axis, or None if one loses more than `ROUNDING` of the error allowed."""
    found = [in_powers_of(part) if axis == 1 else in_powers_of(part.T).T for part in series]
    lost = np.finfo(float).eps * np.array([np.abs(part).sum() for part in found])
    return found if (lost <= ROUNDING * allowed).all() else None


def _peak_series(field: StressField) -> Array:
    """Return the terms of the peak's series without which it would lose more than `ROUNDING` of the tolerance."""
    series = field.table[:, 0]
    left = np.abs(series)[::-1].cumsum()[::-1]
    return series[: max(int((left > ROUNDING * field.tolerance * left[0]).sum()), 1)]


def side_by_side(parts: Sequence[tuple[NDArray[np.intp], Profile]]) -> Profile:
    """Return the profiles of several sets of conditions as one; together the sets are all conditions."""
    batch, n = parts[0][1].peak.shape[0], sum(where.size for where, _ in parts)
    peak, y_least = np.empty((batch, n)), np.empty(n)
    if len(parts) == 1 and (np.diff(parts[0][0]) == 1).all():
        return parts[0][1]
    shape = np.zeros((max(len(part.shape) for _, part in parts), batch, n))
    for where, part in parts:
        peak[:, where], y_least[where] = part.peak, part.y_least
        shape[: len(part.shape), :, where] = part.shape
    return Profile(peak, shape, y_least)
