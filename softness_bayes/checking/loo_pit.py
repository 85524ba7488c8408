"""LOO-PIT: probability integral transform of each rating in its leave-one-out predictive distribution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.likelihood.contract import Likelihood, Parameters
from softness_bayes.likelihood.pieces import pieces

FloatArray = NDArray[np.float64]

_SEED = 0  # seed of the random positions of discrete ratings within their probabilities


class LooPit(NamedTuple):
    """LOO-PIT values and their reliability, arrays of shape (rows,)."""

    value: FloatArray
    """Probability of a smaller rating; each is uniform under the model, but they are not independent."""
    pareto_k: FloatArray
    """Pareto k of the importance weights; above 0.7 they are unreliable."""


def loo_pit(
    observation: Likelihood, mean_rate: FloatArray, parameters: Parameters, alone: FloatArray | None = None
) -> LooPit:
    """Return the probability integral transform of each rating given all the others.

    With the effects of participants and fabrics integrated out, p(y_i | y_-i, theta) is known in closed
    form. It is averaged over theta with importance weights 1 / p(y_i | y_-i, theta), smoothed by a generalised Pareto
    law, which turn draws given all ratings into draws given the others (Bürkner, Gabry and Vehtari, Computational
    Statistics 36, 1243, 2021). For discrete ratings, the transform is randomised within the probability of the rating
    by a fixed random number.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate, parameters
        Draws, batch shape (draws,).
    alone
        Log density of each rating given all the others, if it is known.
    """
    if alone is None:
        alone = observation.log_likelihood_loo(mean_rate, parameters)
    below = observation.below_loo(mean_rate, parameters)
    if (rows := observation.discrete).any():
        share = np.random.default_rng(_SEED).uniform(-0.5, 0.5, int(rows.sum()))
        below[:, rows] += share * np.exp(alone[:, rows])
    value, pareto_k = np.empty(alone.shape[1]), np.empty(alone.shape[1])
    for k in pieces(alone.shape[1], len(alone)):
        log_weights, pareto_k[k] = arviz_bridge.psis(-alone[:, k].T)
        value[k] = (np.exp(log_weights) * below[:, k].T).sum(axis=1)
    return LooPit(np.clip(value, 0.0, 1.0), pareto_k)
