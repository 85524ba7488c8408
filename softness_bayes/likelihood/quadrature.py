"""Resolutions of the integrals over raters' scales and the level, and the rules that they use (model.md 9)."""

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
    """Chebyshev points at which a rater's log density is computed; 0 for its derivatives at one point alone."""
    scales: int
    """Nodes of each rater's scale."""
    levels: int
    """Nodes of the level."""
    settled: float
    """Newton's method ends once no rater's mode moves by more than this, in its standard deviations."""


FAST = Quadrature(0, 7, 5, 1.0)
"""For raters with many ratings each."""
FINE = Quadrature(24, 13, 9, 0.05)
"""For raters with few ratings, and to measure the error of `FAST`."""
FINEST = Quadrature(40, 13, 13, 0.01)
"""To measure the error of `FINE`."""

ROUGHLY = Quadrature(12, 9, 5, 0.6)
"""For parameters at which derivatives do not suffice, far from the data."""
DENSE, DENSER = Quadrature(0, 9, 0, 0.35), Quadrature(0, 13, 0, 0.2)
"""For `dense_integrals.DenseIntegrals`, and to measure its error: nodes of zeta, and distance of points in standard
deviations."""

MANY_ROWS, FEW_ROWS = 20, 10
"""Ratings of every rater from which `FAST` is used, and below which heavy tails need `DENSE`."""


def quadrature_for(count: FloatArray) -> Quadrature:
    """Return the quadrature for raters with so many ratings each, shape (raters,)."""
    return FINE if count.min() < MANY_ROWS else FAST


def finer_than(quadrature: Quadrature, count: FloatArray, law: ErrorLaw) -> Quadrature:
    """Return a quadrature that measures the error of another one, for raters with so many ratings each."""
    if quadrature in (DENSE, DENSER):
        return DENSER
    # equal, not the same: a law that came to a worker is a copy
    if count.min() < FEW_ROWS and law != NORMAL:
        return DENSE
    return FINEST if quadrature == FINE else FINE


@cache
def gauss_hermite(size: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes x and log weights of the integral of f(x), sum of exp(log weight) f(x): Gauss-Hermite."""
    x, weight = hermegauss(size)
    return x, np.log(weight) + 0.5 * x**2


@cache
def to_chebyshev(size: int) -> FloatArray:
    """Return the matrix from values at Chebyshev points to coefficients."""
    k = np.arange(size)
    matrix = 2.0 / size * np.cos(np.pi * k[:, None] * (k + 0.5) / size)
    matrix[0] /= 2.0
    return matrix
