"""Exact steady firing rates, the reference for all faster approximations, and the onset of firing.

Firing starts in one of three ways, which are distinguished by simulation:

- at a fold of equilibria on the periodic orbit, at arbitrarily low rates (:mod:`~.cells`);
- at a fold of periodic orbits, at a finite rate: the stable orbit meets an unstable one and both vanish. Orbits near
  the fold attract only weakly, and below it trajectories pass the vanished orbit so slowly that they look periodic. The
  fold is therefore extrapolated twice from stable orbits well above it, the second time from closer ones. If the two
  disagree because the orbits turn too sharply, the rheobase is found by simulation to 1e-3 µA/cm²;
- elsewhere, where the trajectory from rest no longer enters the basin of an equilibrium. There the period
  also diverges, but only as the logarithm of the distance to the rheobase.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from softness_bayes.touch.neuron.cells import Cells, Fold, fold, rest
from softness_bayes.touch.neuron.limit_cycle import AGREEMENT, TOLERANCE, Budget, Orbit, steady_orbit
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane, lanes

FloatArray = NDArray[np.float64]

_BLOCK = 2048  # cells integrated simultaneously
_SLOW = 0.06  # sqrt(µA/cm²): closer to the fold, the tolerance decreases because errors accumulate over the long period
CONTINUED = 0.02  # sqrt(µA/cm²): closer to the fold the rate is continued analytically
_CONTINUATION_NODES = CONTINUED * np.array([1.0, 1.5, 2.0, 2.5])
_SAME_LIMIT = 1e-3  # relative difference to the analytic limit below which the orbit passes through the fold


def firing_rate(
    current: ArrayLike,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    tolerance: float = TOLERANCE,
    budget: Budget | None = None,
) -> FloatArray:
    """Return the steady firing rate after a current step applied to the membrane at rest.

    The membrane starts from its equilibrium without a current, and the rate is the inverse period of the orbit that it
    reaches: 0 if it settles on an equilibrium (below the rheobase, and in depolarisation block far above it). Within
    4e-4 µA/cm² above a fold the period exceeds seconds and is not integrated. There ``sqrt(I - I_fold) / rate``, which
    is smooth in ``sqrt(I - I_fold)``, is interpolated between its analytic limit and exact values.

    Parameters
    ----------
    current : array_like
        Injected currents [µA/cm²], broadcast with the multipliers.
    channels : Channels
        Multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    tolerance : float
        Largest local error of a step. With 5e-8 rates take half the time, and differ by up to 1e-6 (relative), or 4e-6
        within 0.01 µA/cm² of the rheobase.
    budget : Budget, optional
        Limit on the number of steps, as for :func:`~.limit_cycle.steady_orbit`.

    Returns
    -------
    ndarray
        Rates [Hz], relative error below 1e-6, of the broadcast shape.

    Raises
    ------
    InputError
        If a current or multiplier is not finite, or a multiplier negative.
    NumericalError
        If a membrane neither settles nor becomes periodic, or the budget is spent.
    """
    shape, (*multipliers, flat) = lanes(channels, current=current)
    distinct, lane = np.unique(np.array(multipliers), axis=1, return_inverse=True)
    lane = lane.ravel()
    folds = fold(Channels(*distinct), membrane)
    excess = flat - folds.current[lane]
    slow = (excess > 0.0) & (excess < CONTINUED**2)
    near, place = np.unique(lane[slow], return_inverse=True)
    above = _CONTINUATION_NODES[:, None] ** 2

    def exact(cells: NDArray[np.bool_], more: FloatArray) -> FloatArray:
        """Exact rates of some cells, then of the cells at ``near`` with currents ``more`` above their folds."""
        many = np.hstack([np.array(multipliers)[:, cells], np.tile(distinct[:, near], len(more))])
        currents = np.append(flat[cells], folds.current[near] + more)
        beyond = np.append(excess[cells], np.repeat(more, near.size))
        return simulated(currents, Channels(*many), membrane, beyond, tolerance, budget).rate

    # all at once, because together they take only as many steps as the slowest
    found = exact(~slow, above)
    rate = np.zeros(flat.size)
    rate[~slow], nodes = np.split(found, [found.size - len(above) * near.size])
    if near.size:
        continued = _Continuation.of(folds.prefactor[near], nodes.reshape(len(above), near.size))
        rate[slow] = continued.rate(np.sqrt(excess[slow]), place)
        slow[slow] = ~continued.through_fold[place]
        if slow.any():
            rate[slow] = exact(slow, above[:0])
    return rate.reshape(shape)


class _Continuation(NamedTuple):
    """Period times distance from the fold, ``T s`` with ``s = sqrt(I - I_fold)``, as a polynomial in s."""

    coefficients: FloatArray
    through_fold: NDArray[np.bool_]

    @classmethod
    def of(cls, prefactor: FloatArray, rate: FloatArray) -> _Continuation:
        """Return the continuation from exact rates at the nodes, shape (nodes, n)."""
        nodes = _CONTINUATION_NODES[:, None]
        fires = (rate > 0.0).all(axis=0)
        scaled = nodes / np.where(rate > 0.0, rate, 1.0)
        limit = 1.0 / prefactor
        free = np.linalg.solve(np.vander(nodes[:, 0], increasing=True), scaled)
        through_fold = fires & (np.abs(free[0] - limit) <= _SAME_LIMIT * limit)
        beyond = np.linalg.solve(np.vander(nodes[:, 0], increasing=True), (scaled - limit) / nodes)
        return cls(np.vstack([limit, beyond]), through_fold)

    def rate(self, s: FloatArray, place: NDArray[np.intp]) -> FloatArray:
        scaled = np.zeros_like(s)
        for coefficient in self.coefficients[::-1]:
            scaled = scaled * s + coefficient[place]
        return s / scaled


def simulated(
    current: FloatArray,
    channels: Channels,
    membrane: Membrane,
    excess: FloatArray,
    tolerance: float = TOLERANCE,
    budget: Budget | None = None,
) -> Orbit:
    """Integrate cells from rest and return the orbits reached; ``excess`` is the current above a fold, or NaN."""
    closeness = np.where(excess > 0.0, np.sqrt(np.maximum(excess, 0.0)) / _SLOW, 1.0)
    local, agreement = tolerance * np.clip(closeness, CONTINUED / _SLOW, 1.0) ** 3, tolerance * (AGREEMENT / TOLERANCE)
    state = rest(channels, membrane)
    orbit = Orbit(np.empty(current.size), np.empty_like(state))
    for start in range(0, current.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        cells = Cells.of(membrane, Channels(*(c[block] for c in channels)), current[block])
        found = steady_orbit(cells, state[:, block], local[block], agreement, budget)
        orbit.rate[block], orbit.spike_state[:, block] = found
    return orbit


SEARCH_LIMIT = 250.0
"""Largest current [µA/cm²] in the search for the onset; all membranes are in depolarisation block beyond it."""

_CLASSIFYING_TOLERANCE = 1e-7  # local error if only the type of onset is needed
_SECTIONS = 24  # currents tried simultaneously while a jump is bracketed, shared by the cells of a batch
_RUNGS = 25  # increasing currents tried until one fires
_RESOLUTION = 1e-6  # µA/cm², width of the final bracket around a jump
_SLOW_RESOLUTION = 1e-3  # µA/cm², without a fold of equilibria: the time taken grows like 1/sqrt(width)
_FAMILY_BRACKET = 0.02  # µA/cm², width of the bracket from which a fold of orbits is extrapolated
_FAMILY = 0.1 + 0.7 * np.sin(0.5 * np.pi * (np.arange(12) + 0.5) / 12.0) ** 2  # sqrt(µA/cm²), orbits above the bracket
_DEGREE_FROM_AFAR = 9  # of the current as a polynomial in the rate; higher degrees only fit errors
_SAME_FOLD = 2e-3  # µA/cm², agreement of the two extrapolations
_JUST_ABOVE = 5e-4  # µA/cm² above the fold, where a trajectory from rest must reach the orbit
_LOOKS_PERIODIC = 5e-3  # µA/cm² below the fold within which a slow passage looks like firing
_EXPECTED_WITHIN = 0.49 * _FAMILY_BRACKET  # µA/cm² around an expected rheobase that are searched first
_PASSING = 1e-5  # agreement of periods if only the type of onset is needed


class Onset(NamedTuple):
    """The onset of firing; every array has the shape of the multipliers."""

    rheobase: FloatArray
    """Smallest current with sustained firing [µA/cm²]; infinite if there is none"""
    rate: FloatArray
    """Rate just above the rheobase [Hz]: 0 at a fold of equilibria"""
    prefactor: FloatArray
    """Rate divided by the square root of the excess current at a fold of equilibria [Hz/sqrt(µA/cm²)]; NaN at a jump"""
    born: NDArray[np.bool_]
    """True where firing starts at a fold of periodic orbits; the rate is then smooth in that square root"""


def rheobase(channels: Channels = PAPER_CHANNELS, membrane: Membrane = CONNOR_STEVENS) -> FloatArray:
    """Return the smallest current step from rest with sustained firing [µA/cm²]; see :func:`onset`."""
    return onset(channels, membrane).rheobase


def onset(
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    expected: ArrayLike | None = None,
    budget: Budget | None = None,
) -> Onset:
    """Return the rheobase, and the rate just above it.

    Parameters
    ----------
    channels : Channels
        Multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    expected : array_like, optional
        Expected rheobases [µA/cm²], of the multipliers' shape. A jump is first searched around them, which is several
        times faster. The result is still decided by simulation.
    budget : Budget, optional
        Limit on the number of steps, as for :func:`~.limit_cycle.steady_orbit`.

    Raises
    ------
    InputError
        If a multiplier is negative or not finite.
    NumericalError
        If a membrane neither settles nor becomes periodic, or the budget is spent.
    """
    shape, multipliers = lanes(channels)
    distinct, first, lane = np.unique(np.array(multipliers), axis=1, return_index=True, return_inverse=True)
    guess = np.full(shape, np.nan) if expected is None else np.broadcast_to(np.asarray(expected, float), shape)
    folds = fold(Channels(*distinct), membrane)
    smooth = fires_through(folds, Channels(*distinct), membrane, budget)
    begin = Onset(
        rheobase=folds.current.copy(),
        rate=np.zeros(smooth.size),
        prefactor=np.where(smooth, folds.prefactor, np.nan),
        born=np.zeros(smooth.size, dtype=bool),
    )
    jumps = np.flatnonzero(~smooth)
    if jumps.size:
        begin.rheobase[jumps], begin.rate[jumps], begin.born[jumps] = _jumps(
            distinct[:, jumps], folds.current[jumps], membrane, guess.reshape(-1)[first[jumps]], budget
        )
    place = lane.reshape(shape)
    return Onset(begin.rheobase[place], begin.rate[place], begin.prefactor[place], begin.born[place])


def fires_through(
    folds: Fold, channels: Channels, membrane: Membrane, budget: Budget | None = None
) -> NDArray[np.bool_]:
    """Return whether firing starts at arbitrarily low rates at each fold, shape (n,).

    In this case, the period just above the fold is the time that the membrane spends near the vanished equilibrium.
    """
    through = np.isfinite(folds.prefactor)
    some = Channels(*(c[through] for c in channels))
    cells = Cells.of(membrane, some, folds.current[through] + CONTINUED**2)
    rate = steady_orbit(cells, rest(some, membrane), _CLASSIFYING_TOLERANCE, _PASSING, budget).rate
    through[through] = np.abs(rate / (CONTINUED * folds.prefactor[through]) - 1.0) < 0.1
    return through


class _Bracket(NamedTuple):
    """Currents that bracket the onset of firing [µA/cm²] and the rate at the upper one [Hz], of shape (n,)."""

    low: FloatArray
    high: FloatArray
    rate: FloatArray


def _jumps(
    channels: FloatArray, fold_current: FloatArray, membrane: Membrane, expected: FloatArray, budget: Budget | None
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return the currents at which firing starts abruptly, the rates there, and whether it is a fold of orbits.

    Multipliers have the shape (4, n).
    """

    def passing(current: FloatArray, lane: NDArray[np.intp]) -> FloatArray:
        """Return approximate rates without integrating the many spikes near a fold of orbits."""
        some = Channels(*channels[:, lane])
        cells = Cells.of(membrane, some, current)
        return steady_orbit(cells, rest(some, membrane), _CLASSIFYING_TOLERANCE, _PASSING, budget).rate

    def exact(current: FloatArray, lane: NDArray[np.intp]) -> FloatArray:
        excess = current - fold_current[lane]
        return simulated(current, Channels(*channels[:, lane]), membrane, excess, budget=budget).rate

    start = np.where(np.isfinite(fold_current), fold_current, 0.0)
    bracket = _climb(passing, start, expected)
    found = np.isfinite(bracket.high)
    # next to a fold of equilibria, orbits do not fold: firing starts where rest enters the basin of the orbit
    folding = np.flatnonzero(found & ~np.isfinite(fold_current))
    _narrow(passing, bracket, folding, _FAMILY_BRACKET)
    current, rate = _births(exact, passing, bracket, folding)
    born = np.zeros(found.size, dtype=bool)
    born[folding] = np.isfinite(current)
    slow = folding[~born[folding]]  # a slow passage may have been mistaken for firing here
    bracket.high[slow] += _LOOKS_PERIODIC
    _narrow(exact, bracket, slow, _SLOW_RESOLUTION)
    _narrow(exact, bracket, np.flatnonzero(found & np.isfinite(fold_current)), _RESOLUTION)
    bracket.high[folding], bracket.rate[folding] = (
        np.where(np.isfinite(current), new, old[folding])
        for new, old in ((current, bracket.high), (rate, bracket.rate))
    )
    return bracket.high, bracket.rate, born


_Rates = Callable[[FloatArray, NDArray[np.intp]], FloatArray]


def _climb(rates: _Rates, start: FloatArray, expected: FloatArray) -> _Bracket:
    """Return the first of increasing currents with firing, and the one before it; infinite if there is none."""
    low, high, rate = start.copy(), np.full(start.size, np.inf), np.zeros(start.size)
    lane = np.flatnonzero(expected - _EXPECTED_WITHIN > start)
    if lane.size:
        below, above = expected[lane] - _EXPECTED_WITHIN, expected[lane] + _EXPECTED_WITHIN
        silent, found = np.split(rates(np.append(below, above), np.append(lane, lane)), 2)
        begins = (silent == 0.0) & (found > 0.0)
        low[lane[begins]], high[lane[begins]], rate[lane[begins]] = below[begins], above[begins], found[begins]
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
    """Narrow the brackets at ``lane`` in place, with several currents at once."""
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


def _births(rates: _Rates, passing: _Rates, bracket: _Bracket, lane: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Return current and rate at the folds of periodic orbits where firing starts; NaN if it does not start there."""
    low, high = bracket.low[lane], bracket.high[lane]
    first, _ = _turn(rates, high, lane, _DEGREE_FROM_AFAR)
    margin = _LOOKS_PERIODIC + _SAME_FOLD
    with np.errstate(invalid="ignore"):
        # an extrapolated fold this far from the bracket is an artefact and is not refined
        first = np.where((first > low - margin) & (first <= high + margin), first, np.nan)
        birth, rate = _turn(rates, first, lane, _FAMILY.size - 1)
        inside = (birth > low - _LOOKS_PERIODIC) & (birth <= high + _LOOKS_PERIODIC)
        found = np.flatnonzero(inside & (np.abs(birth - first) <= _SAME_FOLD))
    # firing starts at the fold only if a trajectory from rest reaches the orbit
    found = found[passing(birth[found] + _JUST_ABOVE, lane[found]) > 0.0]
    missing = np.setdiff1d(np.arange(lane.size), found)
    birth[missing], rate[missing] = np.nan, np.nan
    return birth, rate


def _turn(rates: _Rates, base: FloatArray, lane: NDArray[np.intp], degree: int) -> tuple[FloatArray, FloatArray]:
    """Return current and rate at which the family of orbits above ``base`` folds back; NaN if no fold is found.

    Along the family the current is a smooth function of the rate, and smallest at the fold.
    """
    turn = np.full((2, lane.size), np.nan)
    known = np.flatnonzero(np.isfinite(base))
    currents = base[known, None] + _FAMILY**2
    rate = rates(currents.ravel(), np.repeat(lane[known], _FAMILY.size)).reshape(currents.shape)
    for i in np.flatnonzero((rate > 0.0).all(axis=1)):
        family = Polynomial.fit(rate[i], currents[i], degree)
        ends = family.deriv().roots()
        ends = ends.real[(np.abs(ends.imag) < 1e-9 * rate[i, 0]) & (ends.real < rate[i, 0])]
        if ends.size:
            turn[:, known[i]] = family(ends.max()), ends.max()
    return turn[0], turn[1]
