"""Interface to ArviZ 0.23 and 1.x, and files that both versions can read.

A result is an `xarray.DataTree` whose children are the groups. It is written and read by xarray alone, so that a file
does not depend on the installed version of ArviZ. ArviZ and xarray are imported inside the functions, because they take
seconds and most commands do not need them.
"""

from __future__ import annotations

import io
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError

if TYPE_CHECKING:
    import xarray

FloatArray = NDArray[np.float64]

GROUPS = (
    "posterior",
    "sample_stats",
    "log_prior",
    "log_likelihood",
    "log_likelihood_joint",
    "log_likelihood_participant",
    "posterior_predictive",
    "predictions",
    "inflection",
    "prior_inflection",
    "prior",
    "prior_predictive",
    "observed_data",
    "constant_data",
    "illustration_data",
)
"""The groups of a result, in the order of the file."""

SAMPLE_DIMS = ("chain", "draw")
"""Leading dimensions of every group except those in `_WITHOUT_DRAWS`."""

ENSEMBLE = "ensemble"
"""Variable of `sample_stats` with the ensemble of each draw; draws of a chain (walker) have the same one."""

FEWEST_DRAWS = 4
"""Draws per chain below which ArviZ does not compute an effective sample size and prints a warning."""

_WITHOUT_DRAWS = ("observed_data", "constant_data", "illustration_data")
"""Groups without draws; ArviZ recognises them by `data` in their names when it makes a table of draws."""


def r_hat(chains: ArrayLike) -> float:
    """Return the rank-normalised, split and folded R-hat of an array (chains, draws)."""
    return float(_arviz().rhat(_chains(chains)))


def ess_bulk(chains: ArrayLike) -> float:
    """Return the bulk effective sample size of an array (chains, draws); NaN for fewer draws than `FEWEST_DRAWS`."""
    return float(_arviz().ess(_chains(chains))) if _enough(chains) else math.nan


def mcse(chains: ArrayLike, of: str) -> float:
    """Return the Monte-Carlo standard error of the mean or the sd of an array (chains, draws), or NaN as `ess_bulk`."""
    return float(_arviz().mcse(_chains(chains), method=of)) if _enough(chains) else math.nan


def hdi(draws: ArrayLike, probability: float) -> tuple[float, float]:
    """Return the shortest interval (low, high) that contains a given share of the draws, an array of any shape."""
    flat = np.ravel(np.asarray(draws, float))
    name = "prob" if _next_line() else "hdi_prob"
    low, high = np.asarray(_arviz().hdi(flat, **{name: probability}))
    return float(low), float(high)


def psis(log_ratios: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return Pareto-smoothed importance weights of draws.

    Parameters
    ----------
    log_ratios
        Logarithms of the raw weights, shape (cases, draws).

    Returns
    -------
    log_weights, pareto_k : ndarray, shapes (cases, draws) and (cases,)
        Weights sum to 1 in each case. If the largest weights are equal, there is no tail to smooth, and k is -inf.
    """
    log_weights = np.array(log_ratios, float)
    pareto_k = np.full(len(log_weights), -np.inf)
    draws = log_weights.shape[-1]
    tail = math.ceil(min(draws / 5, 3 * math.sqrt(draws)))
    uneven = np.ptp(np.sort(log_weights, axis=-1)[:, -tail:], axis=-1) > 0
    if uneven.any() and _next_line():
        from arviz_stats.base import array_stats  # it takes log-likelihoods

        log_weights[uneven], pareto_k[uneven] = array_stats.psislw(-log_weights[uneven], axis=-1)
    elif uneven.any():
        log_weights[uneven], pareto_k[uneven] = _arviz().psislw(log_weights[uneven])
    return log_weights - np.logaddexp.reduce(log_weights, axis=-1, keepdims=True), pareto_k


def to_tree(
    groups: Mapping[str, Mapping[str, ArrayLike]],
    dims: Mapping[str, Sequence[str]] | None = None,
    coords: Mapping[str, ArrayLike] | None = None,
    attrs: Mapping[str, Any] | None = None,
    variable_attrs: Mapping[str, Mapping[str, Any]] | None = None,
) -> xarray.DataTree:
    """Assemble groups of arrays into a result.

    Parameters
    ----------
    groups
        Arrays by group and name. In groups with draws the first two axes are chain and draw.
    dims
        Names of each variable's remaining axes; an array that is not listed must not have any.
    coords
        Coordinates by name, each along the dimension of the same name; other dimensions are numbered from 0. ArviZ
        cannot make tables of groups with further coordinates.
    attrs
        Attributes of the whole result: numbers and text.
    variable_attrs
        Attributes of variables by name, wherever they occur, such as their units.
    """
    import xarray

    dims, coords, variable_attrs = dims or {}, coords or {}, variable_attrs or {}
    children = {}
    for group in [*(g for g in GROUPS if g in groups), *(g for g in groups if g not in GROUPS)]:
        leading = () if group in _WITHOUT_DRAWS else SAMPLE_DIMS
        variables = {
            name: ((*leading, *dims.get(name, ())), np.asarray(values), dict(variable_attrs.get(name, {})))
            for name, values in groups[group].items()
        }
        sizes = {d: n for along, v, _ in variables.values() for d, n in zip(along, v.shape, strict=True)}
        axes = {d: (d, np.asarray(coords.get(d, np.arange(n)))) for d, n in sizes.items()}
        children[f"/{group}"] = xarray.Dataset(variables, axes)
    children["/"] = xarray.Dataset(attrs=dict(attrs or {}))
    return xarray.DataTree.from_dict(children)


def require_storable(values: Mapping[str, Any]) -> None:
    """Raise an error for attributes or labels that a result file cannot store; each is tried in memory.

    Parameters
    ----------
    values
        Attributes of the result, and names along its axes, as sequences of text.

    Raises
    ------
    InputError
        Names the first one that cannot be stored.
    """
    import h5netcdf

    with h5netcdf.File(io.BytesIO(), "w") as file:
        for name, value in values.items():
            for one in value if isinstance(value, (tuple, list)) else [value]:
                try:
                    file.attrs["tried"] = one
                except (TypeError, ValueError):
                    expected = "expected UTF-8 text without NUL, or a number of 64 bits"
                    raise InputError(f"{name} {one!r:.80}: the file of a result cannot hold it; {expected}") from None


def netcdf(tree: xarray.DataTree, ending: Callable[[memoryview], bytes] | None = None) -> bytes:
    """Return a result as the bytes of a NetCDF file that ArviZ 0.23 and 1.x can read.

    The content is created in memory because HDF5 does not reliably report a full disk.

    Parameters
    ----------
    tree
        Groups of the result.
    ending
        Function of the content that returns bytes to append to it, which readers ignore.
    """
    content = io.BytesIO()
    tree.to_netcdf(content, engine="h5netcdf")
    if ending is not None:
        with content.getbuffer() as whole:
            last = ending(whole)
        content.seek(0, io.SEEK_END)
        content.write(last)
    return content.getvalue()


def read_netcdf(path: str | os.PathLike[str]) -> xarray.DataTree:
    """Read a result from `netcdf` into memory: as xarray does, in a tenth of the time."""
    import h5py
    import xarray

    def variable(name: str, stored: h5py.Dataset, scales: Mapping[h5py.Dataset, str]) -> tuple[Any, ...]:
        # axes by their datasets: to ask HDF5 for the name of one takes a millisecond
        dims = [scales[file[one[0]]] for one in stored.attrs.get("DIMENSION_LIST", ())]
        if stored in scales:
            dims = [name]
        text = h5py.check_string_dtype(stored.dtype) is not None
        units = {"units": str(stored.attrs["units"])} if "units" in stored.attrs else {}
        return tuple(dims), (stored.asstr() if text else stored)[()], units

    def dataset(group: h5py.Group) -> xarray.Dataset:
        scales = {stored: name for name, stored in group.items() if stored.is_scale}
        return xarray.Dataset({name: variable(name, stored, scales) for name, stored in group.items()})

    with h5py.File(path) as file:
        groups = {f"/{name}": dataset(group) for name, group in file.items()}
        attributes = {name: value for name, value in file.attrs.items() if name != "_NCProperties"}
        attributes = {name: value[0] if np.ndim(value) else value for name, value in attributes.items()}
        groups["/"] = xarray.Dataset(attrs=attributes)
    return xarray.DataTree.from_dict(groups)


@contextmanager
def without(library: str, user: str) -> Iterator[None]:
    """Keep its user from importing a library in a ``with`` block: it is slow, and serves only arguments of its types.

    Nothing changes if the program has imported one of the two already.
    """
    unknown = library not in sys.modules and user not in sys.modules
    if unknown:
        sys.modules[library] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if unknown:
            del sys.modules[library]


def _enough(chains: ArrayLike) -> bool:
    return np.shape(chains)[-1] >= FEWEST_DRAWS


def _arviz() -> Any:
    import arviz

    return arviz


def _next_line() -> bool:
    return not _arviz().__version__.startswith("0.")


def _chains(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, float)
    if array.ndim != 2:
        raise ValueError(f"expected an array (chains, draws), got shape {array.shape}")
    return array
