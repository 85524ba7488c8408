"""Every receptor by SciPy's `solve_ivp`, one after the other, and by exponential Euler steps in NumPy, side by side."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from softness_bayes.bench.peers import Peer
from softness_bayes.touch.neuron.cells import Cells, rest
from softness_bayes.touch.neuron.limit_cycle import SPIKE_VOLTAGE
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, open_fractions

Array = NDArray[np.float64]
ONE = Channels(*(np.atleast_1d(c) for c in PAPER_CHANNELS))


def solve_each(method: str, tolerance: float, current: Array, duration: float) -> Array:
    """Return rates [Hz] from the last interval between spikes, one receptor after another, with SciPy."""

    def crossing(_t: float, state: Array) -> float:
        return float(state[0] - SPIKE_VOLTAGE)

    crossing.direction = 1.0  # type: ignore[attr-defined]
    start, times = rest(ONE, CONNOR_STEVENS)[:, 0], []
    for one in current:
        cells = Cells.of(CONNOR_STEVENS, ONE, np.array([one]))
        with np.errstate(over="ignore", invalid="ignore"):  # trial steps may overflow; the solver rejects them
            solution = solve_ivp(
                lambda _t, state, cells=cells: cells.slope(state[:, None])[:, 0],
                (0.0, duration),
                start,
                method=method,
                rtol=tolerance,
                atol=1e-3 * tolerance,
                events=crossing,
            )
        times.append(solution.t_events[0])
    return np.array([1000.0 / (t[-1] - t[-2]) if t.size > 2 else 0.0 for t in times])


def step_all(step: float, current: Array, duration: float) -> Array:
    """Return rates [Hz] from the last interval between spikes, all receptors together, in equal steps [ms]."""
    membrane, c = CONNOR_STEVENS, PAPER_CHANNELS
    state = np.repeat(rest(ONE, membrane), current.size, axis=1)
    voltage, gates = state[0].copy(), state[1:].copy()
    conductance = np.array([membrane.g_na * c.c_Na, membrane.g_a * c.c_A, membrane.g_k * c.c_K])
    potential, leak = np.array([membrane.e_na, membrane.e_a, membrane.e_k]), membrane.g_l * c.c_L
    last, interval = np.full_like(current, np.nan), np.full_like(current, np.nan)
    for k in range(round(duration / step)):
        opening, total = membrane.gating.rates(voltage)
        open_ = conductance[:, None] * open_fractions(gates)
        sum_ = open_.sum(axis=0) + leak
        aim, before = (potential @ open_ + leak * membrane.e_l + current) / sum_, voltage
        voltage = aim + (voltage - aim) * np.exp(-sum_ * (step / membrane.capacitance))
        gates = opening / total + (gates - opening / total) * np.exp(-total * step)
        fired = (before < SPIKE_VOLTAGE) & (voltage >= SPIKE_VOLTAGE)
        at = (k + (SPIKE_VOLTAGE - before[fired]) / (voltage[fired] - before[fired])) * step
        interval[fired], last[fired] = at - last[fired], at
    return np.where(np.isfinite(interval), 1000.0 / interval, 0.0)


RK45, LSODA = (partial(solve_each, method, rtol) for method, rtol in (("RK45", 1e-3), ("LSODA", 1e-6)))
PEERS = (
    Peer("SciPy solve_ivp", "RK45, rtol 1e-3", RK45, False),
    Peer("SciPy solve_ivp", "LSODA, rtol 1e-6", LSODA, False),
    *(Peer("NumPy exponential Euler", f"{step} ms", partial(step_all, step), True) for step in (0.05, 0.02)),
)
