"""Resolutions and rules of the quadrature over raters' scales and the level (model.md 9)."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw

FloatArray = NDArray[np.float64]


class Quadrature(NamedTuple):
    """Resolution of the integrals over raters' scales and the level."""

    points: int
    """Chebyshev points at which a rater's log density is computed; 0 to use only derivatives at one point."""
    scales: int
    """Nodes of each rater's scale."""
    levels: int
    """Nodes of the level."""
    settled: float
    """Newton's method stops once no rater's mode moves by more than this, in its standard deviations."""
    maxima: bool = True
    """True to integrate raters' densities with several maxima over all of these (`several_maxima`)."""

    @property
    def fast(self) -> bool:
        """True if this is `FAST`, with or without a search for several maxima."""
        return self._replace(maxima=True) == FAST


FAST = Quadrature(0, 5, 3, 1.0)
"""Quadrature for raters with many ratings each."""
SAMPLING = FAST._replace(maxima=False)
"""The same for sampling: all proposals far from the data are rejected, whatever the error of their density."""
FINE = Quadrature(24, 13, 9, 0.05)
"""Quadrature for raters with few ratings, and reference for the error of `FAST`."""
FINEST = Quadrature(40, 13, 13, 0.01)
"""Reference for the error of `FINE`."""

ROUGHLY = Quadrature(12, 9, 5, 0.6)
"""Quadrature for parameters far from the data, where derivatives are not accurate enough."""
DENSE, DENSER = Quadrature(0, 9, 0, 0.35), Quadrature(0, 13, 0, 0.2)
"""Resolution of `dense_integrals.DenseIntegrals`, and reference for its error: nodes of zeta, and spacing of points in
standard deviations."""

MANY_ROWS, FEW_ROWS = 20, 10
"""Smallest number of ratings per rater for which `FAST` is used, and below which heavy tails need `DENSE`."""


def quadrature_for(count: FloatArray) -> Quadrature:
    """Return the quadrature for the given numbers of ratings per rater, shape (raters,)."""
    return FINE if count.min() < MANY_ROWS else FAST


def finer_than(quadrature: Quadrature, count: FloatArray, law: ErrorLaw, walled: bool = False) -> Quadrature:
    """Return a reference quadrature for the error of another one, given the numbers of ratings per rater.

    Of raters with a wall (`walled_integrals`), only the finest quadrature is a reference.
    """
    if quadrature in (DENSE, DENSER):
        return DENSER
    # compared by equality, because a law sent to a worker is a copy
    if count.min() < FEW_ROWS and law != NORMAL:
        return DENSE
    return FINEST if walled or quadrature == FINE else FINE


@cache
def gauss_hermite(size: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss-Hermite nodes x and log weights, such that the integral of f is the sum of exp(log weight) f(x)."""
    x, weight = hermegauss(size)
    return x, np.log(weight) + 0.5 * x**2


@cache
def to_chebyshev(size: int) -> FloatArray:
    """Return the matrix from values at Chebyshev points to coefficients."""
    k = np.arange(size)
    matrix = 2.0 / size * np.cos(np.pi * k[:, None] * (k + 0.5) / size)
    matrix[0] /= 2.0
    return matrix
