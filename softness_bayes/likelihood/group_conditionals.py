"""Density of all ratings of one group given all other ratings, in closed form for each draw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.contract import Likelihood, Parameters

Array = NDArray[np.float64]


def block_log_likelihood(
    observation: Likelihood, mean_rate: Array, parameters: Parameters, block: NDArray[np.intp]
) -> Array:
    """Return the log density of each block given all others, log p(y_g | y_-g, theta) = log p(y) - log p(y_-g).

    The response is still centred or standardised over all rows: ratings are left out, not conditions.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        N/N_ref [Hz], shape (..., conditions).
    parameters
        Parameters of the rating model, of batch shape (...).
    block
        Index of each row's block, shape (rows,), with every index up to the largest in use.

    Returns
    -------
    ndarray, shape (..., blocks)
    """
    whole = np.asarray(observation.log_likelihood(mean_rate, parameters))
    rest = [
        np.zeros_like(whole)
        if (block == k).all()
        else observation.without(block == k).log_likelihood(mean_rate, parameters)
        for k in range(int(block.max()) + 1)
    ]
    return whole[..., None] - np.stack(rest, axis=-1)
