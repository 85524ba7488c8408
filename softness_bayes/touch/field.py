"""Stress field of one load as a smooth one-parameter family, tabulated once (model.md 5).

For a given load the stress at receptor depth depends on fabric and skin only through E_star: the
contact radius and the pressure's shape are functions of it. The population needs the inverse: the
distance from the axis at which the stress is sigma. If the stress falls like rho^-n far
away, then with y = (sigma / sigma_peak)^(2/n)

    rho² = Q(y; E_star) (1 - y) / y

and Q has no singularity at either end of y, so that a short Chebyshev series in y and in
ln(E_star + shift) represents it. The series is truncated where its coefficients fall below the tolerance.
"""

from __future__ import annotations

import copy
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.touch.contact import Finger, Load
from softness_bayes.touch.inversion import Inversion, values_to_coefficients
from softness_bayes.touch.neuron.polynomials import clenshaw, horner
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import kink_distances

Array = NDArray[np.float64]

SHAPE_NODES = (41, 81, 161, 321)
"""Numbers of Chebyshev nodes in y at which the field is inverted before its series is truncated; the first sufficient
one is used.

Finer tolerances and strong attenuation under a force need more nodes. The largest number is needed for the largest
principal stress with the printed kernel, which is not symmetric about the axis: its slope in rho is then confined to a
layer near y = 1."""

MODULUS_NODES = (24, 48, 96, 160)
"""Chebyshev nodes in ln(E_star + shift), likewise."""


class Profile(NamedTuple):
    """The field at a batch of reduced moduli, ready to be evaluated at any stress."""

    peak: Array
    """Stress on the axis [Pa], shape (...)."""
    shape: Array
    """Coefficients of Q [m²] in T_k of y scaled to [-1, 1] over its range, shape (order, ...)."""
    y_least: Array
    """Lower end of that range, of a shape that broadcasts with the peak's."""
    powers: bool = False
    """True if the coefficients are those of powers instead, which take less time."""

    def among(self, mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Profile]:
        """Return indices into the flattened batch of the elements of a mask, and their profile along one axis."""
        at = np.flatnonzero(mask)
        return at, self.take(at)

    def take(self, at: NDArray[np.intp]) -> Profile:
        """Return the profile of selected elements of the flattened batch, along one axis."""
        least = np.broadcast_to(self.y_least, self.peak.shape)
        shape = self.shape.reshape(len(self.shape), -1).take(at, axis=1)
        return Profile(self.peak.take(at), shape, least.take(at), self.powers)

    def squared_distance(self, y: Array) -> Array:
        """Return rho² [m²] where the stress is y^(1/root) of its peak, of the shape of `y`: (..., *batch)."""
        rise = 2.0 / (1.0 - self.y_least)
        scaled = y * rise - (rise - 1.0)
        return (horner if self.powers else clenshaw)(self.shape, scaled) * (1.0 / y - 1.0)


class Fields(Protocol):
    """The field at a batch of reduced moduli, of which only some elements may be needed at every stress."""

    @property
    def peak(self) -> Array:
        """Stress on the axis [Pa], shape (batch, conditions)."""

    def among(self, mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Profile]:
        """Return indices into the flattened batch of the elements of a mask, and their profile along one axis."""


class StressField:
    """Stress against distance under one load, inverted, for any reduced modulus.

    Parameters
    ----------
    load
        The load that is held constant.
    finger, readings
        Geometry and the readings of pressure, kernel and component.
    modulus_range
        Reduced moduli [Pa] that the table covers. Others are computed exactly, which is slow.
    tolerance
        Error allowed in Q and in the peak, each relative to its largest in the table.

    Attributes
    ----------
    root : float
        2/n, the power of sigma / sigma_peak that gives y.
    reached : float
        Error of the table on the scale of the tolerance: the largest difference from the exact field at points between
        its nodes. A few times the tolerance is normal, because each series is truncated separately. Much more means
        that no number of nodes was sufficient. `Scene.error` includes it.
    """

    def __init__(
        self,
        load: Load,
        finger: Finger,
        readings: Readings,
        modulus_range: tuple[float, float],
        tolerance: float,
    ) -> None:
        self.load, self.finger, self.readings, self.tolerance = load, finger, readings, tolerance
        if not finger.receptor_depth > 0:
            raise InputError("finger: receptor_depth is 0, expected a positive depth for a stress field")
        self._inversion = Inversion(finger.receptor_depth, float(kink_distances(finger)[-1]), readings, tolerance)
        self.root = self._inversion.root
        low, high = modulus_range
        self.shift = self._shift(high)
        # if the family has a limit for soft fabrics, the table starts at that limit, E_star = 0
        self.log_range = np.log(self.shift) if self.shift > 0 else np.log(low), np.log(high + self.shift)
        moduli = np.geomspace(1e-3 * low, 1e3 * high, 13)
        self.y_least = float(self._inversion.y_least(*self._touch(moduli)).min())
        self._fit()

    def _shift(self, high: float) -> float:
        """Return the modulus at which the pressure's decay is 1 if the load holds the contact radius; otherwise 0."""
        radius = self.load.close(np.array([0.5, 1.0]) * high, self.finger).radius
        if radius[0] != radius[1]:
            return 0.0
        decay = float(self.readings.pressure.decay(np.array(high), radius[1], self.finger))
        return high / decay if decay > 1e-3 else 1e3 * high

    def _touch(self, modulus: Array) -> tuple[Array, Array]:
        """Return contact radius [m] and decay at some reduced moduli."""
        radius = self.load.close(modulus, self.finger).radius
        return radius, self.readings.pressure.decay(modulus, radius, self.finger)

    def size(self, modulus: Array, radius: Array) -> Array:
        """Return the scale of Q [m²]: the sum of the squared depth and the squared width of the loaded patch."""
        return self._inversion.size(radius, self.readings.pressure.decay(modulus, radius, self.finger))

    def exact_rows(self, modulus: Array) -> Array:
        """Compute [unit peak, coefficients of Q / size in T_k(y)] without the table, for moduli of shape (n,)."""
        return self._rows(modulus, self.shape_nodes)

    def _rows(self, modulus: Array, shape_nodes: int, guess: Array | None = None) -> Array:
        return self._inversion.rows(*self._touch(modulus), shape_nodes, self.y_least, guess)

    def moduli(self, x: Array) -> Array:
        """Return the moduli [Pa] at points of the range of ln(E_star + shift), scaled to [-1, 1]."""
        low, high = self.log_range
        return np.exp(0.5 * (low + high) + 0.5 * (high - low) * x) - self.shift

    def _fit(self) -> None:
        few = self.moduli(np.linspace(-0.999, 0.999, 5))
        for self.shape_nodes in SHAPE_NODES:
            rows = np.abs(self._rows(few, self.shape_nodes)[:, 1:])
            if rows[:, -(self.shape_nodes // 10) :].sum(axis=1).max() <= self.tolerance * rows.sum(axis=1).max():
                break
        coarser: Array | None = None
        for order in MODULUS_NODES:
            x = chebyshev.chebpts1(order)
            guess = None if coarser is None else np.asarray(chebyshev.chebval(x, coarser[:, 1:]).T, float)
            rows = self._rows(self.moduli(x), self.shape_nodes, guess)
            largest = np.abs(rows[:, 1:]).sum(axis=1).max()
            scale = np.concatenate([[rows[:, 0].max()], np.full(self.shape_nodes, largest)])
            coarser = table = values_to_coefficients(order) @ rows
            size = np.abs(table) / scale
            by_modulus = size.max(axis=1)[::-1].cumsum()[::-1]
            if by_modulus[-4] <= self.tolerance:
                break
        self.table = _cut(table, size, self.tolerance)
        self._scale = float(scale[0]), float(largest)
        self.reached = self._measure(*self._scale)

    def cut(self, tolerance: float) -> StressField:
        """Return the field with series truncated at a larger tolerance; `reached` still refers to the full series."""
        if tolerance <= self.tolerance:
            return self
        part = copy.copy(self)
        size = np.abs(self.table) / np.r_[self._scale[0], np.full(self.table.shape[1] - 1, self._scale[1])]
        part.tolerance, part.table = tolerance, _cut(self.table, size, tolerance)
        return part

    def _measure(self, peak_scale: float, shape_scale: float) -> float:
        """Return the largest difference between table and field at points that are not nodes of either series."""
        along, across = np.cos(np.pi * (np.arange(11) + 0.3) / 11), np.cos(np.pi * (np.arange(61) + 0.3) / 61)
        rows = chebyshev.chebvander(along, self.table.shape[0] - 1) @ self.table
        peak, shape = self._inversion.values(*self._touch(self.moduli(along)), across, self.y_least, rows[:, 1:])
        found = rows[:, 1:] @ chebyshev.chebvander(across, self.table.shape[1] - 2).T
        return float(max(np.abs(rows[:, 0] - peak).max() / peak_scale, np.abs(found - shape).max() / shape_scale))


def _cut(table: Array, size: Array, tolerance: float) -> Array:
    """Leave out the orders whose coefficients, of the given relative size, sum to less than half the tolerance."""
    by_modulus = size.max(axis=1)[::-1].cumsum()[::-1]
    by_shape = size[:, 1:].max(axis=0)[::-1].cumsum()[::-1]
    keep_modulus, keep_shape = (max(int((sums > 0.5 * tolerance).sum()), 2) for sums in (by_modulus, by_shape))
    return np.ascontiguousarray(table[:keep_modulus, : 1 + keep_shape])
