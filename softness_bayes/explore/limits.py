"""Ends of the page's axes: rounded, and kept while a slider moves as long as the curves fit them.

A chart whose ends stay repaints only its curves; new ends mean new ticks and a new layout.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

STEPS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.5)
"""Upper ends, times a power of ten."""

FILLED = 0.45
"""Smallest share of an axis that the curves fill before it gets a nearer end."""

MARGIN = 0.06
"""Share of an axis beyond the curves."""


def step_above(value: float) -> float:
    """Return a rounded number that is at least a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * next(step for step in STEPS if step * power >= value))


class UpperEnd:
    """Upper end of an axis that begins at zero."""

    def __init__(self) -> None:
        self._end = 0.0

    def of(self, largest: float) -> float:
        """Return the end for a largest value; 1 for zero."""
        largest = largest or 1.0
        if not FILLED * self._end <= largest <= self._end:
            self._end = step_above(largest)
        return self._end

    def forget(self) -> None:
        """Let the next value alone decide."""
        self._end = 0.0


class BothEnds:
    """Ends of an axis of ratings.

    Parameters
    ----------
    behind
        Values that are always shown, such as data and bands; NaN counts as nothing.
    forth, back
        The transformation in which the axis is linear, and its inverse.
    """

    def __init__(self, behind: ArrayLike, forth: Callable[[Any], Array], back: Callable[[Any], Array]) -> None:
        self._forth, self._back, self._ends = forth, back, (0.0, 0.0)
        self._behind = self._hull(behind)

    def _hull(self, values: ArrayLike) -> tuple[float, float]:
        places = self._forth(np.asarray(values, float))
        return float(np.nanmin(places)), float(np.nanmax(places))

    def of(self, values: ArrayLike) -> tuple[float, float]:
        """Return the ends for the curves of a state."""
        low, high = self._hull(values)
        low, high = min(low, self._behind[0]), max(high, self._behind[1])
        if high == low:
            low, high = low - 0.5, high + 0.5
        start, end = self._ends
        if not (start <= low and high <= end and high - low >= FILLED * (end - start)):
            margin = MARGIN * (high - low)
            self._ends = low - margin, high + margin
        start, end = self._back(np.array(self._ends)).tolist()
        return start, end

    def forget(self) -> None:
        """Let the next curves alone decide."""
        self._ends = 0.0, 0.0
