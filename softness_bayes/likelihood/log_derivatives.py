"""Derivatives of logarithms: of a function from those of the function itself, and of a sum of exponentials."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def derivatives_of_log(moments: list[FloatArray]) -> list[FloatArray]:
    """Return the derivatives of a logarithm, from those of its argument over the argument."""
    one, two, three, four, *others = moments
    square = one * one
    second = two - square
    third = three - one * (3.0 * second + square)
    fourth = four - (4.0 * one * third + 3.0 * second * (second + 2.0 * square) + square * square)
    found = [one, second, third, fourth]
    for n, moment in enumerate(others, len(found)):
        found.append(moment - sum(math.comb(n, k) * found[k] * moments[n - k - 1] for k in range(n)))
    return found


def weighted(weight: FloatArray, values: FloatArray) -> FloatArray:
    """Return the weighted sum along the first axis."""
    return np.einsum("k...,k...->...", weight, values)


def cumulants(
    weight: FloatArray, slope: FloatArray, bend: FloatArray, skew: FloatArray, curl: FloatArray
) -> tuple[FloatArray, ...]:
    """Return four derivatives of the log of a sum of exponentials.

    Parameters
    ----------
    weight
        Shares of the terms in the sum, which is along the first axis.
    slope, bend, skew
        Derivatives of each term's exponent; the first two are overwritten.
    curl
        The mean of their fourth derivatives.
    """
    first, second = weighted(weight, slope), weighted(weight, bend)
    slope -= first
    bend -= second
    square = slope * slope
    variance = weighted(weight, square)
    third = weighted(weight, skew + slope * (3.0 * bend + square))
    fourth = weighted(weight, 4.0 * slope * skew + 3.0 * bend * bend + square * (6.0 * bend + square))
    return first, second + variance, third, fourth + (curl - 3.0 * variance * variance)
