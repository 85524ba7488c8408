"""Other ways to compute the total rates, by simulating every receptor that fires, one by one or together.

The workload is one parameter vector at the priors' medians (sigma_0 = 7 kPa): all receptors that fire, summed over the
36 conditions. The time per receptor is measured on a subset, with currents from just above the rheobase to alpha, and
multiplied by the number of receptors. The error is that of the summed rate of this subset. Transduction and the search
for the receptors are excluded.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from softness_bayes.bench.precision import LIKELIHOOD, Point
from softness_bayes.bench.subject import Effort, Subject
from softness_bayes.model.scenes import touch_parameters, usual_values
from softness_bayes.touch.neuron.equilibrium import rest
from softness_bayes.touch.neuron.gating import open_fractions
from softness_bayes.touch.neuron.limit_cycle import SPIKE_VOLTAGE
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.vector_field import Cells
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

PEER = "peer"


class Work(NamedTuple):
    """The workload of a peer method."""

    receptors: float
    """Number of receptors that fire, over all conditions."""
    alpha: float
    """Largest current [µA/cm²]."""
    rheobase: float

    def currents(self, size: int) -> Array:
        """Return currents [µA/cm²] from alpha down to near the rheobase, evenly spaced in sqrt(I - rheobase)."""
        return self.rheobase + (self.alpha - self.rheobase) * np.linspace(1.0, 0.5, size) ** 2


class Peer(NamedTuple):
    """One method of computing firing rates."""

    name: str
    setting: str
    rates: Callable[[Array, float], Array]
    """Function from currents [µA/cm²] and duration [ms] to rates [Hz]."""
    vectorised: bool


def work_of(of: Subject) -> Work:
    """Return the workload at the priors' medians."""
    scene = of.model.scene
    values = touch_parameters(usual_values(MENDED, given={"sigma_0": 7.0}))
    response = scene.respond(values)
    curve = scene.firing.curves(values)
    return Work(float(response.responding.sum()), float(np.asarray(values.alpha)), float(curve.rheobase))


def measure_peer(peer: Peer, work: Work, effort: Effort) -> Point:
    """Take a peer's processor time for some receptors, and compare their summed rate with exact ones."""
    current = work.currents(effort.lanes if peer.vectorised else effort.loop)
    # compilation for arrays of this size is not counted
    peer.rates(current if peer.vectorised else current[:1], 1.0)
    begun = time.process_time()
    found = peer.rates(current, effort.duration)
    spent = (time.process_time() - begun) / current.size
    some = np.unique(np.linspace(0, current.size - 1, 12).astype(int))
    exact = firing_rate(current[some])
    error = abs(float(found[some].sum() / exact.sum() - 1.0))
    return Point(PEER, f"{peer.name}, {peer.setting}", spent * work.receptors, error, error, np.nan, np.nan)


class Ratio(NamedTuple):
    """Ratio of a peer's time to that of the fastest likelihood with the same error or less."""

    ratio: float
    setting: str
    """Setting of that likelihood."""


def faster(peer: Point, ours: list[Point]) -> Ratio | None:
    """Return how many times longer a peer takes; None if no likelihood is as accurate."""
    good = [p for p in ours if p.stage == LIKELIHOOD and "held" in p.setting and p.max_peak <= peer.max_peak]
    if not good:
        return None
    best = min(good, key=lambda point: point.seconds)
    return Ratio(peer.seconds / best.seconds, best.setting)


def solve_each(method: str, tolerance: float) -> Callable[[Array, float], Array]:
    """Return a function that integrates one receptor after another with SciPy."""

    def rates(current: Array, duration: float) -> Array:
        return np.array([_solved(float(i), duration, method, tolerance) for i in current])

    return rates


def _solved(current: float, duration: float, method: str, tolerance: float) -> float:
    cells = Cells.of(CONNOR_STEVENS, _one(PAPER_CHANNELS), np.array([current]))

    def crossing(_t: float, state: Array) -> float:
        return float(state[0] - SPIKE_VOLTAGE)

    crossing.direction = 1.0  # type: ignore[attr-defined]
    # trial steps may overflow; the solver rejects them
    with np.errstate(over="ignore", invalid="ignore"):
        found = solve_ivp(
            lambda _t, state: cells.slope(state[:, None])[:, 0],
            (0.0, duration),
            rest(_one(PAPER_CHANNELS), CONNOR_STEVENS)[:, 0],
            method=method,
            rtol=tolerance,
            atol=1e-3 * tolerance,
            events=crossing,
        )
    times = found.t_events[0]
    return 1000.0 / float(times[-1] - times[-2]) if times.size > 2 else 0.0


def step_all(step: float) -> Callable[[Array, float], Array]:
    """Return a function that integrates all receptors together with exponential Euler steps [ms] in NumPy."""

    def rates(current: Array, duration: float) -> Array:
        membrane, channels = CONNOR_STEVENS, PAPER_CHANNELS
        state = np.repeat(rest(_one(channels), membrane), current.size, axis=1)
        voltage, gates = state[0].copy(), state[1:].copy()
        conductance = np.array(
            [membrane.g_na * channels.c_Na, membrane.g_a * channels.c_A, membrane.g_k * channels.c_K]
        )
        potential = np.array([membrane.e_na, membrane.e_a, membrane.e_k])
        leak = membrane.g_l * channels.c_L
        last, interval = np.full_like(current, np.nan), np.full_like(current, np.nan)
        for k in range(round(duration / step)):
            opening, total = membrane.gating.rates(voltage)
            open_ = conductance[:, None] * open_fractions(gates)
            sum_ = open_.sum(axis=0) + leak
            aim = (potential @ open_ + leak * membrane.e_l + current) / sum_
            before = voltage
            voltage = aim + (voltage - aim) * np.exp(-sum_ * (step / membrane.capacitance))
            steady = opening / total
            gates = steady + (gates - steady) * np.exp(-total * step)
            fired = (before < SPIKE_VOLTAGE) & (voltage >= SPIKE_VOLTAGE)
            part = (SPIKE_VOLTAGE - before[fired]) / (voltage[fired] - before[fired])
            at = (k + part) * step
            interval[fired], last[fired] = at - last[fired], at
        return np.where(np.isfinite(interval), 1000.0 / interval, 0.0)

    return rates


PEERS = (
    Peer("SciPy solve_ivp, receptor by receptor", "RK45, rtol 1e-3", solve_each("RK45", 1e-3), False),
    Peer("SciPy solve_ivp, receptor by receptor", "LSODA, rtol 1e-6", solve_each("LSODA", 1e-6), False),
    Peer("NumPy exponential Euler, side by side", "0.05 ms", step_all(0.05), True),
    Peer("NumPy exponential Euler, side by side", "0.02 ms", step_all(0.02), True),
)
"""The peers without further dependencies."""


def _one(channels: Channels) -> Channels:
    return Channels(*(np.atleast_1d(np.asarray(c, float)) for c in channels))
