"""Information in the data: posterior contraction, power-scaling sensitivity, and well or weakly informed directions.

Power-scaling reweights the posterior as if prior or likelihood were raised to a power near one. The rate of
change of a parameter's distribution shows its sensitivity to either (Kallioinen, Paananen, Bürkner and
Vehtari, Statistics and Computing 34, 57, 2024). With powers this close to one the weights differ by a few
per cent, so that they need no smoothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, xlog1py

from softness_bayes.parameters.priors import Prior
from softness_bayes.sampler.jackknife import jackknife

FloatArray = NDArray[np.float64]

SENSITIVE = 0.05
"""Power-scaling sensitivity above which a posterior is sensitive to prior or likelihood."""

DETERMINED, INFORMED = 1 / 3, 0.8
"""Ratios of posterior to prior width up to which the data determine a quantity, or partly inform it.

In a normal model the data then carry at least 8 times, or 0.56 times, as much information as the prior.
"""

POWERS = (0.99, 1.01)
"""Powers of prior and likelihood."""

_SMALL = 0.05  # up to here five terms of the series of `_spread` are exact to rounding

_REACH, _NODES = 8.0, 641  # standard normal deviates over which moments are summed


class Directions(NamedTuple):
    """Principal directions of the posterior, best informed first, in logarithms of the parameters."""

    contraction: FloatArray
    """1 - posterior variance / prior variance along each direction, shape (directions,)."""
    vectors: FloatArray
    """Unit vectors, one row per direction, in units of each log parameter's prior sd."""
    prior_sd: FloatArray
    """Prior standard deviation of each log parameter, shape (parameters,)."""


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
    deviate = np.linspace(-_REACH, _REACH, _NODES)
    weight = np.exp(-0.5 * deviate**2)
    weight /= weight.sum()
    values = of(prior.quantile(ndtr(deviate)))
    mean = float(weight @ values)
    return mean, float(np.sqrt(weight @ (values - mean) ** 2))


def contraction(prior_sd: ArrayLike, sd: ArrayLike) -> FloatArray:
    """Return 1 - (sd / prior_sd)²: 0 without information, near 1 with much, below 0 if the posterior is wider."""
    return 1.0 - (np.asarray(sd, float) / np.asarray(prior_sd, float)) ** 2


def power_scaling(draws: ArrayLike, log_component: ArrayLike) -> float:
    """Return the sensitivity of a quantity's posterior to the power of one component, per doubling of the power.

    It is the mean of `distance` / |log2 power| over a slightly larger and a slightly smaller power.

    Parameters
    ----------
    draws
        Posterior draws of the quantity, shape (draws,).
    log_component
        Joint log prior density, or joint log-likelihood, of the same draws, shape (draws,).
    """
    draws, log_component = np.asarray(draws, float), np.asarray(log_component, float)
    order = np.argsort(draws)
    return _rate(draws[order], log_component[order])


def power_scaling_with_error(draws: ArrayLike, log_component: ArrayLike) -> tuple[float, float]:
    """Return the sensitivity of `power_scaling`, and its Monte-Carlo standard error.

    Parameters
    ----------
    draws, log_component
        As there, in order of the chains; the error comes from leaving out groups of draws (`jackknife`).
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
        farther = max(_distances(x, weights / weights.sum()))
        rates.append(farther / abs(np.log2(power)))
    return float(np.mean(rates))


def distance(draws: FloatArray, weights: FloatArray) -> float:
    """Return the cumulative Jensen-Shannon distance between draws and the same draws weighted, from 0 to 1.

    sqrt((D(P, M) + D(Q, M)) / ∫ (P + Q)), P and Q the distribution functions without and with weights,
    M their mean, D(F, M) = ∫ F log2(F / M) dx + ∫ (M - F) dx / ln 2. It depends on the sign of x.

    Parameters
    ----------
    draws, weights
        Shape (draws,); the weights sum to 1.
    """
    order = np.argsort(draws)
    return _distances(draws[order], weights[order])[0]


def _distances(x: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the distances from draws in rising order, and of the same draws with the opposite sign.

    The distribution functions of -x are 1 - P and 1 - Q. With u = (Q - P) / (Q + P), both divergences together are
    ∫ M h(u) dx / ln 2, h(u) = (1 + u) ln(1 + u) + (1 - u) ln(1 - u); their terms without a logarithm cancel.
    """
    width = np.diff(x)
    plain = np.arange(1, x.size) / x.size
    weighted = np.cumsum(weights)[:-1]
    half, middle = 0.5 * (weighted - plain), 0.5 * (weighted + plain)

    def distance_from(middle: FloatArray) -> float:
        divergence, total = width @ (middle * _spread(half / middle)) / np.log(2.0), 2.0 * (width @ middle)
        return float(np.sqrt(max(divergence, 0.0) / total)) if total > 0 else 0.0

    return distance_from(middle), distance_from(1.0 - middle)


def _spread(u: FloatArray) -> FloatArray:
    """Return h(u) = (1 + u) ln(1 + u) + (1 - u) ln(1 - u), for u from -1 to 1."""
    square = u * u
    found = square * (1.0 + square * (1 / 6 + square * (1 / 15 + square * (1 / 28 + square * (1 / 45)))))
    far = np.flatnonzero(square > _SMALL**2)
    if far.size:
        value = u[far].clip(-1.0, 1.0)  # beyond by rounding
        found[far] = xlog1py(1.0 + value, value) + xlog1py(1.0 - value, -value)
    return found


def find_directions(priors: Sequence[Prior], theta: FloatArray) -> Directions:
    """Return principal directions of the posterior in logarithms, scaled by the priors' standard deviations.

    Under the prior every direction has variance 1. The posterior variance is much smaller along stiff directions and
    almost unchanged along sloppy ones.

    Parameters
    ----------
    priors
        Prior of each parameter, which must be positive.
    theta
        Draws, shape (draws, parameters).
    """
    prior_sd = np.array([prior_moments(prior, np.log)[1] for prior in priors])
    scaled = np.log(theta) / prior_sd
    variance, vectors = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
    vectors = vectors.T
    leading = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=1)[:, None], axis=1)
    return Directions(1.0 - variance, vectors * np.sign(leading), prior_sd)
