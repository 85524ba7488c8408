"""Rodas5P integration steps for a row of cells, each with an individual step length.

Rodas5P (Steinebach, BIT Numerical Mathematics 63:27, 2023) is an L-stable Rosenbrock method of order 5 with an
embedded solution of order 4. The Jacobian of a cell is an arrowhead matrix, so each of the eight linear systems takes
only a few elementwise operations, and the long quiescent phase before a spike takes few steps despite its stiffness.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.neuron.vector_field import ArrowJacobian, Cells

FloatArray = NDArray[np.float64]

ORDER = 5

FIRST_LENGTH = 0.01
"""Length of a first step [ms]."""

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


def local_error(error: FloatArray) -> FloatArray:
    """Return the size of a step's error estimate, relative to 100 mV and to a fully open gate, shape (n,)."""
    size = np.abs(error)
    size = np.maximum(size[0] / 100.0, np.maximum.reduce(size[1:]))
    return np.where(np.isfinite(size), size, 1.0)


def next_length(length: FloatArray, size: FloatArray) -> FloatArray:
    """Return the length of the next step [ms] after a step whose error was ``size`` times the tolerance."""
    factor = 0.9 * np.maximum(size, 1e-9) ** (-1.0 / ORDER)
    return length * np.minimum(np.maximum(factor, 0.2), 5.0)


def travel(cells: Cells, state: FloatArray, duration: FloatArray, tolerance: float) -> FloatArray:
    """Return the state of every cell after its duration [ms], with shapes as in :func:`step`."""
    state, left = state.copy(), duration.copy()
    length = np.minimum(FIRST_LENGTH, duration)
    under_way = np.flatnonzero(left > 0.0)
    moving = cells.take(under_way)
    while under_way.size:
        attempt = np.minimum(length[under_way], left[under_way])
        after, error, _ = step(moving, state[:, under_way], attempt)
        size = local_error(error) / tolerance
        accepted = size <= 1.0
        done = under_way[accepted]
        state[:, done] = after[:, accepted]
        left[done] -= attempt[accepted]
        length[under_way] = next_length(attempt, size)
        if (left[done] <= 0.0).any():
            under_way = under_way[left[under_way] > 0.0]
            moving = cells.take(under_way)
    return state


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
