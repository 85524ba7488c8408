"""Coefficients of the log mean density over a narrow interval, and of its derivatives in the middle (model.md 9).

With t = 1/nu, p = 1/(1 + t u²), z = p u² and H = p h², the log of the mean of Student's t density over an interval of
half-width h about u is that of the density itself plus a sum of H^j times polynomials of z. Its even derivatives have
the same form; its odd ones are p u times such sums. The normal law is the case t = 0.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

POWERS = 4, 3, 3, 1, 1
"""Largest power of H in the series of the value, and of each derivative. The errors of many ratings' values add up,
whereas those of derivatives matter only about the mode."""

WIDEST, STEEPEST = 0.7, 0.8
"""Largest half-width of the intervals whose probability is a series, in the smooth length of the law, and largest
square of the change of the log density over it."""

FLAT = 1.1
"""Largest square of that change where Student's log density is steepest, up to which no row is too steep: the heavier
tails are, the faster the series converges."""

# polynomials of t and z are arrays (powers of t, powers of z)
_Z, _T = np.array([[0.0, 1.0]]), np.array([[0.0], [1.0]])
_C = np.array([[1.0], [1.0]])  # 1 + t
_P = np.array([[1.0, 0.0], [0.0, -1.0]])  # p = 1 - t z


@cache
def series(powers: tuple[int, ...] = POWERS) -> tuple[tuple[FloatArray, ...], ...]:
    """Return the coefficients for each derivative, from the value on: an array (powers of t, powers of z) for each H^j.

    The log of the density itself is no such sum: for the value, the array for H^0 is zero.
    """
    parts = _value(max(powers))
    found = [(np.zeros((1, 1)), *parts[1 : 1 + powers[0]])]
    odd = [-_C, *(_slope(part, j) for j, part in enumerate(parts[1:], 1))]
    for k, power in enumerate(powers[1:], 1):
        even = k % 2 == 0
        if k > 1:
            odd = [(_bend if even else _slope)(part, j) for j, part in enumerate(odd)]
        found.append(tuple(_trimmed(part) for part in odd[: 1 + power]))
    return tuple(found)


def _value(power: int) -> list[FloatArray]:
    """Return the polynomials of z that multiply the powers of H in the value, from H^0 = 1 on (unused).

    With m_k = f^(k)/f, the mean of the density over f is 1 + h² m_2/3! + h⁴ m_4/5! + ... . Leibniz's rule for
    (1 + t u²) f' = -(1 + t) u f gives each m from the two before it: m_2n is p^n times a polynomial of z, and
    m_(2n+1) is u p^(n+1) times another.
    """
    even, odd, mean = np.ones((1, 1)), -_C, [np.ones((1, 1))]
    for n in range(1, power + 1):
        k = 2 * n - 1
        even = -_plus(_times(_plus(_C, 2 * k * _T), _Z, odd), k * _times(_plus(_C, (k - 1) * _T), even))
        odd = -_plus(_times(_plus(_C, 2 * (k + 1) * _T), even), (k + 1) * _times(_plus(_C, k * _T), odd))
        mean.append(even / math.factorial(2 * n + 1))
    # the logarithm of a power series
    found = [np.ones((1, 1))]
    for n in range(1, power + 1):
        part = mean[n]
        for i in range(1, n):
            part = _plus(part, -i / n * _times(found[i], mean[n - i]))
        found.append(part)
    return found


def _slope(even: FloatArray, j: int) -> FloatArray:
    """Return O, where p u H^j O is the derivative of H^j times an even polynomial.

    dH/du = -2 t p u H, dz/du = 2 p² u.
    """
    return _plus(-2.0 * j * _times(_T, even), 2.0 * _times(_P, _by_z(even)))


def _bend(odd: FloatArray, j: int) -> FloatArray:
    """Return the even polynomial that, times H^j, is the derivative of p u H^j times another.

    d(p u)/du = p (2 p - 1).
    """
    return _plus(_times(_P, _plus(2.0 * _P, -np.ones((1, 1))), odd), _times(_Z, _P, _slope(odd, j)))


def _by_z(values: FloatArray) -> FloatArray:
    """Return the derivative of a polynomial in z."""
    return np.asarray(values[:, 1:] * np.arange(1, values.shape[1])) if values.shape[1] > 1 else np.zeros((1, 1))


def _plus(one: FloatArray, other: FloatArray) -> FloatArray:
    found = np.zeros(np.maximum(one.shape, other.shape))
    for part in (one, other):
        found[: part.shape[0], : part.shape[1]] += part
    return found


def _trimmed(values: FloatArray) -> FloatArray:
    """Return the polynomial without powers of z whose coefficients are zero."""
    return values[:, : 1 + max(np.flatnonzero(values.any(axis=0)), default=0)]


def _times(first: FloatArray, *others: FloatArray) -> FloatArray:
    """Return the product of polynomials in two variables."""
    # `scipy.signal` has this, but imports all of `scipy.stats`, which delays the start of every command
    for other in others:
        rows, columns = other.shape
        product = np.zeros((len(first) + rows - 1, first.shape[1] + columns - 1))
        for (i, k), factor in np.ndenumerate(first):
            product[i : i + rows, k : k + columns] += factor * other
        first = product
    return first
