"""Effect of the fast forward model on the posterior: its log-likelihood compared with an exact one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base import arviz_bridge

Array = NDArray[np.float64]

HARMLESS = 0.05
"""Standard deviation of the differences below which the importance weights are too similar for their tail to matter.

Pareto k does not depend on scale: differences of 1e-6 with heavy tails have k > 0.6."""

_CERTAIN = 5.0

LARGEST_K = 0.7
"""Pareto k above which weighted means are unreliable."""

EXACT_RATES = "exact firing rates"
SAME_RATES = "the same noise-averaged firing rates"
"""Names of the reference rates; the second is for averages over noise, whose own error is reported separately."""


@dataclass(frozen=True)
class Exactness:
    """Exact minus fast log-likelihood at posterior draws, and the effect of the resulting importance weights.

    Parameters
    ----------
    difference
        At each draw, shape (draws,).
    log_weight
        Pareto-smoothed log weights, summing to 1 as weights, shape (draws,).
    pareto_k
        Shape of the weights' tail.
    shift
        Change of each parameter's mean due to the weights, in its posterior standard deviations, shape (parameters,).
    names
        The parameters.
    rates
        The reference for the fast firing rates, in words.
    """

    difference: Array
    log_weight: Array
    pareto_k: float
    shift: Array
    names: tuple[str, ...]
    rates: str = EXACT_RATES

    @property
    def sd(self) -> float:
        """Standard deviation of the differences; a common offset is irrelevant."""
        return float(self.difference.std())

    @property
    def certain(self) -> bool:
        """True if more draws would almost certainly not change the conclusion that the approximation is exact enough.

        The standard deviation of the differences plus five of its standard errors (jackknife) must be negligible, and
        so must the largest deviation.
        """
        return self.sd + _CERTAIN * self.sd_error <= HARMLESS and self.largest <= HARMLESS

    @property
    def sd_error(self) -> float:
        """Standard error of the standard deviation of the differences, by the jackknife."""
        n, apart = self.difference.size, (self.difference - self.difference.mean()) ** 2
        if n < 3:
            return np.inf
        without = np.sqrt(np.maximum((apart.sum() - apart * n / (n - 1)) / (n - 1), 0.0))
        return float(np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum()))

    @property
    def largest(self) -> float:
        """Largest deviation of a difference from their mean."""
        return float(np.abs(self.difference - self.difference.mean()).max())

    @property
    def efficiency(self) -> float:
        """Effective sample size of the weighted draws divided by their number."""
        weight = np.exp(self.log_weight)
        return float(weight.sum() ** 2 / (weight**2).sum() / weight.size)

    @property
    def exact_enough(self) -> bool:
        """True if the error of the approximation is known to be negligible."""
        return self.sd <= HARMLESS or (self.pareto_k <= LARGEST_K and float(np.abs(self.shift).max(initial=0.0)) <= 0.1)


def compare_likelihoods(
    names: tuple[str, ...], theta: Array, fast: Array, exact: Array, rates: str = EXACT_RATES
) -> Exactness:
    """Compare two log-likelihoods at draws of the posterior under the fast one.

    Parameters
    ----------
    names
        Parameters.
    theta
        Draws, shape (draws, parameters).
    fast, exact
        Log-likelihoods, shape (draws,), possibly empty.
    rates
        Description of the firing rates in the exact log-likelihood.
    """
    difference = exact - fast
    (log_weight,), (k,) = arviz_bridge.psis(difference[None])
    weight = np.exp(log_weight)[:, None]
    spread = theta.std(axis=0)
    moved = (weight * theta).sum(axis=0) / weight.sum() - theta.mean(axis=0)
    shift = np.divide(moved, spread, out=np.zeros_like(moved), where=spread > 0)
    return Exactness(difference, log_weight, float(k), shift, names, rates)


def largest_pareto_k(draws: int) -> float:
    """Return the largest reliable Pareto k for a number of draws (Vehtari et al., JMLR 25, 72, 2024)."""
    return float(min(1.0 - 1.0 / np.log10(max(draws, 11)), LARGEST_K))


def resample(log_weight: Array, size: int) -> NDArray[np.intp]:
    """Return indices of draws in proportion to their weights, by systematic resampling at the midpoints of strata."""
    cumulative = np.cumsum(np.exp(log_weight - log_weight.max()))
    at = (np.arange(size) + 0.5) / size * cumulative[-1]
    return np.searchsorted(cumulative, at).astype(np.intp)
