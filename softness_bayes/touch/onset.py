"""Where and how firing begins: the rheobase, and the rate just above it.

There are three ways, told apart by simulation:

- at a fold of equilibria that the periodic orbit passes through, arbitrarily slowly (:mod:`~.equilibrium`);
- at a fold of periodic orbits, at a finite rate (:mod:`~.cycle_fold`);
- elsewhere, where the trajectory that leaves rest stops falling into the basin of an equilibrium. There the period
  grows without bound too, but only as the logarithm of the distance to the rheobase.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.cells import Cells
from softness_bayes.touch.cycle_fold import CycleFold, cycle_fold, extrapolate
from softness_bayes.touch.equilibrium import Fold, fold, rest
from softness_bayes.touch.limit_cycle import Orbit, steady_orbit
from softness_bayes.touch.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane, lanes
from softness_bayes.touch.rate import CONTINUED, simulated
from softness_bayes.touch.rosenbrock import travel

FloatArray = NDArray[np.float64]

SEARCH_LIMIT = 250.0
"""Current [µA/cm²] beyond which no onset of firing is looked for: every membrane is blocked there."""

_CLASSIFYING_TOLERANCE = 1e-7  # local error where only the kind of onset is asked for
_SECTIONS = 24  # currents tried side by side while a jump is bracketed
_RUNGS = 2  # currents tried side by side, upwards, until one fires
_RESOLUTION = 1e-6  # µA/cm², width of the final bracket around a jump
_FAMILY = 5  # stable orbits from which a fold of orbits is extrapolated
_TRAVEL_TOLERANCE = 1e-9
_FAMILY_REACH = 0.6  # µA/cm², width of the bracket from which that is tried
_JUST_ABOVE = 3e-3  # µA/cm² above a fold of orbits at which firing is confirmed
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
        rate = _orbits(currents, channels, membrane, fold_current).rate
        below, fires = np.append(low, currents), rate > 0.0
        if not fires.any():
            low = float(currents[-1])
            continue
        first = int(fires.argmax())
        low, high, rate_above = float(below[first]), float(currents[first]), float(rate[first])
        if not tried and high - low < _FAMILY_REACH:
            tried, born = True, birth(channels, membrane, low, high)
            if np.isfinite(born.current[0]):
                return float(born.current[0]), float(1000.0 / born.period[0]), True
    return high, rate_above, False


def _orbits(currents: FloatArray, channels: FloatArray, membrane: Membrane, fold_current: float) -> Orbit:
    many = Channels(*(np.full(currents.size, c) for c in channels))
    return simulated(currents, many, membrane, currents - fold_current)


def birth(channels: FloatArray, membrane: Membrane, low: float, high: float) -> CycleFold:
    """Fold of periodic orbits at which the membrane at rest begins to fire.

    Parameters
    ----------
    channels : ndarray, shape (4,)
        Multipliers.
    membrane : Membrane
        Constants.
    low, high : float
        Currents between which firing begins [µA/cm²].

    Returns
    -------
    CycleFold
        With n = 1; NaN if there is no such fold between ``low`` and ``high``, or the membrane at rest misses it.
    """
    currents = high + _FAMILY_REACH * np.linspace(0.0, 1.3, _FAMILY) ** 2
    orbit = _orbits(currents, channels, membrane, np.nan)
    one = Channels(*(channels[:, None]))
    unknown = np.full(1, np.nan)
    nothing = CycleFold(unknown, unknown, unknown, orbit.spike_state[:, :1])
    if not (orbit.rate > 0.0).all():
        return nothing
    period = 1000.0 / orbit.rate
    many = Channels(*(np.full(currents.size, c) for c in channels))
    halfway = travel(Cells.of(membrane, many, currents), orbit.spike_state, 0.5 * period, _TRAVEL_TOLERANCE)
    found = cycle_fold(one, membrane, extrapolate(currents, period, halfway))
    if not low < found.current[0] <= high:
        return nothing
    cells = Cells.of(membrane, one, found.current + _JUST_ABOVE)
    confirmed = steady_orbit(cells, rest(one, membrane), _CLASSIFYING_TOLERANCE, _PASSING).rate[0] > 0.0
    return found if confirmed else nothing
