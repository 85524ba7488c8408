"""Response of one parameter vector by slow adaptive integration: the reference for the fast scene.

There are no tables and no integration by parts. Over the distance rho from the contact's axis, with w the number of
receptors of the pad per unit distance,

    N = integral of w(rho) nu(I(sigma(rho))) d rho    from 0 to the last receptor that fires,

where the stress is exact at every node and w follows from the arcs of the circle inside the pad. The range is divided
where w or sigma has a kink, and each piece is halved until its integral agrees with that of its halves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Contact, Finger, solve_contact
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.rate import firing_rate, rheobase
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.receptors import Density, kink_distances, receptor_current
from softness_bayes.touch.scene import Response, Scene
from softness_bayes.touch.stress import stress

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

NODES = 12
"""Gauss nodes of a piece."""

HALVINGS = 60
"""Largest number of halvings of a piece; 2^-60 of the pad is smaller than an atom."""

INTERVAL_RTOL = 1e-7
"""Smallest tolerance of mean intervals. Near the onset of firing they diverge like an inverse square root, so that
rounding errors of 1e-15 in the stress cause errors of about the square root of that."""

ARC_NODES = 40
"""Gauss nodes of an arc, which spans at most a quarter of the circle."""


class RateLaw(Protocol):
    """Firing rate of a receptor against current: a `RateCurve` of one parameter vector, or the simulated membrane."""

    @property
    def rheobase(self) -> ArrayLike:
        """Current at which firing starts [µA/cm²], a scalar; infinite for a membrane that never fires."""

    def rate(self, current: Array) -> Array:
        """Return the firing rate [Hz] at currents of any shape [µA/cm²]."""


@dataclass(frozen=True)
class SimulatedRate:
    """Firing rate of the membrane, simulated at every current.

    Parameters
    ----------
    channels
        Multipliers of the conductances, scalars [-].
    membrane
        Constants.
    """

    channels: Channels
    membrane: Membrane

    @cached_property
    def rheobase(self) -> Array:
        """Current at which firing starts [µA/cm²]."""
        return rheobase(self.channels, self.membrane)

    def rate(self, current: Array) -> Array:
        """Return the steady firing rate [Hz]."""
        return firing_rate(current, self.channels, self.membrane)


def reference_response(
    scene: Scene, parameters: TouchParameters, law: RateLaw | None = None, rtol: float = 1e-8
) -> Response:
    """Return the response of every condition of a scene to one parameter vector.

    Parameters
    ----------
    scene
        The scene; its fabrics, loads, finger and readings are used, its tables are not.
    parameters
        Scalars; a radius or a depth among them replaces the finger's.
    law
        The firing rate. By default the reading's membrane is simulated, which takes about a millisecond per quadrature
        node: ten seconds for 36 conditions at `rtol` 1e-5, compared with a tenth of a second for a rate curve.
    rtol
        Relative tolerance of each integral; intervals are not refined below `INTERVAL_RTOL`, and
        simulated rates have an error of 1e-6 themselves.

    Returns
    -------
    Response
        Fields of shape (conditions,); means are NaN if no receptor fires.

    Raises
    ------
    InputError
        If a parameter is not a finite scalar.
    NumericalError
        If an integral does not reach its tolerance.
    """
    value = {name: _scalar(name, given) for name, given in parameters._asdict().items()}
    law = law or SimulatedRate(Channels(*(value[name] for name in Channels._fields)), scene.readings.membrane)
    alpha, beta, sigma_0 = value["alpha"], value["beta"], value["sigma_0"]
    usual, readings = scene.finger, scene.readings
    radius, depth = value["radius"] or usual.radius, value["receptor_depth"] or usual.receptor_depth
    finger = replace(usual, radius=radius, receptor_depth=depth)
    contact = _contact(scene, finger, value["b"], value["m"])

    def stress_at(rho: Array, condition: Indices) -> Array:
        state = contact.reduced_modulus[condition], contact.radius[condition]
        return stress(rho, *state, finger, readings.pressure, readings.stress_kernel, readings.stress_component)

    def integrand(rho: Array, condition: Indices) -> Array:
        current = receptor_current(stress_at(rho, condition[:, None]), alpha, beta, sigma_0)
        rate = law.rate(current.ravel()).reshape(rho.shape)
        interval = np.divide(1.0, rate, out=np.zeros_like(rate), where=rate > 0)
        weight = receptors_per_distance(rho.ravel(), finger, readings.receptor_density).reshape(rho.shape)
        return weight * np.stack([rate, np.ones_like(rate), interval])

    def excess(rho: float, condition: int) -> float:
        return float(stress_at(np.array(rho), np.array(condition))) - needed

    peak = stress_at(np.zeros(scene.n_conditions), np.arange(scene.n_conditions))
    needed = _needed_stress(float(np.asarray(law.rheobase).item()), alpha, beta, sigma_0)
    firing = np.flatnonzero(peak > needed)
    ends = [_last_distance(excess, condition, finger) for condition in firing.tolist()]
    kinks = [np.append(kink_distances(finger), contact.radius[c]) for c in firing]
    pieces = _Pieces.cut(firing, ends, kinks)
    rate, responding, interval = _integrate(integrand, pieces, scene.n_conditions, rtol)
    divisor = np.where(responding > 0, responding, np.nan)
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
    node, weight = np.polynomial.legendre.leggauss(ARC_NODES)
    angle = middle[inside][:, None] + half[inside][:, None] * node
    arcs = half[inside] * (density.at(x + rho[circle][:, None] * np.cos(angle)) @ weight)
    return rho * np.bincount(circle, arcs, rho.size)


def _scalar(name: str, value: ArrayLike) -> float:
    array = np.asarray(value, float)
    if array.size != 1 or not np.isfinite(array).all():
        raise InputError(f"parameters: {name} is {array}, expected one finite number")
    return float(array.item())


def _contact(scene: Scene, finger: Finger, b: float, m: float) -> Contact:
    fields = np.empty((len(Contact._fields), scene.n_conditions))
    for index in np.unique(scene.load):
        held = scene.load == index
        load, displacement = scene.loads[index], scene.readings.skin_displacement
        fabric = scene.modulus[held], scene.poisson[held]
        fields[:, held] = solve_contact(*fabric, load, b, m, finger, displacement)
    return Contact(*fields)


def _needed_stress(rheobase: float, alpha: float, beta: float, sigma_0: float) -> float:
    """Return the stress [Pa] at which the current equals the rheobase; infinite if the current never reaches it."""
    odds = (alpha - rheobase) / rheobase
    return sigma_0 - math.log(odds) / beta if odds > 0 else math.inf


def _last_distance(excess: Callable[[float, int], float], condition: int, finger: Finger) -> float:
    """Return the distance [m] up to which the stress of a condition suffices, at most the pad's farthest corner."""
    farthest = float(kink_distances(finger)[-1])
    if excess(farthest, condition) >= 0:
        return farthest
    return float(brentq(excess, 0.0, farthest, args=(condition,), xtol=1e-18, rtol=1e-15))


class _Pieces(NamedTuple):
    """Ranges of the distance, each of one condition; fields of shape (n,)."""

    lower: Array
    upper: Array
    condition: Indices

    def integrals(self, integrand: Callable[[Array, Indices], Array]) -> Array:
        """Gauss quadrature on each piece, shape (3, n).

        The substitution rho = lower + (upper - lower) sin²(phi) removes the square-root singularities at the ends of a
        piece, at the onset of firing and beyond a kink of the arcs.
        """
        node, weight = np.polynomial.legendre.leggauss(NODES)
        phi = 0.25 * np.pi * (node + 1.0)
        span = (self.upper - self.lower)[:, None]
        rho = self.lower[:, None] + span * np.sin(phi) ** 2
        return np.einsum("knj,nj->kn", integrand(rho, self.condition), span * (0.25 * np.pi * weight * np.sin(2 * phi)))

    def halves(self) -> _Pieces:
        """Return the left halves, then the right ones."""
        middle = 0.5 * (self.lower + self.upper)
        lower, upper = np.append(self.lower, middle), np.append(middle, self.upper)
        return _Pieces(lower, upper, np.tile(self.condition, 2))

    def take(self, index: NDArray[np.bool_]) -> _Pieces:
        """Return the pieces selected by a mask."""
        return _Pieces(self.lower[index], self.upper[index], self.condition[index])

    @classmethod
    def cut(cls, condition: Indices, ends: list[float], kinks: list[Array]) -> _Pieces:
        """Return [0, end] of each condition, cut at its kinks."""
        cuts = [np.unique([0.0, *kink[kink < end], end]) for end, kink in zip(ends, kinks, strict=True)]
        lower, upper = (np.concatenate([np.empty(0), *(cut[part] for cut in cuts)]) for part in (np.s_[:-1], np.s_[1:]))
        return cls(lower, upper, np.repeat(condition, [cut.size - 1 for cut in cuts]))


def _integrate(integrand: Callable[[Array, Indices], Array], pieces: _Pieces, n_conditions: int, rtol: float) -> Array:
    """Sum the integrals over each condition's pieces, halving pieces until they agree with their halves."""
    total = np.zeros((3, n_conditions))
    if not pieces.lower.size:
        return total
    whole = pieces.integrals(integrand)
    scale = np.array([np.bincount(pieces.condition, part, n_conditions) for part in whole])
    allowed = np.array([[rtol], [rtol], [max(rtol, INTERVAL_RTOL)]]) * scale
    for _ in range(HALVINGS):
        halves = pieces.halves()
        left, right = np.split(halves.integrals(integrand), 2, axis=1)
        settled = (np.abs(left + right - whole) <= allowed[:, pieces.condition]).all(axis=0)
        for sums, part in zip(total, (left + right)[:, settled], strict=True):
            np.add.at(sums, pieces.condition[settled], part)
        if settled.all():
            return total
        again = ~settled
        pieces = halves.take(np.tile(again, 2))
        whole = np.concatenate([left[:, again], right[:, again]], axis=1)
    raise NumericalError(f"reference: an integral does not reach the tolerance {rtol}")
