"""Resting state and its loss of existence: equilibria of the membrane from its steady current, without simulation.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.neuron.membrane import Channels, Membrane, steady_terms
from softness_bayes.touch.neuron.vector_field import Cells

FloatArray = NDArray[np.float64]

_GRID_STEP = 0.5  # mV
_CURVATURE_STEP = 0.1  # mV, of the fourth-order difference that gives I_ss'' from I_ss'
_ITERATIONS = 60
_VOLTAGE_ERROR = 1e-12  # mV


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
    found = falling.any(axis=1)
    first = np.where(found, falling.argmax(axis=1), 1)
    found &= first > 0

    def steepness(voltage: FloatArray) -> FloatArray:
        return -(weights * steady_terms(voltage, membrane).slope).sum(axis=0)

    def curvature(voltage: FloatArray) -> FloatArray:
        near, far = (
            steepness(voltage + k * _CURVATURE_STEP) - steepness(voltage - k * _CURVATURE_STEP) for k in (1.0, 2.0)
        )
        return (8.0 * near - far) / (12.0 * _CURVATURE_STEP)

    voltage = _rising_root(steepness, curvature, grid[first - 1], grid[first])
    terms = steady_terms(voltage, membrane)
    current = (weights * terms.current).sum(axis=0)
    cells = Cells.of(membrane, channels, current)
    jacobian = cells.linearise(steady_state(voltage, membrane))
    lag = (jacobian.voltage_by_gate * jacobian.gate_by_voltage / jacobian.decay**2).sum(axis=0)
    capacitance = membrane.capacitance * (1.0 + lag)
    bend = np.where(found & (capacitance > 0.0), curvature(voltage), np.nan)
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
    first = np.maximum(outward.argmax(axis=1), 1)
    voltage = _rising_root(
        lambda v: (weights * steady_terms(v, membrane).current).sum(axis=0),
        lambda v: (weights * steady_terms(v, membrane).slope).sum(axis=0),
        grid[first - 1],
        grid[first],
    )
    return steady_state(voltage, membrane)


def steady_state(voltage: FloatArray, membrane: Membrane) -> FloatArray:
    """Return the state, shape (1 + gates, n), with all gates in equilibrium at voltages of shape (n,)."""
    opening, total = membrane.gating.rates(voltage)
    return np.vstack([voltage, opening / total])


def _rising_root(
    function: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Return the root of a function increasing through 0 between ``low`` and ``high``, by Newton and bisection."""
    x = 0.5 * (low + high)
    for _ in range(_ITERATIONS):
        value, steepness = function(x), slope(x)
        low, high = np.where(value < 0.0, x, low), np.where(value < 0.0, high, x)
        newton = x - value / np.where(steepness == 0.0, 1.0, steepness)
        inside = (newton > low) & (newton < high)
        new = np.where(inside, newton, 0.5 * (low + high))
        if (np.abs(new - x) <= _VOLTAGE_ERROR).all():
            return new
        x = new
    return x
