"""Grouping of many loads for checks: the loads of a result, and conditions merged over groups of loads."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.quantities import Layout
from softness_bayes.likelihood.design import Design
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.load_groups import LoadGroups, groups_of

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

LOAD_GROUP = "load_group"
"""Axis of variables stored for groups of many loads; with few loads, the axis is `load`."""


def loads_in(constant: xr.Dataset) -> tuple[Load, ...]:
    """Return the loads of the data, of the group `constant_data`."""
    return tuple(
        Indentation(float(depth) * 1e-3) if np.isfinite(depth) else Force(float(newton))
        for depth, newton in zip(constant["indentation_mm"].values, constant["force_n"].values, strict=True)
    )


def groups_in(tree: xr.DataTree) -> LoadGroups:
    """Return the groups of the loads of a result."""
    return groups_of(loads_in(tree["constant_data"].to_dataset()))


def shown_in(stored: xr.Dataset, groups: LoadGroups) -> IndexArray:
    """Return the indices of the shown loads on the load axis of a group of a result.

    Parameters
    ----------
    stored
        Curves or turning points. Results of earlier versions store them for every load.
    groups
        The groups of all loads.
    """
    return groups.at if LOAD_GROUP not in stored.dims else np.arange(groups.at.size)


def merge(layout: Layout, of: IndexArray) -> tuple[Layout, IndexArray]:
    """Return a layout whose conditions are fabrics under groups of loads, and the new condition of each old one.

    Parameters
    ----------
    layout
        Design of the ratings, under single loads.
    of
        Index of each load's group, which replaces the load.
    """
    design = layout.design
    code = of[layout.load] * design.n_fabrics + design.fabric
    distinct, first, place = np.unique(code, return_index=True, return_inverse=True)
    loads, fabrics = np.divmod(distinct, design.n_fabrics)
    merged = Design(place[design.condition], design.participant, fabrics, design.n_participants)
    return replace(layout, design=merged, modulus=layout.modulus[first], load=loads), place


def averaged(layout: Layout, place: IndexArray, values: FloatArray) -> FloatArray:
    """Return means over the ratings of each merged condition.

    Parameters
    ----------
    layout
        Design of the ratings, under single loads.
    place
        Merged condition of each condition, from `merge`.
    values
        Values by condition, shape (..., conditions).
    """
    count = layout.design.cells.sum(axis=0)
    weight = np.zeros((count.size, int(place.max()) + 1))
    weight[np.arange(count.size), place] = count
    return np.asarray(values @ (weight / weight.sum(axis=0)))
