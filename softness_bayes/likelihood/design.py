"""Design of a data set: condition and participant of every observation."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


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


def _require_range(name: str, index: IndexArray, size: int) -> None:
    if not ((index >= 0) & (index < size)).all():
        raise InputError(f"design: a {name} index lies outside 0 to {size - 1}")
