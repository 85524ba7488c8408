"""The stress field of a load as scenes share it: the moduli that it covers, and fields that are made once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.contact import Finger, FingerBox, Load
from softness_bayes.touch.discretisation import Discretisation
from softness_bayes.touch.field import StressField
from softness_bayes.touch.finger_field import FingerField
from softness_bayes.touch.readings import Readings

Array = NDArray[np.float64]

LEAST_SKIN_MODULUS = 1e3
"""Softest skin [Pa] in the tables of force-controlled loads; softer skin is computed without tables."""

STIFFEST_SKIN_MODULUS = 1e7
"""Stiffest skin [Pa] in the tables, a hundred times the median at rest; stiffer skin is computed without tables."""


def covered_moduli(
    modulus: Array, poisson: Array, finger: Finger, modulus_range: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the reduced moduli [Pa] that the stress fields of a scene cover.

    Parameters
    ----------
    modulus, poisson
        E_fab [Pa] and nu_fab of each condition.
    finger
        The finger that touches.
    modulus_range
        Further moduli [Pa] of fabrics.
    """
    softness, least = 1.0 - finger.poisson_ratio**2, modulus.argmin()
    soft, stiff = modulus_range or (np.inf, 0.0)
    stiff /= 1.0 - float(poisson.max()) ** 2
    stiff = max(float((modulus / (1.0 - poisson**2)).max()), stiff)
    high = min(stiff, STIFFEST_SKIN_MODULUS / softness)
    fabric = (1.0 - poisson[least] ** 2) / min(modulus[least], soft)
    low = float(1.0 / (softness / LEAST_SKIN_MODULUS + fabric))
    return min(low, 0.5 * high), high


def field_of(
    load: Load,
    finger: Finger,
    box: FingerBox | None,
    readings: Readings,
    modulus_range: tuple[float, float],
    discretisation: Discretisation,
) -> StressField | FingerField:
    """Return the stress field of a load at a resolution, for one finger, or for those of a box.

    Equal fields are made once. The reference scene of an accuracy choice and the chosen scene share a field, cut
    differently.
    """
    tolerance = discretisation.field_tolerance
    rest = readings, modulus_range, discretisation.field_source or tolerance
    if box is None:
        return _stress_field(load, finger, *rest).cut(tolerance)
    return _finger_field(load, finger, box, *rest).cut(tolerance)


_stress_field = lru_cache(maxsize=64)(StressField)
_finger_field = lru_cache(maxsize=64)(FingerField)
