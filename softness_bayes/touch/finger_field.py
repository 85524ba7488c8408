"""Stress field of one load for fingers whose radius and receptor depth vary, tabulated once (model.md 5).

With the receptors' depth as the unit of length, the fields of all loads, moduli, radii and depths form a family with
two parameters: A = a / z, and the decay q of the pressure. One load and a range of fingers cover a narrow band of this
family, which is straightened by two coordinates: one along the moduli, one across the fingers.

    indentation   along: ln(1 + q)   across: ln(A), determined by the finger force         along: ln(A)       across:
    ln(q_0), q = q_0 A^p

Under a force, the radius follows from E_star, so that the decay is a power of A. Q is a Chebyshev series in y and the
two coordinates. The coordinate across the fingers is the same for all conditions of a parameter vector: the series is
summed over it once per vector, which leaves the table of a `StressField`.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, FingerBox, Fingertip, Fingertips, Force, Load
from softness_bayes.touch.field import (
    MODULUS_NODES,
    SHAPE_NODES,
    Fields,
    Profile,
    StressField,
)
from softness_bayes.touch.inversion import Inversion, values_to_coefficients
from softness_bayes.touch.load_field import LoadField, profiles_of_loads
from softness_bayes.touch.neuron.polynomials import chebyshev_values
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import kink_distances
from softness_bayes.touch.several_fields import SeveralFields, side_by_side
from softness_bayes.touch.several_fields import profiles as profiles_of_one_finger

Array = NDArray[np.float64]

FINGER_NODES = (3, 5, 7, 9, 12, 15, 20, 26)
"""Numbers of Chebyshev nodes across the fingers; the first sufficient one is used."""

SILENT_DECAY = 1e-12
"""Decay below which it is treated as zero."""


class FingerField:
    """Stress against distance under one load, inverted, for any reduced modulus and any finger of a range.

    Parameters
    ----------
    load
        The load that is held constant.
    finger, box
        The pad and the skin's Poisson ratio; the ranges of radius and depth that the table covers. Other fingers are
        computed exactly, which is slow.
    readings, modulus_range, tolerance
        As for `StressField`.
    greatest
        Largest load, of the same kind, up to which the table extends; by default it covers only `load`.

    Attributes
    ----------
    root, reached
        As for `StressField`.
    """

    def __init__(
        self,
        load: Load,
        finger: Finger,
        box: FingerBox,
        readings: Readings,
        modulus_range: tuple[float, float],
        tolerance: float,
        greatest: Load | None = None,
    ) -> None:
        self.load, self.readings, self.tolerance = load, readings, tolerance
        self._farthest, self._shallowest = float(kink_distances(finger)[-1]), box.receptor_depth[0]
        self._inversion = Inversion(1.0, self._farthest / self._shallowest, readings, tolerance)
        self.root = self._inversion.root
        radius, depth = (side[:, None] for side in box.corners)
        corners = Fingertips(radius, depth, finger.poisson_ratio)
        self._power = self._power_of_decay(corners)
        modulus = np.broadcast_to(np.array(modulus_range), (4, 2))
        ends = [self.under(end) for end in dict.fromkeys((load, greatest or load))]
        touched = [end.touch(modulus, end.load.close(modulus, corners).radius, corners) for end in ends]
        along = np.stack([self._along(*contact) for contact in touched])
        across = np.stack([end._across(corners) for end in ends])
        # all indentations have the same limit for soft fabrics, at which the pressure has no decay
        self._sides = np.array([[0.0 if self._held else along.min(), along.max()], [across.min(), across.max()]])
        self.y_least = float(self._inversion.y_least(*self._contacts(*np.mgrid[-2:2:9j, -1:1:3j].reshape(2, -1))).min())
        self._fit()

    def under(self, load: Load) -> FingerField:
        """Return the field of another load that the table covers."""
        part = copy.copy(self)
        part.load = load
        return part

    @property
    def _held(self) -> bool:
        """True if the load holds the contact radius, and not the force."""
        return not isinstance(self.load, Force)

    def touch(self, modulus: Array, radius: Array, finger: Fingertip) -> tuple[Array, Array]:
        """Return A and the decay of contacts of some radius [m] at reduced moduli [Pa]."""
        return radius / finger.receptor_depth, self.readings.pressure.decay(modulus, radius, finger)

    def _decay_at(self, relative: float, finger: Fingertip) -> Array:
        """Return the decay under a given force for a contact radius in units of the depth."""
        assert isinstance(self.load, Force)
        radius = np.asarray(relative * finger.receptor_depth)
        modulus = 0.75 * finger.radius * self.load.newton / radius**3
        return self.readings.pressure.decay(modulus, radius, finger)

    def _power_of_decay(self, fingers: Fingertips) -> float:
        """Return p in q = q_0 A^p under a given force; 0 if the pressure has no decay, or the radius is held.

        Raises
        ------
        InputError
            If the decay is not a power of A.
        """
        if self._held:
            return 0.0
        one, two, ten = (self._decay_at(relative, fingers) for relative in (1.0, 2.0, 10.0))
        if one.max() <= SILENT_DECAY:
            return 0.0
        power = float(np.log2(two[0, 0] / one[0, 0]))
        if not (np.allclose(two, one * 2.0**power, rtol=1e-9) and np.allclose(ten, one * 10.0**power, rtol=1e-9)):
            raise InputError(
                f"radius and receptor_depth cannot be sampled with pressure={self.readings.pressure.name} "
                "under a given force, because its decay is not a power of the contact radius; fix the finger"
            )
        return power

    def _along(self, relative: Array, decay: Array) -> Array:
        return np.log1p(decay) if self._held else np.log(relative)

    def _across(self, fingers: Fingertips) -> Array:
        """Return the coordinate across the fingers, of their shape."""
        if self._held:
            radius = self.load.close(np.ones_like(fingers.radius), fingers).radius
            return np.log(radius / fingers.receptor_depth)
        return np.log(np.maximum(self._decay_at(1.0, fingers), SILENT_DECAY))

    def _scaled(self, value: Array, side: int) -> Array:
        """Return a coordinate scaled to [-1, 1] over its range."""
        low, high = self._sides[side]
        return (2.0 * value - (low + high)) / max(high - low, 1e-6)

    def _contacts(self, along: Array, across: Array) -> tuple[Array, Array]:
        """Return A and decay at scaled coordinates."""
        (low, high), (first, last) = self._sides
        s = np.maximum(0.5 * (low + high) + 0.5 * (high - low) * along, 0.0 if self._held else -np.inf)
        t = 0.5 * (first + last) + 0.5 * (last - first) * across
        if self._held:
            return np.exp(t), np.expm1(s)
        return np.exp(s), np.exp(t + self._power * s)

    def _rows(self, along: Array, across: Array, shape_nodes: int) -> Array:
        """Return exact rows at all pairs of coordinates, shape (across, along, 1 + shape_nodes)."""
        t, s = (x.ravel() for x in np.meshgrid(across, along, indexing="ij"))
        rows = self._inversion.rows(*self._contacts(s, t), shape_nodes, self.y_least)
        return rows.reshape(across.size, along.size, -1)

    def _fit(self) -> None:
        tolerance, ends = self.tolerance, np.array([-1.0, 0.0, 1.0])
        for self.shape_nodes in SHAPE_NODES:
            rows = np.abs(self._rows(np.linspace(-0.999, 0.999, 5), ends, self.shape_nodes)[..., 1:])
            if rows[..., -(self.shape_nodes // 10) :].sum(axis=-1).max() <= tolerance * rows.sum(axis=-1).max():
                break
        few = chebyshev.chebpts1(5)
        for n_across in FINGER_NODES:
            rows = self._rows(few, chebyshev.chebpts1(n_across), self.shape_nodes)
            size = np.abs(np.tensordot(values_to_coefficients(n_across), rows, 1)) / self._scale(rows)
            if size[-1].max() <= 0.3 * tolerance:
                break
        for n_along in MODULUS_NODES:
            rows = self._rows(chebyshev.chebpts1(n_along), ends, self.shape_nodes)
            size = np.abs(np.einsum("ij,tjk->tik", values_to_coefficients(n_along), rows)) / self._scale(rows)
            if size.max(axis=(0, 2))[-4:].sum() <= tolerance:
                break
        rows = self._rows(chebyshev.chebpts1(n_along), chebyshev.chebpts1(n_across), self.shape_nodes)
        table = np.tensordot(values_to_coefficients(n_across), rows, 1)
        table = np.einsum("ij,tjk->tik", values_to_coefficients(n_along), table)
        self._scales = self._scale(rows)
        self.table = _cut(table, np.abs(table) / self._scales, tolerance)
        self.reached = self._measure()

    @staticmethod
    def _scale(rows: Array) -> Array:
        """Return the scale of errors of [unit peak, coefficients of Q / size]: the maxima over the table."""
        largest = np.abs(rows[..., 1:]).sum(axis=-1).max()
        return np.concatenate([[rows[..., 0].max()], np.full(rows.shape[-1] - 1, largest)])

    def _measure(self) -> float:
        """Return the largest difference between table and field at the corners and between the nodes."""
        along, across = np.mgrid[-1:1:6j, -1:1:4j].reshape(2, -1) * 0.98
        edges = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]).T
        along, across = np.append(along, edges[0]), np.append(across, edges[1])
        x = np.cos(np.pi * (np.arange(61) + 0.3) / 61)
        peak, shape = self._inversion.values(*self._contacts(along, across), x, self.y_least)
        rows = self._evaluated(along[:, None], across)[:, 0]
        found = rows[:, 1:] @ chebyshev.chebvander(x, self.table.shape[-1] - 2).T
        return float(
            max((np.abs(rows[:, 0] - peak) / self._scales[0]).max(), np.abs(found - shape).max() / self._scales[1])
        )

    def cut(self, tolerance: float) -> FingerField:
        """Return the field with series truncated at a larger tolerance; `reached` still refers to the full series."""
        if tolerance <= self.tolerance:
            return self
        part = copy.copy(self)
        part.tolerance = tolerance
        part.table = _cut(self.table, np.abs(self.table) / self._scales[: self.table.shape[-1]], tolerance)
        return part

    def _evaluated(self, along: Array, across: Array) -> Array:
        """Return the table's rows at scaled coordinates (batch, n) and (batch,), shape (batch, n, 1 + order)."""
        n_across, n_along, width = self.table.shape
        basis = chebyshev_values(across, n_across).T
        own = (basis @ self.table.reshape(n_across, -1)).reshape(across.size, n_along, width)
        return np.moveaxis(chebyshev_values(along, n_along), 0, -1) @ own

    def rows(self, relative: Array, decay: Array, fingers: Fingertips) -> tuple[Array, Array]:
        """Return [unit peak, coefficients of Q / size in T_k(y)], and the lower end of y, of contacts (batch, n).

        Parameters
        ----------
        relative, decay
            As `touch` returns them.
        fingers
            Fields of shape (batch, 1).

        Returns
        -------
        tuple of ndarray
            Shapes (batch, n, 1 + order) and (batch, n).
        """
        along, across = self._scaled(self._along(relative, decay), 0), self._scaled(self._across(fingers), 1)
        inside, least = 1.0 + 1e-9, self._shallowest * (1.0 - 1e-9)
        beyond = (np.abs(along) > inside) | (np.abs(across) > inside) | (fingers.receptor_depth < least)
        found = self._evaluated(np.clip(along, -1.0, 1.0), np.clip(across[:, 0], -1.0, 1.0))
        y_least = np.full(relative.shape, self.y_least)
        if beyond.any():
            found = np.pad(found, ((0, 0), (0, 0), (0, 1 + self.shape_nodes - found.shape[-1])))
            depth = np.broadcast_to(fingers.receptor_depth, relative.shape)[beyond]
            found[beyond], y_least[beyond] = self.exact_rows(relative[beyond], decay[beyond], depth)
        return found, y_least

    def exact_rows(self, relative: Array, decay: Array, depth: Array) -> tuple[Array, float]:
        """Compute rows and the lower end of y without the table, for A, decay and receptor depth [m] of shape (n,)."""
        inversion = replace(self._inversion, farthest=self._farthest / depth.min())
        y_least = float(inversion.y_least(relative, decay).min())
        return inversion.rows(relative, decay, self.shape_nodes, y_least), y_least


class FieldsOfLoads:
    """The stress fields of the loads of a scene, side by side, for one finger or for one of each row.

    Parameters
    ----------
    fields, columns
        As `softness_bayes.touch.several_fields.SeveralFields` takes them; all fields of one kind.

    Attributes
    ----------
    several
        The fields of one finger with a table each; None for other kinds.
    """

    def __init__(self, fields: Sequence[StressField | FingerField], columns: Sequence[NDArray[np.intp]]) -> None:
        self._fields, self._columns = fields, columns
        one = [field for field in fields if isinstance(field, StressField)]
        shared = any(isinstance(field, LoadField) for field in one)
        self.several = SeveralFields(one, columns, fast=True) if one and not shared else None

    def at(self, modulus: Array, radius: Array, finger: Fingertip) -> Fields:
        """Return the fields at reduced moduli and contact radii; arguments as `profiles` takes them."""
        if self.several is not None:
            return self.several.at(modulus, radius)
        return profiles(self._fields, self._columns, modulus, radius, finger)


def profiles(
    fields: Sequence[StressField | FingerField],
    columns: Sequence[NDArray[np.intp]],
    modulus: Array,
    radius: Array,
    finger: Fingertip,
) -> Profile:
    """Return the fields of several loads at reduced moduli, concatenated, for one finger or one finger per row.

    Parameters
    ----------
    fields, columns
        As for `softness_bayes.touch.several_fields.profiles`; all fields of one kind.
    modulus, radius
        E_star [Pa] and contact radius [m], shape (batch, conditions).
    finger
        The finger that touches; `Fingertips` have the shape (batch, 1).

    Raises
    ------
    NumericalError
        If a modulus is not a positive finite number.
    """
    one = [field for field in fields if isinstance(field, StressField)]
    if any(isinstance(field, LoadField) for field in one):
        return _profiles_by_table(one, columns, modulus, radius)
    if one:
        return profiles_of_one_finger(one, columns, modulus, radius)
    if not isinstance(finger, Fingertips):
        one_radius, depth = np.full((1, 1), finger.radius), np.full((1, 1), finger.receptor_depth)
        finger = Fingertips(one_radius, depth, finger.poisson_ratio)
    many = [field for field in fields if isinstance(field, FingerField)]
    return _profiles_of_fingers(many, columns, modulus, radius, finger)


def _profiles_by_table(
    fields: Sequence[StressField], columns: Sequence[NDArray[np.intp]], modulus: Array, radius: Array
) -> Profile:
    """Return the fields of loads, some of which share tables."""
    shared: dict[int, list[int]] = {}
    alone = [k for k, field in enumerate(fields) if not isinstance(field, LoadField)]
    parts: list[tuple[NDArray[np.intp], Profile]] = []
    for k, field in enumerate(fields):
        if isinstance(field, LoadField):
            shared.setdefault(id(field.side), []).append(k)
    for places in shared.values():
        own = [columns[k] for k in places]
        loads = [field for k in places if isinstance(field := fields[k], LoadField)]
        parts.append((np.concatenate(own), profiles_of_loads(loads, own, modulus, radius)))
    if alone:
        sizes = np.cumsum([0, *(columns[k].size for k in alone)])
        blocks = [np.arange(start, stop) for start, stop in pairwise(sizes.tolist())]
        where = np.concatenate([columns[k] for k in alone])
        one = profiles_of_one_finger([fields[k] for k in alone], blocks, modulus[:, where], radius[:, where])
        parts.append((where, one))
    return side_by_side(parts)


def _profiles_of_fingers(
    fields: Sequence[FingerField],
    columns: Sequence[NDArray[np.intp]],
    modulus: Array,
    radius: Array,
    fingers: Fingertips,
) -> Profile:
    if not ((modulus > 0) & np.isfinite(modulus)).all():
        raise NumericalError("stress field: a reduced modulus is not positive and finite")
    relative, decay = fields[0].touch(modulus, radius, fingers)
    parts = [field.rows(relative[:, k], decay[:, k], fingers) for field, k in zip(fields, columns, strict=True)]
    order = max(rows.shape[-1] for rows, _ in parts) - 1
    unit, shape, y_least = np.empty_like(modulus), np.zeros((order, *modulus.shape)), np.empty_like(modulus)
    for (rows, least), where in zip(parts, columns, strict=True):
        unit[:, where], y_least[:, where] = rows[..., 0], least
        shape[: rows.shape[-1] - 1, :, where] = np.moveaxis(rows[..., 1:], -1, 0)
    shape *= fingers.receptor_depth**2 * (1.0 + relative**2 / (1.0 + decay))
    return Profile(fields[0].readings.pressure.amplitude(modulus, radius, fingers) * unit, shape, y_least)


def _cut(table: Array, size: Array, tolerance: float) -> Array:
    """Drop the orders whose coefficients, of the given sizes, sum to less than a third of the tolerance."""

    def kept(sizes: Array) -> int:
        return max(int((sizes[::-1].cumsum()[::-1] > tolerance / 3.0).sum()), 1)

    across, along = kept(size.max(axis=(1, 2))), kept(size.max(axis=(0, 2)))
    return np.ascontiguousarray(table[:across, :along, : 1 + kept(size[..., 1:].max(axis=(0, 1)))])
