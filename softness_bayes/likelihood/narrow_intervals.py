"""Log densities averaged over narrow intervals, and their derivatives, row by row (model.md 9).

One density in the middle and the series of `narrow_series` replace two distribution functions. All arrays may have
single precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import student
from softness_bayes.likelihood.narrow_series import series

FloatArray = NDArray[np.float64]

NORMAL_ORDERS = 3
"""Number of derivatives of normal errors, the value included; others are of the order of h⁴."""

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


def averaged(errors: FloatArray, square: FloatArray | None, nu: FloatArray | None = None) -> tuple[FloatArray, ...]:
    """Return the log of the mean density over intervals, and its derivatives in their middles.

    Parameters
    ----------
    errors
        Middles of the intervals in spreads, shape (..., rows).
    square
        Squares of their half-widths in spreads, of the same shape; None for exact numbers.
    nu
        Degrees of freedom of Student's t, shape (..., 1); None for normal errors.

    Returns
    -------
    tuple of ndarray
        Value and derivatives, each (..., rows): four derivatives of Student's t, two of normal errors.
    """
    z, high = errors * errors, np.zeros(1, errors.dtype) if square is None else square
    if nu is None:
        slope, value = errors, -0.5 * z
        value -= _LOG_ROOT_TWO_PI
        every = [[part[0].tolist() for part in parts] for parts in _series(square is not None)[:NORMAL_ORDERS]]
    else:
        p = z / nu
        value = student.log_one_plus(p, nu)
        value *= -0.5 * (nu + 1.0)
        value += student.log_constant(nu).astype(errors.dtype)
        p += 1.0
        np.divide(1.0, p, out=p)
        slope = errors * p
        z *= p
        high = p * high
        every = _coefficients(square is not None, nu, errors.dtype)
    found = []
    for n, parts in enumerate(every):
        whole = _polynomial([_polynomial(part, z) for part in parts], high)
        found.append(whole * slope if n % 2 else value + whole if n == 0 else whole)
    return tuple(found)


@cache
def _series(rounded: bool) -> tuple[tuple[FloatArray, ...], ...]:
    """Return the coefficients of `series`; of exact numbers only those without a power of H."""
    return series() if rounded else tuple(parts[:1] for parts in series())


def _coefficients(rounded: bool, nu: FloatArray, kind: Any) -> list[list[list[FloatArray]]]:
    """Return the coefficients of each derivative, power of H and power of z, for degrees of freedom (..., 1)."""
    table = _table(rounded)
    values = np.vander(1.0 / nu.ravel().astype(float), len(table), increasing=True) @ table
    each = iter(values.T.astype(kind).reshape(-1, *nu.shape))
    return [[[next(each) for _ in range(part.shape[1])] for part in parts] for parts in _series(rounded)]


@cache
def _table(rounded: bool) -> FloatArray:
    """Return all coefficients together, shape (powers of t, coefficients)."""
    every = [part for parts in _series(rounded) for part in parts]
    rows = max(len(part) for part in every)
    return np.concatenate([np.pad(part, ((0, rows - len(part)), (0, 0))) for part in every], axis=1)


def _polynomial(coefficients: Sequence[Any], x: FloatArray) -> Any:
    """Return a polynomial of x, given its coefficients from the constant on."""
    found = coefficients[-1]
    for k, coefficient in enumerate(coefficients[-2::-1]):
        if k:
            found *= x
        else:
            found = found * x
        found += coefficient
    return found
