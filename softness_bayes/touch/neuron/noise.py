"""Noise-averaged firing rate as a function of current, with its Monte-Carlo error.

With noise, a membrane also fires below its rheobase, at decreasing rates. The curve ends where the mean rate falls
below `LEAST_RATE`; below that current the membrane is treated as silent. Above it, the rate is a smooth function of the
current, and a least-squares polynomial in the square root of the distance from that end averages out the scatter of the
simulations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.ranges import NOISES
from softness_bayes.touch.neuron.firing import CurveError, RateCurve, exact_curve, key
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane
from softness_bayes.touch.neuron.spikes import firing_statistics

FloatArray = NDArray[np.float64]

LEAST_RATE = 0.25
"""Mean rate [Hz] below which a noisy membrane is treated as silent: one spike in four seconds."""

_NODES = 40
_DEGREE = 13
_STEP = 0.02  # ms; rates are accurate to 2e-4
_CLOSEST = 0.05  # of the range of s, the node next to the end of the curve
_KNOWN: dict[str, RateCurve] = {}
_REACHES = np.linspace(0.0, 12.0, 25)  # µA/cm² below the rheobase at which the end of the curve is searched


def averaged_curve(noise: float, channels: Channels, membrane: Membrane, max_current: float) -> RateCurve:
    """Return a curve by `noisy_curve`, from memory if it was simulated before or stored with a run (`make_known`)."""
    at = _place(noise, channels, membrane, max_current)
    if at not in _KNOWN:
        _KNOWN[at] = noisy_curve(noise, channels, membrane, max_current)
    return _KNOWN[at]


def make_known(noise: float, channels: Channels, membrane: Membrane, curve: RateCurve) -> None:
    """Add a curve that `averaged_curve` returned in another process."""
    _KNOWN[_place(noise, channels, membrane, float(curve.max_current))] = curve


def _place(noise: float, channels: Channels, membrane: Membrane, max_current: float) -> str:
    return f"noise {float(noise)!r}, {key(channels, membrane, max_current, _NODES)}"


def noisy_curve(
    noise: float,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    max_current: float = 40.0,
    seed: int = 0,
    runs: int = 16,
    duration: float = 2000.0,
) -> RateCurve:
    """Return a smooth curve fitted to simulated mean rates.

    Parameters
    ----------
    noise : float
        Strength of the white-noise current [µA/cm² sqrt(ms)].
    channels : Channels
        Scalar multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    max_current : float
        Largest current that the curve covers [µA/cm²].
    seed : int
        Seed of the simulations.
    runs : int
        Number of runs for each current.
    duration : float
        Duration of each run [ms].

    Returns
    -------
    RateCurve
        Curve of batch shape (). Its error is the larger of the maximum deviation of a simulated rate from the curve and
        two standard errors of the fit.

    Raises
    ------
    InputError
        If the noise is not positive, or the membrane is silent up to the largest current.
    """
    replace(NOISES, above=True).require("noise", noise)
    rng = np.random.default_rng(seed)
    quiet = exact_curve(channels, membrane, max_current)
    if not quiet.rheobase < max_current:
        raise InputError(f"the membrane {membrane.name} is silent up to {max_current:g} µA/cm²")
    begin = _end(noise, channels, membrane, float(quiet.rheobase), rng, runs)
    s_max = float(np.sqrt(max_current - begin))
    share = 0.5 * (1.0 - np.cos(np.pi * np.arange(_NODES) / (_NODES - 1)))
    s = s_max * (_CLOSEST + (1.0 - _CLOSEST) * share)
    current = np.minimum(begin + s**2, max_current)  # rounding errors may go past the end
    found = firing_statistics(current, noise, rng, channels, membrane, duration, runs, _STEP)
    # runs without spikes have zero variance; their error is at least that of one spike
    spread = np.maximum(found.rate_error, 1000.0 / (duration * runs))
    w = 2.0 * s / s_max - 1.0
    rows = s[:, None] * chebyshev.chebvander(w, _DEGREE) / spread[:, None]
    fitted = np.linalg.lstsq(rows, (found.rate - LEAST_RATE) / spread, rcond=None)[0]
    coefficients = np.asarray(chebyshev.cheb2poly(fitted), dtype=float)
    curve = RateCurve(np.array(begin), np.array(LEAST_RATE), coefficients, max_current, CurveError(0.0, 0.0, 0.0))
    deviation = np.abs(curve.rate(current) - found.rate)
    of_fit = spread * np.sqrt((rows @ np.linalg.pinv(rows)).diagonal())
    size = np.maximum(deviation, 2.0 * of_fit)
    error = CurveError(float(size.max()), float((size / np.maximum(found.rate, LEAST_RATE)).max()), LEAST_RATE)
    return RateCurve(curve.rheobase, curve.onset_rate, coefficients, max_current, error)


def _end(
    noise: float, channels: Channels, membrane: Membrane, rheobase: float, rng: np.random.Generator, runs: int
) -> float:
    """Return the current at which the mean rate crosses `LEAST_RATE`, by interpolation of its logarithm."""
    current = rheobase - _REACHES
    found = firing_statistics(current, noise, rng, channels, membrane, 1000.0, 2 * runs, _STEP)
    seldom = np.flatnonzero(found.rate < LEAST_RATE)
    if not seldom.size:
        raise InputError(
            f"noise: with {noise:g} µA/cm² sqrt(ms) the membrane fires even {_REACHES[-1]:g} µA/cm² below its "
            "rheobase; expected less noise"
        )
    if seldom[0] == 0:
        return rheobase
    above, below = np.log(found.rate[seldom[0] - 1]), np.log(max(float(found.rate[seldom[0]]), 0.1 * LEAST_RATE))
    share = (above - np.log(LEAST_RATE)) / (above - below)
    return float(current[seldom[0] - 1] - share * (_REACHES[1] - _REACHES[0]))
