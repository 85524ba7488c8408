"""The density to sample, and the points at which it could not be computed: counted, recorded, of zero density."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import NumericalError

FloatArray = NDArray[np.float64]
Value = TypeVar("Value")

KEPT = 1000
"""Largest number of points kept in a record; further ones are only counted."""

_LEAST = 10_000  # smallest denominator of the share of failures, so that a few failures are always allowed


class TargetDensity(Protocol):
    """A density to sample, in coordinates that are unbounded on every axis.

    A target may have further members:

    ``for_sampling``
        The target that is sampled: the same density, which may be less accurate where it is too small to matter.
    ``n_linear``
        Number of last coordinates that are nearly linear in the others; a map has fewer coefficients for these
        (`adaptation.TriangularMap.fit`).
    ``failing_stage(z)``
        Name of the first stage without a finite result at one point ``z``, shape (dimension,).
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    def natural(self, z: FloatArray) -> FloatArray:
        """Parameters [natural units] at coordinates ``z``, both of shape (..., dimension)."""

    def __call__(self, z: FloatArray) -> FloatArray:
        """Log density, shape (points,), at ``z`` of shape (points, dimension)."""

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Draw dispersed points of finite density from which optimisations may start, shape (size, dimension)."""


class Failure(NamedTuple):
    """One point at which the density could not be computed."""

    point: tuple[float, ...]
    """Sampler coordinates."""
    stage: str
    """The stage that failed."""


@dataclass(frozen=True)
class Nonfinite:
    """Number of evaluations of a density, and the points at which it could not be computed.

    Parameters
    ----------
    evaluations
        Points at which it was evaluated.
    count
        Points at which it was NaN or plus infinity.
    failures
        The first `KEPT` of them.
    """

    evaluations: int = 0
    count: int = 0
    failures: tuple[Failure, ...] = ()

    def __add__(self, other: Nonfinite) -> Nonfinite:
        failures = (*self.failures, *other.failures)[:KEPT]
        return Nonfinite(self.evaluations + other.evaluations, self.count + other.count, failures)

    @property
    def share(self) -> float:
        """Share of the evaluations that failed; fewer than ten thousand evaluations count as ten thousand."""
        return self.count / max(self.evaluations, _LEAST)

    def sentence(self, names: Sequence[str], natural: Callable[[FloatArray], FloatArray]) -> str:
        """Describe the number of failures, with the first one in natural units; empty if there are none."""
        if not self.failures:
            return ""
        first = natural(np.array(self.failures[0].point))
        point = ", ".join(f"{name}={value!r}" for name, value in zip(names, first.tolist(), strict=True))
        return (
            f"the density could not be computed at {self.count} of {self.evaluations} points, "
            f"first at {point} ({self.failures[0].stage})"
        )


class Watched:
    """A target whose failures are recorded in `found` and have density zero, so that they are never accepted.

    A target fails if it returns NaN or plus infinity, or raises an arithmetic error; minus infinity is a density of
    zero. This object is called like the target and delegates all other members to it.
    """

    def __init__(self, target: TargetDensity) -> None:
        self._target, self.found = target, Nonfinite()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._target, name)

    def __call__(self, z: FloatArray) -> FloatArray:
        """Return the log density at ``z`` (points, dimension), shape (points,): minus infinity at failures."""
        raised: dict[int, str] = {}
        try:
            value = np.array(self._target(z), float)
        except (ArithmeticError, np.linalg.LinAlgError):
            value = np.full(len(z), np.nan)
            for i in range(len(z)):
                try:
                    value[i] = self._target(z[i : i + 1])[0]
                except (ArithmeticError, np.linalg.LinAlgError) as error:
                    raised[i] = str(error)
        wrong = np.isnan(value) | np.isposinf(value)
        if wrong.any():
            stage = getattr(self._target, "failing_stage", lambda z: "density")
            indices = np.flatnonzero(wrong)[:KEPT].tolist()
            failures = tuple(Failure(tuple(z[i].tolist()), raised.get(i) or stage(z[i])) for i in indices)
            self.found += Nonfinite(0, int(wrong.sum()), failures)
            value[wrong] = -np.inf
        self.found += Nonfinite(len(value))
        return value


def watching(target: TargetDensity, work: Callable[..., Value], *task: Any) -> tuple[Value, Nonfinite]:
    """Return ``work(target, *task)``, with the target as it is sampled, and the failures of the target during it.

    Raises
    ------
    NumericalError
        If raised by the work; the failures so far are added to the message.
    """
    watched = Watched(getattr(target, "for_sampling", target))
    try:
        return work(watched, *task), watched.found
    except NumericalError as error:
        said = watched.found.sentence(target.names, target.natural)
        raise NumericalError(f"{error}; {said}" if said else str(error)) from None
