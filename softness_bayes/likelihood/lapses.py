"""Distributions of lapses: ratings that do not depend on the touch (model.md 9)."""

from __future__ import annotations

from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.scales import Scale

FloatArray = NDArray[np.float64]

BEYOND = 2.0
"""Factor by which lapses may lie beyond the smallest and the largest number of their rater.

If lapses ended there, these two numbers, which define the range, would themselves look like lapses.
"""


class Lapses(Protocol):
    """Distribution of the lapses of every row."""

    def log_probability(self, low: FloatArray, high: FloatArray, scale: Scale) -> FloatArray:
        """Return the log probability of an interval as a lapse, shape (rows,); of an exact number, the log density.

        Parameters
        ----------
        low, high
            Ends of each row's interval, as in the file, shape (rows,); equal for an exact number, whose density is
            that on the additive scale.
        scale
            Scale of the ratings.
        """

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], scale: Scale) -> FloatArray:
        """Return a lapse for every row, as in the file, of shape (..., rows)."""

    def take(self, rows: NDArray[np.bool_]) -> Self:
        """Return the distribution for a selection of the rows."""


class RaterRange(NamedTuple):
    """Lapses that are uniform on the additive scale, over a range of their rater's; fields are (..., rows)."""

    least: FloatArray
    """Smallest lapse on the additive scale."""
    most: FloatArray
    """Largest lapse on the additive scale."""

    @classmethod
    def of(cls, low: FloatArray, high: FloatArray, design: Design, scale: Scale) -> Self:
        """Return ranges that extend those of the raters' numbers by the factor `BEYOND` at each end.

        Parameters
        ----------
        low, high
            Ends of each row's interval, as in the file, shape (..., rows). An interval from 0 counts with its upper
            end.
        design
            The rater of every row.
        scale
            Scale of the ratings.
        """
        order = np.argsort(design.participant, kind="stable")
        _, first, rater = np.unique(design.participant[order], return_index=True, return_inverse=True)
        back = rater[np.argsort(order)]
        positive = np.where(low > 0.0, low, high)
        least = np.minimum.reduceat(positive[..., order], first, axis=-1)[..., back]
        most = np.maximum.reduceat(high[..., order], first, axis=-1)[..., back]
        return cls(scale.additive(least) - np.log(BEYOND), scale.additive(most) + np.log(BEYOND))

    def log_probability(self, low: FloatArray, high: FloatArray, scale: Scale) -> FloatArray:
        """Implement `Lapses.log_probability`."""
        with np.errstate(divide="ignore"):
            inside = np.minimum(scale.additive(high), self.most) - np.maximum(scale.additive(low), self.least)
            return np.asarray(np.log(np.where(low == high, 1.0, np.maximum(inside, 0.0)) / (self.most - self.least)))

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], scale: Scale) -> FloatArray:
        """Implement `Lapses.draw`."""
        return scale.natural(self.least + rng.random(shape) * (self.most - self.least))

    def take(self, rows: NDArray[np.bool_]) -> Self:
        """Implement `Lapses.take`."""
        return type(self)(self.least[rows], self.most[rows])


class WholeScale(NamedTuple):
    """Lapses that are uniform from 0 to the upper end of a bounded scale, as on a slider."""

    end: float
    """Upper end of the scale."""

    def log_probability(self, low: FloatArray, high: FloatArray, scale: Scale) -> FloatArray:
        """Implement `Lapses.log_probability`."""
        with np.errstate(divide="ignore"):
            return np.where(low == high, scale.log_slope(low), np.log(high - low)) - np.log(self.end)

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], scale: Scale) -> FloatArray:
        """Implement `Lapses.draw`."""
        return self.end * rng.random(shape)

    def take(self, rows: NDArray[np.bool_]) -> Self:
        """Implement `Lapses.take`."""
        return self
