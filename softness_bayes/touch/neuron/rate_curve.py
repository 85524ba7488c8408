"""Rate curves: for given channels, the rate is one polynomial in the root of the current above the rheobase."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.touch.neuron.membrane import Channels

FloatArray = NDArray[np.float64]


class CurveError(NamedTuple):
    """Measured error of a curve against exact rates."""

    hertz: float
    """Largest error [Hz], except within 1e-3 µA/cm² of a jump"""
    relative: float
    """Largest error relative to the rate, at the same places"""
    onset_hertz: float
    """Error of the rate just above a jump [Hz]; 0 at a fold"""


@dataclass(frozen=True)
class RateCurve:
    """Firing rate against current, one curve for each parameter vector of a batch.

    ``rate(I) = onset_rate + s sum_k coefficients[k] w^k`` with ``s = sqrt(I - rheobase)`` and
    ``w = 2 s / s_max - 1``; 0 up to the rheobase. The rate is smooth in s, not in I.

    Parameters
    ----------
    rheobase : ndarray, shape (...)
        Smallest current with sustained firing [µA/cm²]; infinite where there is none.
    onset_rate : ndarray, shape (...)
        Rate just above the rheobase [Hz]: 0 at a fold, more at a jump.
    coefficients : ndarray, shape (..., K)
        Monomial coefficients [Hz/sqrt(µA/cm²)].
    max_current : float or ndarray, shape (...)
        Largest current that the curve covers [µA/cm²].
    error : CurveError
        Largest measured difference to the exact rate.
    """

    rheobase: FloatArray
    onset_rate: FloatArray
    coefficients: FloatArray
    max_current: float | FloatArray
    error: CurveError

    @cached_property
    def s_max(self) -> FloatArray:
        """sqrt(max_current - rheobase), shape (...); 1 where the membrane does not fire up to that current."""
        excess = self.max_current - self.rheobase
        return np.sqrt(np.where(excess > 0.0, excess, 1.0))

    @cached_property
    def slopes(self) -> FloatArray:
        """Monomial coefficients of d rate / d s in w, shape (..., K)."""
        slopes = self.coefficients.copy(order="K")
        # with P = sum_k coefficients[k] w^k it is P + (w + 1) P'
        slopes[..., :-1] += self.coefficients[..., 1:]
        slopes *= np.arange(1, slopes.shape[-1] + 1)
        return slopes

    def rate(self, current: ArrayLike) -> FloatArray:
        """Return firing rates [Hz] at currents [µA/cm²] of shape (..., n), whose leading axes are those of the batch.

        Raises
        ------
        InputError
            If a current exceeds ``max_current`` or is not a number.
        """
        current = np.asarray(current, dtype=float)
        limit = np.asarray(self.max_current)[..., None]
        if not (current <= limit).all():
            raise InputError(
                f"a current of {current.max():.6g} µA/cm² lies beyond the {limit.min():.6g} µA/cm² "
                "that the firing-rate curve covers"
            )
        excess = current - self.rheobase[..., None]
        fires = excess > 0.0
        s = np.sqrt(np.where(fires, excess, 0.0))
        w = s * (2.0 / self.s_max)[..., None]
        w -= 1.0
        total = np.zeros_like(w) + self.coefficients[..., -1, None]
        for k in range(self.coefficients.shape[-1] - 2, -1, -1):
            total *= w
            total += self.coefficients[..., k, None]
        total *= s
        total += self.onset_rate[..., None]
        total *= fires
        return total

    def shortened(self, terms: int) -> RateCurve:
        """Return the curves with no more than some number of terms, those of the lowest Chebyshev orders in ``w``."""
        return replace(self, coefficients=self.coefficients @ shortening(self.coefficients.shape[-1], terms))

    def take(self, index: Any) -> RateCurve:
        """Return the curves at ``index`` of the batch."""
        return replace(
            self,
            rheobase=self.rheobase[index],
            onset_rate=self.onset_rate[index],
            coefficients=self.coefficients[index],
            max_current=self.max_current if np.ndim(self.max_current) == 0 else np.asarray(self.max_current)[index],
        )


@lru_cache(maxsize=64)
def shortening(size: int, terms: int) -> FloatArray:
    """Return the matrix that leaves the lowest Chebyshev orders of polynomials, from monomials to monomials.

    Parameters
    ----------
    size
        Number of coefficients of the polynomials.
    terms
        Number of orders that are left.

    Returns
    -------
    ndarray, shape (size, min(size, terms))
        To be multiplied from the left by the coefficients.
    """
    matrix = np.zeros((size, min(size, terms)))
    for k, monomial in enumerate(np.eye(size)):
        lowest = chebyshev.cheb2poly(chebyshev.poly2cheb(monomial[: k + 1])[:terms])
        matrix[k, : lowest.size] = lowest
    return matrix


LARGEST_CURRENT = 150.0
"""Largest alpha [µA/cm²] with a rate curve: depolarisation block starts at 154-210 (model.md 7)."""


class Firing(Protocol):
    """Source of a scene's rate curves: fixed channels, or a surface over the channels."""

    noise: float

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return the rate curves of channel multipliers up to currents alpha, of batch shape (batch,) or ()."""

    def exact(self) -> Firing:
        """Return a source of exact curves, the reference for the error of these."""

    def shortened(self, terms: int) -> Firing:
        """Return a source of curves with no more than some number of terms; exact curves keep theirs."""
