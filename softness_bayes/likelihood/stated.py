"""Intervals that ratings stand for: grids of numbers, ratings of 0, and ends of sliders; lists of orders."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Stated(NamedTuple):
    """Ratings with the intervals that they stand for, or the lists that they are places in; fields are (rows,)."""

    values: FloatArray
    """Ratings; stand-ins for those of 0, `limit` / 2, and at the upper end of a slider, halfway from `most` to it."""
    step: FloatArray
    """Step of the rater's grid; 0 if numbers are exact."""
    limit: FloatArray
    """Number below which the rater says 0: half a step; of exact numbers the rater's smallest, and 0 if none is 0."""
    most: FloatArray
    """Number above which the rater says 1, on a slider; infinite on an open scale."""
    end: float = np.inf
    """Upper end of the scale."""
    lists: NDArray[np.intp] | None = None
    """Index of the list that each row's place is in, shape (rows,); None if ratings are not places."""

    @property
    def exact(self) -> bool:
        """True if every rating is an exact number between the ends of the scale."""
        return self.lists is None and not (self.step.any() or self.limit.any() or (self.most < self.end).any())

    def take(self, rows: NDArray[np.bool_]) -> Stated:
        """Return some of the rows."""
        lists = None if self.lists is None else self.lists[rows]
        return Stated(self.values[rows], self.step[rows], self.limit[rows], self.most[rows], self.end, lists)

    def rounded(self, numbers: FloatArray) -> FloatArray:
        """Return the ratings, as `values`, that would be given for numbers (..., rows)."""
        step = np.where(self.step > 0, self.step, 1.0)
        on_grid = np.where(self.step > 0, np.floor(numbers / step + 0.5) * step, numbers)
        on_grid = np.where(numbers < self.limit, 0.5 * self.limit, on_grid)
        return np.where(numbers > self.most, self._top, on_grid)

    def ends(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the intervals that ratings (rows,), as `values`, stand for."""
        zero, top = values < self.limit, values > self.most
        low = np.where(zero, 0.0, np.maximum(values - 0.5 * self.step, self.limit))
        high = np.where(zero, self.limit, np.minimum(values + 0.5 * self.step, self.most))
        return np.where(top, self.most, low), np.where(top, self.end, high)

    @property
    def _top(self) -> FloatArray:
        return 0.5 * (self.most + self.end) if np.isfinite(self.end) else self.most
