"""Groups of a result as variables with axes and units, and their assembly into a tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes import arviz_bridge
from softness_bayes.checking.individual import UNCERTAIN
from softness_bayes.checking.inflection import Inflection
from softness_bayes.model.posterior import Density
from softness_bayes.parameters.fabric_moduli import FABRIC_MODULUS
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.sampler.chains import Chains

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


class Variable(NamedTuple):
    """A variable of a group: values (chain, draw first in groups with draws), further axes, unit."""

    values: NDArray[Any]
    dims: tuple[str, ...] = ()
    units: str = ""


Groups = dict[str, dict[str, Variable]]
"""Variables by group and name; variables of the same name have the same axes and unit in every group."""


def tree_of(groups: Groups, coordinates: Mapping[str, ArrayLike], attributes: Mapping[str, Any]) -> xr.DataTree:
    """Return the groups as a result, with `attributes` as its provenance."""
    every = {name: variable for group in groups.values() for name, variable in group.items()}
    return arviz_bridge.to_tree(
        {group: {name: v.values for name, v in variables.items()} for group, variables in groups.items()},
        {name: v.dims for name, v in every.items()},
        coordinates,
        attributes,
        {name: {"units": v.units} for name, v in every.items() if v.units},
    )


def merged(*parts: Groups) -> Groups:
    """Return groups with the variables of all parts."""
    names = dict.fromkeys(group for part in parts for group in part)
    return {group: {n: v for part in parts for n, v in part.get(group, {}).items()} for group in names}


def named(space: ParameterSpace, theta: Array) -> dict[str, Variable]:
    """Return points theta (..., dimension) by parameter name; sampled moduli form one variable."""
    return _by_name(space, theta, [p.unit for p in space.sampled])


def _by_name(space: ParameterSpace, values: Array, units: Sequence[str]) -> dict[str, Variable]:
    chain = range(space.n_chain)
    found = {space.names[k]: Variable(values[..., k], units=units[k]) for k in chain}
    if space.moduli is not None:
        found[FABRIC_MODULUS] = Variable(values[..., space.n_chain :], (UNCERTAIN,), units[-1])
    return found


def sampled_groups(density: Density, kept: Chains, theta: Array, data: str) -> Groups:
    """Return the draws of the sampled parameters and their densities.

    Parameters
    ----------
    density
        The sampled density.
    kept, theta
        The draws, and their points theta, shape (chains, draws, dimension).
    data
        Name of the joint log-likelihood in its group.
    """
    log_prior = density.space.log_prior(theta)
    # a density in natural units, not in the sampler's own coordinates
    height = kept.by_walker(kept.log_density - density.space.log_jacobian(kept.coordinates))
    acceptance = np.broadcast_to(kept.accepted.reshape(-1, 1), height.shape)
    return {
        "posterior": named(density.space, theta),
        "sample_stats": {"lp": Variable(height), "acceptance_rate": Variable(acceptance)},
        "log_prior": _by_name(density.space, log_prior, [""] * density.space.dimension),
        "log_likelihood": {data: Variable(height - log_prior.sum(axis=-1))},
    }


def turning_variables(turn: Inflection, shape: tuple[int, int], axis: str) -> dict[str, Variable]:
    """Return turning points of the response as variables along an axis of loads; draws have `shape` (chains, draws)."""
    points: dict[str, tuple[NDArray[Any], str]] = {
        "inflection_outcome": (turn.outcome, ""),
        "inflection_e_fab_kpa": (turn.modulus * 1e-3, "kPa"),
        "inflection_ratio": (turn.ratio, ""),
        "inflection_force_n": (turn.force, "N"),
        "inflection_drop": (turn.drop, ""),
        "inflection_inside": (turn.inside.astype(np.int8), ""),
    }
    return {n: Variable(v.reshape(*shape, v.shape[-1]), (axis,), unit) for n, (v, unit) in points.items()}


def evenly(shape: tuple[int, ...], size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return chain and draw indices of draws evenly spaced over a run, with the walkers interleaved in time.

    Parameters
    ----------
    shape
        Shape of the run's draws, (chains, draws, ...).
    size
        Number of draws, if the run has enough.
    """
    chains, stored = shape[:2]
    flat = np.linspace(0, chains * stored - 1, min(size, chains * stored)).astype(int)
    return flat % chains, flat // chains
