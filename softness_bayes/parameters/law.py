"""Base of all prior laws: members, written form, and checks of constants."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.ranges import Range
from softness_bayes.supplied import PACKAGE, reference

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
