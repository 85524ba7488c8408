"""Validation of what a scene is made of: its fabrics, conditions and parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.kinds import numbers, require_kind, require_members
from softness_bayes.touch.contact import Finger, Load, require_loads
from softness_bayes.touch.discretisation import Discretisation
from softness_bayes.touch.neuron.fixed_channels import Firing
from softness_bayes.touch.readings import Readings

Array = NDArray[np.float64]


def valid_parts(
    loads: Sequence[Load], firing: Firing, finger: Finger, readings: Readings, discretisation: Discretisation
) -> Sequence[Load]:
    """Return the loads of a scene; raise an error if one of its parts is of another kind.

    Raises
    ------
    InputError
        If one of them is.
    """
    loads = require_loads("loads", loads)
    require_members("firing", firing, ("curves",), "a source of rate curves, such as FixedChannels()")
    require_kind("finger", finger, Finger, "a Finger, such as Finger(receptor_depth=0.6e-3)")
    require_kind("readings", readings, Readings, "Readings, such as NAMED_READINGS['printed']")
    require_kind("discretisation", discretisation, Discretisation, "a Discretisation")
    return loads


def checked_fabrics(modulus: ArrayLike, poisson: ArrayLike) -> tuple[Array, Array]:
    """Return E_fab [Pa] and nu_fab of each fabric, shape (fabrics,).

    Raises
    ------
    InputError
        If a modulus is not positive and finite or a Poisson ratio is outside (-1, 0.5].
    """
    given = numbers("fabric_modulus", modulus, "numbers in Pa"), numbers("fabric_poisson", poisson)
    moduli, ratios = np.broadcast_arrays(np.atleast_1d(given[0]), given[1])
    if not ((moduli > 0) & np.isfinite(moduli)).all():
        raise InputError("scene: every fabric modulus must be positive and finite [Pa]")
    if not ((ratios > -1) & (ratios <= 0.5)).all():
        raise InputError("scene: every fabric's Poisson ratio must lie in (-1, 0.5]")
    return moduli, ratios


def checked_conditions(
    fabric: ArrayLike | None, load: ArrayLike | None, fabrics: int, loads: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return each condition's fabric and load, shape (conditions,); all pairs, ordered by load, if one is None.

    Raises
    ------
    InputError
        If there is no condition, or an index is out of range.
    """
    if fabric is None or load is None:
        fabric, load = np.tile(np.arange(fabrics), loads), np.repeat(np.arange(loads), fabrics)
    touched, held = indices(fabric, fabrics, "fabric"), indices(load, loads, "load")
    if touched.size == 0 or touched.shape != held.shape:
        raise InputError("scene: expected one fabric and one load index for each of at least one condition")
    return touched, held


def distinct(*columns: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first condition of each group that agrees in all columns, and the group of each condition."""
    _, first, place = np.unique(np.column_stack(columns), axis=0, return_index=True, return_inverse=True)
    return first, place.reshape(-1)


def indices(values: ArrayLike, size: int, what: str) -> NDArray[np.intp]:
    """Return indices as a read-only array.

    Raises
    ------
    InputError
        If one is outside 0 to size - 1.
    """
    array = np.array(values, dtype=np.intp)
    if array.size and not ((array >= 0) & (array < size)).all():
        raise InputError(f"scene: a {what} index lies outside 0 to {size - 1}")
    array.flags.writeable = False
    return array


def frozen(values: ArrayLike) -> Array:
    """Return a read-only copy."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
