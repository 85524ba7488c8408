"""Exact steady firing rates, the reference for all faster approximations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.touch.neuron.equilibrium import fold, rest
from softness_bayes.touch.neuron.limit_cycle import AGREEMENT, TOLERANCE, Budget, Orbit, steady_orbit
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane, lanes
from softness_bayes.touch.neuron.vector_field import Cells

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
