"""Prior laws: frozen values with a normalised density and a written form."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import Range
from softness_bayes.base.supplied import PACKAGE, reference

FloatArray = NDArray[np.float64]


NUMBERS = Range(-1e100, 1e100)
"""Range of the constants of a law, within which no computation overflows."""
LEAST_WIDTH = 1e-6
"""Smallest width of a law relative to its location; narrower laws would be lost to rounding errors."""


class Prior(Protocol):
    """A prior of one real quantity; a new one is a frozen dataclass with these members, listed in `priors.LAWS`."""

    @property
    def median(self) -> float:
        """Median of the law, before any truncation."""

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value with positive density."""

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log of the normalised density at ``x``, same shape; -inf outside the support."""

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability of a value up to ``x``, same shape."""

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value up to which the probability is ``p``, same shape: the inverse of `cumulative`."""

    def draw(self, rng: np.random.Generator, size: int | tuple[int, ...]) -> FloatArray:
        """Return independent draws of shape ``size``."""


class Law(ABC):
    """Base of all laws, with draws by inversion and the written form that `parse_prior` reads."""

    @abstractmethod
    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value up to which the probability is ``p``."""

    def draw(self, rng: np.random.Generator, size: int | tuple[int, ...]) -> FloatArray:
        """Return independent draws of shape ``size``."""
        return self.quantile(rng.uniform(np.finfo(float).tiny, 1.0, size))

    def __str__(self) -> str:
        arguments = (getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]
        return f"{name_of(type(self))}({','.join(_written(a) for a in arguments if a is not None)})"


def in_short(prior: Prior) -> str:
    """Return a prior with its numbers to four digits; ``str`` gives all digits."""
    if "law" in (field.name for field in fields(prior)):  # type: ignore[arg-type]
        return f"{str(prior)[0]}{in_short(prior.law)}" if str(prior).startswith("±") else in_short(prior.law)  # type: ignore[attr-defined]
    numbers = (getattr(prior, field.name) for field in fields(prior))  # type: ignore[arg-type]
    return f"{name_of(type(prior))}({','.join(f'{a:.4g}' for a in numbers if a is not None)})"


def name_of(law: type) -> str:
    """Return the name of a kind of law in written forms; for a custom law, its importable name if it has one."""
    own = law.__module__.partition(".")[0] != PACKAGE
    return (reference(law) if own else None) or law.__name__.lower()


def _written(number: float) -> str:
    return repr(float(number)).removesuffix(".0")


def require_finite(prior: Law) -> None:
    """Raise an error for a constant that is not within `NUMBERS`."""
    for field in fields(prior):  # type: ignore[arg-type]
        value = getattr(prior, field.name)
        none = value is None and field.default is None
        require(prior, field.name, none or NUMBERS.holds(value), str(NUMBERS))


def require(prior: Law, name: str, holds: bool, expected: str) -> None:
    """Raise an error that names a constant, unless its requirement holds."""
    if not holds:
        raise InputError(f"{name_of(type(prior))}: {name} is {getattr(prior, name)!s:.60}, expected {expected}")


LOG_TWO_PI = math.log(2.0 * math.pi)
"""Minus twice the log density of the standard normal law at 0."""

SD_LOGS = Range(LEAST_WIDTH, 5.0)
"""Standard deviations of the logarithm of a log-normal law; 5 is a factor of 150 up or down."""


def _middle(law: Law) -> float:
    """Median of the law."""
    return float(law.quantile(0.5))


class Standardised(Law):
    """A law of x = location + scale u, or location exp(scale u), where u has a standard law cut to the support.

    log p = log f(u) + log |du/dx| - log Z, with f the density of the standard normal or uniform law and Z its
    probability of the support.
    """

    logarithmic: ClassVar[bool] = False
    """True if x = location exp(scale u)."""
    uniform: ClassVar[bool] = False
    """True if u is uniform on [0, 1], false if it is standard normal."""

    @property
    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Smallest and largest value with positive density."""

    @abstractmethod
    def standard(self) -> tuple[float, float]:
        """Return location and scale."""

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the log density at ``x``."""
        x, (low, high), (location, scale) = np.asarray(x, float), self.support, self.standard()
        inside = (x >= low) & (x <= high)
        if self.logarithmic:
            inside &= (x > 0) & (x < math.inf)
        at = np.where(inside, x, location)
        with np.errstate(over="ignore"):  # far in the tail the square overflows, and the density is rightly zero
            density = np.zeros_like(at) if self.uniform else -0.5 * self._score(at) ** 2 - 0.5 * LOG_TWO_PI
        if self.logarithmic:
            density = density - np.log(at)
        return np.where(inside, density - math.log(scale * (self._shares[1] - self._shares[0])), -np.inf)

    def cumulative(self, x: ArrayLike) -> FloatArray:
        """Return the probability up to ``x``."""
        below, above = self._shares
        return (self._share(np.clip(np.asarray(x, float), *self.support)) - below) / (above - below)

    def quantile(self, p: ArrayLike) -> FloatArray:
        """Return the value at probability ``p``."""
        (below, above), (location, scale) = self._shares, self.standard()
        share = below + (above - below) * np.asarray(p, float)
        score = scale * (share if self.uniform else np.asarray(ndtri(share)))
        # rounding could carry a draw past the ends
        return np.clip(location * np.exp(score) if self.logarithmic else location + score, *self.support)

    @cached_property
    def _shares(self) -> tuple[float, float]:
        """Probabilities of the standard law below the ends of the support."""
        below, above = self._share(np.array(self.support))
        return float(below), float(above)

    def _share(self, x: FloatArray) -> FloatArray:
        return np.asarray(self._score(x) if self.uniform else ndtr(self._score(x)))

    def _score(self, x: FloatArray) -> FloatArray:
        location, scale = self.standard()
        # near the largest number the ratio overflows to inf, and the density is rightly zero there
        with np.errstate(over="ignore", divide="ignore"):
            return (np.log(x) - math.log(location) if self.logarithmic else x - location) / scale


@dataclass(frozen=True)
class Normal(Standardised):
    """Normal law, log p = -(x - mean)²/(2 sd²) - log(sd √(2π)).

    Raises
    ------
    InputError
        If ``sd`` is not positive or a number is not finite.
    """

    mean: float
    sd: float
    support: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    median = property(_middle)

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "sd", self.sd > LEAST_WIDTH * abs(self.mean), f"a number above {LEAST_WIDTH * abs(self.mean):g}")

    def standard(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        return self.mean, self.sd


@dataclass(frozen=True)
class HalfNormal(Standardised):
    """Absolute value of a centred normal law, log p = log 2 - x²/(2 scale²) - log(scale √(2π)) for x >= 0.

    Raises
    ------
    InputError
        If ``scale`` is not positive and finite.
    """

    scale: float
    support: ClassVar[tuple[float, float]] = (0.0, math.inf)
    median = property(_middle)

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "scale", self.scale > 0, "a positive number")

    def standard(self) -> tuple[float, float]:
        """Return 0 and the scale."""
        return 0.0, self.scale


@dataclass(frozen=True)
class Uniform(Standardised):
    """Uniform law between two bounds, log p = -log(high - low).

    Raises
    ------
    InputError
        If the bounds are not finite and in increasing order.
    """

    low: float
    high: float
    uniform: ClassVar[bool] = True
    median = property(_middle)

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "high", self.high > self.low, f"a number above {self.low:g}")
        least = LEAST_WIDTH * max(abs(self.low), abs(self.high))
        require(self, "high", self.high - self.low >= least, f"a number at least {least:g} above {self.low:g}")

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    def standard(self) -> tuple[float, float]:
        """Return the lower bound and the width."""
        return self.low, self.high - self.low


@dataclass(frozen=True)
class LogUniform(Standardised):
    """Law whose logarithm is uniform between two bounds, log p = -log x - log(log(high / low)).

    Raises
    ------
    InputError
        If the bounds are not positive, finite and in increasing order.
    """

    low: float
    high: float
    logarithmic: ClassVar[bool] = True
    uniform: ClassVar[bool] = True
    median = property(_middle)

    def __post_init__(self) -> None:
        require_finite(self)
        require(self, "low", self.low > 0, "a positive number")
        least = self.low * (1.0 + LEAST_WIDTH)
        require(self, "high", self.high >= least, f"a number from {least!r}")

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    def standard(self) -> tuple[float, float]:
        """Return the lower bound and the width of the logarithm."""
        return self.low, math.log(self.high) - math.log(self.low)


@dataclass(frozen=True)
class LogNormal(Standardised):
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
    logarithmic: ClassVar[bool] = True

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

    def standard(self) -> tuple[float, float]:
        """Return the median and the standard deviation of the logarithm."""
        return self.median, self.sd_log


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


@dataclass(frozen=True)
class Signed(Law):
    """The law of a quantity whose magnitude has a positive law: either sign has probability 1/2."""

    law: Prior
    support: ClassVar[tuple[float, float]] = (-math.inf, math.inf)

    def __str__(self) -> str:
        return f"±{self.law}"

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


def magnitude(prior: Prior) -> Prior:
    """Return the law of a quantity's magnitude: its prior, or the one inside a `Signed` law."""
    return prior.law if isinstance(prior, Signed) else prior
