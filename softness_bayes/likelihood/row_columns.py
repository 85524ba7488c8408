"""Arrangement of rows in columns, one or more for each rater, with the draws as the last axis.

Operations and sums then run over long stretches of memory, and take a third of the time of those over rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

HEIGHT = 3.0
"""Time that a column takes in addition to that of its rows, in rows."""

ROOM = 72_000
"""Number of elements of the arrays of a block of draws (`pieces.BLOCK`), most of which have single precision."""


class Columns(NamedTuple):
    """Places of rows in columns of equal length, some of which stay empty."""

    rows: IndexArray
    """Row at each place, shape (length, columns); any row at those that are empty."""
    times: FloatArray
    """Multiplicity of the row at each place, (length, columns); 0 at those that are empty."""
    first: IndexArray
    """The first column of each rater."""
    rater: IndexArray
    """Rater of each column."""

    @property
    def empty(self) -> IndexArray:
        """Places without a row, as indices of the flattened array."""
        return np.flatnonzero(self.times == 0.0)

    def placed(self, values: FloatArray) -> FloatArray:
        """Return values (rows,) or (draws, rows) at their places, shape (length, columns, 1) or (..., draws)."""
        if values.ndim == 1:
            return np.asarray(values[self.rows][..., None])
        across = np.ascontiguousarray(values.T)
        return across.take(self.rows.ravel(), axis=0).reshape(*self.rows.shape, -1)

    def of_raters(self, values: FloatArray) -> FloatArray:
        """Return sums of values (..., columns, draws) over each rater's columns, shape (..., raters, draws)."""
        return values if self.first.size == self.rater.size else np.add.reduceat(values, self.first, axis=-2)

    def sums_of(self, values: FloatArray) -> FloatArray:
        """Return sums of values (rows,) or (draws, rows) by rater, (1, raters) or (draws, raters)."""
        placed = self.placed(values) * self.times[..., None]
        return self.of_raters(placed.sum(axis=0)).T

    def of_columns(self, values: FloatArray) -> FloatArray:
        """Return values (draws, raters) for each column, shape (columns, draws)."""
        return values.T if self.first.size == self.rater.size else values.T[self.rater]


def over_columns(values: FloatArray, columns: int) -> FloatArray:
    """Return values (draws,) for each of several columns, as one axis (columns x draws)."""
    return values[None].repeat(columns, axis=0).ravel()


def in_columns(rater: IndexArray, times: FloatArray) -> Columns:
    """Return an arrangement of rows that are sorted by rater.

    Parameters
    ----------
    rater
        Rater of each row, without gaps, shape (rows,).
    times
        Multiplicity of each row; rows with 0 are omitted, but a rater has at least one other.
    """
    chosen = np.flatnonzero(times > 0.0)
    sizes = np.bincount(rater[chosen])
    begin = np.cumsum(sizes) - sizes
    lengths = np.unique(-(-sizes.max() // np.arange(1, 1 + sizes.max())))
    length = int(min(lengths, key=lambda one: (-(-sizes // one)).sum() * (one + HEIGHT)))
    columns = -(-sizes // length)
    first = np.cumsum(columns) - columns
    within = np.arange(chosen.size) - np.repeat(begin, sizes)
    place = within % length, np.repeat(first, sizes) + within // length
    rows, own = np.zeros((length, columns.sum()), np.intp), np.zeros((length, columns.sum()))
    rows[place], own[place] = chosen, times[chosen]
    return Columns(rows, own, first, np.repeat(np.arange(sizes.size), columns))
