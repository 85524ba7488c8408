"""Inputs of the integrals over raters' scales: parameters, and groups of similar rows sorted by rater."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.interval_law import Rows, in_single

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]
T = TypeVar("T")

WIDE = 0.6
"""Width of intervals, as a difference of logs, beyond which their midpoints are a poor approximation."""

ROUNDED = 0.05
"""Width of the widest interval, in spreads, below which all are computed in double precision, as exact numbers are."""

TINY = 0.03
"""Spread of errors below which log densities are so large, where the residuals are not as small, that single precision
loses the digits of 1e-3."""

NEARLY_NORMAL = 1.0 - 1e-4
"""Smooth length of a law from which it is computed in double precision, as its limit, the normal law."""

_MOST_KNOWN = 100  # results that are kept at most
_WIDTHS = 1e-12, 0.25, WIDE, 1e300  # limits between groups: exact numbers, intervals, half-open intervals


class LawParameters(NamedTuple):
    """Parameters of the error laws, each an array (draws,), or with trailing axes of length 1."""

    nu: FloatArray
    lapse: FloatArray

    def single(self) -> LawParameters:
        """Return the parameters in single precision."""
        return LawParameters(*map(in_single, self))

    def at_points(self) -> LawParameters:
        """Return the parameters with an axis of points after that of draws."""
        return LawParameters(self.nu[:, None], self.lapse[:, None])


class HasParts(Protocol):
    """Arrays with an axis of draws."""

    def part(self, piece: Any) -> Self:
        """Return some of the draws."""


class OwnSpreads(NamedTuple):
    """Spreads of raters' log exponents and of their log noise, each (draws, 1)."""

    exponent: FloatArray
    noise: FloatArray

    def part(self, piece: Any) -> OwnSpreads:
        """Return some of the draws."""
        return OwnSpreads(*(one[piece] for one in self))


class RowParameters(NamedTuple):
    """Parameters of a batch of points, each with a first axis of draws."""

    drive: FloatArray
    """Drive of every row, sorted by rater, shape (draws, rows)."""
    tau: FloatArray
    """Shape (draws, 1)."""
    spread: FloatArray
    """Spread of single errors, shape (draws, 1), or (draws, rows) if raters have noise of their own."""
    parameters: LawParameters
    """Those of the error law."""
    rows: Rows
    """Every row, sorted by rater."""
    middle: FloatArray
    """A number inside of each row's interval, from which Newton's method starts, shape (rows,) or (draws, rows)."""
    omega: FloatArray
    """Spread of fabrics' deviations, which `fabric_integrals` alone uses, shape (draws, 1)."""
    own: OwnSpreads | None = None
    """Spreads of raters' own exponents and noise, if these differ."""

    @property
    def deviating(self) -> bool:
        """True if fabrics have deviations in any draw."""
        return bool((self.omega > 0.0).any())

    def in_single(self, law: ErrorLaw, widest: float) -> bool:
        """Return whether single precision is enough, given the widest interval.

        It is not if all probabilities are nearly densities of a normal law: the closed form is their limit. Nor is its
        range if errors are tiny.
        """
        spread = float(self.spread.min())
        rounded = widest > ROUNDED * spread
        return spread > TINY and (rounded or float(law.smooth(self.parameters).max()) < NEARLY_NORMAL)

    def part(self, piece: Any) -> RowParameters:
        """Return some of the draws."""
        if isinstance(piece, slice) and piece == slice(0, len(self.drive)):
            return self
        of, middle = self.parameters, self.middle
        return RowParameters(
            self.drive[piece],
            self.tau[piece],
            self.spread[piece],
            LawParameters(*(v[piece] for v in of)),
            self.rows.part(piece),
            middle if middle.ndim == 1 else middle[piece],
            self.omega[piece],
            None if self.own is None else self.own.part(piece),
        )


class WidthGroup(NamedTuple):
    """Rows with intervals of similar width."""

    rows: IndexArray | slice
    """Indices of the rows, sorted by rater; a slice if these are all rows."""
    size: int
    """Number of the rows."""
    first: IndexArray
    """Places of the first row of each rater among these."""
    sizes: IndexArray
    """Number of rows of each of these raters."""
    raters: IndexArray | slice
    """Raters who have any; a slice if these are all raters."""
    times: FloatArray | None
    """Multiplicity of each row; None if all count once."""

    def of_rows(self, values: FloatArray) -> FloatArray:
        """Return the value of each row's rater, (..., rows), from those of all raters, (..., raters)."""
        return np.repeat(values[..., self.raters], self.sizes, axis=-1)

    def of_raters(self, values: FloatArray, exactly: bool = True) -> FloatArray:
        """Return the sums of these rows (..., rows) by rater, shape (..., raters).

        Those of single precision are added up in double precision if they are to be had `exactly`.
        """
        values = values if self.times is None else values * self.times.astype(values.dtype)
        return np.add.reduceat(values, self.first, axis=-1, dtype=float if exactly else None)

    def sums(self, values: Sequence[FloatArray]) -> FloatArray:
        """Return `of_raters` of several values, shape (values, ..., raters), the first of them exactly."""
        return np.stack([self.of_raters(one, exactly=k == 0) for k, one in enumerate(values)])


def groups_by_width(rater: IndexArray, width: FloatArray, times: FloatArray) -> list[WidthGroup]:
    """Return groups of rows with intervals of similar width; rows with multiplicity 0 are omitted.

    Parameters
    ----------
    rater
        Rater of each row, sorted, without gaps, shape (rows,).
    width
        Width of each row's interval, infinite if it has only one finite end.
    times
        Multiplicity of each row.
    """
    kind, found = np.digitize(width, _WIDTHS), []
    for k in np.unique(kind[times > 0]):
        rows = np.flatnonzero((kind == k) & (times > 0))
        raters, first, sizes = np.unique(rater[rows], return_index=True, return_counts=True)
        own = times[rows]
        group = WidthGroup(rows, rows.size, first, sizes, raters, None if (own == 1.0).all() else own)
        # views are faster than copies
        group = group._replace(rows=slice(None)) if rows.size == rater.size else group
        found.append(group._replace(raters=slice(None)) if raters.size == rater[-1] + 1 else group)
    return found


class Kept(Generic[T]):
    """Results for sets of rows, which are kept for further use, but left out of copies for other processes."""

    def __init__(self) -> None:
        self._known: dict[bytes, T] = {}

    def __call__(self, of: NDArray[Any], make: Callable[[], T]) -> T:
        """Return the result for an array, such as a mask of rows; `make` computes a new one."""
        key = of.tobytes()
        if key not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[key] = make()
        return self._known[key]

    def __reduce__(self) -> tuple[type[Kept[T]], tuple[()]]:
        return type(self), ()


def of_two_kinds(
    rater: IndexArray, closed: NDArray[np.bool_], chosen: NDArray[np.bool_], times: FloatArray
) -> list[WidthGroup]:
    """Return groups of chosen rows: those whose intervals have two finite ends, and others.

    Parameters
    ----------
    rater, times
        As for `groups_by_width`.
    closed
        True for rows with two finite ends, shape (rows,).
    chosen
        True for chosen rows.
    """
    return groups_by_width(rater, np.where(closed, WIDE, np.inf), np.where(chosen, times, 0.0))


def times_of(*keys: FloatArray | IndexArray) -> FloatArray:
    """Return the number of rows with equal keys, (rows,), at the first of them, and 0 at the others."""
    _, first, count = np.unique(np.stack(keys, axis=1), axis=0, return_index=True, return_counts=True)
    found = np.zeros(len(keys[0]))
    found[first] = count
    return found


def robust_weights(values: FloatArray, rater: IndexArray, condition: IndexArray) -> FloatArray:
    """Return weights of rows that fall with their distance from the medians of their raters and conditions."""
    left = values.copy()
    for _ in range(2):
        for index in (rater, condition):
            order = np.argsort(index, kind="stable")
            parts = np.split(order, np.flatnonzero(np.diff(index[order])) + 1)
            for part in parts:
                left[part] -= np.median(left[part])
    scale = 1.5 * np.median(np.abs(left))
    return np.ones(values.size) if not scale > 0 else 1.0 / (1.0 + 0.25 * (left / scale) ** 2)
