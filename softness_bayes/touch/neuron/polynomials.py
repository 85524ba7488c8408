"""Evaluation of polynomial series for inner loops: in place, orders along the first axis, points along the last.

Values at neighbouring points are then contiguous in memory, for coefficients and points alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def chebyshev_values(x: Array, order: int) -> Array:
    """Return T_k(x), k < order, along a new first axis."""
    basis = np.empty((order, *x.shape))
    basis[0], basis[1:2] = 1.0, x
    twice = 2.0 * x
    for k in range(2, order):
        np.multiply(twice, basis[k - 1], out=basis[k])
        basis[k] -= basis[k - 2]
    return basis


def clenshaw(coefficients: Array, x: Array) -> Array:
    """Return sum_k coefficients[k] T_k(x), each coefficients[k] of a shape that broadcasts to that of x."""
    twice = 2.0 * x
    ahead, further = np.zeros_like(x), np.zeros_like(x)
    for c in coefficients[:0:-1]:
        # b_k = c_k + 2x b_{k+1} - b_{k+2}, in the place of b_{k+2}
        np.subtract(c, further, out=further)
        further += twice * ahead
        ahead, further = further, ahead
    return coefficients[0] + x * ahead - further


def horner(coefficients: Array, x: Array) -> Array:
    """Return sum_k coefficients[k] x^k, each coefficients[k] of a shape that broadcasts to that of x.

    It is evaluated in place: one pass over memory for each operation.
    """
    result = np.empty_like(x)
    result[...] = coefficients[-1]
    for c in coefficients[-2::-1]:
        result *= x
        result += c
    return result
