"""Sufficient statistics of each rater's ratings for a normal law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.design import Design, IndexArray

FloatArray = NDArray[np.float64]


class RaterSums(NamedTuple):
    """Counts, means and scatter of each rater's values; the axis "raters" includes only raters with ratings."""

    participant: IndexArray
    """Index of each rater within all participants, shape (raters,)."""
    rows: FloatArray
    """Number of each rater's rows, shape (raters,)."""
    cells: FloatArray
    """Number of each rater's rows in each condition, shape (raters, conditions)."""
    means: FloatArray
    """Mean of each rater's values, shape (raters,)."""
    squares: FloatArray
    """Sum of the squares of each rater's deviations from that mean, shape (raters,)."""
    sums: FloatArray
    """Sum of these deviations in each condition, shape (raters, conditions)."""
    of_row: IndexArray
    """Rater of each row, shape (rows,)."""
    deviation: FloatArray
    """Deviation of each row's value from its rater's mean, shape (rows,)."""

    @classmethod
    def of(cls, design: Design, values: FloatArray) -> RaterSums:
        """Return the sums of values (rows,)."""
        every = design.cells.sum(axis=1)
        participant = np.flatnonzero(every)
        place = np.full(every.size, -1)
        place[participant] = np.arange(participant.size)
        of_row, rows, cells = place[design.participant], every[participant], design.cells[participant]
        means = np.bincount(of_row, values, rows.size) / rows
        deviation = values - means[of_row]
        squares = np.asarray(np.bincount(of_row, deviation**2, rows.size), float)
        sums = np.zeros_like(cells)
        np.add.at(sums, (of_row, design.condition), deviation)
        return cls(participant, rows, cells, means, squares, sums, of_row, deviation)

    @property
    def shares(self) -> FloatArray:
        """Share of each condition in a rater's rows, shape (raters, conditions)."""
        return self.cells / self.rows[:, None]
