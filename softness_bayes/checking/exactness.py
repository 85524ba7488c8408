"""Effect of the fast forward model on the posterior: its log-likelihood compared with an exact one."""

from __future__ import annotations

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


class Exactness:
    """Exact minus fast log-likelihood at draws of the posterior under the fast one, and what importance weights change.

    Parameters
    ----------
    names
        Parameters.
    theta
        Draws, shape (draws, parameters).
    fast, exact
        Log-likelihoods, shape (draws,).
    rates
        The reference for the fast firing rates, in words.

    Attributes
    ----------
    difference
        Exact minus fast, shape (draws,).
    sd, sd_error
        Standard deviation of the differences (a common offset is irrelevant), and its standard error by the jackknife.
    largest
        Largest deviation of a difference from their mean.
    log_weight, pareto_k
        Pareto-smoothed log weights, summing to 1 as weights, shape (draws,), and the shape of their tail.
    efficiency
        Effective sample size of the weighted draws divided by their number.
    shift
        Change of each parameter's mean due to the weights, in its posterior standard deviations, shape (parameters,).
    exact_enough
        True if the error of the approximation is known to be negligible.
    certain
        True if more draws would almost certainly not change this: the standard deviation of the differences plus five
        of its standard errors is negligible, and so is the largest deviation.
    """

    def __init__(
        self, names: tuple[str, ...], theta: Array, fast: Array, exact: Array, rates: str = EXACT_RATES
    ) -> None:
        self.names, self.rates, self.difference = names, rates, exact - fast
        (self.log_weight,), (k,) = arviz_bridge.psis(self.difference[None])
        self.pareto_k, weight, spread = float(k), np.exp(self.log_weight), theta.std(axis=0)
        self.efficiency = float(weight.sum() ** 2 / (weight**2).sum() / weight.size)
        moved = weight @ theta / weight.sum() - theta.mean(axis=0)
        self.shift: Array = np.divide(moved, spread, out=np.zeros_like(moved), where=spread > 0)
        apart, n = self.difference - self.difference.mean(), self.difference.size
        self.sd, self.largest, self.sd_error = float(apart.std()), float(np.abs(apart).max()), np.inf
        if n > 2:
            without = np.sqrt(np.maximum(((apart**2).sum() - apart**2 * n / (n - 1)) / (n - 1), 0.0))
            self.sd_error = float(np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum()))
        moves = float(np.abs(self.shift).max(initial=0.0))
        self.exact_enough = self.sd <= HARMLESS or (self.pareto_k <= LARGEST_K and moves <= 0.1)
        self.certain = self.sd + _CERTAIN * self.sd_error <= HARMLESS and self.largest <= HARMLESS


def largest_pareto_k(draws: int) -> float:
    """Return the largest reliable Pareto k for a number of draws (Vehtari et al., JMLR 25, 72, 2024)."""
    return float(min(1.0 - 1.0 / np.log10(max(draws, 11)), LARGEST_K))


def resample(log_weight: Array, size: int) -> NDArray[np.intp]:
    """Return indices of draws in proportion to their weights, by systematic resampling at the midpoints of strata."""
    cumulative = np.cumsum(np.exp(log_weight - log_weight.max()))
    at = (np.arange(size) + 0.5) / size * cumulative[-1]
    return np.searchsorted(cumulative, at).astype(np.intp)
