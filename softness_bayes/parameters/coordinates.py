"""Coordinates of the sampler, each of which maps the support of a parameter to the whole real line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, log_expit, logit, ndtr, ndtri

from softness_bayes.base.laws import LogUniform, Prior

FloatArray = NDArray[np.float64]


class Coordinate(Protocol):
    """A smooth increasing map from the real line z to the open support of a parameter x, element by element."""

    def natural(self, z: FloatArray) -> FloatArray:
        """Return the parameter value x at ``z``."""

    def coordinate(self, x: FloatArray) -> FloatArray:
        """Return z at ``x``, the inverse of `natural`."""

    def log_slope(self, z: FloatArray) -> FloatArray:
        """Return the log of dx/dz at ``z``, so that log p(z) = log p(x) + log_slope(z)."""


@dataclass(frozen=True)
class Scaled:
    """x = unit z, for a quantity of either sign."""

    unit: float

    def natural(self, z: FloatArray) -> FloatArray:
        """Return x = unit z."""
        return self.unit * z

    def coordinate(self, x: FloatArray) -> FloatArray:
        """Return z = x / unit."""
        return x / self.unit

    def log_slope(self, z: FloatArray) -> FloatArray:
        """Log of the unit."""
        return np.zeros_like(z) + np.log(self.unit)


@dataclass(frozen=True)
class HalfLine:
    """x = low + exp z, for a quantity above ``low``."""

    low: float = 0.0

    def natural(self, z: FloatArray) -> FloatArray:
        """Return x = low + exp z; infinite if exp overflows, where every prior has zero density."""
        with np.errstate(over="ignore"):
            return self.low + np.exp(z)

    def coordinate(self, x: FloatArray) -> FloatArray:
        """Return z = log(x - low)."""
        return np.log(x - self.low)

    def log_slope(self, z: FloatArray) -> FloatArray:
        """Log of exp z."""
        return z


@dataclass(frozen=True)
class Interval:
    """x = low + (high - low)/(1 + exp -z), for a quantity between two bounds."""

    low: float
    high: float

    def natural(self, z: FloatArray) -> FloatArray:
        """Parameter value at ``z``."""
        return self.low + (self.high - self.low) * expit(z)

    def coordinate(self, x: FloatArray) -> FloatArray:
        """Log odds of the share of the interval below ``x``."""
        return logit((x - self.low) / (self.high - self.low))

    def log_slope(self, z: FloatArray) -> FloatArray:
        """log((high - low) s (1 - s)), s the share of the interval below x."""
        return np.log(self.high - self.low) + log_expit(z) + log_expit(-z)


@dataclass(frozen=True)
class LogScore:
    """x = low (high / low)^Phi(z), for a quantity whose logarithm lies between two bounds.

    A law that is uniform in the logarithm is the standard normal one of z, also over many powers of ten, where log odds
    of the share of the interval itself would crowd at the lower bound.
    """

    low: float
    high: float

    def natural(self, z: FloatArray) -> FloatArray:
        """Parameter value at ``z``."""
        return np.clip(np.exp(self._log(z)), self.low, self.high)

    def coordinate(self, x: FloatArray) -> FloatArray:
        """Normal score of the share of the logarithm's interval below ``x``."""
        return ndtri((np.log(x) - np.log(self.low)) / (np.log(self.high) - np.log(self.low)))

    def log_slope(self, z: FloatArray) -> FloatArray:
        """Log of x log(high / low) times the normal density at ``z``."""
        width = np.log(self.high) - np.log(self.low)
        return self._log(z) + np.log(width) - 0.5 * z * z - 0.5 * np.log(2.0 * np.pi)

    def _log(self, z: FloatArray) -> FloatArray:
        low = np.log(self.low)
        return low + (np.log(self.high) - low) * ndtr(z)


@dataclass(frozen=True)
class Bent:
    """x = centre + width sinh z: linear near a centre, logarithmic far from it on either side.

    It suits a quantity whose effect grows like a power of its distance from the centre, such as the largest
    receptor current above the rheobase: its ridges with exponents become straight. It reaches every number,
    including those that a prior excludes.
    """

    centre: float
    width: float

    def natural(self, z: FloatArray) -> FloatArray:
        """Return x = centre + width sinh z; infinite where sinh overflows."""
        with np.errstate(over="ignore"):
            return self.centre + self.width * np.sinh(z)

    def coordinate(self, x: FloatArray) -> FloatArray:
        """Return z = arsinh((x - centre) / width)."""
        return np.arcsinh((x - self.centre) / self.width)

    def log_slope(self, z: FloatArray) -> FloatArray:
        """Log of width cosh z."""
        return np.log(0.5 * self.width) + np.logaddexp(z, -z)


def coordinate_for(support: tuple[float, float]) -> Coordinate:
    """Return the coordinate for a support (low, high).

    A support bounded only from above has the whole line; no prior of the toolkit has one.
    """
    low, high = support
    if math.isinf(low):
        return Scaled(1.0)
    return HalfLine(low) if math.isinf(high) else Interval(low, high)


def walked(prior: Prior) -> Coordinate:
    """Return the sampler coordinate of a parameter with this prior."""
    return LogScore(*prior.support) if isinstance(prior, LogUniform) else coordinate_for(prior.support)
