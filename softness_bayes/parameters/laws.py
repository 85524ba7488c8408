"""Prior laws: frozen values with a normalised density and a written form; the law of a signed quantity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from softness_bayes.parameters.law import LEAST_WIDTH, Law, Prior, require, require_finite
from softness_bayes.ranges import Range

FloatArray = NDArray[np.float64]

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)

SD_LOGS = Range(LEAST_WIDTH, 5.0)
"""Standard deviations of the logarithm of a log-normal law; 5 is a factor of 150 up or down."""


@dataclass(frozen=True)
class Normal(Law):
    """Normal law, log p = -(x - mean)²/(2 sd²) - log(sd √(2π)).

    Raises
    ------
    InputError
        If ``sd`` is not positive or a number is not finite.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "sd", self.sd > LEAST_WIDTH * abs(self.mean), f"a number above {LEAST_WIDTH * abs(self.mean):g}")

    @property
    def support(self) -> tuple[float, float]:
        """The real line."""
        return -math.inf, math.inf

    @property
    def median(self) -> float:
        """The mean."""
        return self.mean

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        return _standard_normal(_deviate(np.asarray(x, float), self.mean, self.sd)) - math.log(self.sd)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        return np.asarray(ndtr(_deviate(np.asarray(x, float), self.mean, self.sd)))

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        return self.mean + self.sd * np.asarray(ndtri(np.asarray(p, float)))


@dataclass(frozen=True)
class HalfNormal(Law):
    """Absolute value of a centred normal law, log p = log 2 - x²/(2 scale²) - log(scale √(2π)) for x >= 0.

    Raises
    ------
    InputError
        If ``scale`` is not positive and finite.
    """

    scale: float

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "scale", self.scale > 0, "a positive number")

    @property
    def support(self) -> tuple[float, float]:
        """From 0 upwards."""
        return 0.0, math.inf

    @property
    def median(self) -> float:
        """0.6745 times the scale."""
        return float(self.quantile(0.5))

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        x = np.asarray(x, float)
        inside = _standard_normal(_deviate(x, 0.0, self.scale)) + math.log(2.0 / self.scale)
        return np.where(x >= 0, inside, -np.inf)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        return 2.0 * np.asarray(ndtr(_deviate(np.maximum(np.asarray(x, float), 0.0), 0.0, self.scale))) - 1.0

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        return self.scale * np.asarray(ndtri(0.5 + 0.5 * np.asarray(p, float)))


@dataclass(frozen=True)
class Uniform(Law):
    """Uniform law between two bounds, log p = -log(high - low).

    Raises
    ------
    InputError
        If the bounds are not finite and in increasing order.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "high", self.high > self.low, f"a number above {self.low:g}")
        least = LEAST_WIDTH * max(abs(self.low), abs(self.high))
        require(self, "high", self.high - self.low >= least, f"a number at least {least:g} above {self.low:g}")

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    @property
    def median(self) -> float:
        """Midway between the bounds."""
        return 0.5 * (self.low + self.high)

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        x = np.asarray(x, float)
        return np.where((x >= self.low) & (x <= self.high), -math.log(self.high - self.low), -np.inf)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        return np.clip((np.asarray(x, float) - self.low) / (self.high - self.low), 0.0, 1.0)

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        return self.low + (self.high - self.low) * np.asarray(p, float)


@dataclass(frozen=True)
class LogUniform(Law):
    """Law whose logarithm is uniform between two bounds, log p = -log x - log(log(high / low)).

    Raises
    ------
    InputError
        If the bounds are not positive, finite and in increasing order.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "low", self.low > 0, "a positive number")
        least = self.low * (1.0 + LEAST_WIDTH)
        require(self, "high", self.high >= least, f"a number from {least!r}")

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    @property
    def median(self) -> float:
        """The geometric mean of the bounds."""
        return math.sqrt(self.low) * math.sqrt(self.high)

    @property
    def _width(self) -> float:
        return math.log(self.high) - math.log(self.low)

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        x = np.asarray(x, float)
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, -np.log(np.where(inside, x, 1.0)) - math.log(self._width), -np.inf)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        inside = np.clip(np.asarray(x, float), self.low, self.high)
        return (np.log(inside) - math.log(self.low)) / self._width

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        return np.clip(self.low * np.exp(self._width * np.asarray(p, float)), self.low, self.high)


@dataclass(frozen=True)
class LogNormal(Law):
    """Law whose logarithm is normal, optionally truncated on both sides of its median.

    log p = -log x - (log x - log median)²/(2 sd_log²) - log(sd_log √(2π)) - log Z, with Z the
    probability of the untruncated law between median (1 - bound) and median (1 + bound).

    Parameters
    ----------
    median
        Median before truncation, in the unit of x.
    sd_log
        Standard deviation of log x before truncation.
    bound
        Half-width of the support relative to the median, between 0 and 1; none without truncation.

    Raises
    ------
    InputError
        If the median or ``sd_log`` is not positive and finite or ``bound`` is not within (0, 1).
    """

    median: float
    sd_log: float
    bound: float | None = None

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "median", self.median > 0, "a positive number")
        require(self, "sd_log", SD_LOGS.holds(self.sd_log), str(SD_LOGS))
        wide = self.bound is None or LEAST_WIDTH <= self.bound < 1
        require(self, "bound", wide, f"a fraction from {LEAST_WIDTH:g} to below 1")

    @property
    def support(self) -> tuple[float, float]:
        """From 0 upwards, or the bounds of the truncation."""
        if self.bound is None:
            return 0.0, math.inf
        return self.median * (1.0 - self.bound), self.median * (1.0 + self.bound)

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        x = np.asarray(x, float)
        low, high = self.support
        inside = (x > 0) & (x >= low) & (x <= high) & (x < math.inf)
        return log_normal_density(x, inside, *self.constants)

    @property
    def constants(self) -> tuple[float, float, float]:
        """Log of the median, standard deviation of log x, and log of the normalising constant."""
        below, above = self._mass_limits
        return math.log(self.median), self.sd_log, math.log(self.sd_log * (above - below))

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        below, above = self._mass_limits
        inside = np.clip(np.asarray(x, float), *self.support)
        with np.errstate(divide="ignore"):
            return (np.asarray(ndtr(self._standardised(np.log(inside)))) - below) / (above - below)

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        below, above = self._mass_limits
        deviate = np.asarray(ndtri(below + (above - below) * np.asarray(p, float)))
        # rounding in ndtri could carry a draw past the truncation
        return np.clip(self.median * np.exp(self.sd_log * deviate), *self.support)

    @cached_property
    def _mass_limits(self) -> tuple[float, float]:
        low, high = self.support
        below = 0.0 if low == 0.0 else float(ndtr(self._standardised(np.asarray(math.log(low)))))
        return below, float(ndtr(self._standardised(np.asarray(math.log(high)))))

    def _standardised(self, log_x: FloatArray) -> FloatArray:
        return (log_x - math.log(self.median)) / self.sd_log


@dataclass(frozen=True)
class Truncated(Law):
    """Another law cut at two ends and normalised between them; its written form is that of the law."""

    law: Prior
    low: float
    high: float

    def __str__(self) -> str:
        return str(self.law)

    @property
    def support(self) -> tuple[float, float]:
        """Values that both the law and the ends allow."""
        low, high = self.law.support
        return max(low, self.low), min(high, self.high)

    @property
    def median(self) -> float:
        """The median of the law."""
        return self.law.median

    @cached_property
    def _ends(self) -> FloatArray:
        return self.law.cumulative(np.array(self.support))

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        x, (low, high) = np.asarray(x, float), self.support
        inside = (x >= low) & (x <= high)
        return np.where(inside, self.law.log_density(x) - math.log(self._ends[1] - self._ends[0]), -math.inf)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        return np.clip((self.law.cumulative(x) - self._ends[0]) / (self._ends[1] - self._ends[0]), 0.0, 1.0)

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        within = self._ends[0] + np.asarray(p, float) * (self._ends[1] - self._ends[0])
        return np.clip(self.law.quantile(within), *self.support)


def log_normal_density(
    x: FloatArray,
    inside: NDArray[np.bool_],
    log_median: float | FloatArray,
    sd_log: float | FloatArray,
    normalisation: float | FloatArray,
) -> FloatArray:
    """Return log densities of log-normal laws, one for all ``x`` or one for each place; -inf if not ``inside``."""
    log_x = np.log(np.where(inside, x, 1.0))
    return np.where(inside, _standard_normal((log_x - log_median) / sd_log) - log_x - normalisation, -np.inf)


def _deviate(x: FloatArray, mean: float, sd: float) -> FloatArray:
    # near the largest number the ratio overflows to inf, and the density is rightly zero there
    with np.errstate(over="ignore"):
        return (x - mean) / sd


def _standard_normal(deviate: FloatArray) -> FloatArray:
    # far in the tail the square overflows to inf and the density is rightly zero
    with np.errstate(over="ignore"):
        return -0.5 * deviate**2 - _LOG_ROOT_TWO_PI


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
