"""Where and how firing begins: the rheobase, and the rate just above it.

There are three ways, told apart by simulation:

- at a fold of equilibria that the periodic orbit passes through, arbitrarily slowly (:mod:`~.equilibrium`);
- at a fold of periodic orbits, at a finite rate: the stable orbit meets an unstable one and both vanish. Orbits near
  there attract ever more weakly, so the fold is extrapolated from stable orbits a little above it;
- elsewhere, where the trajectory that leaves rest stops falling into the basin of an equilibrium. There the period
  grows without bound too, but only as the logarithm of the distance to the rheobase.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from softness_bayes.touch.cells import Cells
from softness_bayes.touch.equilibrium import Fold, fold, rest
from softness_bayes.touch.limit_cycle import steady_orbit
from softness_bayes.touch.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane, lanes
from softness_bayes.touch.rate import CONTINUED, simulated

FloatArray = NDArray[np.float64]

SEARCH_LIMIT = 250.0
"""Current [µA/cm²] beyond which no onset of firing is looked for: every membrane is blocked there."""

_CLASSIFYING_TOLERANCE = 1e-7  # local error where only the kind of onset is asked for
_SECTIONS = 24  # currents tried side by side while a jump is bracketed
_RUNGS = 2  # currents tried side by side, upwards, until one fires
_RESOLUTION = 1e-6  # µA/cm², width of the final bracket around a jump
_FAMILY = 5  # stable orbits from which a fold of orbits is extrapolated
_FAMILY_BRACKET = 5e-3  # µA/cm², width of the bracket from which that is tried
_FAMILY_REACH = 0.04  # µA/cm² above the bracket over which the orbits are spread
_PASSING = 1e-5  # agreement of periods where only the kind of onset is asked for


class Onset(NamedTuple):
    """Where and how firing begins; every array has the shape of the multipliers."""

    rheobase: FloatArray
    """Smallest current with sustained firing [µA/cm²]; infinite where there is none"""
    rate: FloatArray
    """Rate just above the rheobase [Hz]: 0 at a fold of equilibria"""
    prefactor: FloatArray
    """Rate over the root of the excess current at a fold of equilibria [Hz/sqrt(µA/cm²)]; NaN at a jump"""
    born: NDArray[np.bool_]
    """Whether firing begins at a fold of periodic orbits, where the rate is smooth in that root"""


def rheobase(channels: Channels = PAPER_CHANNELS, membrane: Membrane = CONNOR_STEVENS) -> FloatArray:
    """Smallest current step from rest with sustained firing [µA/cm²]; see :func:`onset`."""
    return onset(channels, membrane).rheobase


def onset(channels: Channels = PAPER_CHANNELS, membrane: Membrane = CONNOR_STEVENS) -> Onset:
    """Rheobase, and the rate just above it.

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
    folds = fold(Channels(*distinct), membrane)
    smooth = fires_through(folds, Channels(*distinct), membrane)
    begin = Onset(
        rheobase=folds.current.copy(),
        rate=np.zeros(smooth.size),
        prefactor=np.where(smooth, folds.prefactor, np.nan),
        born=np.zeros(smooth.size, dtype=bool),
    )
    for i in np.flatnonzero(~smooth):
        begin.rheobase[i], begin.rate[i], begin.born[i] = _jump(distinct[:, i], folds.current[i], membrane)
    place = lane.reshape(shape)
    return Onset(begin.rheobase[place], begin.rate[place], begin.prefactor[place], begin.born[place])


def fires_through(folds: Fold, channels: Channels, membrane: Membrane) -> NDArray[np.bool_]:
    """Whether firing begins arbitrarily slowly at each fold, shape (n,): the period just above is the lingering's."""
    through = np.isfinite(folds.prefactor)
    some = Channels(*(c[through] for c in channels))
    cells = Cells.of(membrane, some, folds.current[through] + CONTINUED**2)
    rate = steady_orbit(cells, rest(some, membrane), _CLASSIFYING_TOLERANCE, _PASSING).rate
    through[through] = np.abs(rate / (CONTINUED * folds.prefactor[through]) - 1.0) < 0.1
    return through


def _jump(channels: FloatArray, fold_current: float, membrane: Membrane) -> tuple[float, float, bool]:
    """Where firing begins abruptly between the fold (0 without one) and the limit, the rate, whether orbits fold."""
    low, high, rate_above = fold_current if np.isfinite(fold_current) else 0.0, np.inf, 0.0
    ladder = low + np.geomspace(2.0, SEARCH_LIMIT - low, _SECTIONS)
    tried = np.isfinite(fold_current)
    while high - low > _RESOLUTION:
        if np.isfinite(high):
            currents = np.linspace(low, high, _SECTIONS + 2)[1:-1]
        else:
            currents, ladder = np.split(ladder, [_RUNGS])
        if not currents.size:
            return np.inf, 0.0, False
        # a bracket that a fold of orbits may lie in needs no more than that periods all but stand still
        rate = _rates(currents, channels, membrane, fold_current) if tried else _passing(currents, channels, membrane)
        below, fires = np.append(low, currents), rate > 0.0
        if not fires.any():
            low = float(currents[-1])
            continue
        first = int(fires.argmax())
        low, high, rate_above = float(below[first]), float(currents[first]), float(rate[first])
        if not tried and high - low < _FAMILY_BRACKET:
            tried, (current, rate_at_birth) = True, _birth(channels, membrane, low, high)
            if np.isfinite(current):
                return current, rate_at_birth, True
    return high, rate_above, False


def _rates(currents: FloatArray, channels: FloatArray, membrane: Membrane, fold_current: float) -> FloatArray:
    many = Channels(*(np.full(currents.size, c) for c in channels))
    return simulated(currents, many, membrane, currents - fold_current).rate


def _passing(currents: FloatArray, channels: FloatArray, membrane: Membrane) -> FloatArray:
    """As `_rates`, roughly, and without waiting for the last of the many spikes that pass by a fold of orbits."""
    many = Channels(*(np.full(currents.size, c) for c in channels))
    cells = Cells.of(membrane, many, currents)
    return steady_orbit(cells, rest(many, membrane), _CLASSIFYING_TOLERANCE, _PASSING).rate


def _birth(channels: FloatArray, membrane: Membrane, low: float, high: float) -> tuple[float, float]:
    """Current and rate at the fold of periodic orbits near which firing begins between two currents; NaN without one.

    Along the family of orbits the current is a smooth function of the period, and smallest at the fold.
    """
    currents = high + _FAMILY_REACH * np.linspace(0.1, 1.0, _FAMILY) ** 2
    rate = _rates(currents, channels, membrane, np.nan)
    if not (rate > 0.0).all():
        return np.nan, np.nan
    period = 1000.0 / rate
    scale = period[0] - period[-1]
    x = (period - period[0]) / scale
    family = np.linalg.solve(np.vander(x, increasing=True), currents)
    turns = polynomial.polyroots(polynomial.polyder(family))
    turns = turns.real[(np.abs(turns.imag) < 1e-9) & (turns.real > 0.0) & (turns.real < 1.0)]
    if not turns.size:
        return np.nan, np.nan
    current = float(polynomial.polyval(turns.min(), family))
    # periods that pass by slowly are taken for firing some 1e-4 µA/cm² below the fold
    if not low - 0.1 * _FAMILY_BRACKET < current <= high + 0.1 * _FAMILY_BRACKET:
        return np.nan, np.nan
    return current, float(1000.0 / (period[0] + turns.min() * scale))
