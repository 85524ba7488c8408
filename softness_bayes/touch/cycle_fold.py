"""Where periodic firing is born at a finite rate: the fold of the family of periodic orbits.

Along the family of orbits the current is a smooth function of the period. Its minimum is the fold at which the stable
orbit meets an unstable one and both vanish: no periodic firing exists at a smaller current. Orbits near it attract so
weakly that simulation would take hundreds of spikes; here they are solved for. An orbit of period T through a given
voltage solves ``flow_T(x; I) = x`` for its gates there and its current, and the same Jacobian gives ``dI/dT``, whose
zero is the fold. The voltage is one of the slow recovery between spikes, where Newton's method reaches far.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from softness_bayes.touch.cells import Cells
from softness_bayes.touch.membrane import Channels, Membrane
from softness_bayes.touch.rosenbrock import travel

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-10  # local error of the flow
_DIFFERENCE = 1e-4  # of the gates and the current [µA/cm²] in the Jacobian of the flow
_MAX_STRETCH = 0.5  # ms by which the period may change in one iteration
_ITERATIONS = 25
_APART = 3e-3  # ms between two periods from which dI/dT is differentiated
_ON_ORBIT = 1e-3  # correction below which dI/dT is that of an orbit
_CONVERGED = 1e-7  # largest change of gates and current in the last iteration
_FLAT = 1e-5  # largest dI/dT at the fold [µA/(cm² ms)]; the error of the current is of second order in it
_LOST = 5.0  # correction that only a wrong orbit needs


class CycleFold(NamedTuple):
    """Fold of periodic orbits; arrays of shape (n,), NaN where none was found."""

    current: FloatArray
    """[µA/cm²]"""
    period: FloatArray
    """Period of the orbit that is born there [ms]"""
    curvature: FloatArray
    """Second derivative of the current by the period [µA/(cm² ms²)]"""
    state: FloatArray
    """State of that orbit half a period after a spike, shape (1 + gates, n)"""


def extrapolate(current: FloatArray, period: FloatArray, state: FloatArray) -> CycleFold:
    """First guess of one fold, from exact stable orbits at rising currents above it.

    Parameters
    ----------
    current, period : ndarray, shape (k,)
        Currents [µA/cm²] and periods [ms], the longest period first; current and state are polynomials in the period.
    state : ndarray, shape (1 + gates, k)
        States half a period after a spike.

    Returns
    -------
    CycleFold
        With n = 1; NaN where the current has no minimum within reach.
    """
    scale = period[0] - period[-1]
    x = (period - period[0]) / scale
    family = np.linalg.solve(np.vander(x, increasing=True), np.vstack([current, state]).T)
    slope = polynomial.polyder(family[:, 0])
    turns = polynomial.polyroots(slope)
    turns = turns.real[(np.abs(turns.imag) < 1e-9) & (turns.real > 0.0) & (turns.real < 1.0)]
    place = turns.min() if turns.size else np.nan
    at_fold = polynomial.polyval(place, family)
    curvature = polynomial.polyval(place, polynomial.polyder(slope)) / scale**2
    return CycleFold(at_fold[:1], period[:1] + place * scale, np.atleast_1d(curvature), at_fold[1:, None])


def cycle_fold(channels: Channels, membrane: Membrane, guess: CycleFold) -> CycleFold:
    """Solve for folds of periodic orbits.

    Parameters
    ----------
    channels : Channels
        Multipliers, each of shape (n,).
    membrane : Membrane
        Constants.
    guess : CycleFold
        First guesses, good to some tenths of a millisecond.
    """
    current, period, curvature, state = (np.array(x) for x in guess)
    found = CycleFold(*(np.full_like(x, np.nan) for x in guess))
    last = np.full((2, current.size), np.nan)
    active = np.flatnonzero(np.isfinite(current))
    for _ in range(_ITERATIONS):
        if not active.size:
            break
        some = Channels(*(c[active] for c in channels))
        correction, tangent = _linear_response(some, membrane, current[active], period[active], state[:, active])
        size, slope = np.abs(correction).max(axis=0), tangent[-1]
        current[active] += correction[-1]
        state[1:, active] += correction[:-1]
        done = (size <= _CONVERGED) & (np.abs(slope) <= _FLAT)
        for whole, part in zip(found, (current, period, curvature, state), strict=True):
            whole[..., active[done]] = part[..., active[done]]

        on_orbit = size < _ON_ORBIT
        moved = period[active] - last[0, active]
        apart = np.abs(moved) > _APART
        bend = (slope - last[1, active]) / np.where(apart, moved, 1.0)
        curvature[active] = np.where(on_orbit & apart & (bend > 0.0), bend, curvature[active])
        last[:, active] = np.where(on_orbit, [period[active], slope], last[:, active])
        stretch = np.where(on_orbit, np.clip(-slope / curvature[active], -_MAX_STRETCH, _MAX_STRETCH), 0.0)
        period[active] += stretch
        current[active] += (slope + 0.5 * curvature[active] * stretch) * stretch
        state[1:, active] += tangent[:-1] * stretch
        active = active[~done & (size < _LOST)]
    return found


def _linear_response(
    channels: Channels, membrane: Membrane, current: FloatArray, period: FloatArray, state: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Newton correction of (gates, current) at fixed period, and their derivative by the period, (gates + 1, n)."""
    rows, n = state.shape
    starts = np.repeat(state[:, None, :], rows + 1, axis=1)
    currents = np.repeat(current[None], rows + 1, axis=0)
    for gate in range(1, rows):
        starts[gate, gate] += _DIFFERENCE
    currents[rows] += _DIFFERENCE
    cells = Cells.of(membrane, Channels(*(np.tile(c, rows + 1) for c in channels)), currents.ravel())
    ends = travel(cells, starts.reshape(rows, -1), np.tile(period, rows + 1), _TOLERANCE).reshape(starts.shape)
    jacobian = ((ends[:, 1:] - ends[:, :1]) / _DIFFERENCE).transpose(2, 0, 1)
    gates = np.arange(rows - 1)
    jacobian[:, gates + 1, gates] -= 1.0
    miss = ends[:, 0] - state
    drift = cells.take(np.arange(n)).slope(ends[:, 0])
    response = np.asarray(np.linalg.solve(jacobian, -np.stack([miss.T, drift.T], axis=-1)), dtype=float)
    return response[..., 0].T, response[..., 1].T
