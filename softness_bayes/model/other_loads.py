"""Additional loads, besides the stated ones, at which responses are needed if loads have errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import LOAD_COLUMNS, Ratings
from softness_bayes.likelihood.load_errors import LoadErrors
from softness_bayes.touch.contact import Load

IndexArray = NDArray[np.intp]


class Touched(NamedTuple):
    """Conditions of a scene."""

    loads: tuple[Load, ...]
    """The distinct loads."""
    fabric: IndexArray
    """Index of each condition's fabric."""
    load: IndexArray
    """Index of each condition's load."""


def touched_in(ratings: Ratings) -> Touched:
    """Return the conditions that were rated, at their stated loads."""
    return Touched(ratings.loads, ratings.conditions.fabric, ratings.conditions.load)


def beside(stated: Touched, errors: LoadErrors) -> Touched:
    """Return the conditions at the lower and higher loads of uncertain touches, in the order of their columns.

    Parameters
    ----------
    stated
        The conditions at their stated loads.
    errors
        Errors of the loads.

    Raises
    ------
    InputError
        If such a load is out of range.
    """
    uncertain = errors.uncertain
    condition = errors.condition[uncertain]
    every = [
        scaled(stated.loads[load], float(np.exp(node * spread)))
        for node in errors.nodes
        for load, spread in zip(stated.load[condition], errors.log_sd[uncertain], strict=True)
    ]
    loads = tuple(dict.fromkeys(every))
    place = {load: k for k, load in enumerate(loads)}
    fabric = np.tile(stated.fabric[condition], len(errors.nodes))
    return Touched(loads, fabric, np.array([place[load] for load in every]))


def scaled(load: Load, factor: float) -> Load:
    """Return a load of the same kind, multiplied by a factor."""
    return next(kind(value(load) * factor) for _, kind, value in LOAD_COLUMNS if isinstance(load, kind))
