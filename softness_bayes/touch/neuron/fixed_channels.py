"""Rate curves of fixed channels: one curve for all parameter vectors, with or without noise.

With noise, a membrane also fires below its rheobase, at decreasing rates. The curve ends where the mean rate falls
below `LEAST_RATE`; below that current the membrane is treated as silent. Above it, the rate is a smooth function of the
current, and a least-squares polynomial in the square root of the distance from that end averages out the scatter of the
simulations.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.base.ranges import NOISES, require_kind, require_members
from softness_bayes.touch.neuron.firing import exact_curve, key, known_curve
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT, CurveError, RateCurve
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


USUAL_CURRENT = 40.0
"""Largest current [µA/cm²] of the default curve."""


class FixedChannels:
    """One rate curve for all parameter vectors, which ignores their channel multipliers.

    Parameters
    ----------
    channels, membrane
        Multipliers and membrane of the curve.
    max_current
        Largest current [µA/cm²] of the default curve. For larger alphas, a longer curve is computed once.
    noise
        Strength of a white-noise current [µA/cm² sqrt(ms)] over which the curve is averaged by simulation.
    nodes
        Number of exact rates that the default curve interpolates.
    """

    def __init__(
        self,
        channels: Channels = PAPER_CHANNELS,
        membrane: Membrane = CONNOR_STEVENS,
        max_current: float = USUAL_CURRENT,
        noise: float = 0.0,
        nodes: int = 18,
    ) -> None:
        require_members("channels", channels, Channels._fields, "Channels, as in PAPER_CHANNELS")
        require_kind("membrane", membrane, Membrane, "a Membrane, as in HODGKIN_HUXLEY")
        self.channels, self.membrane, self.noise, self.max_current = channels, membrane, noise, max_current
        self.nodes = nodes
        self.curve = self._made(max_current, nodes)
        # an averaged curve takes minutes: computed now, once for all processes of a run
        self._longer: RateCurve | None = self._made(LARGEST_CURRENT, nodes) if noise else None
        self._exact: FixedChannels | None = None

    def _made(self, max_current: float, nodes: int) -> RateCurve:
        if self.noise:
            return averaged_curve(self.noise, self.channels, self.membrane, max_current)
        return known_curve(self.channels, self.membrane, max_current, nodes)

    @property
    def averaged(self) -> tuple[RateCurve, ...]:
        """The default and the longer curve, if they are averages over noise."""
        return () if self._longer is None or not self.noise else (self.curve, self._longer)

    def exact(self) -> FixedChannels:
        """Return a cached source with more nodes, or this one if the curve is an average over noise."""
        if self.noise:
            return self
        if self._exact is None:
            self._exact = FixedChannels(self.channels, self.membrane, self.max_current, nodes=max(28, self.nodes + 6))
        return self._exact

    def shortened(self, terms: int) -> FixedChannels:
        """Return the same source with a shorter default curve; curves to larger currents stay as they are."""
        part = copy.copy(self)
        part.curve = self.curve.shortened(terms)
        return part

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return the common curve, of batch shape (), or one per vector if an alpha requires a longer curve.

        Raises
        ------
        NumericalError
            If an alpha exceeds `LARGEST_CURRENT`.
        """
        alpha = np.asarray(alpha, float)
        long = alpha > self.curve.max_current
        if not long.any():
            return self.curve
        if alpha.max() > LARGEST_CURRENT:
            raise NumericalError(
                f"alpha = {alpha.max():.6g} µA/cm² lies beyond {LARGEST_CURRENT:g}, where the membrane is near "
                "depolarisation block and no rate curve is kept"
            )
        if self._longer is None:
            self._longer = self._made(LARGEST_CURRENT, 28)
        # a vector's curve does not depend on the other vectors of its batch
        usual, longer = self.curve.coefficients, self._longer.coefficients
        size = max(usual.size, longer.size)
        padded, longer = (np.append(c, np.zeros(size - c.size)) for c in (usual, longer))
        return RateCurve(
            np.where(long, self._longer.rheobase, self.curve.rheobase),
            np.where(long, self._longer.onset_rate, self.curve.onset_rate),
            np.where(long[..., None], longer, padded),
            np.where(long, LARGEST_CURRENT, self.curve.max_current),
            self._longer.error,
        )
