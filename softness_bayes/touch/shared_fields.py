"""Stress fields shared between scenes: the range of moduli that they cover, and a cache of computed fields."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.contact import Finger, FingerBox, Force, Indentation, Load
from softness_bayes.touch.discretisation import Discretisation
from softness_bayes.touch.field import StressField
from softness_bayes.touch.finger_field import FingerField
from softness_bayes.touch.load_field import LoadField, LoadTable, cut_together, held
from softness_bayes.touch.readings import Readings

Array = NDArray[np.float64]

LEAST_SKIN_MODULUS = 1e3
"""Softest skin [Pa] in the tables of force-controlled loads; softer skin is computed without tables."""

STIFFEST_SKIN_MODULUS = 1e7
"""Stiffest skin [Pa] in the tables, a hundred times the median at rest; stiffer skin is computed without tables."""


MANY_LOADS = 24
"""Number of loads of one kind above which they share one table, whose compilation takes as long as 20 to 30 loads."""


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


def fields_of(
    loads: Sequence[Load],
    finger: Finger,
    box: FingerBox | None,
    readings: Readings,
    modulus_range: tuple[float, float],
    discretisation: Discretisation,
) -> list[StressField | FingerField]:
    """Return the stress fields of distinct loads at a resolution, for one finger or a range of fingers.

    Equal fields are computed once. The reference scene of an accuracy choice and the chosen scene share a field with
    different truncations. More than `MANY_LOADS` loads of one kind share a table.
    """
    tolerance = discretisation.field_tolerance
    rest = readings, modulus_range, discretisation.field_source or tolerance
    found: dict[Load, StressField | FingerField] = {}
    for kind in (Indentation, Force):
        own = sorted((load for load in loads if isinstance(load, kind)), key=held)
        if len(own) <= MANY_LOADS:
            continue
        if box is None:
            found |= zip(own, _load_table(own[0], own[-1], finger, *rest).cut(tolerance).fields(own), strict=True)
        else:
            table = _finger_field(own[0], finger, box, *rest, own[-1]).cut(tolerance)
            found |= {load: table.under(load) for load in own}
    for load in loads:
        if load not in found:
            alone = _stress_field(load, finger, *rest) if box is None else _finger_field(load, finger, box, *rest)
            found[load] = alone.cut(tolerance)
    return [found[load] for load in loads]


def cut(fields: Sequence[StressField | FingerField], tolerance: float) -> list[StressField | FingerField]:
    """Return fields with series truncated at a larger tolerance."""
    tables: dict[int, list[LoadField]] = {}
    of_fingers: dict[int, FingerField] = {}
    for field in fields:
        if isinstance(field, LoadField):
            tables.setdefault(id(field.side), []).append(field)
        elif isinstance(field, FingerField) and id(field.table) not in of_fingers:
            of_fingers[id(field.table)] = field.cut(tolerance)
    cuts = {field.load: field for group in tables.values() for field in cut_together(group, tolerance)}

    def part(field: StressField | FingerField) -> StressField | FingerField:
        if isinstance(field, LoadField):
            return cuts[field.load]
        return field.cut(tolerance) if isinstance(field, StressField) else of_fingers[id(field.table)].under(field.load)

    return [part(field) for field in fields]


def forget() -> None:
    """Clear the cache of fields, so that computation of the next ones can be timed."""
    for kept in (_stress_field, _finger_field, _load_table):
        kept.cache_clear()


_stress_field = lru_cache(maxsize=64)(StressField)
_finger_field = lru_cache(maxsize=64)(FingerField)
_load_table = lru_cache(maxsize=16)(LoadTable)
