"""Design of a data set: each observation's condition, participant, load error, and the interval that it represents."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

KNOTS = (-math.sqrt(3.0), 0.0, math.sqrt(3.0))
"""Loads for sums over the law of a load, in standard deviations of its logarithm, with weights 1/6, 2/3, 1/6."""


@dataclass(frozen=True)
class Design:
    """Condition and participant of every row, and fabric of every condition.

    Parameters
    ----------
    condition, participant
        Index of each row's condition and participant, shape (rows,).
    fabric
        Index of each condition's fabric, shape (conditions,).
    n_participants
        Number of participants; those without rows are allowed.

    Raises
    ------
    InputError
        If there is no row, or an index is outside its range.
    """

    condition: IndexArray
    participant: IndexArray
    fabric: IndexArray
    n_participants: int
    cells: FloatArray = field(init=False, repr=False, compare=False)
    """Number of rows of each participant and condition, shape (participants, conditions)."""

    def __post_init__(self) -> None:
        for name in ("condition", "participant", "fabric"):
            index = np.array(getattr(self, name), dtype=np.intp)
            index.flags.writeable = False
            object.__setattr__(self, name, index)
        if self.condition.size == 0:
            raise InputError("there are no ratings")
        _require_range("condition", self.condition, self.n_conditions)
        _require_range("participant", self.participant, self.n_participants)
        cells = np.zeros((self.n_participants, self.n_conditions))
        np.add.at(cells, (self.participant, self.condition), 1.0)
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return self.condition.size

    @property
    def n_conditions(self) -> int:
        """Number of conditions."""
        return self.fabric.size

    @property
    def n_fabrics(self) -> int:
        """Number of fabrics."""
        return int(self.fabric.max()) + 1

    @cached_property
    def weight(self) -> FloatArray:
        """Share of the rows in each condition, shape (conditions,)."""
        return self.cells.sum(axis=0) / self.n_rows

    def without(self, rows: NDArray[np.bool_]) -> Design:
        """Return the design of the other rows, with the same conditions and participants."""
        return Design(self.condition[~rows], self.participant[~rows], self.fabric, self.n_participants)


@dataclass(frozen=True)
class LoadErrors:
    """Touches (distinct pairs of a condition and an error), and the loads at which each needs a response.

    After the mean rates of the conditions come those of all touches at the first of the further loads, then at the
    next.

    Parameters
    ----------
    condition, log_sd
        Condition of each touch, and standard deviation of its log load, shape (touches,).
    of_row
        Touch of each rating, shape (rows,).
    load
        Index of each touch's load, whose error all its ratings share, shape (touches,); None if errors are independent.
    knots
        The loads z, in ascending order; 0 is the stated one.
    """

    condition: IndexArray
    log_sd: FloatArray
    of_row: IndexArray
    load: IndexArray | None = None
    knots: tuple[float, ...] = KNOTS

    @classmethod
    def of(cls, design: Design, log_sd: ArrayLike, load: ArrayLike | None = None) -> LoadErrors:
        """Return the touches of ratings.

        Parameters
        ----------
        design
            Condition of each rating.
        log_sd
            Standard deviation of the log load of each rating, a number or an array (rows,).
        load
            Index of each condition's load, shape (conditions,), if all its ratings share one error.

        Raises
        ------
        InputError
            If a standard deviation is negative or not finite.
        """
        spread = np.broadcast_to(np.asarray(log_sd, float), design.condition.shape)
        if not (np.isfinite(spread) & (spread >= 0)).all():
            raise InputError("load errors: expected finite standard deviations of 0 or above")
        pairs, of_row = np.unique(np.column_stack([design.condition, spread]), axis=0, return_inverse=True)
        condition = pairs[:, 0].astype(np.intp)
        return cls(condition, pairs[:, 1], of_row.reshape(-1), None if load is None else np.asarray(load)[condition])

    @property
    def further(self) -> tuple[float, ...]:
        """The loads other than the stated one."""
        return tuple(z for z in self.knots if z != 0.0)

    @property
    def weights(self) -> FloatArray:
        """Weights of the knots in means over the standard normal law, shape (knots,)."""
        if self.knots == KNOTS:
            return np.array([1.0, 4.0, 1.0]) / 6.0
        weight = np.exp(-0.5 * np.square(self.knots))
        return np.asarray(weight / weight.sum())

    @property
    def member(self) -> FloatArray:
        """1 if a touch has a load's error, else 0, shape (shared errors, touches)."""
        return np.zeros((0, self.condition.size)) if self.load is None else np.eye(self.load.max() + 1)[:, self.load]


class Stated(NamedTuple):
    """Ratings with the intervals that they represent, or with their lists if they are places; fields are (rows,)."""

    values: FloatArray
    """Ratings; those of 0 are replaced by `limit` / 2, those at a slider's upper end by the midpoint from `most` to
    it."""
    step: FloatArray
    """Step of the rater's grid; 0 if numbers are exact."""
    limit: FloatArray
    """Number below which the rater answers 0: half a step, or for exact numbers the rater's smallest; 0 without
    zeros."""
    most: FloatArray
    """Number above which the rater answers with the upper end of a slider; infinite on an open scale."""
    end: float = np.inf
    """Upper end of the scale."""
    lists: NDArray[np.intp] | None = None
    """Index of the list that contains each row's place, shape (rows,); None if ratings are not places."""
    reference: NDArray[np.bool_] | None = None
    """True for the references of pairs with a guess rate, shape (rows,); None without."""

    @property
    def exact(self) -> bool:
        """True if every rating is an exact number between the ends of the scale."""
        return self.lists is None and not (self.step.any() or self.limit.any() or (self.most < self.end).any())

    @property
    def censored(self) -> NDArray[np.bool_]:
        """Ratings of which only a limit is known: those of 0, and those at an end of a slider."""
        return (self.values < self.limit) | (self.values > self.most)

    def take(self, rows: NDArray[np.bool_]) -> Stated:
        """Return a selection of the rows."""
        lists = None if self.lists is None else self.lists[rows]
        reference = None if self.reference is None else self.reference[rows]
        return Stated(self.values[rows], self.step[rows], self.limit[rows], self.most[rows], self.end, lists, reference)

    def rounded(self, numbers: FloatArray) -> FloatArray:
        """Return the ratings, in the form of `values`, that would be given for numbers (..., rows)."""
        step = np.where(self.step > 0, self.step, 1.0)
        on_grid = np.where(self.step > 0, np.floor(numbers / step + 0.5) * step, numbers)
        on_grid = np.where(numbers < self.limit, 0.5 * self.limit, on_grid)
        return np.where(numbers > self.most, self._top, on_grid)

    def ends(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the intervals represented by ratings (rows,) in the form of `values`."""
        zero, top = values < self.limit, values > self.most
        low = np.where(zero, 0.0, np.maximum(values - 0.5 * self.step, self.limit))
        high = np.where(zero, self.limit, np.minimum(values + 0.5 * self.step, self.most))
        return np.where(top, self.most, low), np.where(top, self.end, high)

    @property
    def _top(self) -> FloatArray:
        return 0.5 * (self.most + self.end) if np.isfinite(self.end) else self.most


def _require_range(name: str, index: IndexArray, size: int) -> None:
    if not ((index >= 0) & (index < size)).all():
        raise InputError(f"design: a {name} index lies outside 0 to {size - 1}")
