"""Error distributions of single observations about their expectation: normal, Student's t, normal with lapses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri_exp

from softness_bayes.errors import InputError
from softness_bayes.likelihood import narrow_intervals, student

FloatArray = NDArray[np.float64]

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True, kw_only=True)
class ErrorLaw:
    """Distribution of one observation's error on the additive scale (logs or log odds of ratings).

    The functions take errors in units of their spread, and the model's parameters of batch shape (...).

    Parameters
    ----------
    name
        Name in options and in the table of observation models.
    meaning
        Meaning in words, for help.
    needs
        Names of the law's own parameters.
    draw
        Draws errors in units of their spread; takes a source of random numbers, a shape (..., rows) and the parameters.
    normal_scores
        Normal score of errors (..., rows): the standard normal quantile at the error's cumulative probability (Dunn
        and Smyth, J. Comp. Graph. Stat. 5, 236, 1996). All checks of residuals can thus assume a normal distribution.
    log_below
        Log probability of smaller errors than these, (..., rows).
    log_density
        Log density of errors (..., rows).
    log_peak
        Log density of an error of 0; its last axis has length 1.
    slopes
        First derivatives of the density with respect to the error, each divided by the density; takes errors,
        parameters and the number of derivatives.
    weight
        Weight of an error in the mean that is most probable: minus the first of these slopes over the error.
    kernel
        Density divided by the density at error 0, shape (..., rows).
    ends
        `kernel` and its first derivatives, three or five of them as asked.
    smooth
        Length scale of the density relative to that of the standard normal density, from the eighth derivative at 0;
        its last axis has length 1.
    steepest
        Largest slope of the log density within a distance from 0; takes the parameters and the distance.
    lapses
        True if some observations are lapses (`lapses`), with the share `lapse`.
    averaged
        Log of the mean density over narrow intervals and its derivatives (`narrow_intervals`), for symmetric laws;
        takes middles, squares of half-widths (None for exact numbers), and the parameters. None if there is no such
        series.
    sixth_over_fourth
        Ratio of the expected sixth derivative of the log density to the expected fourth, of laws with heavy tails; its
        last axis has length 1. None if the derivatives of higher orders than the second are zero, or are not estimated.
    """

    name: str
    meaning: str
    needs: tuple[str, ...]
    draw: Callable[[np.random.Generator, tuple[int, ...], Any], FloatArray]
    normal_scores: Callable[[FloatArray, Any], FloatArray]
    log_below: Callable[[FloatArray, Any], FloatArray]
    log_density: Callable[[FloatArray, Any], FloatArray]
    log_peak: Callable[[Any], FloatArray]
    slopes: Callable[[FloatArray, Any, int], tuple[FloatArray, ...]]
    weight: Callable[[FloatArray, Any], FloatArray]
    kernel: Callable[[FloatArray, Any], FloatArray]
    ends: Callable[[FloatArray, Any, int], tuple[FloatArray, ...]]
    smooth: Callable[[Any], FloatArray]
    steepest: Callable[[Any, float], float]
    lapses: bool = False
    averaged: Callable[[FloatArray, FloatArray | None, Any], tuple[FloatArray, ...]] | None = None
    sixth_over_fourth: Callable[[Any], FloatArray] | None = None


def _draw_normal(rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
    return rng.standard_normal(shape)


def _same(errors: FloatArray, parameters: Any) -> FloatArray:
    return errors


def _log_normal_below(errors: FloatArray, parameters: Any) -> FloatArray:
    return np.asarray(log_ndtr(errors))


def _log_normal_density(errors: FloatArray, parameters: Any) -> FloatArray:
    return -0.5 * errors * errors - _LOG_ROOT_TWO_PI


def _log_normal_peak(parameters: Any) -> FloatArray:
    return np.full(1, -_LOG_ROOT_TWO_PI)


def _normal_slopes(errors: FloatArray, parameters: Any, orders: int) -> tuple[FloatArray, ...]:
    """Return Hermite's polynomials, with the signs of the derivatives."""
    found = [np.ones(1), -errors]
    for k in range(1, orders):
        found.append(-(errors * found[k] + k * found[k - 1]))
    return tuple(found[1 : orders + 1])


def _equal(errors: FloatArray, parameters: Any) -> FloatArray:
    return np.ones(1)


def _normal_kernel(errors: FloatArray, parameters: Any) -> FloatArray:
    return np.asarray(np.exp(-0.5 * errors * errors))


def _normal_ends(errors: FloatArray, parameters: Any, orders: int) -> tuple[FloatArray, ...]:
    square = errors * errors
    kernel = -0.5 * square
    np.exp(kernel, out=kernel)
    one = errors * kernel
    two = (square - 1.0) * kernel
    square -= 3.0
    square *= one
    found = [kernel, -one, two, -square]
    for k in range(3, orders):
        found.append(-(errors * found[k] + k * found[k - 1]))
    return tuple(found)


def _normal_averaged(errors: FloatArray, square: FloatArray | None, parameters: Any) -> tuple[FloatArray, ...]:
    return narrow_intervals.averaged(errors, square)


def _one(parameters: Any) -> FloatArray:
    return np.ones(1)


def _normal_steepest(parameters: Any, distance: float) -> float:
    return distance


def _unbounded(parameters: Any, distance: float) -> float:
    return math.inf


def _nu(parameters: Any) -> FloatArray:
    nu = np.asarray(parameters.nu)  # single precision stays so
    return np.maximum(nu, student.LEAST, dtype=nu.dtype if nu.dtype.kind == "f" else float)[..., None]


def _draw_student(rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
    normal, nu = rng.standard_normal(shape), np.broadcast_to(_nu(parameters), shape)
    return normal / np.sqrt(rng.chisquare(nu) / nu)


def _student_score(errors: FloatArray, parameters: Any) -> FloatArray:
    return student.normal_score(errors, _nu(parameters))


def _log_student_below(errors: FloatArray, parameters: Any) -> FloatArray:
    return student.log_below(errors, _nu(parameters))


def _log_student_density(errors: FloatArray, parameters: Any) -> FloatArray:
    return student.log_density(errors, _nu(parameters))


def _log_student_peak(parameters: Any) -> FloatArray:
    return student.log_constant(_nu(parameters))


def _student_slopes(errors: FloatArray, parameters: Any, orders: int) -> tuple[FloatArray, ...]:
    """Return the derivatives of (1 + t u²)^-a over itself, t = 1/nu and 2 a t = 1 + t, each from the two before it.

    This is Leibniz's rule for (1 + t u²) f' = -(1 + t) u f.
    """
    t = 1.0 / _nu(parameters)
    part = 1.0 / (1.0 + t * errors * errors)
    lean = errors * part
    found = [np.ones(1), -(1.0 + t) * lean]
    for k in range(1, orders):
        found.append(-((1.0 + t + 2.0 * k * t) * lean * found[k] + k * (1.0 + k * t) * part * found[k - 1]))
    return tuple(found[1 : orders + 1])


def _student_averaged(errors: FloatArray, square: FloatArray | None, parameters: Any) -> tuple[FloatArray, ...]:
    return narrow_intervals.averaged(errors, square, _nu(parameters))


def _student_weight(errors: FloatArray, parameters: Any) -> FloatArray:
    nu = _nu(parameters)
    return np.asarray((nu + 1.0) / (nu + errors * errors))


def _student_kernel(errors: FloatArray, parameters: Any) -> FloatArray:
    nu = _nu(parameters)
    found = errors * errors
    found *= 1.0 / nu
    found = student.log_one_plus(found, nu)
    found *= -0.5 * (nu + 1.0)
    return np.asarray(np.exp(found, out=found))


def _student_ends(errors: FloatArray, parameters: Any, orders: int) -> tuple[FloatArray, ...]:
    nu = _nu(parameters)
    t = 1.0 / nu
    square = errors * errors
    base = t * square
    kernel = student.log_one_plus(base, nu)
    kernel *= -0.5 * (nu + 1.0)
    np.exp(kernel, out=kernel)
    base += 1.0
    part = np.divide(1.0, base, out=base)
    square *= 1.0 + 2.0 * t
    factor = kernel * part
    factor *= -(1.0 + t)
    one = errors * factor
    factor *= part
    two = (1.0 - square) * factor
    square -= 3.0
    three = one * part
    three *= part
    three *= 1.0 + 3.0 * t
    square *= three
    found = [kernel, one, two, square]
    for k in range(3, orders):
        found.append(-part * ((1.0 + t + 2.0 * k * t) * (errors * found[k]) + k * (1.0 + k * t) * found[k - 1]))
    return tuple(found)


def _student_smooth(parameters: Any) -> FloatArray:
    t = 1.0 / _nu(parameters)
    return np.asarray(((1.0 + t) * (1.0 + 3.0 * t) * (1.0 + 5.0 * t) * (1.0 + 7.0 * t)) ** -0.125)


def _student_sixth(parameters: Any) -> FloatArray:
    return student.sixth_over_fourth(_nu(parameters))


def _student_steepest(parameters: Any, distance: float) -> float:
    nu = _nu(parameters)
    at = np.minimum(distance, np.sqrt(nu))
    return float(((nu + 1.0) * at / (nu + at * at)).max())


GUMBEL_SD = math.pi / math.sqrt(6.0)
"""Standard deviation of Gumbel's law of scale 1."""


def _gumbel(errors: FloatArray) -> FloatArray:
    """Return standardised errors in units of the law's own scale, about its mode."""
    return GUMBEL_SD * errors + np.euler_gamma


def _draw_gumbel(rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
    return (rng.gumbel(size=shape) - np.euler_gamma) / GUMBEL_SD


def _gumbel_score(errors: FloatArray, parameters: Any) -> FloatArray:
    return np.asarray(ndtri_exp(-np.exp(-_gumbel(errors))))


def _log_gumbel_below(errors: FloatArray, parameters: Any) -> FloatArray:
    return np.asarray(-np.exp(-_gumbel(errors)))


def _log_gumbel_density(errors: FloatArray, parameters: Any) -> FloatArray:
    z = _gumbel(errors)
    return np.log(GUMBEL_SD) - z - np.exp(-z)


def _log_gumbel_peak(parameters: Any) -> FloatArray:
    return _log_gumbel_density(np.zeros(1), parameters)


def _gumbel_weight(errors: FloatArray, parameters: Any) -> FloatArray:
    return np.asarray(-_gumbel_slopes(errors, parameters, 1)[0] / errors)


def _gumbel_kernel(errors: FloatArray, parameters: Any) -> FloatArray:
    at_zero = _log_gumbel_density(np.zeros(1), parameters)
    return np.asarray(np.exp(_log_gumbel_density(errors, parameters) - at_zero))


def _gumbel_ends(errors: FloatArray, parameters: Any, orders: int) -> tuple[FloatArray, ...]:
    kernel = _gumbel_kernel(errors, parameters)
    return kernel, *(kernel * part for part in _gumbel_slopes(errors, parameters, orders))


def _gumbel_slopes(errors: FloatArray, parameters: Any, orders: int) -> tuple[FloatArray, ...]:
    """Return the derivatives of the density over itself: polynomials in t = exp(-z)."""
    t, unit = np.exp(-_gumbel(errors)), GUMBEL_SD
    found = (
        unit * (t - 1.0),
        unit**2 * (t * (t - 3.0) + 1.0),
        unit**3 * (t * (t * (t - 6.0) + 7.0) - 1.0),
        unit**4 * (t * (t * (t * (t - 10.0) + 25.0) - 15.0) + 1.0),
    )
    return found[:orders]


NORMAL = ErrorLaw(
    name="normal",
    meaning="normal",
    needs=(),
    draw=_draw_normal,
    normal_scores=_same,
    log_below=_log_normal_below,
    log_density=_log_normal_density,
    log_peak=_log_normal_peak,
    slopes=_normal_slopes,
    weight=_equal,
    kernel=_normal_kernel,
    ends=_normal_ends,
    smooth=_one,
    steepest=_normal_steepest,
    averaged=_normal_averaged,
)
"""Normal errors: log-normal about a magnitude estimate or a force, normal about a z-score."""
STUDENT = ErrorLaw(
    name="student",
    meaning="Student's t with sampled degrees of freedom",
    needs=("nu",),
    draw=_draw_student,
    normal_scores=_student_score,
    log_below=_log_student_below,
    log_density=_log_student_density,
    log_peak=_log_student_peak,
    slopes=_student_slopes,
    weight=_student_weight,
    kernel=_student_kernel,
    ends=_student_ends,
    smooth=_student_smooth,
    steepest=_student_steepest,
    averaged=_student_averaged,
    sixth_over_fourth=_student_sixth,
)
"""Errors with heavy tails: Student's t with `nu` degrees of freedom."""
LAPSES = replace(
    NORMAL,
    name="lapses",
    meaning="normal, mixed with a share of lapses over the rater's range",
    needs=("lapse",),
    lapses=True,
    averaged=None,
)
"""Normal errors, but for a share `lapse` of observations that do not depend on the touch."""
GUMBEL = ErrorLaw(
    name="gumbel",
    meaning="Gumbel's, as in the Plackett-Luce model of orders",
    needs=(),
    draw=_draw_gumbel,
    normal_scores=_gumbel_score,
    log_below=_log_gumbel_below,
    log_density=_log_gumbel_density,
    log_peak=_log_gumbel_peak,
    slopes=_gumbel_slopes,
    weight=_gumbel_weight,
    kernel=_gumbel_kernel,
    ends=_gumbel_ends,
    smooth=_one,
    steepest=_unbounded,
)
"""Errors of orders: Gumbel's law of largest values, with mean 0 and standard deviation 1."""
ERROR_LAWS: Mapping[str, ErrorLaw] = MappingProxyType({law.name: law for law in (NORMAL, STUDENT, LAPSES)})
"""The error laws of ratings that can be chosen, by name; orders have their own."""


def error_law_named(name: str) -> ErrorLaw:
    """Return an error law by its name.

    Raises
    ------
    InputError
        If no error law has that name.
    """
    for law in (*ERROR_LAWS.values(), GUMBEL):
        if law.name == name:
            return law
    raise InputError(f"errors: {name!r} is not known, expected {' or '.join(ERROR_LAWS)}")
