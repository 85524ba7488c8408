"""Information in the data: posterior contraction and power-scaling sensitivity.

Power-scaling reweights the posterior as if prior or likelihood were raised to a power near one. The rate of
change of a parameter's distribution shows its sensitivity to either (Kallioinen, Paananen, Bürkner and
Vehtari, Statistics and Computing 34, 57, 2024). With powers this close to one the weights differ by a few
per cent, so that they need no smoothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, xlog1py

from softness_bayes.parameters.laws import Prior
from softness_bayes.sampler.chain_statistics import jackknife

FloatArray = NDArray[np.float64]

SENSITIVE = 0.05
"""Power-scaling sensitivity above which a posterior is sensitive to prior or likelihood."""

DETERMINED, INFORMED = 1 / 3, 0.8
"""Ratios of posterior to prior width up to which the data determine a quantity, or partly inform it.

In a normal model the data then carry at least 8 times, or 0.56 times, as much information as the prior.
"""

FAR = 2.5
"""Distance of a posterior mean from its prior's median, in prior standard deviations on the prior's own scale, from
which data and prior are said to disagree: a draw of a normal prior lies that far in 1.2 % of cases."""

POWERS = (0.99, 1.01)
"""Powers of prior and likelihood."""


def prior_moments(prior: Prior, of: Callable[[FloatArray], FloatArray] = np.asarray) -> tuple[float, float]:
    """Return mean and standard deviation of a function of a quantity under its prior.

    The integral is a trapezium rule over the standard normal deviate of the quantile, exponentially accurate for
    smooth laws.

    Parameters
    ----------
    prior
        The law of the quantity x.
    of
        The function; by default x itself.
    """
    deviate = np.linspace(-8.0, 8.0, 641)
    weight = np.exp(-0.5 * deviate**2)
    weight /= weight.sum()
    values = of(prior.quantile(ndtr(deviate)))
    mean = float(weight @ values)
    return mean, float(np.sqrt(weight @ (values - mean) ** 2))


def contraction(prior_sd: ArrayLike, sd: ArrayLike) -> FloatArray:
    """Return 1 - (sd / prior_sd)²: 0 without information, near 1 with much, below 0 if the posterior is wider."""
    return 1.0 - (np.asarray(sd, float) / np.asarray(prior_sd, float)) ** 2


def power_scaling(draws: ArrayLike, log_component: ArrayLike) -> tuple[float, float]:
    """Return the sensitivity of a quantity's posterior to the power of one component, per doubling of the power.

    It is the mean of the larger distance of x and -x (`distances`) over |log2 power|, for a slightly larger and a
    slightly smaller power.

    Parameters
    ----------
    draws
        Posterior draws of the quantity in order of the chains, shape (draws,).
    log_component
        Joint log prior density, or joint log-likelihood, of the same draws, shape (draws,).

    Returns
    -------
    sensitivity : float
    error : float
        Its Monte-Carlo standard error, from leaving out groups of draws (`jackknife`).
    """
    draws, log_component = np.asarray(draws, float), np.asarray(log_component, float)
    order = np.argsort(draws)
    x, component = draws[order], log_component[order]

    def without(kept: NDArray[np.bool_]) -> float:
        left = kept[order]
        return _rate(x[left], component[left], POWERS[1:])  # one power has the same error as both

    return _rate(x, component), float(jackknife(without, draws.size))


def _rate(x: FloatArray, log_component: FloatArray, powers: Sequence[float] = POWERS) -> float:
    """Return the sensitivity from draws in rising order."""
    centred = log_component - log_component.mean()
    rates = []
    for power in powers:
        weights = np.exp((power - 1.0) * centred)
        rates.append(max(distances(x, weights / weights.sum())) / abs(np.log2(power)))
    return float(np.mean(rates))


def distances(x: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the cumulative Jensen-Shannon distances, from 0 to 1, of weighted draws of x and of -x from equal weights.

    sqrt((D(P, M) + D(Q, M)) / ∫ (P + Q)), P and Q the distribution functions without and with weights, M their mean,
    D(F, M) = ∫ F log2(F / M) dx + ∫ (M - F) dx / ln 2. Those of -x are 1 - P and 1 - Q. With u = (Q - P) / (Q + P),
    both divergences together are ∫ M h(u) dx / ln 2, h(u) = (1 + u) ln(1 + u) + (1 - u) ln(1 - u); their terms without
    a logarithm cancel.

    Parameters
    ----------
    x, weights
        Draws in rising order and their weights, which sum to 1, shape (draws,).
    """
    width = np.diff(x)
    plain = np.arange(1, x.size) / x.size
    weighted = np.cumsum(weights)[:-1]
    half, middle = 0.5 * (weighted - plain), 0.5 * (weighted + plain)

    def distance_from(middle: FloatArray) -> float:
        u = (half / middle).clip(-1.0, 1.0)  # beyond by rounding
        divergence = width @ (middle * (xlog1py(1.0 + u, u) + xlog1py(1.0 - u, -u))) / np.log(2.0)
        total = 2.0 * (width @ middle)
        return float(np.sqrt(max(divergence, 0.0) / total)) if total > 0 else 0.0

    return distance_from(middle), distance_from(1.0 - middle)
