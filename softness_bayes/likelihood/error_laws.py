"""Laws of the errors of single observations about their expectation: normal, Student's t, normal with lapses, Gumbel.

Lapses are observations that do not depend on the touch; their own distribution is uniform over some range.

A law is a frozen value. Its methods take errors in units of their spread, shape (..., rows), and the model's
parameters of batch shape (...).

Distribution functions are slow. Mills' ratio r of the probability beyond u > 0 and the density there is smooth, and the
density is known. That of the normal law is a quotient of polynomials; that of Student's law is close to
(1 + u²/nu) / (u + 1/r(0)), and what it differs by is smooth in nu^-1/2 and u / (u + 1): a series in both. Both keep the
precision of their arguments, single or double.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.special import betaln, ndtri_exp

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.likelihood.design import Design, FloatArray

if TYPE_CHECKING:
    from softness_bayes.likelihood.scales import Scale


GUMBEL_SD = math.pi / math.sqrt(6.0)
"""Standard deviation of Gumbel's law of scale 1."""

LEAST_FREEDOM = 0.5
"""Smallest degrees of freedom of the series."""

_ORDERS = 30, 16  # numbers of terms in nu^-1/2 and in u / (u + 1)
_FARTHEST = 100.0  # error beyond which the normal density is 0 in double precision
_LARGE = 100.0  # degrees of freedom beyond which rounding of 1 + u²/nu would matter
# Hart et al., Computer Approximations (1968), no. 5666: the normal law's ratio, from the highest power down
_NUMERATOR = (
    *(3.52624965998911e-2, 0.700383064443688, 6.37396220353165, 33.912866078383),
    *(112.079291497871, 221.213596169931, 220.206867912376),
)
_DENOMINATOR = (
    *(8.83883476483184e-2, 1.75566716318264, 16.064177579207, 86.7807322029461),
    *(296.564248779674, 637.333633378831, 793.826512519948, 440.413735824752),
)


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

    def tail(self, errors: FloatArray, density: FloatArray, parameters: Any) -> FloatArray:
        """Return the probability beyond the absolute values of errors on one side, given the density there."""
        return density * normal_tail_ratio(errors)

    def log_density(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return the log density of errors."""
        return -0.5 * errors * errors - 0.5 * LOG_TWO_PI

    def slopes(self, errors: FloatArray, parameters: Any) -> tuple[FloatArray, FloatArray]:
        """Return the first two derivatives of `log_density` with respect to the error."""
        return -errors, np.full(1, -1.0, errors.dtype)


@dataclass(frozen=True)
class StudentLaw(ErrorLaw):
    """Student's t with `nu` degrees of freedom."""

    concave = False

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
        """Return normal errors over the root of a mean square."""
        normal, nu = rng.standard_normal(shape), np.broadcast_to(_nu(parameters), shape)
        return normal / np.sqrt(rng.chisquare(nu) / nu)

    def normal_scores(self, errors: FloatArray, parameters: Any) -> FloatArray:
        """Return q with Phi(q) = F_nu(error)."""
        log_density = self.log_density(errors, parameters)
        return np.copysign(ndtri_exp(log_density + np.log(self.tail(errors, np.ones(1), parameters))), errors)

    def tail(self, errors: FloatArray, density: FloatArray, parameters: Any) -> FloatArray:
        """Return the density times Mills' ratio."""
        return density * student_tail_ratio(errors, _nu(parameters))

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


def normal_tail_ratio(u: FloatArray) -> FloatArray:
    """Return the normal probability beyond abs(u) on one side, divided by exp(-u²/2) / sqrt(2 pi).

    Its relative error is at most 1e-10 below 5 and 1e-5 beyond.
    """
    size = np.minimum(np.abs(u), _FARTHEST)
    above, below = np.full_like(size, _NUMERATOR[0]), np.full_like(size, _DENOMINATOR[0])
    for found, coefficients in ((above, _NUMERATOR), (below, _DENOMINATOR)):
        for coefficient in coefficients[1:]:
            found *= size
            found += coefficient
    above *= math.sqrt(2.0 * math.pi)
    above /= below
    return above


def student_log_density(u: FloatArray, nu: FloatArray) -> FloatArray:
    """Return the log density at `u`, which is broadcast with `nu`."""
    different, place = _different(nu)
    constant = (-betaln(0.5 * different, 0.5) - 0.5 * np.log(different)).astype(u.dtype)
    squares = u * u / nu
    # not all processors have vector instructions for log1p; where nu is small the rounding of 1 + u²/nu is harmless
    logs = np.log1p(squares) if different.max(initial=0.0) > _LARGE else np.log(squares + 1.0)
    return constant[place] - 0.5 * (nu + 1.0) * logs


def student_tail_ratio(u: FloatArray, nu: FloatArray) -> FloatArray:
    """Return F_nu(-abs(u)) divided by the density at `u`, which is broadcast with `nu`.

    For nu from `LEAST_FREEDOM` up its relative error is at most 1e-6.
    """
    different, place = _different(nu)
    angle = np.arccos(2.0 * np.sqrt(np.minimum(LEAST_FREEDOM / different, 1.0)) - 1.0)
    series = (np.cos(angle[:, None] * np.arange(_ORDERS[0])) @ _coefficients()).T.astype(u.dtype)
    size = np.abs(u)
    share = size / (size + 1.0)
    found, x = np.broadcast_to(series[-1][place], size.shape).copy(), 2.0 * share - 1.0
    for coefficient in series[-2::-1]:
        found *= x
        found += coefficient[place]
    found *= share
    found += 1.0
    found *= 1.0 + size * (size / nu)
    found /= size + _density_at_zero(different).astype(u.dtype)[place]
    return found


def _density_at_zero(nu: FloatArray) -> FloatArray:
    """Return twice the density at 0, the inverse of Mills' ratio there."""
    return np.asarray(2.0 * np.exp(-betaln(0.5 * nu, 0.5)) / np.sqrt(nu))


def _different(nu: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the values of runs of equal ones, as of the rows of few draws, and the place of each of the many."""
    flat = np.ravel(nu)
    first = np.append(True, flat[1:] != flat[:-1])[: flat.size]
    return flat[first], (np.cumsum(first) - 1).reshape(np.shape(nu))


@cache
def _coefficients() -> FloatArray:
    """Return the coefficients: Chebyshev in nu^-1/2, powers of 2 share - 1, shape (orders of each)."""
    x, y = (np.cos(np.pi * (np.arange(size) + 0.5) / size) for size in _ORDERS)
    share, nu = 0.5 * (1.0 + y), LEAST_FREEDOM * (2.0 / (1.0 + x))[:, None] ** 2
    u = share / (1.0 - share)
    # the ratio is the integral of the density's ratio to that at u: over logarithms, because tails are long
    step, beyond = 0.2, np.exp(np.arange(-36.0, 70.0, 0.2))[:, None, None]
    fall = np.log1p((2.0 * u + beyond) * beyond / (nu + u * u))
    ratio = step * (np.exp(-0.5 * (nu + 1.0) * fall) * beyond).sum(axis=0)
    table = (ratio * (u + _density_at_zero(nu)) / (1.0 + u * u / nu) - 1.0) / share
    by_share = chebyshev.chebfit(y, chebyshev.chebfit(x, table, x.size - 1).T, y.size - 1).T
    return np.array([chebyshev.cheb2poly(row) for row in by_share])  # on -1 to 1 powers lose few digits


def _nu(parameters: Any) -> FloatArray:
    return np.asarray(np.maximum(parameters.nu, LEAST_FREEDOM))[..., None]


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
