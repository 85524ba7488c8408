"""A row of independent cells as one vector field with its Jacobian."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.neuron.gating import channel_of_gate, fraction_slopes, open_fractions
from softness_bayes.touch.neuron.membrane import Channels, Membrane

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
    _drive: FloatArray = field(init=False, repr=False, compare=False)
    _reversal: FloatArray = field(init=False, repr=False, compare=False)
    _channel_of_gate: list[int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        m = self.membrane
        reversal = [m.e_na, m.e_k] if len(self.conductance) == 2 else [m.e_na, m.e_a, m.e_k]
        object.__setattr__(self, "_reversal", np.array(reversal)[:, None])
        object.__setattr__(self, "_channel_of_gate", channel_of_gate(2 * len(reversal) - 1))
        object.__setattr__(self, "_drive", self.current + self.leak * m.e_l)

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

    def linearise(self, state: FloatArray) -> ArrowJacobian:
        """Return the derivative of :meth:`slope` with respect to the state."""
        return self.slope_and_jacobian(state)[1]

    def slope_and_jacobian(self, state: FloatArray) -> tuple[FloatArray, ArrowJacobian]:
        """Return :meth:`slope` and :meth:`linearise` together, with rates computed once."""
        voltage, gates = state[0], state[1:]
        opening, total, opening_slope, total_slope = self.membrane.gating.rates_and_slopes(voltage)
        fractions = open_fractions(gates)
        conductance = (self.conductance * fractions).sum(axis=0) + self.leak
        force = self.conductance * (self._reversal - voltage) / self.membrane.capacitance
        jacobian = ArrowJacobian(
            -conductance / self.membrane.capacitance,
            fraction_slopes(gates) * force[self._channel_of_gate],
            opening_slope - total_slope * gates,
            total,
        )
        return self._slope(state, opening, total, fractions), jacobian

    def _slope(self, state: FloatArray, opening: FloatArray, total: FloatArray, fractions: FloatArray) -> FloatArray:
        """Time derivative of the state from its rates and open fractions; the latter are overwritten."""
        voltage = state[0]
        slope = np.empty_like(state)
        np.subtract(opening, total * state[1:], out=slope[1:])
        fractions *= self.conductance
        fractions *= self._reversal - voltage
        net = np.add.reduce(fractions)
        net += self._drive
        net -= self.leak * voltage
        np.divide(net, self.membrane.capacitance, out=slope[0])
        return slope
