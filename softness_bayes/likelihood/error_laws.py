"""Laws of the errors of single observations about their expectation: normal, Student's t, normal with lapses, Gumbel.

Lapses are observations that do not depend on the touch; their own distribution is uniform over some range.

A law is a frozen value. Its methods take errors in units of their spread, shape (..., rows), and the model's
parameters of batch shape (...).

Student's distribution function is slow: its normal score q, with Phi(q) = F_nu(u), is close to z = sign(u) sqrt(nu
log(1 + u²/nu)) (Wallace, Ann. Math. Stat. 30, 1121, 1959), and (q/z - 1) nu is smooth in 1/nu and z. A Chebyshev series
in both, fitted to SciPy's function, takes a seventh of the time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.special import betaln, ndtri_exp, stdtr

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.likelihood.design import Design, FloatArray

if TYPE_CHECKING:
    from softness_bayes.likelihood.scales import Scale


GUMBEL_SD = math.pi / math.sqrt(6.0)
"""Standard deviation of Gumbel's law of scale 1."""

LEAST_FREEDOM = 0.5
"""Smallest degrees of freedom of the series."""

LARGEST_SCORE = 10.0
"""Largest z of the series; beyond it q/z stays as it is there, where probabilities are below 1e-18."""

_HALF_WAY = 4.0  # value of z at the midpoint of the series' variable
_ORDERS = 40, 20  # numbers of terms in 1/nu and in z
_LARGE = 100.0  # degrees of freedom beyond which rounding of 1 + u²/nu would matter


@dataclass(frozen=True)
class ErrorLaw:
    """Law of one observation's error on the additive scale (logs or log odds of ratings): normal, or a subclass.

    Parameters
    ----------
    name
        Name in options and in the table of observation models.
    meaning
        Meaning in words, for help.
    needs
        Names of the law's own parameters.
    lapses
        True if a share `lapse` of the observations does not depend on the touch (`RaterRange`, `WholeScale`).
    """

    name: str
    meaning: str
    needs: tuple[str, ...] = ()
    lapses: bool = False
    slow_functions: ClassVar[bool] = False
    """True if distribution functions take several times as long as densities."""

    @property
    def concave(self) -> bool:
        """True if the log probability of a row has one maximum: the log density is concave, and there are no lapses."""
        return not self.lapses

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
        """Return errors in units of their spread, of a shape (..., rows)."""
        return rng.standard_normal(shape)

    def normal_scores(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return the standard normal quantiles at the errors' cumulative probabilities.

        All checks of residuals can thus assume a normal law (Dunn and Smyth, J. Comp. Graph. Stat. 5, 236, 1996).
        """
        return errors

    def log_density(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return the log density of errors."""
        return -0.5 * errors * errors - 0.5 * LOG_TWO_PI

    def slopes(self, errors: FloatArray, parameters: Any) -> tuple[FloatArray, FloatArray]:
        """Return the first two derivatives of `log_density` with respect to the error."""
        return -errors, np.full(1, -1.0)


@dataclass(frozen=True)
class StudentLaw(ErrorLaw):
    """Student's t with `nu` degrees of freedom."""

    slow_functions: ClassVar[bool] = True

    concave = False

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
        """Return normal errors over the root of a mean square."""
        normal, nu = rng.standard_normal(shape), np.broadcast_to(_nu(parameters), shape)
        return normal / np.sqrt(rng.chisquare(nu) / nu)

    def normal_scores(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return q with Phi(q) = F_nu(error)."""
        return student_normal_score(errors, _nu(parameters))

    def log_density(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return the log of Student's density."""
        return student_log_density(errors, _nu(parameters))

    def slopes(self, errors: FloatArray, parameters: Any) -> tuple[FloatArray, FloatArray]:
        """Return -(nu + 1) u / (nu + u²), and its derivative."""
        nu = _nu(parameters)
        weight = (nu + 1.0) / (nu + errors * errors)
        first = -weight * errors
        return first, 2.0 / (nu + 1.0) * first * first - weight


@dataclass(frozen=True)
class GumbelLaw(ErrorLaw):
    """Gumbel's law of largest values, with mean 0 and standard deviation 1, for draws; `orders` has all else."""

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
        """Return standardised draws."""
        return (rng.gumbel(size=shape) - np.euler_gamma) / GUMBEL_SD


def student_log_density(u: FloatArray, nu: FloatArray) -> FloatArray:
    """Return the log density at `u`, which is broadcast with `nu`."""
    different, place = _different(nu)
    constant = -betaln(0.5 * different, 0.5) - 0.5 * np.log(different)
    squares = u * u / nu
    # not all processors have vector instructions for log1p; where nu is small the rounding of 1 + u²/nu is harmless
    logs = np.log1p(squares) if different.max(initial=0.0) > _LARGE else np.log(squares + 1.0)
    return constant[place] - 0.5 * (nu + 1.0) * logs


def student_normal_score(u: FloatArray, nu: FloatArray) -> FloatArray:
    """Return q with Phi(q) = F_nu(u), where `u` is broadcast with `nu`.

    For nu from `LEAST_FREEDOM` up its error is at most 1e-8 of q, and falls as 1/nu.
    """
    different, place = _different(nu)
    angle = np.arccos(2.0 * np.sqrt(np.minimum(LEAST_FREEDOM / different, 1.0)) - 1.0)
    of_score = (np.cos(angle[:, None] * np.arange(_ORDERS[0])) @ _coefficients()).T
    z = np.sqrt(nu * np.log1p(u * u / nu))
    at = np.minimum(z, LARGEST_SCORE)
    at = at / (at + _HALF_WAY) * (2.0 + 2.0 * _HALF_WAY / LARGEST_SCORE) - 1.0
    correction = np.broadcast_to(of_score[-1][place], at.shape).copy()
    for coefficient in of_score[-2::-1]:
        correction *= at
        correction += coefficient[place]
    correction *= np.minimum(1.0 / nu, 1.0 / LEAST_FREEDOM)
    correction += 1.0
    correction *= z
    return np.copysign(correction, u)


def _different(nu: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the values of runs of equal ones, as of the rows of few draws, and the place of each of the many."""
    flat = np.ravel(nu)
    first = np.append(True, flat[1:] != flat[:-1])[: flat.size]
    return flat[first], (np.cumsum(first) - 1).reshape(np.shape(nu))


@cache
def _coefficients() -> FloatArray:
    """Return the coefficients of (q/z - 1) nu: Chebyshev in 1/nu, monomial in z, shape (orders of each)."""
    x, y = (np.cos(np.pi * (np.arange(size) + 0.5) / size) for size in _ORDERS)
    v = 0.5 * (1.0 + y) / (1.0 + _HALF_WAY / LARGEST_SCORE)
    z, nu = _HALF_WAY * v / (1.0 - v), LEAST_FREEDOM * (2.0 / (1.0 + x))[:, None] ** 2
    u = np.sqrt(nu * np.expm1(z * z / nu))
    score = -ndtri_exp(np.log(stdtr(nu, -u)))
    table = (score / z - 1.0) * nu
    by_nu = chebyshev.chebfit(x, table, x.size - 1)
    by_z = chebyshev.chebfit(y, by_nu.T, y.size - 1).T
    return np.array([chebyshev.cheb2poly(row) for row in by_z])


def _nu(parameters: Any) -> FloatArray:
    return np.maximum(np.asarray(parameters.nu, float), LEAST_FREEDOM)[..., None]


NORMAL = ErrorLaw("normal", "normal")
"""Normal errors: log-normal about a magnitude estimate or a force, normal about a z-score."""
STUDENT = StudentLaw("student", "Student's t with sampled degrees of freedom", ("nu",))
"""Errors with heavy tails: Student's t with `nu` degrees of freedom."""
LAPSES = ErrorLaw("lapses", "normal, mixed with a share of lapses over the rater's range", ("lapse",), lapses=True)
"""Normal errors, but for a share `lapse` of observations that do not depend on the touch."""
GUMBEL = GumbelLaw("gumbel", "Gumbel's, as in the Plackett-Luce model of orders")
"""Errors of orders."""
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


BEYOND = 2.0
"""Factor by which lapses may lie beyond the smallest and the largest number of their rater.

If lapses ended there, these two numbers, which define the range, would themselves look like lapses.
"""


class RaterRange(NamedTuple):
    """Lapses that are uniform on the additive scale, over a range of their rater's; fields are (..., rows)."""

    least: FloatArray
    """Smallest lapse on the additive scale."""
    most: FloatArray
    """Largest lapse on the additive scale."""

    @classmethod
    def of(cls, low: FloatArray, high: FloatArray, design: Design, scale: Scale) -> Self:
        """Return ranges that extend those of the raters' numbers by the factor `BEYOND` at each end.

        Parameters
        ----------
        low, high
            Ends of each row's interval, as in the file, shape (..., rows). An interval from 0 counts with its upper
            end.
        design
            The rater of every row.
        scale
            Scale of the ratings.
        """
        order = np.argsort(design.participant, kind="stable")
        _, first, rater = np.unique(design.participant[order], return_index=True, return_inverse=True)
        back = rater[np.argsort(order)]
        positive = np.where(low > 0.0, low, high)
        least = np.minimum.reduceat(positive[..., order], first, axis=-1)[..., back]
        most = np.maximum.reduceat(high[..., order], first, axis=-1)[..., back]
        return cls(scale.additive(least) - np.log(BEYOND), scale.additive(most) + np.log(BEYOND))

    def log_probability(self, low: FloatArray, high: FloatArray, scale: Scale) -> FloatArray:
        """Return the log probability of an interval as a lapse, shape (rows,); of an exact number, the log density.

        Parameters
        ----------
        low, high
            Ends of each row's interval, as in the file, shape (rows,); equal for an exact number, whose density is
            that on the additive scale.
        scale
            Scale of the ratings.
        """
        with np.errstate(divide="ignore"):
            inside = np.minimum(scale.additive(high), self.most) - np.maximum(scale.additive(low), self.least)
            return np.asarray(np.log(np.where(low == high, 1.0, np.maximum(inside, 0.0)) / (self.most - self.least)))

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], scale: Scale) -> FloatArray:
        """Return a lapse for every row, as in the file, of shape (..., rows)."""
        return scale.natural(self.least + rng.random(shape) * (self.most - self.least))

    def take(self, rows: NDArray[np.bool_]) -> Self:
        """Return the distribution for a selection of the rows."""
        return type(self)(self.least[rows], self.most[rows])


class WholeScale(NamedTuple):
    """Lapses that are uniform from 0 to the upper end of a bounded scale, as on a slider."""

    end: float
    """Upper end of the scale."""

    def log_probability(self, low: FloatArray, high: FloatArray, scale: Scale) -> FloatArray:
        """Return the log probability of an interval as a lapse, or log density, shape (rows,); as for `RaterRange`."""
        with np.errstate(divide="ignore"):
            return np.where(low == high, scale.log_slope(low), np.log(high - low)) - np.log(self.end)

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], scale: Scale) -> FloatArray:
        """Return a lapse for every row, as in the file, of shape (..., rows)."""
        return self.end * rng.random(shape)

    def take(self, rows: NDArray[np.bool_]) -> Self:
        """Return the distribution for a selection of the rows."""
        return self


Lapses = RaterRange | WholeScale
"""Distributions of the lapses of every row."""
