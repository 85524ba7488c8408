"""A row of independent cells: their vector field with its Jacobian, and their equilibria.

At a fold of ``I_ss(V)`` the resting state collides with a saddle and vanishes (saddle-node bifurcation). If a closed
orbit passes through the fold (SNIC), firing starts at arbitrarily low rates: on the centre manifold ``dx/dt = a (I -
I_fold) + b x^2``, so that

``rate = sqrt(a b (I - I_fold)) / pi``,  ``a b = -I_ss''(V) / (2 C_eff^2)``,
``C_eff = C (1 + sum_g (dV'/dg) (dg_inf/dV) tau_g)``,

because the null vectors of the Jacobian follow from the arrow form and the curvature along the manifold from
differentiating ``f(x_ss(V), I_ss(V)) = 0`` twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.neuron.membrane import (
    Channels,
    Membrane,
    channel_of_gate,
    fraction_slopes,
    open_fractions,
    steady_terms,
)

FloatArray = NDArray[np.float64]


class ArrowJacobian(NamedTuple):
    """Jacobian of a cell, an arrowhead matrix because each gate depends only on itself and the voltage.

    Attributes
    ----------
    voltage_by_voltage : ndarray, shape (n,)
        [1/ms].
    voltage_by_gate : ndarray, shape (gates, n)
        [mV/ms].
    gate_by_voltage : ndarray, shape (gates, n)
        [1/(ms mV)].
    decay : ndarray, shape (gates, n)
        Negative derivative of each gate's slope with respect to the gate [1/ms].
    """

    voltage_by_voltage: FloatArray
    voltage_by_gate: FloatArray
    gate_by_voltage: FloatArray
    decay: FloatArray


@dataclass(frozen=True)
class Cells:
    """A row of independent cells of one membrane under constant currents.

    A state has the shape (1 + gates, n): the voltage [mV], then the gates in the order of ``Gating.names``.

    Parameters
    ----------
    membrane : Membrane
        Constants common to all cells.
    conductance : ndarray, shape (2 or 3, n)
        Maximal conductances of the gated channels Na, (A,) K [mS/cm²].
    leak : ndarray, shape (n,)
        Leak conductance [mS/cm²].
    current : ndarray, shape (n,)
        Injected current [µA/cm²].
    """

    membrane: Membrane
    conductance: FloatArray
    leak: FloatArray
    current: FloatArray

    @cached_property
    def _reversal(self) -> FloatArray:
        """Reversal potentials [mV] of the gated channels, shape (2 or 3, 1)."""
        m = self.membrane
        return np.array([m.e_na, m.e_k] if len(self.conductance) == 2 else [m.e_na, m.e_a, m.e_k])[:, None]

    @classmethod
    def of(cls, membrane: Membrane, channels: Channels, current: FloatArray) -> Cells:
        """Return cells with multipliers and currents of one shape (n,)."""
        c_na, c_k, c_l, c_a = channels
        gated = [c_na * membrane.g_na, c_k * membrane.g_k]
        if membrane.gating.a_current is not None:
            gated.insert(1, c_a * membrane.g_a)
        return cls(membrane, np.array(gated), c_l * membrane.g_l, current)

    def __len__(self) -> int:
        return len(self.leak)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Cells:
        """Return the cells at ``index``."""
        return Cells(self.membrane, self.conductance[:, index], self.leak[index], self.current[index])

    def slope(self, state: FloatArray) -> FloatArray:
        """Return the time derivative of the state [mV/ms and 1/ms], same shape."""
        return self._slope(state, *self.membrane.gating.rates(state[0]), open_fractions(state[1:]))

    def slope_and_jacobian(self, state: FloatArray) -> tuple[FloatArray, ArrowJacobian]:
        """Return :meth:`slope` and its derivative with respect to the state, with rates computed once."""
        voltage, gates = state[0], state[1:]
        opening, total, opening_slope, total_slope = self.membrane.gating.rates_and_slopes(voltage)
        fractions = open_fractions(gates)
        conductance = (self.conductance * fractions).sum(axis=0) + self.leak
        force = self.conductance * (self._reversal - voltage) / self.membrane.capacitance
        jacobian = ArrowJacobian(
            -conductance / self.membrane.capacitance,
            fraction_slopes(gates) * force[channel_of_gate(len(gates))],
            opening_slope - total_slope * gates,
            total,
        )
        return self._slope(state, opening, total, fractions), jacobian

    def _slope(self, state: FloatArray, opening: FloatArray, total: FloatArray, fractions: FloatArray) -> FloatArray:
        """Return the time derivative of the state from its rates and open fractions."""
        voltage = state[0]
        net = (fractions * self.conductance * (self._reversal - voltage)).sum(axis=0)
        net += self.current + self.leak * (self.membrane.e_l - voltage)
        return np.vstack([net / self.membrane.capacitance, opening - total * state[1:]])


_GRID_STEP = 0.5  # mV
_CURVATURE_STEP = 0.1  # mV, of the fourth-order difference that gives I_ss'' from I_ss'
_VOLTAGE_ERROR = {"xatol": 1e-12, "xrtol": 0.0, "fatol": 0.0, "frtol": 0.0}  # mV


class Fold(NamedTuple):
    """The first fold of the steady current, NaN if there is none; all arrays have shape (n,)."""

    voltage: FloatArray
    """[mV]"""
    current: FloatArray
    """[µA/cm²]"""
    prefactor: FloatArray
    """Rate divided by the square root of the excess current, just above the fold [Hz/sqrt(µA/cm²)]"""


def fold(channels: Channels, membrane: Membrane) -> Fold:
    """Return the first local maximum of the steady current along the resting branch.

    Parameters
    ----------
    channels : Channels
        Multipliers, each of shape (n,).
    membrane : Membrane
        Constants.
    """
    weights = np.array(channels)
    grid = np.arange(membrane.voltage_range[0], 0.0, _GRID_STEP)
    falling = weights.T @ steady_terms(grid, membrane).slope < 0.0
    found = falling.any(axis=1) & ~falling[:, 0]

    def steepness(voltage: FloatArray, *weights: FloatArray) -> FloatArray:
        return -(np.array(weights) * steady_terms(voltage, membrane).slope).sum(axis=0)

    voltage = _first_root(steepness, channels, grid, falling)
    near, far = (
        steepness(voltage + k * _CURVATURE_STEP, *channels) - steepness(voltage - k * _CURVATURE_STEP, *channels)
        for k in (1.0, 2.0)
    )
    curvature = (8.0 * near - far) / (12.0 * _CURVATURE_STEP)
    terms = steady_terms(voltage, membrane)
    current = (weights * terms.current).sum(axis=0)
    cells = Cells.of(membrane, channels, current)
    _, jacobian = cells.slope_and_jacobian(steady_state(voltage, membrane))
    lag = (jacobian.voltage_by_gate * jacobian.gate_by_voltage / jacobian.decay**2).sum(axis=0)
    capacitance = membrane.capacitance * (1.0 + lag)
    bend = np.where(found & (capacitance > 0.0), curvature, np.nan)
    prefactor = 1000.0 * np.sqrt(np.maximum(bend, 0.0) / 2.0) / (np.pi * capacitance)
    return Fold(np.where(found, voltage, np.nan), np.where(found, current, np.nan), prefactor)


def rest(channels: Channels, membrane: Membrane) -> FloatArray:
    """Return the state at rest without a current, shape (1 + gates, n): the equilibrium of lowest voltage.

    Parameters
    ----------
    channels : Channels
        Multipliers, each of shape (n,).
    membrane : Membrane
        Constants.
    """
    weights = np.array(channels)
    lowest, highest = membrane.voltage_range
    grid = np.append(np.arange(lowest, highest, _GRID_STEP), highest)
    outward = weights.T @ steady_terms(grid, membrane).current >= 0.0

    def net(voltage: FloatArray, *weights: FloatArray) -> FloatArray:
        return np.asarray((np.array(weights) * steady_terms(voltage, membrane).current).sum(axis=0))

    return steady_state(_first_root(net, channels, grid, outward), membrane)


def _first_root(
    function: Callable[..., FloatArray], channels: Channels, grid: FloatArray, beyond: NDArray[np.bool_]
) -> FloatArray:
    """Return where a function of voltage is 0, next below the first voltage of a grid that is beyond it (n, grid).

    Where there is none, it is a voltage of the grid.
    """
    from scipy.optimize.elementwise import find_root  # imported here because it takes a quarter of a second

    first = np.maximum(beyond.argmax(axis=1), 1)
    found = find_root(function, (grid[first - 1], grid[first]), args=channels, tolerances=_VOLTAGE_ERROR)
    return np.where(found.success, found.x, grid[first])


def steady_state(voltage: FloatArray, membrane: Membrane) -> FloatArray:
    """Return the state, shape (1 + gates, n), with all gates in equilibrium at voltages of shape (n,)."""
    opening, total = membrane.gating.rates(voltage)
    return np.vstack([voltage, opening / total])
