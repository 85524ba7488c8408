"""Evaluation of polynomial series for inner loops: in place, orders along the first axis, points along the last.

Values at neighbouring points are then contiguous in memory, for coefficients and points alike.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def chebyshev_values(x: Array, order: int) -> Array:
    """Return T_k(x), k < order, along a new first axis."""
    basis = np.empty((order, *x.shape))
    basis[0], basis[1:2], twice = 1.0, x, 2.0 * x
    for k in range(2, order):
        np.multiply(twice, basis[k - 1], out=basis[k])
        basis[k] -= basis[k - 2]
    return basis


def clenshaw(coefficients: Array, x: Array) -> Array:
    """Return sum_k coefficients[k] T_k(x), each coefficients[k] of a shape that broadcasts to that of x."""
    twice = 2.0 * x
    ahead, further, product = np.zeros_like(x), np.zeros_like(x), np.empty_like(x)
    for c in coefficients[:0:-1]:
        # b_k = c_k + 2x b_{k+1} - b_{k+2}, in the place of b_{k+2}
        np.subtract(c, further, out=further)
        np.multiply(twice, ahead, out=product)
        further += product
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


@dataclass(frozen=True)
class TotalDegree:
    """Chebyshev products in some variables up to a total degree."""

    variables: int
    degree: int

    @cached_property
    def exponents(self) -> NDArray[np.intp]:
        """Degrees of every product, shape (variables, terms)."""
        every = itertools.product(range(self.degree + 1), repeat=self.variables)
        return np.array([e for e in every if sum(e) <= self.degree]).T

    @cached_property
    def _steps(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """For each further variable: where the products of the ones before it are found, and its degrees."""
        steps, exponents = [], self.exponents
        for k in range(self.variables - 1, 0, -1):
            before, place = np.unique(exponents[:k], axis=1, return_inverse=True)
            steps.append((place.reshape(-1), exponents[k]))
            exponents = before
        return steps[::-1]

    def basis(self, x: Array) -> Array:
        """Return the values of all products at points of shape (variables, n), shape (n, terms)."""
        values = chebyshev_values(x, self.degree + 1)
        product = values[:, 0]
        for k, (place, exponent) in enumerate(self._steps, 1):
            product = product.take(place, axis=0)
            product *= values[:, k].take(exponent, axis=0)
        return product.T
