"""Parts of a finished run that the figures read from its stored result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Drawable = Any
"""A finished run, as figures read it: a `results.result.Result`, which lies above this room."""


def rated_load(result: Drawable) -> NDArray[np.intp]:
    """Return the index (rows,) of the load, or of the group of loads, of each rating."""
    return np.asarray(result.load_groups.of[result.group("constant_data")["load_index"].values])


def given_modulus(result: Drawable) -> Array:
    """Return E_fab [Pa] of the fabrics as given; the middle of its law where it is sampled."""
    return np.asarray(result.group("constant_data")["effective_modulus_kpa"].values * 1e3)


def fabric_modulus(result: Drawable) -> Array:
    """Return E_fab [Pa] of the fabrics; its posterior median where it is sampled."""
    limits = modulus_limits(result)
    return given_modulus(result) if limits is None else limits[1]


def modulus_limits(result: Drawable) -> Array | None:
    """Return lower limit, median and upper limit of E_fab [Pa], (3, fabrics), all equal where it is known.

    None if no modulus is sampled.
    """
    from softness_bayes.checking.individual import MODULUS_LAW
    from softness_bayes.checking.individual import modulus_limits as limits_of
    from softness_bayes.checking.layout import UNCERTAIN

    if MODULUS_LAW not in result.group("constant_data"):
        return None
    limits, names, posterior = np.tile(given_modulus(result), (3, 1)), fabric_names(result), result.group("posterior")
    sampled = [names.index(str(name)) for name in posterior[UNCERTAIN].values]
    limits[:, sampled] = 1e3 * limits_of(posterior)
    return limits


def fabric_names(result: Drawable) -> list[str]:
    """Return the names of the fabrics."""
    return [str(name) for name in result.group("constant_data")["fabric"].values]


def answers(result: Drawable) -> tuple[Array, Array]:
    """Return observed ratings, shape (rows,), and replicated ratings, shape (draws, rows)."""
    from softness_bayes.checking.layout import ratings_in

    return ratings_in(result.tree), result.group("posterior_predictive")["rating"].values[0]


def sampled_parameters(result: Drawable) -> tuple[list[str], list[str]]:
    """Return names and labels (symbol and unit) of the sampled parameters, in the order of their declaration."""
    from softness_bayes.parameters.declared import EVERY_PARAMETER

    stored = result.group("posterior")
    names = [name for name in EVERY_PARAMETER if name in stored]
    return names, [EVERY_PARAMETER[name].label for name in names]


def draws_of(result: Drawable, group: str, names: Sequence[str]) -> Array:
    """Return the draws of all chains, interleaved in time, shape (draws, parameters)."""
    stored = result.group(group)
    return np.stack([stored[name].values.T.ravel() for name in names], axis=-1)


def walkers_of(result: Drawable, names: Sequence[str]) -> tuple[Array, NDArray[np.intp]]:
    """Return the draws of all walkers, shape (walkers, steps, parameters), and each walker's ensemble."""
    stored, ensemble = result.group("posterior"), result.group("sample_stats")["ensemble"].values
    return np.stack([stored[name].values for name in names], axis=-1), ensemble[:, 0]
