"""Exact steady firing rates and rheobases: the reference that every faster form is measured against."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.touch.cells import Cells
from softness_bayes.touch.equilibrium import Fold, fold, rest
from softness_bayes.touch.limit_cycle import TOLERANCE, steady_rate
from softness_bayes.touch.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane, lanes

FloatArray = NDArray[np.float64]

SEARCH_LIMIT = 250.0
"""Current [µA/cm²] beyond which no onset of firing is looked for: every membrane is blocked there."""

_BLOCK = 2048  # cells integrated side by side
_SLOW = 0.06  # sqrt(µA/cm²): closer to the fold the tolerance shrinks, because errors add up during the long stay
_CONTINUED = 0.02  # sqrt(µA/cm²): closer to the fold the rate is continued analytically
_CONTINUATION_NODES = _CONTINUED * np.array([1.0, 1.5, 2.0, 2.5])
_SAME_LIMIT = 1e-3  # relative difference to the analytic limit below which the orbit does pass through the fold
_CLASSIFYING_TOLERANCE = 1e-7  # where only the kind of onset is asked for
_SECTIONS = 24  # currents tried side by side while a jump is bracketed
_RESOLUTION = 1e-6  # µA/cm², width of the final bracket around a jump


def firing_rate(
    current: ArrayLike, channels: Channels = PAPER_CHANNELS, membrane: Membrane = CONNOR_STEVENS
) -> FloatArray:
    """Steady firing rate after a current step applied to the membrane at rest.

    The membrane starts from its equilibrium without a current, and the rate is the inverse period of the orbit that it
    ends on: 0 where it settles on an equilibrium (below the rheobase, and in depolarisation block far above it).
    Within 4e-4 µA/cm² above a fold the period exceeds seconds and is not waited for: ``sqrt(I - I_fold) / rate`` is
    smooth in ``sqrt(I - I_fold)`` and is interpolated between its analytic limit and exact values.

    Parameters
    ----------
    current : array_like
        Injected currents [µA/cm²], broadcast with the multipliers.
    channels : Channels
        Multipliers of the conductances [-].
    membrane : Membrane
        Constants.

    Returns
    -------
    ndarray
        Rates [Hz], relative error below 1e-6, of the broadcast shape.

    Raises
    ------
    InputError
        If a current or multiplier is not finite, or a multiplier negative.
    NumericalError
        If a membrane neither settles nor repeats itself.
    """
    shape, (*multipliers, flat) = lanes(channels, current=current)
    distinct, lane = np.unique(np.array(multipliers), axis=1, return_inverse=True)
    lane = lane.ravel()
    folds = fold(Channels(*distinct), membrane)
    excess = flat - folds.current[lane]
    slow = (excess > 0.0) & (excess < _CONTINUED**2)
    rate = np.zeros(flat.size)
    if slow.any():
        near, place = np.unique(lane[slow], return_inverse=True)
        continued = _Continuation.of(Channels(*distinct[:, near]), Fold(*(x[near] for x in folds)), membrane)
        rate[slow] = continued.rate(np.sqrt(excess[slow]), place)
        slow[slow] = continued.through_fold[place]
    direct = np.flatnonzero(~slow)
    rate[direct] = _simulated_rate(
        flat[direct], Channels(*(c[direct] for c in multipliers)), membrane, excess[direct]
    )
    return rate.reshape(shape)


class _Continuation(NamedTuple):
    """Period times distance from the fold, ``T s`` with ``s = sqrt(I - I_fold)``, as a polynomial in s."""

    coefficients: FloatArray
    through_fold: NDArray[np.bool_]

    @classmethod
    def of(cls, channels: Channels, folds: Fold, membrane: Membrane) -> _Continuation:
        nodes = _CONTINUATION_NODES[:, None]
        n = folds.current.size
        current = (folds.current + nodes**2).ravel()
        many = Channels(*(np.tile(c, len(nodes)) for c in channels))
        rate = _simulated_rate(current, many, membrane, np.repeat(nodes**2, n)).reshape(len(nodes), n)
        fires = (rate > 0.0).all(axis=0)
        scaled = nodes / np.where(rate > 0.0, rate, 1.0)
        limit = 1.0 / folds.prefactor
        free = np.linalg.solve(np.vander(nodes[:, 0], increasing=True), scaled)
        through_fold = fires & (np.abs(free[0] - limit) <= _SAME_LIMIT * limit)
        beyond = np.linalg.solve(np.vander(nodes[:, 0], increasing=True), (scaled - limit) / nodes)
        return cls(np.vstack([limit, beyond]), through_fold)

    def rate(self, s: FloatArray, place: NDArray[np.intp]) -> FloatArray:
        scaled = np.zeros_like(s)
        for coefficient in self.coefficients[::-1]:
            scaled = scaled * s + coefficient[place]
        return s / scaled


def _simulated_rate(
    current: FloatArray, channels: Channels, membrane: Membrane, excess: FloatArray
) -> FloatArray:
    """Rates by integration alone, block by block; ``excess`` is the current above the fold (NaN without one)."""
    closeness = np.where(excess > 0.0, np.sqrt(np.maximum(excess, 0.0)) / _SLOW, 1.0)
    tolerance = TOLERANCE * np.clip(closeness, _CONTINUED / _SLOW, 1.0) ** 3
    rate = np.empty(current.size)
    for start in range(0, current.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        some = Channels(*(c[block] for c in channels))
        cells = Cells.of(membrane, some, current[block])
        rate[block] = steady_rate(cells, rest(some, membrane), tolerance[block])
    return rate


class Onset(NamedTuple):
    """Where and how firing begins; every array has the shape of the multipliers."""

    rheobase: FloatArray
    """Smallest current with sustained firing [µA/cm²]; infinite where there is none"""
    rate: FloatArray
    """Rate just above the rheobase [Hz]: 0 at a fold"""
    prefactor: FloatArray
    """Rate over the square root of the excess current at a fold [Hz/sqrt(µA/cm²)]; NaN at a jump"""


def rheobase(channels: Channels = PAPER_CHANNELS, membrane: Membrane = CONNOR_STEVENS) -> FloatArray:
    """Smallest current step from rest with sustained firing [µA/cm²]; see :func:`onset`."""
    return onset(channels, membrane).rheobase


def onset(channels: Channels = PAPER_CHANNELS, membrane: Membrane = CONNOR_STEVENS) -> Onset:
    """Rheobase, and the rate just above it.

    Where the membrane fires just above the first fold of its steady current, the rheobase is that fold, a scalar
    problem. Elsewhere it is bracketed by simulation, and the rate jumps there.

    Parameters
    ----------
    channels : Channels
        Multipliers of the conductances [-].
    membrane : Membrane
        Constants.

    Raises
    ------
    InputError
        If a multiplier is negative or not finite.
    """
    shape, multipliers = lanes(channels)
    distinct, lane = np.unique(np.array(multipliers), axis=1, return_inverse=True)
    lane = lane.ravel()
    folds = fold(Channels(*distinct), membrane)
    current, rate, prefactor = folds.current.copy(), np.zeros(folds.current.size), folds.prefactor.copy()
    for i in np.flatnonzero(~_fires_through(folds, Channels(*distinct), membrane)):
        current[i], rate[i] = _jump(distinct[:, i], folds.current[i], membrane)
        prefactor[i] = np.nan
    return Onset(*(x[lane].reshape(shape) for x in (current, rate, prefactor)))


def _fires_through(folds: Fold, channels: Channels, membrane: Membrane) -> NDArray[np.bool_]:
    """Whether firing begins arbitrarily slowly at the fold: the period there is that of the lingering alone."""
    through = np.isfinite(folds.prefactor)
    some = Channels(*(c[through] for c in channels))
    cells = Cells.of(membrane, some, folds.current[through] + _CONTINUED**2)
    rate = steady_rate(cells, rest(some, membrane), _CLASSIFYING_TOLERANCE) if len(cells) else np.zeros(0)
    through[through] = np.abs(rate / (_CONTINUED * folds.prefactor[through]) - 1.0) < 0.1
    return through


def _jump(channels: FloatArray, fold_current: float, membrane: Membrane) -> tuple[float, float]:
    """Current and rate at which firing begins abruptly, between the fold (0 without one) and the search limit."""

    def rates(currents: FloatArray) -> FloatArray:
        many = Channels(*(np.full(currents.size, c) for c in channels))
        return _simulated_rate(currents, many, membrane, currents - fold_current)

    start = fold_current if np.isfinite(fold_current) else 0.0
    currents = np.append(start, start + np.geomspace(0.25, SEARCH_LIMIT - start, _SECTIONS))
    rate = rates(currents)
    while True:
        if not (rate > 0.0).any():
            return np.inf, 0.0
        above = max(int((rate > 0.0).argmax()), 1)
        low, high, rate_above = currents[above - 1], currents[above], rate[above]
        if high - low <= _RESOLUTION:
            return float(high), float(rate_above)
        currents = np.append(np.linspace(low, high, _SECTIONS + 1)[1:-1], high)
        rate = np.append(rates(currents[:-1]), rate_above)
        currents, rate = np.append(low, currents), np.append(0.0, rate)
