"""Sums of polynomials as the inner loops take them: in place, and with the points along the last axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    """Return sum_k coefficients[..., k] T_k(x), x with one axis more than the coefficients' batch."""
    twice = 2.0 * x
    ahead, further = np.zeros_like(x), np.zeros_like(x)
    for k in range(coefficients.shape[-1] - 1, 0, -1):
        # b_k = c_k + 2x b_{k+1} - b_{k+2}, in the place of b_{k+2}
        np.subtract(coefficients[..., k, None], further, out=further)
        further += twice * ahead
        ahead, further = further, ahead
    return coefficients[..., 0, None] + x * ahead - further


def horner(coefficients: ArrayLike, x: Array) -> Array:
    """Return sum_k coefficients[..., k] x^k, evaluated in place: one pass over memory for each operation."""
    c = np.asarray(coefficients)
    result = np.empty_like(x)
    result[...] = c[..., -1]
    for k in range(c.shape[-1] - 2, -1, -1):
        result *= x
        result += c[..., k]
    return result
