"""Fast, vectorised Student's t distribution: densities, and normal scores by a Chebyshev series in both arguments.

The normal score of u is q with Phi(q) = F_nu(u). It is close to z = sign(u) sqrt(nu log(1 + u²/nu)) (Wallace, Ann.
Math. Stat. 30, 1121, 1959), and (q/z - 1) nu is smooth in 1/nu and z. The series is fitted to SciPy's distribution
function, which takes about seven times as long.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaln, ndtri_exp, stdtr

FloatArray = NDArray[np.float64]

LEAST = 0.5
"""Smallest degrees of freedom of the series."""

REACH = 10.0
"""Largest z of the series; beyond it q/z stays as it is there, where probabilities are below 1e-18."""

_HALF_WAY = 4.0  # value of z at the midpoint of the series' variable
_ORDERS = 40, 20  # numbers of terms in 1/nu and in z
_LARGE = 100.0  # degrees of freedom beyond which the constant of the density comes from Stirling's series

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


def log_constant(nu: ArrayLike) -> FloatArray:
    """Return log of the density at 0, shape of `nu`; for infinite `nu`, that of the normal law."""
    nu = np.asarray(nu, float)
    small = np.minimum(nu, _LARGE)
    exact = -betaln(0.5 * small, 0.5) - 0.5 * np.log(small)
    if not nu.size or nu.max() < _LARGE:
        return np.asarray(exact)
    w = 1.0 / np.maximum(nu, _LARGE)
    series = -_LOG_ROOT_TWO_PI - w / 4.0 + w**3 / 24.0 - w**5 / 20.0
    return np.where(nu < _LARGE, exact, series)


def log_one_plus(x: FloatArray, nu: FloatArray) -> FloatArray:
    """Return log(1 + x), to be multiplied by `nu`; if that is small, by `numpy.log`, whose rounding is then harmless.

    It is faster, because not all processors have vector instructions for `numpy.log1p`.
    """
    if nu.max() > _LARGE:
        return np.log1p(x)
    found = x + 1.0
    return np.log(found, out=found)


def log_density(u: FloatArray, nu: FloatArray) -> FloatArray:
    """Return the log density at `u`, which is broadcast with `nu`."""
    return log_constant(nu) - 0.5 * (nu + 1.0) * log_one_plus(u * u / nu, nu)


def normal_score(u: FloatArray, nu: FloatArray) -> FloatArray:
    """Return q with Phi(q) = F_nu(u), where `nu` has the shape of `u` with a last axis of length 1, or fewer axes.

    For nu from `LEAST` up its error is at most 1e-8 of q, and falls as 1/nu.
    """
    nu = np.asarray(nu, float)
    z = np.sqrt(nu * np.log1p(u * u / nu))
    w = np.minimum(1.0 / nu, 1.0 / LEAST)
    angle = np.arccos(2.0 * np.sqrt(LEAST * w) - 1.0)
    each = np.cos(angle[..., None] * np.arange(_ORDERS[0])) @ _coefficients()  # of z, (..., orders)
    at = np.minimum(z, REACH)
    at = at / (at + _HALF_WAY) * (2.0 + 2.0 * _HALF_WAY / REACH) - 1.0
    correction = np.broadcast_to(each[..., -1], at.shape).copy()
    for coefficient in np.moveaxis(each, -1, 0)[-2::-1]:
        correction *= at
        correction += coefficient
    correction *= w
    correction += 1.0
    correction *= z
    return np.copysign(correction, u)


@cache
def _coefficients() -> FloatArray:
    """Return the coefficients of (q/z - 1) nu: Chebyshev in 1/nu, monomial in z, shape (orders of each)."""
    x, y = (np.cos(np.pi * (np.arange(size) + 0.5) / size) for size in _ORDERS)
    v = 0.5 * (1.0 + y) / (1.0 + _HALF_WAY / REACH)
    z, nu = _HALF_WAY * v / (1.0 - v), LEAST * (2.0 / (1.0 + x))[:, None] ** 2
    u = np.sqrt(nu * np.expm1(z * z / nu))
    score = -ndtri_exp(np.log(stdtr(nu, -u)))
    table = (score / z - 1.0) * nu
    by_nu = chebyshev.chebfit(x, table, x.size - 1)
    by_z = chebyshev.chebfit(y, by_nu.T, y.size - 1).T
    return np.array([chebyshev.cheb2poly(row) for row in by_z])
