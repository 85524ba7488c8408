"""Profiles of touches: pressure, stress and firing rate along the pad (model.md 4-8)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.touch.contact import Fingertips
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.receptors import receptor_current
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.stress import stress

Array = NDArray[np.float64]

DRAWS_AT_ONCE = 8
"""Number of draws with simultaneous integration of the stress; more do not fit into the cache."""


class Profiles(NamedTuple):
    """A touch along the distance from its axis, every field of shape (draws, conditions, distances)."""

    pressure: Array
    """Pressure between fabric and skin [Pa]; 0 outside the contact."""
    stress: Array
    """Compressive stress at the receptors' depth [Pa]."""
    rate: Array
    """Firing rate of a receptor there [Hz]."""


def touch_profiles(
    scene: Scene, parameters: TouchParameters, distance: ArrayLike, modulus: Array | None = None
) -> Profiles:
    """Evaluate every condition of a scene along a line outwards from the contact's axis.

    Parameters
    ----------
    scene
        The scene; its readings, finger and rate curves are used, its tables are not.
    parameters
        A batch of parameter vectors, shape (draws,).
    distance
        Distances from the axis [m], shape (distances,).
    modulus
        E_fab [Pa] of each fabric, shape (draws, fabrics); by default that of the scene.

    Raises
    ------
    InputError
        If a parameter is outside the range accepted by the forward model.
    """
    r, contact = np.asarray(distance, float), scene.contact(parameters, modulus)
    parameters = TouchParameters(*np.broadcast_arrays(*parameters))
    shares = np.array_split(np.arange(len(contact.radius)), -(-len(contact.radius) // DRAWS_AT_ONCE))
    parts = [
        _profiles(scene, TouchParameters(*(v[some] for v in parameters)), r, *touch)
        for some in shares
        for touch in [(contact.reduced_modulus[some, :, None], contact.radius[some, :, None])]
    ]
    return Profiles(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _profiles(scene: Scene, parameters: TouchParameters, r: Array, modulus: Array, radius: Array) -> Profiles:
    readings, finger = scene.readings, scene.fingertip(parameters)
    if isinstance(finger, Fingertips):
        finger = finger._replace(radius=finger.radius[..., None], receptor_depth=finger.receptor_depth[..., None])
    pressure = readings.pressure(r, modulus, radius, finger)
    felt = stress(r, modulus, radius, finger, readings.pressure, readings.stress_kernel, readings.stress_component)
    alpha, beta, sigma_0 = (v[:, None, None] for v in (parameters.alpha, parameters.beta, parameters.sigma_0))
    current = receptor_current(felt, alpha, beta, sigma_0)
    curve = scene.firing.curves(parameters.channels, parameters.alpha)
    rate = curve.rate(current.reshape(len(current), -1)).reshape(current.shape)
    return Profiles(pressure, felt, rate)
