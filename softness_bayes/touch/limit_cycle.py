"""Steady firing after a current step from rest: integrate until the membrane repeats itself or settles.

A spike is an upward crossing of ``SPIKE_VOLTAGE``. Its instant is found by repeating the step that crosses it with
other lengths until the step ends on it, so that it has the full order of the method. The answer is always taken from
the interval between spikes once it has converged, never from their number: the spikes of an onset transient do not
count as firing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import NumericalError
from softness_bayes.touch.cells import ArrowJacobian, Cells
from softness_bayes.touch.rosenbrock import ORDER, ArrowSolver, step

FloatArray = NDArray[np.float64]

SPIKE_VOLTAGE = -30.0
"""Voltage [mV] that a spike crosses upwards."""

TOLERANCE = 2e-9
"""Largest local error of a step, relative to 100 mV and to a fully open gate; periods come out within 3e-8, except
where the membrane lingers beside the place of a lost equilibrium: there errors count in proportion to the stay."""

_REARM = 1.0  # mV below the spike voltage before another spike can count
_LOCATED = 1e-6  # mV from the spike voltage at which a spike counts as found
_RETURN = 2e-8  # scaled distance between the states at successive spikes of a periodic orbit
_AGREEMENT = 1e-8  # relative difference between successive estimates of the period
_SETTLED = (1e-3, 1e-5)  # mV and gate distance from a stable equilibrium that is silence
_SETTLED_CHECK = 16  # steps between looks for settled cells
_MAX_SUBTHRESHOLD = 1000  # voltage peaks without a spike that are silence: a steady subthreshold oscillation
_MAX_STEPS = 400_000


def steady_rate(cells: Cells, state: FloatArray, tolerance: FloatArray | float = TOLERANCE) -> FloatArray:
    """Steady firing rates of cells that start from given states.

    Parameters
    ----------
    cells : Cells
        n cells under constant currents.
    state : ndarray, shape (1 + gates, n)
        Their states when the currents begin.
    tolerance : float or ndarray, shape (n,)
        Largest local error of a step, as :data:`TOLERANCE`.

    Returns
    -------
    ndarray, shape (n,)
        Rates [Hz]; exactly 0 where the cell settles on a stable equilibrium or oscillates below the spike voltage.

    Raises
    ------
    NumericalError
        If a cell neither settles nor repeats itself.
    """
    rate = np.zeros(len(cells))
    orbits = _Orbits.start(cells, state, tolerance)
    for count in range(_MAX_STEPS):
        orbits.advance()
        period = orbits.period()
        done = period > 0.0
        rate[orbits.lane[done]] = 1000.0 / period[done]
        if count % _SETTLED_CHECK == 0:
            done |= orbits.settled() | (orbits.peaks > _MAX_SUBTHRESHOLD)
        if done.any():
            orbits = orbits.take(np.flatnonzero(~done))
            if not len(orbits.lane):
                return rate
    lane = orbits.lane[0]
    raise NumericalError(
        f"the membrane {cells.membrane.name} neither settles nor repeats itself at {cells.current[lane]:.9g} µA/cm² "
        f"with conductances {cells.conductance[:, lane]} and leak {cells.leak[lane]:.9g} mS/cm²"
    )


@dataclass
class _Orbits:
    """Trajectories under way, one column for each cell that is not decided yet."""

    cells: Cells
    lane: NDArray[np.intp]  # the cell's place among all cells
    tolerance: FloatArray
    state: FloatArray
    stride: FloatArray  # step length that the error allows [ms]
    length: FloatArray  # step length to be tried: the stride, or less while a spike is being located
    elapsed: FloatArray  # time since the last spike [ms]
    armed: NDArray[np.bool_]  # the voltage has been below the spike voltage since the last spike
    rising: NDArray[np.bool_]
    peaks: NDArray[np.intp]  # voltage peaks since the last spike
    low: FloatArray  # step lengths around the spike, (length [ms], voltage above the spike voltage [mV])
    high: FloatArray
    intervals: FloatArray  # the last four, newest last; NaN where there is none yet
    section: FloatArray  # state at the last spike
    returned: FloatArray  # scaled distance between the last two such states

    @classmethod
    def start(cls, cells: Cells, state: FloatArray, tolerance: FloatArray | float) -> _Orbits:
        n = len(cells)
        return cls(
            cells=cells,
            lane=np.arange(n),
            tolerance=np.broadcast_to(np.asarray(tolerance, dtype=float), (n,)),
            state=state.copy(),
            stride=np.full(n, 0.01),
            length=np.full(n, 0.01),
            elapsed=np.full(n, np.nan),
            armed=state[0] < SPIKE_VOLTAGE - _REARM,
            rising=np.zeros(n, dtype=bool),
            peaks=np.zeros(n, dtype=np.intp),
            low=np.zeros((2, n)),
            high=np.zeros((2, n)),
            intervals=np.full((4, n), np.nan),
            section=np.full_like(state, np.nan),
            returned=np.full(n, np.inf),
        )

    def take(self, index: NDArray[np.intp]) -> _Orbits:
        """The trajectories at ``index``."""
        return _Orbits(
            self.cells.take(index),
            *(getattr(self, name)[..., index] for name in self.__dataclass_fields__ if name != "cells"),
        )

    def advance(self) -> None:
        """Try one step of every trajectory."""
        after, error, slope = step(self.cells, self.state, self.length)
        size = np.maximum(np.abs(error[0]) / 100.0, np.abs(error[1:]).max(axis=0)) / self.tolerance
        size = np.where(np.isfinite(size), size, 1e9)
        locating = self.high[0] > 0.0
        accepted = (size <= 1.0) & ~locating
        gap = after[0] - SPIKE_VOLTAGE
        crossing = accepted & self.armed & (gap >= 0.0)
        spiking = self._locate(locating, crossing, gap)

        rising = slope[0] > 0.0
        self.peaks += self.rising & ~rising
        self.rising = rising
        self.stride = np.where(
            locating, self.stride, self.length * np.clip(0.9 * np.maximum(size, 1e-9) ** (-1.0 / ORDER), 0.2, 5.0)
        )
        moved = (accepted & ~crossing) | spiking
        self.state = np.where(moved, after, self.state)
        self.elapsed = np.where(moved, self.elapsed + self.length, self.elapsed)
        self.armed = np.where(moved, (self.armed | (gap < -_REARM)) & ~spiking, self.armed)
        if spiking.any():
            self._record(np.flatnonzero(spiking))
        between = self.high[0] > 0.0
        self.length = np.where(between, self._secant(), self.stride)

    def _locate(self, locating: NDArray[np.bool_], crossing: NDArray[np.bool_], gap: FloatArray) -> NDArray[np.bool_]:
        """Tighten the bracket around every spike that is being located (Illinois); which ones are found."""
        found = (locating | crossing) & (np.abs(gap) <= _LOCATED)
        before = self.state[0] - SPIKE_VOLTAGE
        self.low = np.where(crossing, [np.zeros_like(gap), before], self.low)
        above, below = crossing | (locating & (gap >= 0.0)), locating & (gap < 0.0)
        trial = np.array([self.length, gap])
        self.low[1] *= np.where(above & locating, 0.5, 1.0)
        self.high[1] *= np.where(below, 0.5, 1.0)
        self.high = np.where(above, trial, self.high)
        self.low = np.where(below, trial, self.low)
        self.high = np.where(found, 0.0, self.high)
        return found

    def _secant(self) -> FloatArray:
        (start, below), (end, above) = self.low, self.high
        return start - below * (end - start) / np.where(above > below, above - below, 1.0)

    def _record(self, spiking: NDArray[np.intp]) -> None:
        """Note the intervals that end with the spikes just found."""
        self.intervals[:, spiking] = np.vstack([self.intervals[1:, spiking], self.elapsed[spiking]])
        change = np.abs(self.state[:, spiking] - self.section[:, spiking])
        change[0] /= 100.0
        self.returned[spiking] = change.max(axis=0)
        self.section[:, spiking] = self.state[:, spiking]
        self.elapsed[spiking] = 0.0
        self.peaks[spiking] = 0

    def period(self) -> FloatArray:
        """Periods of the trajectories that repeat themselves [ms], 0 for the others."""
        fresh = self.elapsed == 0.0
        if not fresh.any():
            return np.zeros(len(self.lane))
        first, second, third, last = self.intervals
        with np.errstate(invalid="ignore", divide="ignore"):
            older, newer = _aitken(first, second, third), _aitken(second, third, last)
            converged = np.abs(newer - older) <= _AGREEMENT * last
        repeated = self.returned <= _RETURN
        return np.where(fresh & repeated, last, np.where(fresh & converged, newer, 0.0))

    def settled(self) -> NDArray[np.bool_]:
        """Which trajectories have come to rest on a stable equilibrium."""
        settled = np.zeros(len(self.lane), dtype=bool)
        slope = self.cells.slope(self.state)
        slow = np.flatnonzero(np.abs(slope).max(axis=0) < 1e-2)
        if slow.size:
            jacobian = self.cells.take(slow).linearise(self.state[:, slow])
            distance = np.abs(ArrowSolver(jacobian, np.zeros(slow.size))(slope[:, slow]))
            near = (distance[0] < _SETTLED[0]) & (distance[1:].max(axis=0) < _SETTLED[1])
            settled[slow] = near & (growth_rate(jacobian) < 0.0)
        return settled


def _aitken(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    """Limit of a geometric sequence from three terms; the last term where they no longer differ."""
    change = third - second
    curvature = change - (second - first)
    settled = np.abs(curvature) <= 1e-12 * np.abs(third)
    return np.where(settled, third, third - change**2 / np.where(settled, 1.0, curvature))


def growth_rate(jacobian: ArrowJacobian) -> FloatArray:
    """Largest real part of the eigenvalues [1/ms], shape (n,): negative where an equilibrium is stable."""
    gates, n = jacobian.decay.shape
    matrix = np.zeros((n, gates + 1, gates + 1))
    diagonal = np.arange(1, gates + 1)
    matrix[:, 0, 0] = jacobian.voltage_by_voltage
    matrix[:, 0, 1:] = jacobian.voltage_by_gate.T
    matrix[:, 1:, 0] = jacobian.gate_by_voltage.T
    matrix[:, diagonal, diagonal] = -jacobian.decay.T
    return np.linalg.eigvals(matrix).real.max(axis=1)
