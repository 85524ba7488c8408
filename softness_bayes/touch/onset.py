"""Where and how firing begins: the rheobase, and the rate just above it.

There are three ways, told apart by simulation:

- at a fold of equilibria that the periodic orbit passes through, arbitrarily slowly (:mod:`~.equilibrium`);
- at a fold of periodic orbits, at a finite rate: the stable orbit meets an unstable one and both vanish. Orbits near
  there attract ever more weakly, so the fold is extrapolated from stable orbits a little above it;
- elsewhere, where the trajectory that leaves rest stops falling into the basin of an equilibrium. There the period
  grows without bound too, but only as the logarithm of the distance to the rheobase.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
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
_SECTIONS = 24  # currents tried side by side while a jump is bracketed, shared by the cells of a batch
_RUNGS = 25  # currents tried upwards until one fires
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
    jumps = np.flatnonzero(~smooth)
    if jumps.size:
        begin.rheobase[jumps], begin.rate[jumps], begin.born[jumps] = _jumps(
            distinct[:, jumps], folds.current[jumps], membrane
        )
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


class _Bracket(NamedTuple):
    """Currents between which firing begins [µA/cm²] and the rate at the upper one [Hz], of shape (n,)."""

    low: FloatArray
    high: FloatArray
    rate: FloatArray


def _jumps(
    channels: FloatArray, fold_current: FloatArray, membrane: Membrane
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Where firing begins abruptly, the rate there, and whether orbits fold; for multipliers of shape (4, n)."""

    def passing(current: FloatArray, lane: NDArray[np.intp]) -> FloatArray:
        """Rates, roughly, without waiting for the last of the many spikes that pass by a fold of orbits."""
        some = Channels(*channels[:, lane])
        cells = Cells.of(membrane, some, current)
        return steady_orbit(cells, rest(some, membrane), _CLASSIFYING_TOLERANCE, _PASSING).rate

    def exact(current: FloatArray, lane: NDArray[np.intp]) -> FloatArray:
        return simulated(current, Channels(*channels[:, lane]), membrane, current - fold_current[lane]).rate

    start = np.where(np.isfinite(fold_current), fold_current, 0.0)
    bracket = _climb(passing, start)
    found = np.isfinite(bracket.high)
    # beside a fold of equilibria, orbits do not fold: firing begins where rest is left for the orbit's basin
    folding = np.flatnonzero(found & ~np.isfinite(fold_current))
    _narrow(passing, bracket, folding, _FAMILY_BRACKET)
    current, rate = _births(exact, bracket, folding)
    born = np.zeros(found.size, dtype=bool)
    born[folding] = np.isfinite(current)
    _narrow(exact, bracket, np.flatnonzero(found & ~born), _RESOLUTION)
    bracket.high[folding], bracket.rate[folding] = (
        np.where(np.isfinite(current), new, old[folding])
        for new, old in ((current, bracket.high), (rate, bracket.rate))
    )
    return bracket.high, bracket.rate, born


_Rates = Callable[[FloatArray, NDArray[np.intp]], FloatArray]


def _climb(rates: _Rates, start: FloatArray) -> _Bracket:
    """The first of rising currents that fires, and the one before it; infinite where none does."""
    low, high, rate = start.copy(), np.full(start.size, np.inf), np.zeros(start.size)
    for share in np.geomspace(2.0 / SEARCH_LIMIT, 1.0, _RUNGS):
        lane = np.flatnonzero(np.isinf(high))
        if not lane.size:
            break
        current = start[lane] + share * (SEARCH_LIMIT - start[lane])
        found = rates(current, lane)
        fires = found > 0.0
        low[lane] = np.where(fires, low[lane], current)
        high[lane], rate[lane] = np.where(fires, current, np.inf), found
    return _Bracket(low, high, rate)


def _narrow(rates: _Rates, bracket: _Bracket, lane: NDArray[np.intp], width: float) -> None:
    """Narrow the brackets at ``lane`` in place, several currents side by side."""
    sections = max(1, _SECTIONS // max(lane.size, 1))
    share = np.arange(1, sections + 1) / (sections + 1)
    while (lane := lane[bracket.high[lane] - bracket.low[lane] > width]).size:
        low, high, top = (x[lane] for x in bracket)
        current = low[:, None] + share * (high - low)[:, None]
        rate = rates(current.ravel(), np.repeat(lane, sections)).reshape(current.shape)
        place = np.arange(lane.size)
        currents = np.column_stack([low, current, high])
        found = np.column_stack([np.zeros(lane.size), rate, top])
        first = (found > 0.0).argmax(axis=1)
        bracket.low[lane], bracket.high[lane] = currents[place, first - 1], currents[place, first]
        bracket.rate[lane] = found[place, first]


def _births(rates: _Rates, bracket: _Bracket, lane: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Current and rate at the folds of periodic orbits near which firing begins; NaN where there is none.

    Along the family of orbits the current is a smooth function of the period, and smallest at the fold.
    """
    low, high = bracket.low[lane], bracket.high[lane]
    currents = high[:, None] + _FAMILY_REACH * np.linspace(0.1, 1.0, _FAMILY) ** 2
    rate = rates(currents.ravel(), np.repeat(lane, _FAMILY)).reshape(currents.shape)
    birth = np.full((2, lane.size), np.nan)
    for i in np.flatnonzero((rate > 0.0).all(axis=1)):
        period = 1000.0 / rate[i]
        family = Polynomial.fit(period, currents[i], _FAMILY - 1)
        turns = family.deriv().roots()
        turns = turns.real[(np.abs(turns.imag) < 1e-9) & (turns.real > period[0])]
        if turns.size and turns.min() < 2.0 * period[0] - period[-1]:
            birth[:, i] = family(turns.min()), 1000.0 / turns.min()
    # periods that pass by slowly are taken for firing a little below the fold
    slack = 0.1 * _FAMILY_BRACKET
    birth[:, ~((birth[0] > low - slack) & (birth[0] <= high + slack))] = np.nan
    return birth[0], birth[1]
