"""Steady firing after a current step from rest, integrated until the membrane fires periodically or settles.

A spike is an upward crossing of ``SPIKE_VOLTAGE``. The integration step that contains the crossing is repeated with
adjusted lengths until it ends at the crossing, so that spike times have the full order of the method. The rate is the
inverse of the converged inter-spike interval rather than a spike count, which would include spikes of the onset
transient.

The steps are those of Rodas5P (Steinebach, BIT Numerical Mathematics 63:27, 2023), an L-stable Rosenbrock method of
order 5 with an embedded solution of order 4. The Jacobian of a cell is an arrowhead matrix, so each of the eight linear
systems takes only a few elementwise operations, and the long quiescent phase before a spike takes few steps despite its
stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import NumericalError

if TYPE_CHECKING:
    from softness_bayes.touch.neuron.cells import ArrowJacobian, Cells

FloatArray = NDArray[np.float64]

_GAMMA = 0.21193756319429014
_A = (
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946),
)
_C = (
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471),
    (30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
     -28.087943162872662),
    (37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
     -54.66780262877968, -9.48861652309627),
)  # fmt: skip
# Stages 7 and 8 start where the stage before them ended (stiffly accurate), so that their rows of A are those of
# stage 6 followed by ones.
_STAGES = tuple(np.array([a + (1.0,) * (len(c) - len(a)), c]) for a, c in zip((*_A, _A[-1], _A[-1]), _C, strict=True))


def step(cells: Cells, state: FloatArray, length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Advance every cell by its step length.

    Parameters
    ----------
    cells : Cells
        n cells.
    state : ndarray, shape (1 + gates, n)
        Voltages [mV] and gates.
    length : ndarray, shape (n,)
        Step lengths [ms].

    Returns
    -------
    after : ndarray, shape (1 + gates, n)
        State at the end of the step, of order 5.
    error : ndarray, shape (1 + gates, n)
        Difference to the embedded solution of order 4.
    slope : ndarray, shape (1 + gates, n)
        Time derivative at the start of the step.
    """
    slope, jacobian = cells.slope_and_jacobian(state)
    solver = ArrowSolver(jacobian, 1.0 / (_GAMMA * length))
    rows, n = state.shape
    stages = np.empty((len(_STAGES) + 1, rows * n))
    stages[0] = solver(slope).ravel()
    with np.errstate(over="ignore", invalid="ignore"):  # a step that is much too long overflows and is rejected
        for i, weights in enumerate(_STAGES, start=1):
            offset, memory = (weights @ stages[:i]).reshape(2, rows, n)
            within = state + offset
            stages[i] = solver(cells.slope(within) + memory / length).ravel()
    error = stages[-1].reshape(rows, n)
    return within + error, error, slope


class ArrowSolver:
    """Solver of ``(w - J) x = b`` for arrowhead Jacobians J and scalars w, one of each per cell."""

    def __init__(self, jacobian: ArrowJacobian, w: FloatArray) -> None:
        self._inverse = 1.0 / (w + jacobian.decay)
        self._by_gate = jacobian.voltage_by_gate * self._inverse
        self._by_voltage = jacobian.gate_by_voltage
        feedback = np.add.reduce(self._by_gate * self._by_voltage)
        self._pivot = 1.0 / (w - jacobian.voltage_by_voltage - feedback)

    def __call__(self, b: FloatArray) -> FloatArray:
        """Return the solution for right-hand sides of shape (1 + gates, n)."""
        x = np.empty_like(b)
        x[0] = (b[0] + np.add.reduce(self._by_gate * b[1:])) * self._pivot
        np.multiply(b[1:] + self._by_voltage * x[0], self._inverse, out=x[1:])
        return x


SPIKE_VOLTAGE = -30.0
"""Voltage [mV] whose upward crossing defines a spike."""

TOLERANCE = 2e-9
"""Largest local error of a step, relative to 100 mV and to a fully open gate. Periods are accurate to 3e-8, except
where the membrane lingers near a vanished equilibrium: there the error grows with the time spent."""

AGREEMENT = 1e-8
"""Relative difference of successive periods, and of states at successive spikes, below which an orbit is periodic."""

_REARM = 1.0  # mV below the spike voltage that must be reached before the next spike
_LOCATED = 1e-6  # mV from the spike voltage within which a spike is located
_SETTLED = (2e-2, 2e-4)  # distance from a stable equilibrium [mV, gate] within which a cell is silent
_SETTLED_CHECK = 16  # steps between checks for settled cells
_MAX_SUBTHRESHOLD = 150  # voltage peaks without a spike after which a cell is silent: it oscillates below threshold
_MAX_STEPS = 400_000


class StepsSpentError(NumericalError):
    """The step limit of a search was reached."""


@dataclass
class Budget:
    """Remaining integration steps of one search; a simultaneous step of many cells counts once."""

    left: int

    def spend(self, cells: Cells) -> None:
        """Count one step.

        Raises
        ------
        StepsSpentError
            If none is left; the message gives the currents being tried.
        """
        if self.left <= 0:
            low, high = cells.current.min(), cells.current.max()
            raise StepsSpentError(f"at {low:.7g}" + (f" to {high:.7g}" if high > low else "") + " µA/cm²")
        self.left -= 1


class Orbit(NamedTuple):
    """The periodic orbit or equilibrium to which cells converge."""

    rate: FloatArray
    """Rates [Hz], shape (n,); exactly 0 if a cell settles or oscillates below the spike voltage"""
    spike_state: FloatArray
    """State on the orbit at the time of a spike, shape (1 + gates, n); NaN if the rate is 0"""


def steady_orbit(
    cells: Cells,
    state: FloatArray,
    tolerance: FloatArray | float = TOLERANCE,
    agreement: float = AGREEMENT,
    budget: Budget | None = None,
) -> Orbit:
    """Integrate cells from given states until they reach a periodic orbit or an equilibrium.

    Parameters
    ----------
    cells : Cells
        n cells under constant currents.
    state : ndarray, shape (1 + gates, n)
        Their states when the currents begin.
    tolerance : float or ndarray, shape (n,)
        Largest local error of a step, as :data:`TOLERANCE`.
    agreement : float
        Relative difference of successive periods, and scaled distance of successive spikes, that ends the search.
    budget : Budget, optional
        Limit on the number of steps; by default a separate one for each call.

    Raises
    ------
    NumericalError
        If a cell neither settles nor becomes periodic, or the budget is spent.
    """
    rate, spike_state = np.zeros(len(cells)), np.full_like(state, np.nan)
    orbits = _Orbits.start(cells, state, tolerance)
    for count in range(_MAX_STEPS):
        if not len(orbits.lane):
            return Orbit(rate, spike_state)
        if budget is not None:
            budget.spend(orbits.cells)
        orbits.advance()
        period = orbits.period(agreement)
        done = period > 0.0
        rate[orbits.lane[done]] = 1000.0 / period[done]
        spike_state[:, orbits.lane[done]] = orbits.spike_state[:, done]
        if count % _SETTLED_CHECK == 0:
            done |= orbits.settled() | (orbits.peaks > _MAX_SUBTHRESHOLD)
        if done.any():
            orbits = orbits.take(np.flatnonzero(~done))
    lane = orbits.lane[0]
    raise NumericalError(
        f"the membrane {cells.membrane.name} neither settles nor repeats itself at {cells.current[lane]:.9g} µA/cm² "
        f"with conductances {cells.conductance[:, lane]} and leak {cells.leak[lane]:.9g} mS/cm²"
    )


@dataclass
class _Orbits:
    """Trajectories of cells that have not yet converged, one column per cell."""

    cells: Cells
    lane: NDArray[np.intp]  # index of the cell among all cells
    tolerance: FloatArray
    state: FloatArray
    stride: FloatArray  # step length allowed by the error [ms]
    length: FloatArray  # step length to try: the stride, or less while a spike is being located
    elapsed: FloatArray  # time since the last spike [ms]
    armed: NDArray[np.bool_]  # the voltage has been below the spike voltage since the last spike
    rising: NDArray[np.bool_]
    peaks: NDArray[np.intp]  # voltage peaks since the last spike
    low: FloatArray  # step lengths around the spike, (length [ms], voltage above the spike voltage [mV])
    high: FloatArray
    intervals: FloatArray  # the last four, newest last; NaN if not yet available
    spike_state: FloatArray  # at the last spike
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
            spike_state=np.full_like(state, np.nan),
            returned=np.full(n, np.inf),
        )

    def take(self, index: NDArray[np.intp]) -> _Orbits:
        """Return the trajectories at ``index``."""
        return _Orbits(
            self.cells.take(index),
            *(getattr(self, name)[..., index] for name in self.__dataclass_fields__ if name != "cells"),
        )

    def advance(self) -> None:
        """Try one step of every trajectory."""
        after, error, slope = step(self.cells, self.state, self.length)
        # the error is relative to 100 mV and to a fully open gate; a step that overflowed is far too long
        size = np.abs(error)
        size = np.maximum(size[0] / 100.0, np.maximum.reduce(size[1:]))
        size = np.where(np.isfinite(size), size, 1.0) / self.tolerance
        locating = self.high[0] > 0.0
        accepted = (size <= 1.0) & ~locating
        gap = after[0] - SPIKE_VOLTAGE
        crossing = accepted & self.armed & (gap >= 0.0)
        busy = (locating | crossing).any()
        spiking = self._locate(locating, crossing, gap) if busy else crossing

        rising = slope[0] > 0.0
        self.peaks += self.rising & ~rising
        self.rising = rising
        factor = 0.9 * np.maximum(size, 1e-9) ** -0.2  # the method has order 5
        self.stride = np.where(locating, self.stride, self.length * np.minimum(np.maximum(factor, 0.2), 5.0))
        moved = (accepted & ~crossing) | spiking
        self.state = np.where(moved, after, self.state)
        self.elapsed = np.where(moved, self.elapsed + self.length, self.elapsed)
        self.armed = np.where(moved, (self.armed | (gap < -_REARM)) & ~spiking, self.armed)
        if spiking.any():
            self._record(np.flatnonzero(spiking))
        self.length = self.stride
        if busy:
            (start, below), (end, above) = self.low, self.high
            secant = start - below * (end - start) / np.where(above > below, above - below, 1.0)
            self.length = np.where(end > 0.0, secant, self.stride)

    def _locate(self, locating: NDArray[np.bool_], crossing: NDArray[np.bool_], gap: FloatArray) -> NDArray[np.bool_]:
        """Tighten the bracket around every spike being located (Illinois method); return a mask of those found."""
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

    def _record(self, spiking: NDArray[np.intp]) -> None:
        """Record the intervals that end with the spikes just found."""
        self.intervals[:, spiking] = np.vstack([self.intervals[1:, spiking], self.elapsed[spiking]])
        change = np.abs(self.state[:, spiking] - self.spike_state[:, spiking])
        change[0] /= 100.0
        self.returned[spiking] = change.max(axis=0)
        self.spike_state[:, spiking] = self.state[:, spiking]
        self.elapsed[spiking] = 0.0
        self.peaks[spiking] = 0

    def period(self, agreement: float) -> FloatArray:
        """Return the periods [ms] of periodic trajectories, 0 for the others."""
        fresh = self.elapsed == 0.0
        if not fresh.any():
            return np.zeros(len(self.lane))
        first, second, third, last = self.intervals
        with np.errstate(invalid="ignore", divide="ignore"):
            older, newer = _aitken(first, second, third), _aitken(second, third, last)
            converged = np.abs(newer - older) <= agreement * last
        repeated = self.returned <= 2.0 * agreement
        return np.where(fresh & repeated, last, np.where(fresh & converged, newer, 0.0))

    def settled(self) -> NDArray[np.bool_]:
        """Return a mask of the trajectories that have settled on a stable equilibrium."""
        settled = np.zeros(len(self.lane), dtype=bool)
        slope = self.cells.slope(self.state)
        slow = np.flatnonzero(np.abs(slope).max(axis=0) < 1e-1)
        if slow.size:
            jacobian = self.cells.take(slow).slope_and_jacobian(self.state[:, slow])[1]
            distance = np.abs(ArrowSolver(jacobian, np.zeros(slow.size))(slope[:, slow]))
            near = (distance[0] < _SETTLED[0]) & (distance[1:].max(axis=0) < _SETTLED[1])
            settled[slow] = near & (growth_rate(jacobian) < 0.0)
        return settled


def _aitken(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    """Return the limit of a geometric sequence from three terms, or the last term if they no longer differ."""
    change = third - second
    curvature = change - (second - first)
    settled = np.abs(curvature) <= 1e-12 * np.abs(third)
    return np.where(settled, third, third - change**2 / np.where(settled, 1.0, curvature))


def growth_rate(jacobian: ArrowJacobian) -> FloatArray:
    """Return the largest real part of the eigenvalues [1/ms], shape (n,): negative where an equilibrium is stable."""
    gates, n = jacobian.decay.shape
    matrix = np.zeros((n, gates + 1, gates + 1))
    diagonal = np.arange(1, gates + 1)
    matrix[:, 0, 0] = jacobian.voltage_by_voltage
    matrix[:, 0, 1:] = jacobian.voltage_by_gate.T
    matrix[:, 1:, 0] = jacobian.gate_by_voltage.T
    matrix[:, diagonal, diagonal] = -jacobian.decay.T
    return np.linalg.eigvals(matrix).real.max(axis=1)
