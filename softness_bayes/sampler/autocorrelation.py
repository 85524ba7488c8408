"""Integrated autocorrelation time of ensembles of walkers, as emcee estimates it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

FloatArray = NDArray[np.float64]

WINDOW = 5.0
"""The sum of autocorrelations stops at the first lag beyond this many times itself (Sokal)."""


def autocorrelation_time(walks: FloatArray) -> FloatArray:
    """Return the autocorrelation time of each quantity, in steps, from the mean of the walkers' autocorrelations.

    Parameters
    ----------
    walks
        Values of shape (..., steps, walkers).

    Returns
    -------
    ndarray, shape (...)
        Infinite where a walker never moved.
    """
    return _time(walks - walks.mean(axis=-2, keepdims=True), each=True)


def indicator_time(walks: FloatArray, below: FloatArray) -> FloatArray:
    """Return the autocorrelation time of the indicator that a quantity lies below a threshold, in steps.

    All walkers use the mean and variance of the whole ensemble. A walker that never crosses the threshold has
    no autocorrelation of its own, and in this way lengthens the time as it should.

    Parameters
    ----------
    walks
        Values of shape (..., steps, walkers).
    below
        Thresholds of shape (...).

    Returns
    -------
    ndarray, shape (...)
        Infinite where no walker crosses the threshold.
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
        Infinite where nothing varies.
    """
    return _time(walks - walks.mean(axis=(-2, -1), keepdims=True), each=False)


def _time(deviations: FloatArray, each: bool) -> FloatArray:
    """Integrate autocorrelations normalised walker by ``each`` walker, or over all of them together."""
    steps = deviations.shape[-2]
    padded = fft.next_fast_len(2 * steps, real=True)
    variance = (deviations**2).sum(axis=-2)
    if not each:
        variance = np.broadcast_to(variance.mean(axis=-1, keepdims=True), variance.shape)
    moves = (deviations != deviations[..., :1, :]).any(axis=-2).all(axis=-1) if each else (variance > 0).all(axis=-1)
    power = np.empty((*deviations.shape[:-2], padded // 2 + 1))
    for index in np.ndindex(deviations.shape[:-2]):
        # a contiguous axis makes the transform several times faster
        spectrum = fft.rfft(np.ascontiguousarray(deviations[index].T), padded)
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = 1.0 / variance[index]
        power[index] = np.where(np.isfinite(weight), weight, 0.0) @ (spectrum.real**2 + spectrum.imag**2)
    correlation = fft.irfft(power, padded)[..., :steps] / deviations.shape[-1]
    sums = 2.0 * np.cumsum(correlation, axis=-1) - 1.0
    beyond = np.arange(steps) >= WINDOW * sums
    window = np.where(beyond.any(axis=-1), beyond.argmax(axis=-1), steps - 1)
    time = np.take_along_axis(sums, window[..., None], axis=-1)[..., 0]
    return np.where(moves, time, np.inf)
