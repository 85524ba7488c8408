"""Log densities averaged over narrow intervals, and their derivatives, from the density in the middle (model.md 9).

The mean of a density f over an interval of half-width h about u is f + h² f''/6 + h⁴ f''''/120 + ... . Its logarithm is
that of f plus a series in h², whose terms are polynomials of u for normal errors, and of p = 1/(1 + u²/nu) for
Student's t. One density thus replaces two distribution functions. All arrays may have single precision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import student

FloatArray = NDArray[np.float64]

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


def normal(errors: FloatArray, square: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the log of the mean normal density over intervals, and its first two derivatives in their middles.

    The third and fourth are of the order of h⁴, and left out.

    Parameters
    ----------
    errors
        Middles of the intervals in spreads, shape (..., rows).
    square
        Squares of their half-widths in spreads, shape (..., rows).

    Returns
    -------
    tuple of ndarray
        Value and derivatives, each (..., rows).
    """
    # with w = h² u², exp(-u t) has the mean sinh(√w)/√w over the interval; exp(-t²/2) adds powers of h² alone
    value = errors * errors
    w = value * square
    value *= -0.5
    cross = square * (4.0 / 945.0)
    cross -= 1.0 / 90.0
    linear = square * (1.0 / 945.0)
    linear -= 1.0 / 45.0
    linear *= square
    linear += 1.0 / 6.0
    part = w * (-1.0 / 37800.0)
    part -= square * (1.0 / 4725.0)
    part += 1.0 / 2835.0
    part *= w
    part += 0.5 * cross
    part *= w
    part += linear
    part *= w
    value += part
    np.multiply(square, -1.0 / 2835.0, out=part)
    part += 1.0 / 90.0
    part *= square
    part -= 1.0 / 6.0
    part *= square
    part -= _LOG_ROOT_TWO_PI
    value += part
    # the derivative in w, then in u; the second one has a term more
    np.multiply(w, -1.0 / 9450.0, out=part)
    part += 1.0 / 945.0
    part *= w
    part += cross
    part *= w
    part += linear
    part *= square
    part *= 2.0
    part -= 1.0
    cross += w * (2.0 / 945.0)
    cross *= w
    cross *= square
    cross *= 4.0
    cross += part
    part *= errors
    return value, part, cross


def student_t(errors: FloatArray, square: FloatArray | None, nu: FloatArray) -> tuple[FloatArray, ...]:
    """Return the same as `normal` for Student's t; of exact numbers if `square` is None.

    Parameters
    ----------
    errors, square
        As for `normal`.
    nu
        Degrees of freedom, shape (..., 1).
    """
    t, count = 1.0 / nu, 1.0 + 1.0 / nu  # count is (nu + 1) t
    z = errors * errors
    p = t * z
    value = student.log_one_plus(p, nu)
    value *= -0.5 * (nu + 1.0)
    value += student.log_constant(nu).astype(errors.dtype)
    p += 1.0
    np.divide(1.0, p, out=p)
    lean = errors * p
    one = -count * lean
    lean *= p
    four = p - 1.0
    four *= p
    two = four + 0.5 * p
    two *= -2.0 * count
    four *= 8.0
    four += 1.0
    three = 4.0 * p
    three -= 1.0
    three *= 2.0 * t * count
    three *= lean
    four *= p
    four *= p
    four *= 6.0 * t * count
    if square is None:
        return value, one, two, three, four
    # in z = p u², whose derivative in u is 2 p² u, and p = 1 - t z, so that no digits cancel in the normal limit
    z *= p
    by_z = 1.0 + 3.0 * t
    k0 = count * ((1.0 + 4.0 * t) / 60.0 - count / 180.0)
    k1 = count * (count * by_z / 90.0 + ((count + 2.0 * t) * (by_z - t) - (2.0 * count + 7.0 * t) * by_z) / 30.0)
    k2 = count * by_z * (t * (count + 3.0 * t) / 15.0 - count * by_z / 180.0)
    scaled = square * p
    steep = k2 * z  # of the polynomial of h⁴ p², and its slope
    quartic = steep + k1
    quartic *= z
    quartic += k0
    steep *= 2.0
    steep += k1
    steep *= p
    part = (count * by_z / 6.0) * z
    part -= count / 6.0
    part += scaled * quartic
    part *= scaled
    value += part
    # first and second derivative in z
    quartic *= 2.0 * t
    bend = p * p
    bend *= 2.0 * k2
    bend += t * quartic
    bend -= (4.0 * t) * steep
    bend *= square
    bend -= t * count * by_z / 3.0
    bend *= square
    steep -= quartic
    steep *= scaled
    steep += (count * by_z / 3.0) * p
    steep -= count * (by_z - t) / 6.0
    steep *= square
    one += 2.0 * lean * steep
    # the second in u is 2 p² (4 p - 3) times the first in z plus 4 z p³ times the second
    around = 4.0 * p
    around -= 3.0
    around *= steep
    z *= p
    z *= bend
    z *= 2.0
    around += z
    around *= p
    around *= p
    around *= 2.0
    two += around
    # of higher ones the terms of h²
    scaled *= -4.0 * t * count
    e = 7.0 * by_z - 2.0 * t
    part = (8.0 * by_z) * p
    part -= e
    part *= p
    part += by_z - t
    part *= scaled
    part *= lean
    three += part
    np.multiply(p, 80.0 * by_z, out=part)
    part -= 72.0 * by_z + 8.0 * e
    part *= p
    part += 6.0 * (by_z - t) + 7.0 * e
    part *= p
    part -= 5.0 * (by_z - t)
    part *= scaled
    part *= p
    part *= p
    four += part
    return value, one, two, three, four
