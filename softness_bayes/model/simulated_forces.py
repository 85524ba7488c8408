"""Simulated forces of a rigid plate on fingers with given skin parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Compression
from softness_bayes.errors import InputError
from softness_bayes.kinds import require_kind, require_mapping
from softness_bayes.likelihood.contract import NO_RESPONSE
from softness_bayes.likelihood.plate import CompressionForces, SkinParameters
from softness_bayes.model.simulated_answers import numbered, rounded
from softness_bayes.model.simulation import RNG, VALUES
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.ranges import FINGERS
from softness_bayes.touch.contact import Finger
from softness_bayes.touch.readings import MENDED, Readings

PLATE_DEPTHS = (0.5e-3, 1e-3, 1.5e-3, 2e-3)
"""Indentations [m] of simulated fingers, as in the published measurements."""


class SimulatedForces(NamedTuple):
    """Simulated compression data, with the deviations of the fingers from the typical one."""

    compression: Compression
    log_b_effect: NDArray[np.float64]
    """Deviations in ln b, shape (fingers,)."""
    m_effect: NDArray[np.float64]
    """Deviations in m, shape (fingers,)."""


def simulate_compression(
    rng: np.random.Generator,
    values: Mapping[str, float],
    readings: Readings = MENDED,
    fingers: int = 8,
    depths: tuple[float, ...] = PLATE_DEPTHS,
    shape: Finger = Finger(),
) -> SimulatedForces:
    """Simulate a rigid flat plate pressed on fingers, once to every depth for each finger.

    Parameters
    ----------
    rng
        Random generator of fingers and noise.
    values
        b, m, tau_b, tau_m and varsigma_f in natural units (`usual_values` with a number of fingers).
    readings
        Readings of the model.
    fingers
        Number of fingers.
    depths
        Indentations [m].
    shape
        Shape of every fingertip.

    Raises
    ------
    InputError
        If there is no finger.
    """
    require_kind("rng", rng, np.random.Generator, RNG)
    require_mapping("values", values, VALUES)
    if missing := [name for name in SkinParameters._fields if name not in values]:
        raise InputError(f"values: no {missing[0]}, expected all that usual_values(readings, n_fingers=8) returns")
    replace(FINGERS, low=1).require("simulate: number of fingers", fingers)
    skin = SkinParameters(*(np.float64(values[n]) * EVERY_PARAMETER[n].si for n in SkinParameters._fields))
    finger, depth = np.repeat(np.arange(fingers), len(depths)), np.tile(depths, fingers)
    plate = CompressionForces(
        depth, np.ones(depth.size), finger, fingers, displacement=readings.skin_displacement, shape=shape
    )
    effects = plate.new_effects(rng, skin, ())
    force = rounded(plate.replicate(rng, plate.drive(NO_RESPONSE, skin), skin, effects))
    compression = Compression(numbered("F", fingers), finger, depth, force, np.arange(2, 2 + force.size))
    return SimulatedForces(compression, effects.log_b, effects.m)
