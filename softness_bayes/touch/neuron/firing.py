"""Fast firing rates: for given channels, the rate is one polynomial in the root of the current above the rheobase."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from importlib import resources

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.base.files.records import parse_json
from softness_bayes.touch.neuron.limit_cycle import TOLERANCE, Budget, StepsSpentError
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane
from softness_bayes.touch.neuron.rate import firing_rate, onset
from softness_bayes.touch.neuron.rate_curve import CurveError, RateCurve

FloatArray = NDArray[np.float64]


SEARCH_STEPS = 40_000
"""Largest number of integration steps for an exact curve: about ten seconds. The paper's multipliers take 3000."""

TRIED = Channels(c_Na=(0.8, 1.5), c_K=(0.8, 1.5), c_L=(0.5, 2.0), c_A=(0.5, 2.0))
"""Ranges of each multiplier that give a curve while the other multipliers keep the paper's values."""

_CLOSEST_BORN = 0.1  # sqrt(µA/cm²): distance of the first node from a fold of orbits, where the rate is known
_CLOSEST_JUMP = 0.03  # and from any other jump, where the rate falls logarithmically within about 1e-3 µA/cm²


def exact_curve(
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    max_current: float = 40.0,
    nodes: int = 18,
    steps: int = SEARCH_STEPS,
) -> RateCurve:
    """Return the curve through exact firing rates at Chebyshev nodes in ``s``, with its error measured between them.

    Parameters
    ----------
    channels : Channels
        Scalar multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    max_current : float
        Largest current that the curve covers [µA/cm²].
    nodes : int
        Number of nodes.
    steps : int
        Largest number of integration steps; a step of several cells in parallel counts once.

    Returns
    -------
    RateCurve
        Of batch shape ().

    Raises
    ------
    InputError
        If a multiplier is not one finite non-negative number, or ``max_current`` not finite.
    NumericalError
        If the steps do not suffice, for example where firing starts so slowly that it is hard to tell from rest.
    """
    if not np.isfinite(max_current) or nodes < 2:
        raise InputError(f"a curve needs a finite largest current and two nodes, not {max_current} and {nodes}")
    if any(np.ndim(c) for c in channels):
        raise InputError("an exact curve has one value of each channel multiplier")
    one = Channels(*(np.atleast_1d(c) for c in channels))
    try:
        curve = exact_curves(one, membrane, [max_current], nodes, budget=Budget(steps), check=True).take(0)
    except StepsSpentError as spent:
        named = ", ".join(f"{name} = {value:g}" for name, value in channels._asdict().items())
        known = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in TRIED._asdict().items())
        usual = ", ".join(f"{value:g}" for value in PAPER_CHANNELS)
        raise NumericalError(
            f"no rate curve of the membrane {membrane.name} with {named}: after {steps} steps of integration the "
            f"search for where firing begins was still {spent}, where it settles too slowly to tell firing from "
            f"rest. Use multipliers closer to the paper's ({usual}); one at a time, {known} give a curve with the "
            f"membrane {CONNOR_STEVENS.name}"
        ) from None
    return replace(curve, max_current=float(max_current))


def exact_curves(
    channels: Channels,
    membrane: Membrane,
    max_current: ArrayLike,
    nodes: int = 14,
    expected: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
    budget: Budget | None = None,
    check: bool = False,
) -> RateCurve:
    """Return curves through exact rates for many channel vectors.

    At 14 nodes the curves are within 3e-5 of the rate to 40 µA/cm², and within 3e-6 to 20 (model.md 7).

    Parameters
    ----------
    channels : Channels
        Multipliers, each of shape (n,).
    membrane : Membrane
        Constants.
    max_current : array_like
        Largest current that each covers [µA/cm²], of shape (n,).
    nodes : int
        Number of nodes.
    expected : array_like, optional
        Expected rheobases [µA/cm²], as for :func:`~.rate.onset`.
    tolerance : float
        Tolerance of the rates, as for :func:`~.rate.firing_rate`.
    budget : Budget, optional
        Limit on the number of steps, as for :func:`~.limit_cycle.steady_orbit`.
    check : bool
        True to measure the error between the nodes; otherwise it is NaN.
    """
    limit = np.broadcast_to(np.asarray(max_current, dtype=float), np.shape(channels.c_Na))
    begin = onset(channels, membrane, expected, budget)
    rheobase, rate_0, prefactor = (x.reshape(-1) for x in (begin.rheobase, begin.rate, begin.prefactor))
    born = begin.born.reshape(-1)
    error = CurveError(*([0.0 if check else np.nan] * 3))
    curve = RateCurve(rheobase, np.zeros_like(limit), np.zeros((limit.size, nodes)), limit, error)
    fires = np.flatnonzero(rheobase < limit)
    through_fold, smooth = np.isfinite(prefactor[fires]), np.isfinite(prefactor[fires]) | born[fires]
    s_max = curve.s_max[fires, None]
    closest = np.where(born[fires], _CLOSEST_BORN, _CLOSEST_JUMP)[:, None]
    s_min = np.where(through_fold[:, None], 0.0, np.minimum(closest, 0.1 * s_max))
    angles = np.pi * np.arange(nodes) / (nodes - 1)
    if check:
        # below the first node simulation is slow, but the error is proportional to s and thus smaller
        angles = np.append(angles, 0.5 * (angles[1:] + angles[:-1])[1:])
    s = s_min + 0.5 * (s_max - s_min) * (1.0 - np.cos(angles))
    vector, node = np.nonzero(s)
    lane = fires[vector]
    rate = np.zeros_like(s)
    current = rheobase[lane] + s[vector, node] ** 2
    rate[vector, node] = firing_rate(current, Channels(*(c[lane] for c in channels)), membrane, tolerance, budget)
    for i, k in enumerate(fires):
        w, exact = 2.0 * s[i, :nodes] / s_max[i] - 1.0, rate[i, :nodes]
        if smooth[i]:
            value = (exact - rate_0[k]) / np.where(s[i, :nodes] > 0.0, s[i, :nodes], 1.0)
            value[0] = prefactor[k] if through_fold[i] else value[0]
            curve.onset_rate[k], curve.coefficients[k] = rate_0[k], _monomials(w, value)
        else:
            curve.onset_rate[k], curve.coefficients[k] = _without_constant(_monomials(w, exact), float(s_max[i, 0]))
    if not (check and fires.size):
        return curve
    exact = rate[:, nodes:]
    difference = np.abs(curve.take(fires).rate(rheobase[fires, None] + s[:, nodes:] ** 2) - exact)
    at_onset = np.abs(curve.onset_rate - rate_0)[fires].max()
    return replace(curve, error=CurveError(*map(float, (difference.max(), (difference / exact).max(), at_onset))))


def _monomials(w: FloatArray, value: FloatArray) -> FloatArray:
    """Return monomial coefficients of the polynomial through ``value`` at nodes ``w`` within [-1, 1]."""
    return np.asarray(chebyshev.cheb2poly(chebyshev.chebfit(w, value, w.size - 1)), dtype=float)


def _without_constant(coefficients: FloatArray, s_max: float) -> tuple[float, FloatArray]:
    """Write ``p(w)`` as ``p(-1) + s q(w)``, ``w = 2 s / s_max - 1``: the value ``p(-1)`` and the coefficients of q."""
    value = polynomial.polyval(-1.0, coefficients)
    quotient, _ = polynomial.polydiv(coefficients - value * (np.arange(coefficients.size) == 0), [1.0, 1.0])
    return float(value), np.append(quotient * (2.0 / s_max), 0.0)


CURVES = "known_curves.json"
"""File of the curves, written by `tools.surface_build`."""


def known_curve(channels: Channels, membrane: Membrane, max_current: float, nodes: int) -> RateCurve:
    """Return the shipped curve if there is one; otherwise compute it by `exact_curve` with the same arguments."""
    kept = None if any(map(np.ndim, channels)) else _kept().get(key(channels, membrane, max_current, nodes))
    return exact_curve(channels, membrane, max_current, nodes) if kept is None else kept


def key(channels: Channels, membrane: Membrane, max_current: float, nodes: int) -> str:
    """Return a text key with everything that determines a curve, including all constants of the membrane."""
    multipliers = ", ".join(f"{name} {float(value)!r}" for name, value in channels._asdict().items())
    return f"{multipliers}, to {float(max_current)!r} µA/cm², {nodes} nodes, {membrane!r}"


def text_of(curves: dict[str, RateCurve]) -> str:
    """Return the content of the file, with full precision."""
    fields = {
        name: {
            "rheobase": float(curve.rheobase),
            "onset_rate": float(curve.onset_rate),
            "coefficients": curve.coefficients.tolist(),
            "max_current": float(curve.max_current),
            "error": list(curve.error),
        }
        for name, curve in curves.items()
    }
    return json.dumps(fields, indent=1) + "\n"


@cache
def _kept() -> dict[str, RateCurve]:
    text = resources.files("softness_bayes.touch.neuron").joinpath(CURVES).read_text(encoding="utf-8")
    return {
        name: RateCurve(
            np.array(found["rheobase"]),
            np.array(found["onset_rate"]),
            np.array(found["coefficients"]),
            found["max_current"],
            CurveError(*found["error"]),
        )
        for name, found in parse_json(text).items()
    }
