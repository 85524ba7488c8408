"""Response of one parameter vector by slow adaptive integration: the reference for the fast scene.

There are no tables and no integration by parts. Over the distance rho from the contact's axis, with w the number of
receptors of the pad per unit distance,

    N = integral of w(rho) nu(I(sigma(rho))) d rho    from 0 to the last receptor that fires,

where the stress is exact at every node and w follows from the arcs of the circle inside the pad. The range is divided
where w or sigma has a kink. SciPy's double-exponential rule integrates each piece: its ends may be singular, as
they are at the onset of firing and beyond a kink of the arcs.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import tanhsinh
from scipy.optimize import brentq

from softness_bayes.base.errors import NumericalError
from softness_bayes.touch.contact import Contact, Finger, solve_contact
from softness_bayes.touch.neuron.rate_curve import RateCurve
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.receptors import Density, kink_distances, receptor_current
from softness_bayes.touch.scene import Response, Scene
from softness_bayes.touch.stress import stress

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

INTERVAL_RTOL = 1e-7
"""Smallest tolerance of mean intervals. Near the onset of firing they diverge like an inverse square root, so that
rounding errors of 1e-15 in the stress cause errors of about the square root of that."""


def reference_response(scene: Scene, parameters: TouchParameters, law: RateCurve, rtol: float = 1e-8) -> Response:
    """Return the response of every condition of a scene to one parameter vector.

    Parameters
    ----------
    scene
        The scene; its fabrics, loads, finger and readings are used, its tables are not.
    parameters
        Scalars; a radius or a depth among them replaces the finger's.
    law
        The firing rate.
    rtol
        Relative tolerance of each integral; intervals are not refined below `INTERVAL_RTOL`.

    Returns
    -------
    Response
        Fields of shape (conditions,); means are NaN if no receptor fires.

    Raises
    ------
    NumericalError
        If an integral does not reach its tolerance.
    """
    value = TouchParameters(*(float(np.asarray(given, float).item()) for given in parameters))
    usual, readings, n = scene.finger, scene.readings, scene.n_conditions
    finger = replace(
        usual, radius=value.radius or usual.radius, receptor_depth=value.receptor_depth or usual.receptor_depth
    )
    fields = np.empty((len(Contact._fields), n))
    for index in np.unique(scene.load):
        under = scene.load == index
        fabric, displacement = (scene.modulus[under], scene.poisson[under]), readings.skin_displacement
        fields[:, under] = solve_contact(*fabric, scene.loads[index], value.b, value.m, finger, displacement)
    contact = Contact(*fields)

    def stress_at(rho: Array, condition: Indices) -> Array:
        state = contact.reduced_modulus[condition], contact.radius[condition]
        return stress(rho, *state, finger, readings.pressure, readings.stress_kernel, readings.stress_component)

    def rate_at(rho: Array, condition: Indices) -> Array:
        current = receptor_current(stress_at(rho, condition), value.alpha, value.beta, value.sigma_0)
        return law.rate(current.ravel()).reshape(rho.shape)

    def weight(rho: Array) -> Array:
        return receptors_per_distance(rho.ravel(), finger, readings.receptor_density).reshape(rho.shape)

    rheobase = float(np.asarray(law.rheobase).item())
    odds = (value.alpha - rheobase) / rheobase
    needed = value.sigma_0 - math.log(odds) / value.beta if odds > 0 else math.inf
    farthest = float(kink_distances(finger)[-1])

    def end(condition: int) -> float:
        """Return the distance [m] of the last receptor that fires, at most the pad's farthest corner."""

        def excess(rho: float) -> float:
            return float(stress_at(np.array(rho), np.array(condition))) - needed

        return farthest if excess(farthest) >= 0 else float(brentq(excess, 0.0, farthest, xtol=1e-18, rtol=1e-15))

    peak = stress_at(np.zeros(n), np.arange(n))
    pieces = [np.empty((3, 0))]
    for c in np.flatnonzero(peak > needed).tolist():
        cuts, last = np.append(kink_distances(finger), contact.radius[c]), end(c)
        cuts = np.unique([0.0, *cuts[cuts < last], last])
        pieces.append(np.array([cuts[:-1], cuts[1:], np.full(cuts.size - 1, c)]))
    lower, upper, which = np.concatenate(pieces, axis=1)
    condition = which.astype(np.intp)
    # each condition's integrals are in units of the rate on the axis, so that one absolute tolerance serves all
    unit = rate_at(np.zeros(n), np.arange(n))
    unit[unit == 0.0] = 1.0

    def integral(power: int, tolerance: float) -> Array:
        """Return the integrals of w (nu / unit)^power over each condition's receptors that fire, shape (n,)."""

        def integrand(rho: Array, condition: Indices) -> Array:
            share = rate_at(rho, condition) / unit[condition]
            fires = share > 0.0
            return np.where(fires, np.where(fires, share, 1.0) ** power, 0.0) * weight(rho)

        # at lower levels the rule can miss a layer near the receptors' depth or threshold, and yet agree with itself
        found = tanhsinh(integrand, lower, upper, args=(condition,), rtol=tolerance, atol=tolerance, minlevel=4)
        if not found.success.all():
            raise NumericalError(f"reference: an integral does not reach the tolerance {tolerance}")
        return np.asarray(np.bincount(condition, found.integral, n), float)

    rate, responding = unit * integral(1, rtol), integral(0, rtol)
    divisor = np.where(responding > 0, responding, np.nan)
    interval = integral(-1, max(rtol, INTERVAL_RTOL)) / unit
    return Response(rate, responding, rate / divisor, interval / divisor, peak, contact)


def receptors_per_distance(rho: Array, finger: Finger, density: Density) -> Array:
    """Return the receptors per unit distance from the contact's axis [1/m], at distances of shape (n,).

    The circle's arcs inside the pad lie between its crossings with the lines through the pad's
    sides; each contributes rho times the integral of the density along its angle.
    """
    (x, y), length, width = finger.contact_centre, finger.pad_length, finger.pad_width
    ahead = np.arccos(np.clip([-x / rho, (length - x) / rho], -1, 1))
    aside = np.arcsin(np.clip([-y / rho, (width - y) / rho], -1, 1))
    aside = np.concatenate([aside, np.pi - aside])
    aside = np.where(aside > np.pi, aside - 2 * np.pi, aside)
    quarters = np.broadcast_to(0.5 * np.pi * np.arange(-2, 3)[:, None], (5, rho.size))
    crossings = np.sort(np.concatenate([ahead, -ahead, aside, quarters]), axis=0)
    middle, half = 0.5 * (crossings[1:] + crossings[:-1]), 0.5 * np.diff(crossings, axis=0)
    along, across = x + rho * np.cos(middle), y + rho * np.sin(middle)
    inside = (along >= 0) & (along <= length) & (across >= 0) & (across <= width) & (half > 0)
    circle = np.nonzero(inside)[1]
    node, weight = np.polynomial.legendre.leggauss(40)  # an arc spans at most a quarter of the circle
    angle = middle[inside][:, None] + half[inside][:, None] * node
    arcs = half[inside] * (density.at(x + rho[circle][:, None] * np.cos(angle)) @ weight)
    return rho * np.bincount(circle, arcs, rho.size)
