"""Checks of arguments, with one form of message: ranges of values and counts, and kinds of values."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, NoReturn

from softness_bayes.base.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Range:
    """Values from `low` to `high`, both included.

    Parameters
    ----------
    low, high
        The ends; an infinite end means no limit, and is not included.
    unit
        Unit of the ends and of the values.
    above
        Whether `low` itself is excluded.
    zero
        Whether 0 is allowed, too, although it is below `low`.
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    above: bool = False
    zero: bool = False

    def holds(self, value: float) -> bool:
        """Return whether `value` is a finite number in the range."""
        if not isinstance(value, Real) and getattr(value, "ndim", None) != 0:
            return False
        over = value > self.low if self.above else value >= self.low
        return math.isfinite(value) and ((over and value <= self.high) or (self.zero and value == 0))

    def within(self, factor: float, unit: str = "") -> Range:
        """Return the same range in another unit; one present unit is `factor` new ones."""
        return replace(self, low=self.low * factor, high=self.high * factor, unit=unit)

    def require(self, name: str, value: float) -> None:
        """Raise an error for a value outside the range.

        Raises
        ------
        InputError
            With name, value and range.
        """
        if not self.holds(value):
            given = value if isinstance(value, Real) else f"{value!r:.60}"
            raise InputError(f"{name} is {given}, expected {self}")

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "–") else ""
        low = "" if math.isinf(self.low) else f" {'above' if self.above else 'from'} {self.low:g}"
        if math.isinf(self.high):
            return f"a finite number{low}{unit}"
        if self.above:
            return f"a finite number{low} and at most {self.high:g}{unit}"
        return f"{'0, or ' if self.zero else ''}a number{low} to {self.high:g}{unit}"


ANY = Range()
"""Every finite number."""


@dataclass(frozen=True)
class Count(Range):
    """Whole numbers from `low` to `high`, both included; without `high` there is no limit."""

    low: int = 0
    high: int = sys.maxsize

    def holds(self, value: float) -> bool:
        """Return whether `value` is a whole number in the range."""
        unlimited = self.high == sys.maxsize
        return isinstance(value, Integral) and self.low <= int(value) and (unlimited or int(value) <= self.high)

    def __str__(self) -> str:
        return f"a whole number from {self.low}" + ("" if self.high == sys.maxsize else f" to {self.high}")


def require_kind(what: str, value: object, kind: type | tuple[type, ...], such_as: str) -> None:
    """Raise an error for an argument of the wrong type.

    Parameters
    ----------
    what
        Name of the argument.
    value
        The argument.
    kind
        Expected class or classes.
    such_as
        Expected kind of value, with an example.

    Raises
    ------
    InputError
        With name, value and what was expected.
    """
    if not isinstance(value, kind):
        refuse(what, value, such_as)


def require_members(what: str, value: object, members: Iterable[str], such_as: str) -> None:
    """Raise an error for an argument that lacks members; arguments, and what raises, as `require_kind`."""
    if not all(hasattr(value, member) for member in members):
        refuse(what, value, such_as)


def require_mapping(what: str, value: object, such_as: str) -> None:
    """Raise an error for an argument that is not a mapping; arguments, and what raises, as `require_kind`."""
    require_kind(what, value, Mapping, f"a mapping, as in {such_as}")


def numbers(what: str, value: Any, such_as: str = "numbers") -> NDArray[np.float64]:
    """Return an argument as an array of numbers.

    Raises
    ------
    InputError
        If it is not one, as `require_kind`.
    """
    import numpy as np

    try:
        if np.asarray(value).dtype.kind not in "US":  # texts, which NumPy would read as numbers
            return np.asarray(value, float)
    except (TypeError, ValueError):
        pass
    refuse(what, value, such_as)


def refuse(what: str, value: object, such_as: str) -> NoReturn:
    """Raise the error of an argument that is not what was expected.

    Raises
    ------
    InputError
        With name, value and what was expected.
    """
    raise InputError(f"{what}: expected {such_as}, got {value!r:.60} ({type(value).__name__})")


PARTICIPANTS = Count(1, 10_000)
"""Simulated raters."""
PANEL = Count(1, 10_000)
"""New raters whose mean rating is predicted."""
PORTS = Count(0, 65_535)
"""Ports of this machine; 0 means any free port."""
RANKED = Count(1, 2000)
"""Fabrics in a ranking; its table of pairs grows with the square of their number."""
FINGERS = Count(0, 10_000)
"""Simulated fingers under a rigid flat plate."""
SIMULATED_RATINGS = Count(1, 10_000_000)
"""Ratings of one simulation: participants times fabrics times loads."""
REPLICATES = Count(1, 1_000_000)
"""Simulated sets of ratings of a calibration."""
PRIOR_DRAWS = Count(0, 100_000)
"""Prior draws behind the probabilities of claims."""
STEPS = Count(1, 1_000_000_000)
"""Steps of each ensemble."""
STEPS_PER_TAU = Range(5.0, 1000.0)
"""Kept steps of each ensemble, in autocorrelation times."""
SEEDS = Count(0)
"""Seeds of random numbers."""
PROCESSES = Count(1, 256)
"""Parallel processes."""
ACCURACIES = Range(1e-6, 1e-2)
"""Bounds on the numerical error of the response, relative to its peak."""
LOAD_STEPS = Range(1e-9, 1e3)
"""Step sizes to which loads are rounded, in the unit of their column."""
RELATIVE_ERRORS = Range(0.0, 3.0)
"""Standard errors of a measured quantity relative to its value; 0 is exact."""
LOAD_ERRORS = Range(0.0, 0.3)
"""Standard errors of a load relative to its stated value; for larger ones, three nodes are not accurate."""
SHARED_LOAD_ERRORS, SHARED_MODULUS_ERRORS = Range(0.0, 0.1), Range(0.0, 0.5)
"""The same for an error shared by all ratings of a load; for larger ones, the response is no longer linear in it."""
CATEGORIES_RANGE = Count(2, 11)
"""Ordered categories of ratings."""
RESOLUTIONS = Range(1e-300, 1e300, zero=True)
"""Steps of the grids of numbers that raters use; 0 for exact numbers."""
NOISES = Range(0.0, 100.0, "µA/cm² √ms")
"""Strengths of the white-noise current of the membranes."""
TYPICAL_RATINGS = Range(1e-300, 1e300)
"""Typical ratings, exp(mu), of simulated magnitude estimates."""
SLOPES = Range(0.0, 1e6)
"""Slopes c1 of simulated z-scores."""
INDENTATIONS = Range(1e-9, 0.1, "m")
"""Permitted indentations of a fingertip; the model itself would compute far larger ones."""
GUESSES = Range(1e-6, 0.9, zero=True)
FREE_FORCES = Range(0.05, 20.0, "N")
FORCES = Range(1e-9, 1e3, "N")
"""Permitted contact forces of a fingertip."""
