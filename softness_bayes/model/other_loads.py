"""The loads, beside the stated ones, at which the responses of ratings with errors of their loads are needed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import LOAD_COLUMNS, Ratings
from softness_bayes.likelihood.load_errors import NODE, LoadErrors
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


def beside(ratings: Ratings, errors: LoadErrors) -> Touched:
    """Return the conditions under the lower and the higher loads of uncertain touches, in the order of their columns.

    Raises
    ------
    InputError
        If such a load is out of range.
    """
    conditions, uncertain = ratings.conditions, errors.uncertain
    condition = errors.condition[uncertain]
    every = [
        scaled(ratings.loads[load], float(np.exp(side * NODE * spread)))
        for side in (-1.0, 1.0)
        for load, spread in zip(conditions.load[condition], errors.log_sd[uncertain], strict=True)
    ]
    loads = tuple(dict.fromkeys(every))
    place = {load: k for k, load in enumerate(loads)}
    return Touched(loads, np.tile(conditions.fabric[condition], 2), np.array([place[load] for load in every]))


def scaled(load: Load, factor: float) -> Load:
    """Return a load of the same kind, larger by a factor."""
    return next(kind(value(load) * factor) for _, kind, value in LOAD_COLUMNS if isinstance(load, kind))
