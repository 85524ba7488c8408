"""Integrated autocorrelation time of ensembles of walkers, about the mean of all walkers.

emcee subtracts the mean of each walker. The variance of these means is then missing from the autocorrelations, which
are therefore underestimated: chains with fast and slow components that stop at a length of 50 estimated times have only
42 true ones. The mean of all walkers varies much less, and the same chains have 50.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

FloatArray = NDArray[np.float64]

WINDOW = 5.0
"""Window factor: the sum of autocorrelations stops at the first lag larger than this multiple of it (Sokal)."""


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


def indicator_time(walks: FloatArray, below: FloatArray) -> FloatArray:
    """Return the autocorrelation time of the indicator that a quantity lies below a threshold, in steps.

    Mean and variance are those of the whole ensemble. A walker that never crosses the threshold has no autocorrelation
    of its own; with the common mean it lengthens the time as it should.

    Parameters
    ----------
    walks
        Values of shape (..., steps, walkers).
    below
        Thresholds of shape (...).

    Returns
    -------
    ndarray, shape (...)
        Infinite if no walker crosses the threshold.
    """
    return pooled_time((walks <= below[..., None, None]).astype(float))


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
