"""Log densities averaged over narrow intervals, and their derivatives, from the density in the middle (model.md 9).

The mean of a density f over an interval of half-width h about u is f + h² f''/6 + h⁴ f''''/120 + ... . Its logarithm is
that of f plus a series in h², whose terms are polynomials of u for normal errors, and of p = 1/(1 + u²/nu) for
Student's t. One density thus replaces two distribution functions. The value has terms to h⁶, its derivatives to h⁴ or
less: the errors of many ratings' values add up, whereas those of derivatives matter only about the mode. All arrays may
have single precision.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import polynomial
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
    linear, cross = _polynomial(square, 1 / 945, -1 / 45, 1 / 6), _polynomial(square, 4 / 945, -1 / 90)
    cubic = _polynomial(square, -1 / 4725, 1 / 2835)
    part = _polynomial(w, -1 / 37800, cubic, 0.5 * cross, linear)
    part *= w
    value += part
    constant = _polynomial(square, -1 / 2835, 1 / 90, -1 / 6)
    constant *= square
    constant -= _LOG_ROOT_TWO_PI
    value += constant
    # the derivative of the series in w, then in u; the second derivative has another term
    one = _polynomial(w, -1 / 9450, 1 / 945, cross, linear)
    one *= square
    one *= 2.0
    one -= 1.0
    two = _polynomial(w, 2 / 945, cross)
    two *= w
    two *= square
    two *= 4.0
    two += one
    one *= errors
    return value, one, two


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
    two = _polynomial(p, -2.0 * count, count)
    two *= p
    three = _polynomial(p, 8.0 * t * count, -2.0 * t * count)
    three *= lean
    four = _polynomial(p, 48.0 * t * count, -48.0 * t * count, 6.0 * t * count)
    four *= p
    four *= p
    if square is None:
        return value, one, two, three, four
    # the series is h² p (b z - 1) c/6 + h⁴ p² (k0 + k1 z + k2 z²) + h⁶ p³ times a cubic of z, in which no digits cancel
    # for large nu
    z *= p
    b, scaled = 1.0 + 3.0 * t, square * p
    k2, k1, k0 = _of_fourth_order(t)
    quartic = _polynomial(z, k2, k1, k0)
    part = _polynomial(z, *_of_sixth_order(t, errors.dtype))
    part *= scaled
    part += quartic
    part *= scaled
    part += _polynomial(z, count * b / 6.0, count / -6.0)
    part *= scaled
    value += part
    # its derivatives in z, where dz/du = 2 p² u and dp/dz = -t
    slope, bend = _polynomial(z, 2.0 * k2, k1), p * p
    slope *= p
    quartic *= 2.0 * t
    bend *= 2.0 * k2
    bend += t * quartic
    bend -= (4.0 * t) * slope
    bend *= square
    bend -= t * count * b / 3.0
    bend *= square
    slope -= quartic
    slope *= scaled
    slope += _polynomial(p, count * b / 3.0, count * (t - b) / 6.0)
    slope *= square
    # in u, the first is 2 p² u times the first, the second 2 p² (4 p - 3) times the first plus 4 z p³ times the second
    one += 2.0 * lean * slope
    slope *= _polynomial(p, 8.0, -6.0)
    z *= p
    z *= bend
    z *= 4.0
    slope += z
    slope *= p
    slope *= p
    two += slope
    # of the third and the fourth the terms of h²
    scaled *= -4.0 * t * count
    e = 7.0 * b - 2.0 * t
    part = _polynomial(p, 8.0 * b, -e, b - t)
    part *= scaled
    part *= lean
    three += part
    part = _polynomial(p, 80.0 * b, -72.0 * b - 8.0 * e, 6.0 * (b - t) + 7.0 * e, 5.0 * (t - b))
    part *= scaled
    part *= p
    part *= p
    four += part
    return value, one, two, three, four


def _of_fourth_order(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients of h⁴ p² in Student's series, of z² to 1, each of the shape of t = 1/nu."""
    count, b = 1.0 + t, 1.0 + 3.0 * t
    return (
        count * b * (t * (count + 3.0 * t) / 15.0 - count * b / 180.0),
        count * (count * b / 90.0 + ((count + 2.0 * t) * (b - t) - (2.0 * count + 7.0 * t) * b) / 30.0),
        count * ((1.0 + 4.0 * t) / 60.0 - count / 180.0),
    )


def _of_sixth_order(t: FloatArray, kind: Any) -> list[FloatArray]:
    """Return the coefficients of h⁶ p³ in Student's series, of z³ to 1, each of the shape of t = 1/nu."""
    table = _sixth_order()
    found = (t.astype(float) ** np.arange(len(table)) @ table).astype(kind)
    return [found[..., k : k + 1] for k in (3, 2, 1, 0)]


@cache
def _sixth_order() -> FloatArray:
    """Return the same coefficients, of 1 to z³, as polynomials of t, shape (powers of t, powers of z).

    With m_k = f^(k)/f, the series has h⁶ (m_6/5040 - m_2 m_4/720 + m_2³/648). Leibniz's rule for
    (1 + t u²) f' = -(1 + t) u f gives each m from the two before it: m_2n is p^n times a polynomial of z, and m_(2n-1)
    is -u p^n times another.
    """
    rows, t = [], np.linspace(0.0, 2.0, 7)  # the coefficients have degree 6
    for one in t:
        c, even, odd = 1.0 + one, [np.ones(1)], np.array([1.0 + one])
        for k in (1, 3, 5):
            raised = (c + 2.0 * k * one) * polynomial.polymulx(odd)
            even.append(polynomial.polysub(raised, k * (c + (k - 1) * one) * even[-1]))
            odd = polynomial.polysub((c + 2.0 * (k + 1) * one) * even[-1], (k + 1) * (c + k * one) * odd)
        _, two, four, six = even
        cube = polynomial.polymul(two, polynomial.polymul(two, two))
        rows.append(six / 5040.0 - polynomial.polymul(two, four) / 720.0 + cube / 648.0)
    return polynomial.polyfit(t, np.array(rows), t.size - 1)


def _polynomial(x: FloatArray, first: Any, *others: Any) -> FloatArray:
    """Return a polynomial of x, given its coefficients from that of the highest power to the constant."""
    found = x * first
    for k, coefficient in enumerate(others):
        if k:
            found *= x
        found += coefficient
    return np.asarray(found)
