"""Monte-Carlo standard errors of shares and quantiles, from draws of ensembles of walkers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.autocorrelation import pooled_time

FloatArray = NDArray[np.float64]


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
