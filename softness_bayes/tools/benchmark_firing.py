"""Exact firing rates beside simulators: ``python -m softness_bayes.tools.benchmark_firing [FILE.csv]``.

Measures, for one batch of currents into the Connor-Stevens membrane at the paper's multipliers, the processor time for
each current and the largest relative error of the exact rate, of the same method with other tolerances, and of
simulations by Brian2 and by JAX (fourth-order Runge-Kutta at several step lengths, and diffrax's adaptive steps at
several tolerances). It also gives the ratio of a simulator's time to that of the fastest setting of this package with
at least the same accuracy. The simulators come with the extra ``peers``; Brian2 needs a separate environment as long as
it requires an older NumPy. The comparison favours them: crossings of the spike voltage are interpolated within a step,
and compilation is excluded.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.jax_cells import ABSENT, jax_is_there, orbit_cells, step_cells
from softness_bayes.bench.subject import machine, machine_name
from softness_bayes.errors import InputError
from softness_bayes.touch.neuron.equilibrium import rest
from softness_bayes.touch.neuron.limit_cycle import AGREEMENT, SPIKE_VOLTAGE, TOLERANCE, steady_orbit
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane
from softness_bayes.touch.neuron.vector_field import Cells

FloatArray = NDArray[np.float64]

CURRENTS = 512
CURRENT_RANGE = (20.3, 60.0)  # µA/cm²: from the paper's largest current to the end of the firing-rate surface
OURS = (
    (0.1 * TOLERANCE, 0.1 * AGREEMENT),
    (TOLERANCE, AGREEMENT),
    (3e-8, 1e-7),
    (3e-7, 1e-6),
    (3e-6, 1e-5),
    (3e-5, 1e-4),
    (3e-4, 1e-3),
)
"""Local errors and agreements of periods with which the exact method is measured; the second are its own."""
FINEST = (0.01 * TOLERANCE, 0.01 * AGREEMENT)
"""Those of the rates with which all others are compared."""
STEPS = (0.04, 0.02)
TARGETS = ("cython", "numpy")
ADAPTIVE = (1e-4, 1e-7)
"""Relative tolerances of diffrax's adaptive steps."""
DURATION, SETTLING = 400.0, 200.0  # [ms] length of a simulation, and of its discarded initial part

_A_GATES = """
ainf = (0.0761*exp((v+94.22)/31.84)/(1+exp((v+1.17)/28.93)))**(1.0/3.0) : 1
binf = (1+exp((v+53.3)/14.54))**(-4) : 1
da/dt = (ainf-a)/(0.3632+1.158/(1+exp((v+55.96)/20.12)))/ms : 1
db/dt = (binf-b)/(1.24+2.678/(1+exp((v+50.0)/16.027)))/ms : 1
"""
_HODGKIN_HUXLEY = """
dm/dt = (1/exprel(-(v+40)/10)*(1-m) - 4*exp(-(v+65)/18)*m)/ms : 1
dh/dt = (0.07*exp(-(v+65)/20)*(1-h) - 1/(1+exp(-(v+35)/10))*h)/ms : 1
dn/dt = (0.1/exprel(-(v+55)/10)*(1-n) - 0.125*exp(-(v+65)/80)*n)/ms : 1
"""
_CONNOR_STEVENS = """
dm/dt = (3.8/exprel(-(v+29.7)/10)*(1-m) - 15.2*exp(-(v+54.7)/18)*m)/ms : 1
dh/dt = (0.266*exp(-(v+48)/20)*(1-h) - 3.8/(1+exp(-(v+18)/10))*h)/ms : 1
dn/dt = (0.19/exprel(-(v+45.7)/10)*(1-n) - 0.2375*exp(-(v+55.7)/80)*n)/ms : 1
"""
_IONIC = "g_na*m**3*h*(e_na-v) + g_k*n**4*(e_k-v) + g_l*(e_l-v)"
EQUATIONS: Mapping[str, str] = MappingProxyType(
    {
        "connor-stevens": f"dv/dt = (drive + {_IONIC} + g_a*a**3*b*(e_a-v))/ms : 1 {_CONNOR_STEVENS} {_A_GATES}",
        "hodgkin-huxley": f"dv/dt = (drive + {_IONIC})/ms : 1 {_HODGKIN_HUXLEY}",
        "printed": f"dv/dt = (drive + {_IONIC} + g_a*a**3*b*(e_a-v))/ms : 1 {_HODGKIN_HUXLEY} {_A_GATES}",
    }
)
"""The membranes in Brian2's syntax, in mV, ms, mS/cm² and µA/cm² (model.md 7), by name."""

_BOOKKEEPING = """
drive : 1
v_before : 1
first : 1
last : 1
counted : 1
"""
_AT_A_SPIKE = """
last = t/ms + dt/ms*(spike_voltage-v_before)/(v-v_before)
counted = counted + int(last > settling)
first = first + int(counted == 1)*int(last > settling)*(last-first)
"""
_GATES = {"m": "m", "h": "h", "n": "n", "A": "a", "B": "b"}


class Peer(NamedTuple):
    """One method of computing the rates of a batch."""

    simulator: str
    setting: str
    seconds: float
    """Processor time for each current."""
    error: float
    """Largest, relative to the exact method with a hundredth of its tolerance."""
    ratio: float
    """Ratio of its time to that of the fastest of our methods that is at least as accurate; NaN if there is none, 1 for
    these methods."""


class Simulated(NamedTuple):
    """Result of a simulator."""

    rate: FloatArray
    """Rates [Hz], shape (n,); NaN (Brian2) or 0 (JAX) with fewer than two spikes after the settling."""
    seconds: float
    """Processor time of the simulation, without compiling."""


def brian2_rates(
    current: FloatArray,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    step: float = 0.02,
    target: str = "numpy",
) -> Simulated:
    """Rates after a current step from rest, simulated by Brian2 for `DURATION`.

    Parameters
    ----------
    current : ndarray, shape (n,)
        Currents [µA/cm²].
    channels : Channels
        Scalar multipliers [-].
    membrane : Membrane
        Constants of a membrane in `EQUATIONS`.
    step : float
        Length of a step [ms].
    target : str
        Brian2's code generation target: ``cython`` or ``numpy``.

    Raises
    ------
    InputError
        If Brian2 is not installed.
    """
    try:
        import brian2
    except ImportError as error:
        raise InputError("Brian2 is not installed here: install softness-bayes[peers]") from error
    ms = brian2.ms
    brian2.prefs.codegen.target = target
    cells = brian2.NeuronGroup(
        current.size,
        EQUATIONS[membrane.name] + _BOOKKEEPING,
        method="rk4",
        dt=step * ms,
        threshold="v >= spike_voltage",
        refractory="v >= spike_voltage",
        reset=_AT_A_SPIKE,
        namespace=_constants(channels, membrane),
    )
    remember = cells.run_regularly("v_before = v", when="start", dt=step * ms)
    network = brian2.Network(cells, remember)
    state = rest(Channels(*(np.full(current.size, c) for c in channels)), membrane)
    cells.v, cells.drive = state[0], current
    for gate, values in zip(membrane.gating.names, state[1:], strict=True):
        setattr(cells, _GATES[gate], values)
    _seconds(lambda: network.run(step * ms))  # compiles
    begin = _seconds(lambda: network.run(step * ms))
    seconds = _seconds(lambda: network.run(DURATION * ms)) - begin
    counted, span = np.array(cells.counted), np.array(cells.last) - np.array(cells.first)
    enough = counted >= 2
    rate = np.where(enough, 1000.0 * (counted - 1) / np.where(enough, span, 1.0), np.nan)
    return Simulated(rate, seconds)


def _constants(channels: Channels, membrane: Membrane) -> dict[str, float]:
    """Return the constants used in the equations."""
    conductances = {
        f"g_{ion}": multiplier * getattr(membrane, f"g_{ion}")
        for ion, multiplier in zip(("na", "k", "l", "a"), channels, strict=True)
    }
    potentials = {name: getattr(membrane, name) for name in ("e_na", "e_k", "e_l", "e_a")}
    return {**conductances, **potentials, "spike_voltage": SPIKE_VOLTAGE, "settling": SETTLING}


def firing_peers(
    currents: int = CURRENTS, steps: tuple[float, ...] = STEPS, targets: tuple[str, ...] = TARGETS
) -> list[Peer]:
    """Return time and error of exact rates, of rates with looser tolerances and of simulators, for a batch of currents.

    Parameters
    ----------
    currents : int
        Number of currents, evenly spaced over `CURRENT_RANGE`.
    steps : tuple of float
        Step lengths of Brian2 and JAX [ms].
    targets : tuple of str
        Brian2's code generation targets.

    Raises
    ------
    InputError
        If Brian2, JAX or diffrax is not installed.
    """
    current = np.linspace(*CURRENT_RANGE, currents)
    best = _ours(current, *FINEST)
    ours = []
    for tolerance, agreement in OURS:
        begun = time.process_time()
        rate = _ours(current, tolerance, agreement)
        seconds = (time.process_time() - begun) / currents
        ours.append(Peer("softness-bayes", f"local error {tolerance:.0e}", seconds, _error(rate, best), 1.0))
    theirs = []
    for simulator, setting, found in _simulated(current, steps, targets):
        seconds, error = found.seconds / currents, _error(found.rate, best)
        rivals = [way.seconds for way in ours if way.error <= error]
        theirs.append(Peer(simulator, setting, seconds, error, seconds / min(rivals) if rivals else np.nan))
    return [*ours, *theirs]


def _simulated(
    current: FloatArray, steps: tuple[float, ...], targets: tuple[str, ...]
) -> Iterator[tuple[str, str, Simulated]]:
    """Yield simulator, setting and result of every simulation."""
    for target in targets:
        for step in steps:
            yield "Brian2", f"{target}, RK4, {step:g} ms", brian2_rates(current, step=step, target=target)
    for step in steps:
        yield "JAX", f"RK4, {step:g} ms", jax_rates(current, step)
    for rtol in ADAPTIVE:
        yield "JAX, diffrax", f"Tsit5, rtol {rtol:.0e}", jax_orbits(current, rtol)


def jax_rates(current: FloatArray, step: float = 0.02) -> Simulated:
    """Rates after a current step from rest, simulated by JAX with equal steps [ms] for `DURATION`.

    Raises
    ------
    InputError
        If JAX or diffrax is not installed.
    """
    return _compiled(lambda duration: step_cells(current, duration, step), step, DURATION)


def jax_orbits(current: FloatArray, rtol: float = 1e-7) -> Simulated:
    """Rates from one interval between spikes after the settling, by diffrax; raises as `jax_rates`."""
    return _compiled(lambda settling: orbit_cells(current, settling, rtol), 1.0, SETTLING)


def _compiled(run: Callable[[float], FloatArray], short: float, long: float) -> Simulated:
    """Return the result of a function of a simulated time [ms], which a short one compiles first."""
    if not jax_is_there():
        raise InputError(ABSENT)
    run(short)
    rate = []
    seconds = _seconds(lambda: rate.append(run(long)))
    return Simulated(rate[0], seconds)


def _ours(current: FloatArray, tolerance: float, agreement: float) -> FloatArray:
    many = Channels(*(np.full(current.size, c) for c in PAPER_CHANNELS))
    cells = Cells.of(CONNOR_STEVENS, many, current)
    return steady_orbit(cells, rest(many, CONNOR_STEVENS), tolerance, agreement).rate


def _error(rate: FloatArray, best: FloatArray) -> float:
    return float(np.abs(rate / best - 1.0).max())


def _seconds(run: Callable[[], object]) -> float:
    begun = time.process_time()
    run()
    return time.process_time() - begun


COLUMNS = ("simulator", "setting", "ms_per_current", "error", "ratio", "machine")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write it if a file is given."""
    from threadpoolctl import threadpool_limits

    parser = argparse.ArgumentParser(description="Compare exact firing rates with simulators in time and error.")
    parser.add_argument("file", type=Path, nargs="?", metavar="FILE.csv", help="file to write")
    given = parser.parse_args(arguments)
    name = machine_name(machine())
    with threadpool_limits(1):
        found = firing_peers()
    rows = [
        (
            one.simulator,
            one.setting,
            f"{1e3 * one.seconds:.3g}",
            f"{one.error:.1e}",
            "" if np.isnan(one.ratio) else f"{one.ratio:.2g}",
            name,
        )
        for one in found
    ]
    print(f"{CURRENTS} currents from {CURRENT_RANGE[0]:g} to {CURRENT_RANGE[1]:g} µA/cm²")
    for row in (COLUMNS, *rows):
        print(" | ".join(row))
    if given.file is not None:
        with given.file.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
