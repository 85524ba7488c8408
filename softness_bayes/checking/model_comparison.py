"""Comparison of models by predictive accuracy: clustered errors of summed differences, and stacking weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ITERATIONS, _TOLERANCE = 20_000, 1e-10


def clustered_error(values: FloatArray, cluster: NDArray[np.intp]) -> float:
    """Return the standard error of a sum of values that are correlated within clusters.

    With G clusters and S_g the sum of the deviations from the mean in cluster g it is sqrt(G / (G - 1) sum_g S_g²), the
    sandwich estimate corrected for few clusters (Cameron and Miller, Journal of Human Resources 50, 317, 2015).
    If every value is its own cluster, it is the error for independent values.

    Parameters
    ----------
    values
        Shape (units,).
    cluster
        Index of each one's cluster, shape (units,).

    Returns
    -------
    float
        NaN with fewer than two clusters.
    """
    _, place = np.unique(cluster, return_inverse=True)
    sums = np.bincount(place, values - values.mean())
    return float(np.sqrt(sums.size / (sums.size - 1) * (sums**2).sum())) if sums.size > 1 else float("nan")


def stacking_weights(log_density: FloatArray) -> FloatArray:
    """Return the weights of the mixture of models that best predicts the left-out data.

    They maximise sum_i log sum_k w_k exp(l_ik) (Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 917, 2018),
    which is concave and increases with each step of the EM algorithm for mixtures.

    Parameters
    ----------
    log_density
        Log predictive density of every unit under every model, shape (units, models).

    Returns
    -------
    ndarray, shape (models,)
    """
    weights = np.full(log_density.shape[1], 1.0 / log_density.shape[1])
    # relative to the best model of each unit, whose weight is at least one over the number of units
    density = np.exp(log_density - log_density.max(axis=1, keepdims=True))
    for _ in range(_ITERATIONS):
        after = weights * (density / (density @ weights)[:, None]).mean(axis=0)
        if np.abs(after - weights).max() < _TOLERANCE:
            return after
        weights = after
    return weights
