"""Symmetric law of a signed quantity, from the positive law of its magnitude."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.parameters.law import Prior

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Signed:
    """The law of a quantity whose magnitude has a positive law: either sign has probability 1/2."""

    law: Prior

    def __str__(self) -> str:
        return f"±{self.law}"

    @property
    def support(self) -> tuple[float, float]:
        """The real line."""
        return -math.inf, math.inf

    @property
    def median(self) -> float:
        """Median of the magnitude."""
        return self.law.median

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``; -inf at 0."""
        size = np.abs(np.asarray(x, float))
        # laws with support from 0 may have no density there; a point at 0 is given none
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.law.log_density(np.where(size > 0, size, 1.0)) - math.log(2.0)
        return np.where(size > 0, found, -np.inf)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        x = np.asarray(x, float)
        share = 0.5 * np.asarray(self.law.cumulative(np.abs(x)))
        return np.where(x < 0, 0.5 - share, 0.5 + share)

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        p = np.asarray(p, float)
        size = np.asarray(self.law.quantile(np.abs(2.0 * p - 1.0)))
        return np.where(p < 0.5, -size, size)

    def draw(self, rng: np.random.Generator, size: int | tuple[int, ...]) -> FloatArray:
        """Return independent draws of shape ``size``."""
        return self.quantile(rng.uniform(np.finfo(float).tiny, 1.0, size))


def magnitude(prior: Prior) -> Prior:
    """Return the law of a quantity's magnitude: its prior, or the one inside a `Signed` law."""
    return prior.law if isinstance(prior, Signed) else prior
