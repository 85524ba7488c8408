"""Statistics of correlated draws: autocorrelation times, R-hat, effective sample sizes, Monte-Carlo errors.

Autocorrelation times are about the mean of all walkers. emcee subtracts the mean of each walker. The variance of these
means is then missing from the autocorrelations, which are therefore underestimated: chains with fast and slow
components that stop at a length of 50 estimated times have only 42 true ones. The mean of all walkers varies much less,
and the same chains have 50.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from softness_bayes.base import arviz_bridge

FloatArray = NDArray[np.float64]

WINDOW = 5.0
"""Window factor: the sum of autocorrelations stops at the first lag larger than this multiple of it (Sokal)."""

GROUPS = 20
"""Number of groups of consecutive draws; the relative uncertainty of the error is then one sixth."""

_TAILS = (0.05, 0.95)
_ESS_STRIDE = 3  # draws for the bulk ESS in each autocorrelation time
_TAIL_STRIDE = 20  # draws for the tails, whose indicators change faster: the size is a few percent too small
_R_HAT_DRAWS = 4000  # draws of each ensemble that R-hat uses


def autocorrelation_time(walks: FloatArray) -> FloatArray:
    """Return the autocorrelation time of each quantity, in steps; infinite if a walker never moved.

    It is long if walkers stay in different regions, however fast each of them moves within its region.

    Parameters
    ----------
    walks
        Values of shape (..., steps, walkers).

    Returns
    -------
    ndarray, shape (...)
    """
    moved = (walks != walks[..., :1, :]).any(axis=-2).all(axis=-1)
    return np.where(moved, pooled_time(walks), np.inf)


def own_time(walks: FloatArray) -> FloatArray:
    """Return the autocorrelation time about the mean of each walker, as in emcee; see `autocorrelation_time`.

    It is too short but unaffected by differences between walkers; comparison with `autocorrelation_time` reveals these.
    """
    deviations = walks - walks.mean(axis=-2, keepdims=True)
    spread = np.sqrt((deviations**2).mean(axis=-2, keepdims=True))
    return autocorrelation_time(deviations / np.where(spread > 0, spread, 1.0))


def pooled_time(walks: FloatArray) -> FloatArray:
    """Return the autocorrelation time of quantities, in steps, with the mean and variance of the whole ensemble.

    Parameters
    ----------
    walks
        Values of shape (..., steps, walkers).

    Returns
    -------
    ndarray, shape (...)
        Infinite if nothing varies.
    """
    deviations = walks - walks.mean(axis=(-2, -1), keepdims=True)
    steps = deviations.shape[-2]
    padded = fft.next_fast_len(2 * steps, real=True)
    power = np.empty((*deviations.shape[:-2], padded // 2 + 1))
    for index in np.ndindex(deviations.shape[:-2]):
        # a contiguous axis makes the transform several times faster
        spectrum = fft.rfft(np.ascontiguousarray(deviations[index].T), padded)
        power[index] = (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
    variance = (deviations**2).sum(axis=(-2, -1))
    with np.errstate(divide="ignore"):
        weight = np.where(variance > 0, 1.0 / variance, 0.0)
    correlation = fft.irfft(power * weight[..., None], padded)[..., :steps]
    sums = 2.0 * np.cumsum(correlation, axis=-1) - 1.0
    beyond = np.arange(steps) >= WINDOW * sums
    window = np.where(beyond.any(axis=-1), beyond.argmax(axis=-1), steps - 1)
    time = np.take_along_axis(sums, window[..., None], axis=-1)[..., 0]
    return np.where(variance > 0, time, np.inf)


def r_hat_between(walks: FloatArray) -> FloatArray:
    """Return R-hat between ensembles, each treated as one chain with its walkers interleaved in time order.

    Parameters
    ----------
    walks
        Values of shape (ensembles, quantities, steps, walkers).

    Returns
    -------
    ndarray, shape (quantities,)
        Infinite for a quantity that moves in no ensemble.
    """
    ensembles, _, steps, walkers = walks.shape
    every = max(1, steps * walkers // _R_HAT_DRAWS)
    thinned = walks[..., ::every, :]
    chains = [thinned[:, k].reshape(ensembles, -1) for k in range(walks.shape[1])]
    with np.errstate(invalid="ignore"):  # an indicator of exactly half of the draws is constant when folded
        return np.array(
            [arviz_bridge.r_hat(c) if np.ptp(c, axis=1).any() and c.shape[1] > 3 else math.inf for c in chains]
        )


def ess_tail(walks: FloatArray, tau: FloatArray | None = None) -> FloatArray:
    """Return the effective sample size in the tails, from the indicators of the 5 % and 95 % quantiles.

    Parameters
    ----------
    walks
        Values of shape (ensembles, quantities, steps, walkers).
    tau
        Autocorrelation time of each quantity [steps]. If it is given and long, the draws are thinned: almost the same
        result, and faster.

    Returns
    -------
    ndarray, shape (quantities,)
        The smaller of the two tails.
    """
    ensembles, quantities, steps, walkers = walks.shape
    sizes = []
    for k in range(quantities):
        every = 1 if tau is None else max(1, int(tau[k] / _TAIL_STRIDE))
        walk = walks[:, k, ::every]
        thresholds = np.quantile(walk, _TAILS)
        # if no draw is above a quantile, because many are equal to it, only the other one counts
        below = [walk <= t for t in thresholds if (walk > t).any()]
        times = [every * pooled_time(one.astype(float)).mean() for one in below]
        sizes.append(ensembles * steps * walkers / max(times, default=1.0))
    return np.array(sizes)


def ess_bulk(walks: FloatArray, tau: FloatArray) -> FloatArray:
    """Return ArviZ's bulk ESS with one chain per walker, from thinned draws: almost equal and much faster."""
    sizes = []
    for k in range(walks.shape[1]):
        every = max(1, int(tau[k] / _ESS_STRIDE))
        chains = np.swapaxes(walks[:, k, ::every], 1, 2)
        sizes.append(arviz_bridge.ess_bulk(chains.reshape(-1, chains.shape[-1])))
    return np.array(sizes)


def ess_between(walks: FloatArray) -> FloatArray:
    """Return effective sample sizes from the differences between ensembles, of bulk or tails, whichever is smaller.

    If E independent ensembles have means of variance v, and draws the variance s², all draws are worth E s² / v. This
    uses no autocorrelations, and therefore includes movements too slow to be seen in them. It is rough: of four
    ensembles, a quarter to four times the size in 90 % of cases.

    Parameters
    ----------
    walks
        Values of shape (ensembles, quantities, steps, walkers).

    Returns
    -------
    ndarray, shape (quantities,)
        The smallest one of the mean and the indicators of the 5 % and 95 % quantiles; infinite if nothing differs.
    """

    def size(of: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            found = len(of) * of.var(axis=(0, 2, 3)) / of.mean(axis=(2, 3)).var(axis=0, ddof=1)
        return np.where(np.isnan(found), np.inf, found)

    low, high = np.quantile(walks, _TAILS, axis=(0, 2, 3), keepdims=True)
    of = walks, (walks <= low).astype(float), (walks >= high).astype(float)
    return np.asarray(np.min([size(one) for one in of], axis=0))


class Estimate(NamedTuple):
    """An estimate from draws."""

    value: float
    error: float
    """Its Monte-Carlo standard error; NaN if there is no estimate."""


def share(holds: NDArray[np.bool_]) -> Estimate:
    """Return the share of draws for which something holds.

    For the error, half a draw is added to either side, so that a share of 0 or 1 also has an error.

    Parameters
    ----------
    holds
        Shape (ensembles, steps, walkers).
    """
    size, value = effective_size(holds.astype(float)), float(holds.mean())
    smoothed = (value * size + 0.5) / (size + 1.0)
    return Estimate(value, float(np.sqrt(smoothed * (1.0 - smoothed) / size)))


def quantile(walks: FloatArray, probability: float) -> Estimate:
    """Return a quantile of the draws that are not NaN.

    Its error is half the distance between the quantiles one standard error of the probability below and above
    (Vehtari et al., Bayesian Analysis 16, 667, 2021). It includes the uncertainty about which draws are NaN.

    Parameters
    ----------
    walks
        Shape (ensembles, steps, walkers), NaN for draws without a value.
    probability
        Probability of a smaller value.
    """
    has = np.isfinite(walks)
    known = walks[has]
    if known.size == 0:
        return Estimate(np.nan, np.nan)
    value = float(np.quantile(known, probability))
    # influence of each draw on the probability, of mean 0
    pull = np.where(has, np.where(has, walks, np.inf) <= value, probability) - probability
    error = float(np.sqrt((pull**2).mean() / effective_size(pull)) / has.mean())
    # at least the binomial spread of a share, if all draws are on one side
    error = max(error, 0.5 / known.size)
    low, high = np.quantile(known, np.clip([probability - error, probability + error], 0.0, 1.0))
    return Estimate(value, float(0.5 * (high - low)))


def effective_size(walks: FloatArray) -> float:
    """Return the effective sample size; the number of walkers if nothing varies.

    A constant tells nothing about autocorrelation, and steps of one walker may all depend on each other.

    Parameters
    ----------
    walks
        Shape (ensembles, steps, walkers).
    """
    times = pooled_time(walks)
    known = times[np.isfinite(times)]
    return float(walks.size / max(1.0, known.mean())) if known.size else float(walks[:, 0].size)


def jackknife(statistic: Callable[[NDArray[np.bool_]], float | FloatArray], draws: int) -> FloatArray:
    """Return the Monte-Carlo standard error of a statistic by leaving out one group of draws at a time.

    Groups are consecutive draws and so preserve the correlations within chains. The error is NaN with fewer than two
    draws per group.

    Parameters
    ----------
    statistic
        Function of a mask of draws that returns the value, or values, for the selected draws.
    draws
        Number of draws, in order of the chains.
    """
    if draws < 2 * GROUPS:
        return np.asarray(np.full(np.shape(statistic(np.ones(draws, dtype=bool))), np.nan))
    group = np.arange(draws) * GROUPS // draws
    without = np.array([statistic(group != k) for k in range(GROUPS)])
    return np.asarray(np.sqrt((GROUPS - 1) * without.var(axis=0)))
