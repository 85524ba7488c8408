"""Intervals that ratings stand for: grids of numbers, and ratings of 0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Stated(NamedTuple):
    """Ratings with the intervals that they stand for. Every field has shape (rows,)."""

    values: FloatArray
    """Ratings; a stand-in of `limit` / 2 for those of 0, which have no logarithm."""
    step: FloatArray
    """Step of the rater's grid; 0 if numbers are exact."""
    limit: FloatArray
    """Number below which the rater says 0: half a step; of exact numbers the rater's smallest, and 0 if none is 0."""

    @property
    def exact(self) -> bool:
        """True if every rating is an exact number above 0."""
        return not (self.step.any() or self.limit.any())

    def take(self, rows: NDArray[np.bool_]) -> Stated:
        """Return some of the rows."""
        return Stated(*(field[rows] for field in self))

    def rounded(self, numbers: FloatArray) -> FloatArray:
        """Return the ratings, as `values`, that would be given for numbers (..., rows)."""
        step = np.where(self.step > 0, self.step, 1.0)
        on_grid = np.where(self.step > 0, np.floor(numbers / step + 0.5) * step, numbers)
        return np.where(numbers < self.limit, 0.5 * self.limit, on_grid)

    def ends(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the intervals that ratings (rows,), as `values`, stand for."""
        zero = values < self.limit
        low = np.where(zero, 0.0, np.maximum(values - 0.5 * self.step, self.limit))
        return low, np.where(zero, self.limit, values + 0.5 * self.step)
