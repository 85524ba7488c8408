"""Curves against E_fab / E_skin, which differs from draw to draw (model.md 11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.plotting.panels import Array


@dataclass(frozen=True)
class RatioAxis:
    """A grid of E_fab / E_skin in the range common to all draws of one load, and interpolation to this grid.

    Parameters
    ----------
    log_modulus
        ln E_fab on the grid of the curves, shape (points,).
    log_ratio
        ln(E_fab / E_skin) of every draw on the same grid, shape (draws, points).
    """

    log_modulus: Array
    log_ratio: Array

    @classmethod
    def of(cls, modulus: ArrayLike, skin_modulus: ArrayLike) -> Self:
        """Return the axis for moduli of fabric and skin [Pa], shapes (points,) and (draws, points)."""
        log_modulus = np.log(np.asarray(modulus, float))
        return cls(log_modulus, log_modulus - np.log(np.asarray(skin_modulus, float)))

    @property
    def grid(self) -> Array:
        """Logarithmically spaced E_fab / E_skin over the range common to all draws, shape (points,)."""
        low, high = self.log_ratio[:, 0].max(), self.log_ratio[:, -1].min()
        return np.exp(np.linspace(low, high, self.log_modulus.size))

    def carry(self, curves: Array) -> Array:
        """Interpolate curves over E_fab, shape (draws, points), to the grid, using the ratio of each draw."""
        at = np.log(self.grid)
        return np.stack([np.interp(at, x, y) for x, y in zip(self.log_ratio, curves, strict=True)])

    def place(self, modulus: ArrayLike) -> Array:
        """Return the posterior median of the ratio at given fabric moduli [Pa], shape (n,)."""
        at = np.log(np.asarray(modulus, float))
        return np.exp(np.median([np.interp(at, self.log_modulus, x) for x in self.log_ratio], axis=0))
