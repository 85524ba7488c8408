"""Fast firing rates: for given channels, the rate is one polynomial in the root of the current above the rheobase."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.touch.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane
from softness_bayes.touch.onset import onset
from softness_bayes.touch.rate import firing_rate

FloatArray = NDArray[np.float64]


class CurveError(NamedTuple):
    """Largest measured error of a curve: in Hz, and relative to the rate."""

    hertz: float
    relative: float


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
    max_current : float
        Largest current that may be asked for [µA/cm²].
    error : CurveError
        Largest measured difference to the exact rate.
    """

    rheobase: FloatArray
    onset_rate: FloatArray
    coefficients: FloatArray
    max_current: float
    error: CurveError

    @property
    def s_max(self) -> FloatArray:
        """Root of the largest current above the rheobase, shape (...); 1 where nothing fires below it."""
        excess = self.max_current - self.rheobase
        return np.sqrt(np.where(excess > 0.0, excess, 1.0))

    def rate(self, current: ArrayLike) -> FloatArray:
        """Firing rates [Hz] at currents [µA/cm²] of shape (..., n), the leading axes those of the batch.

        Raises
        ------
        InputError
            If a current exceeds ``max_current`` or is not a number.
        """
        current = np.asarray(current, dtype=float)
        if current.size and not current.max() <= self.max_current:
            raise InputError(
                f"a current of {current.max():.6g} µA/cm² lies beyond the {self.max_current:.6g} µA/cm² "
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

    def take(self, index: object) -> RateCurve:
        """The curves at ``index`` of the batch."""
        return RateCurve(
            self.rheobase[index],  # type: ignore[index]
            self.onset_rate[index],  # type: ignore[index]
            self.coefficients[index],  # type: ignore[index]
            self.max_current,
            self.error,
        )


def exact_curve(
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
    max_current: float = 40.0,
    nodes: int = 18,
) -> RateCurve:
    """Curve through exact firing rates at Chebyshev nodes in ``s``, with its error measured between them.

    Parameters
    ----------
    channels : Channels
        Scalar multipliers of the conductances [-].
    membrane : Membrane
        Constants.
    max_current : float
        Largest current that the curve covers [µA/cm²].
    nodes : int
        Number of nodes.

    Returns
    -------
    RateCurve
        Of batch shape ().

    Raises
    ------
    InputError
        If a multiplier is not one finite non-negative number, or ``max_current`` not finite.
    """
    if not np.isfinite(max_current) or nodes < 2:
        raise InputError(f"a curve needs a finite largest current and two nodes, not {max_current} and {nodes}")
    if any(np.ndim(c) for c in channels):
        raise InputError("an exact curve has one value of each channel multiplier")
    begin = onset(channels, membrane)
    if begin.rheobase >= max_current:
        return RateCurve(begin.rheobase, np.array(0.0), np.zeros(nodes), max_current, CurveError(0.0, 0.0))
    s_max = np.sqrt(max_current - begin.rheobase)
    at_fold = np.isfinite(begin.prefactor)
    # a fold gives the value at s = 0 analytically; at a jump the first node lies inside
    angles = np.pi * (np.arange(nodes) / (nodes - 1) if at_fold else (np.arange(nodes) + 0.5) / nodes)
    between = 0.5 * (angles[1:] + angles[:-1])[1:-1]
    w = -np.cos(np.concatenate([angles, between]))
    s = 0.5 * s_max * (w + 1.0)
    exact = np.empty_like(s)
    simulated = slice(int(at_fold), None)
    exact[simulated] = firing_rate(begin.rheobase + s[simulated] ** 2, channels, membrane)
    value = np.empty(nodes)
    value[simulated] = (exact[:nodes][simulated] - begin.rate) / s[:nodes][simulated]
    if at_fold:
        value[0] = begin.prefactor
    coefficients = chebyshev.cheb2poly(chebyshev.chebfit(w[:nodes], value, nodes - 1))
    curve = RateCurve(begin.rheobase, begin.rate, coefficients, float(max_current), CurveError(0.0, 0.0))
    difference = np.abs(curve.rate(begin.rheobase + s[nodes:] ** 2) - exact[nodes:])
    error = CurveError(float(difference.max()), float((difference / exact[nodes:]).max()))
    return RateCurve(begin.rheobase, begin.rate, coefficients, float(max_current), error)
