"""Intervals represented by ratings (grids of numbers, ratings of 0, ends of sliders), and lists of rank orders."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
        return Stated(self.values[rows], self.step[rows], self.limit[rows], self.most[rows], self.end, lists)

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
