"""Logarithm of the modified Bessel function I_v(z) / z^v, by Debye's expansion for large orders v."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

FloatArray = NDArray[np.float64]

LARGE = 20.0
"""Order above which Debye's expansion is used (Abramowitz and Stegun 9.7.7); its error there is below 1e-8."""

_LEAST = 1e-8  # below this argument the function is constant to machine precision
_FAR = 1e7  # above this argument two terms of the asymptotic series are exact to machine precision
_DEBYE = (
    (24.0, (3.0, -5.0)),
    (1152.0, (81.0, -462.0, 385.0)),
    (414720.0, (30375.0, -369603.0, 765765.0, -425425.0)),
    (39813120.0, (4465125.0, -94121676.0, 349922430.0, -446185740.0, 185910725.0)),
)
"""Polynomials u_k(p): a divisor, and the coefficients of p^k, p^(k+2) and so on."""


def log_bessel(order: float, z: FloatArray) -> FloatArray:
    """Return log(I_order(z) / z^order) for z >= 0 and an order of -1/2 or more."""
    if order > LARGE:
        return _debye(order, z)
    z = np.maximum(z, _LEAST)
    far = -0.5 * np.log(2.0 * math.pi * z) - (4.0 * order**2 - 1.0) / (8.0 * z)
    scaled = np.where(z > _FAR, far, np.log(ive(order, np.minimum(z, _FAR))))
    return np.asarray(scaled + z - order * np.log(z))


def _debye(order: float, z: FloatArray) -> FloatArray:
    root = np.sqrt(1.0 + (z / order) ** 2)
    p = 1.0 / root
    square, series = p * p, np.ones_like(p)
    for k, (divisor, coefficients) in enumerate(_DEBYE, start=1):
        polynomial = np.zeros_like(p)
        for coefficient in reversed(coefficients):
            polynomial = polynomial * square + coefficient
        series = series + (p / order) ** k * polynomial / divisor
    level = order * (root - np.log1p(root) - math.log(order)) - 0.5 * math.log(2.0 * math.pi * order)
    return np.asarray(level - 0.5 * np.log(root) + np.log(series))


def log_bessel_slope(order: float, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return approximations of z f'(z), with f = `log_bessel`, and of z times the derivative of z f'(z).

    The ratio of neighbouring orders is approximated by the bound of Amos (Math. Comp. 28, 239, 1974), within a few
    percent.
    """
    square = z * z
    root = np.sqrt((order + 1.5) ** 2 + square)
    below = order + 0.5 + root
    slope = square / below
    return slope, 2.0 * slope - square * square / (root * below**2)
