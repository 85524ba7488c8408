"""Spike trains for arbitrary currents, with or without channel noise, and the noise-averaged firing rate.

Noise is a Gaussian white current, ``C dV = (...) dt + noise dW`` with ``noise`` in µA/cm² sqrt(ms). It is additive and
integrated by Rößler's SRA1 (SIAM J. Numer. Anal. 48, 922, 2010), with strong order 1.5 at two evaluations per step.
Noise-free trains are integrated by LSODA, with spikes located as events.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.touch.neuron.cells import Cells, rest
from softness_bayes.touch.neuron.limit_cycle import SPIKE_VOLTAGE
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane, lanes

FloatArray = NDArray[np.float64]
Current = Callable[[float], float] | float
"""Injected current [µA/cm²]: a number, or a function of the time [ms]."""

REARM_VOLTAGE = -45.0
"""Voltage [mV] below which the membrane must fall before it can spike again. This excludes spurious spikes from noise
about the spike voltage or about the depolarised rest of a blocked membrane."""

STEP = 0.01
"""Step of the noisy integration [ms]; the explicit method becomes unstable beyond about 0.04."""

TOLERANCE = 1e-7
"""Tolerance of the integration without noise, relative and absolute [mV, gate]."""

_LONGEST_STEP = 1.0  # ms, so that no pulse of a millisecond is missed
_TRANSIENT = 100.0  # ms excluded from statistics after the onset of the current


def spike_times(
    current: Current,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    duration: float = 1000.0,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    tolerance: float = TOLERANCE,
) -> FloatArray:
    """Return the spike times of one membrane that is at rest at the onset of the current.

    Parameters
    ----------
    current : float or callable
        Injected current [µA/cm²], or a function that gives it at a time [ms]. Without noise, features shorter than
        1 ms may be missed; the fixed step of the noisy integration resolves them.
    channels : Channels
        Scalar multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    duration : float
        Length of the train [ms].
    noise : float
        Strength of the white-noise current [µA/cm² sqrt(ms)].
    rng : Generator or None
        Random generator of the noise.
    tolerance : float
        Tolerance of the integration without noise. With 1e-5 it takes half the time, and spikes are within 0.02 ms.

    Returns
    -------
    ndarray
        Times of the upward crossings of ``SPIKE_VOLTAGE`` [ms], in increasing order.

    Raises
    ------
    InputError
        If a multiplier, the duration or the noise is negative or not finite, the tolerance is not between 0 and 1,
        there is noise but no generator, or the current is not finite at some time.
    NumericalError
        If the integration fails.
    """
    from scipy.integrate import solve_ivp  # imported here because it takes a sixth of a second

    one = _one(channels)
    _require(duration, noise, rng)
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"tolerance: {tolerance}, expected a number between 0 and 1")
    at = current if callable(current) else lambda _, constant=float(current): constant
    cells = Cells.of(membrane, one, np.zeros(1))
    if noise > 0.0 and rng is not None:
        walk, times = _Walk(cells, rest(one, membrane), noise, rng, STEP), []
        for k in range(int(np.ceil(duration / STEP))):
            t = k * STEP
            spike, part = walk.advance(_finite(at, t), _finite(at, t + 0.75 * STEP))
            if spike[0]:
                times.append(t + float(part[0]) * STEP)
        return np.array([t for t in times if t <= duration])

    def slope(t: float, state: FloatArray) -> FloatArray:
        change = cells.slope(state[:, None])[:, 0]
        change[0] += _finite(at, t) / membrane.capacitance
        return change

    def crossing(_t: float, state: FloatArray) -> float:
        return float(state[0] - SPIKE_VOLTAGE)

    def rearming(_t: float, state: FloatArray) -> float:
        return float(REARM_VOLTAGE - state[0])

    crossing.direction = rearming.direction = 1.0  # type: ignore[attr-defined]
    train = solve_ivp(
        slope,
        (0.0, duration),
        rest(one, membrane)[:, 0],
        method="LSODA",
        events=(crossing, rearming),
        rtol=tolerance,
        atol=tolerance,
        max_step=_LONGEST_STEP,
    )
    if not train.success:
        raise NumericalError(f"spike train: {train.message}")
    crossings, rearmings = train.t_events
    # the first crossing of all, and the first after each rearming
    before = np.searchsorted(rearmings, crossings)
    return np.asarray(crossings[np.append(True, np.diff(before) > 0)[: crossings.size]])


class FiringStatistics(NamedTuple):
    """Firing under noise, averaged over long runs; every array has the shape of the currents."""

    rate: FloatArray
    """Spikes per second [Hz]"""
    rate_error: FloatArray
    """Its Monte-Carlo standard error [Hz]"""
    interval: FloatArray
    """Mean inter-spike interval [ms]; NaN with fewer than two spikes in every run"""
    interval_error: FloatArray
    """Its Monte-Carlo standard error [ms]"""
    variation: FloatArray
    """Coefficient of variation of the intervals [-]; NaN as above"""
    variation_error: FloatArray
    """Its Monte-Carlo standard error [-]"""


def firing_statistics(
    current: ArrayLike,
    noise: float,
    rng: np.random.Generator,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    duration: float = 2000.0,
    runs: int = 16,
    step: float = STEP,
) -> FiringStatistics:
    """Return rate and interval statistics of a noisy membrane under constant currents.

    Each current is simulated in ``runs`` independent runs, whose variation gives the standard errors. The first 100 ms
    of each run are discarded. Rates are spike counts per time, an average over the noise; noise-free rates are instead
    computed from the inter-spike interval.

    Parameters
    ----------
    current : array_like
        Constant currents [µA/cm²].
    noise : float
        Strength of the white current [µA/cm² sqrt(ms)].
    rng : Generator
        Source of the noise.
    channels : Channels
        Scalar multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    duration : float
        Length of each run after the transient [ms].
    runs : int
        Number of runs for each current, at least 2.
    step : float
        Step of the integration [ms].

    Raises
    ------
    InputError
        If a value is not finite or has the wrong sign, or there are fewer than two runs.
    """
    one = _one(channels)
    _require(duration, noise, rng)
    if runs < 2 or not 0.0 < step <= 0.04:
        raise InputError(f"{runs} runs with steps of {step} ms: expected at least 2 runs and steps up to 0.04 ms")
    _, (*_, flat) = lanes(one, current=current)
    shape = np.shape(current)
    many = Channels(*(np.full(flat.size * runs, c[0]) for c in one))
    cells = Cells.of(membrane, many, np.repeat(flat, runs))
    walk = _Walk(cells, rest(many, membrane), noise, rng, step)
    count, first, last, squares = np.zeros((4, len(cells)))
    for k in range(int(np.ceil((_TRANSIENT + duration) / step))):
        spike, part = walk.advance(0.0, 0.0)
        t = k * step
        if t < _TRANSIENT or not spike.any():
            continue
        i = np.flatnonzero(spike)
        now = t + part[i] * step
        squares[i] += np.where(count[i] > 0, (now - last[i]) ** 2, 0.0)
        first[i] = np.where(count[i] > 0, first[i], now)
        last[i] = now
        count[i] += 1
    with np.errstate(invalid="ignore", divide="ignore"):
        intervals = count - 1.0
        mean = np.where(intervals > 0, (last - first) / intervals, np.nan)
        spread = np.where(intervals > 0, np.sqrt(np.maximum(squares / intervals - mean**2, 0.0)), np.nan)
        each = np.array([1000.0 * count / duration, mean, spread / mean]).reshape(3, flat.size, runs)
        known = np.isfinite(each).sum(axis=-1)
        means = np.nansum(each, axis=-1) / known
        errors = np.sqrt(np.nansum((each - means[..., None]) ** 2, axis=-1) / (known - 1) / known)
    return FiringStatistics(*(x.reshape(shape) for pair in zip(means, errors, strict=True) for x in pair))


class _Walk:
    """Simultaneous integration of noisy cells."""

    def __init__(self, cells: Cells, state: FloatArray, noise: float, rng: np.random.Generator, step: float) -> None:
        self.cells, self.state, self.rng, self.step = cells, state, rng, step
        self.noise, self.armed = noise / cells.membrane.capacitance, state[0] < REARM_VOLTAGE

    def advance(self, extra: float, extra_later: float) -> tuple[NDArray[np.bool_], FloatArray]:
        """Take one SRA1 step; return the cells that spiked, and the fraction of the step at which they did.

        ``extra`` is the additional current [µA/cm²] at the start of the step, ``extra_later`` that at 3/4 of it.
        """
        h, before = self.step, self.state
        normal, other = self.rng.standard_normal((2, before.shape[1]))
        kick = np.sqrt(h) * normal
        # I_(1,0) / h, the step's mean of the Wiener path
        mean_path = 0.5 * np.sqrt(h) * (normal + other / np.sqrt(3.0))
        here = self._slope(before, extra)
        there = before + 0.75 * h * here
        there[0] += 1.5 * self.noise * mean_path
        after = before + (h / 3.0) * (here + 2.0 * self._slope(there, extra_later))
        after[0] += self.noise * kick
        self.state = after
        spike = self.armed & (after[0] >= SPIKE_VOLTAGE)
        rise = np.where(spike, after[0] - before[0], 1.0)
        part = np.clip((SPIKE_VOLTAGE - before[0]) / rise, 0.0, 1.0)
        self.armed = (self.armed & ~spike) | (after[0] < REARM_VOLTAGE)
        return spike, part

    def _slope(self, state: FloatArray, extra: float) -> FloatArray:
        slope = self.cells.slope(state)
        slope[0] += extra / self.cells.membrane.capacitance
        return slope


def _one(channels: Channels) -> Channels:
    if any(np.ndim(c) for c in channels):
        raise InputError("a spike train has one value of each channel multiplier")
    _, multipliers = lanes(channels)
    return Channels(*multipliers)


def _require(duration: float, noise: float, rng: np.random.Generator | None) -> None:
    if not (np.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: {duration} ms, expected a positive finite number")
    if not (np.isfinite(noise) and noise >= 0.0):
        raise InputError(f"noise: {noise} µA/cm² sqrt(ms), expected 0 or a positive finite number")
    if noise > 0.0 and rng is None:
        raise InputError("noise needs a random generator: give rng=numpy.random.default_rng(seed)")


def _finite(at: Callable[[float], float], t: float) -> float:
    value = float(at(t))
    if not np.isfinite(value):
        raise InputError(f"the current is {value} at {t:.6g} ms, expected a finite number [µA/cm²]")
    return value
