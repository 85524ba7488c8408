"""R-hat between ensembles, and effective sample sizes of their walkers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.sampler.autocorrelation import indicator_time

FloatArray = NDArray[np.float64]

_TAILS = (0.05, 0.95)
_ESS_STRIDE = 3  # spacing of the draws for the bulk ESS, as a fraction of an autocorrelation time
_R_HAT_DRAWS = 4000  # draws of each ensemble that R-hat uses


def r_hat_between(walks: FloatArray) -> FloatArray:
    """Return R-hat between ensembles, each treated as one chain with its walkers interleaved in time order.

    Parameters
    ----------
    walks
        Values of shape (ensembles, quantities, steps, walkers).

    Returns
    -------
    ndarray, shape (quantities,)
        Infinite for a quantity that never moves.
    """
    ensembles, _, steps, walkers = walks.shape
    every = max(1, steps * walkers // _R_HAT_DRAWS)
    thinned = walks[..., ::every, :]
    chains = [thinned[:, k].reshape(ensembles, -1) for k in range(walks.shape[1])]
    return np.array([arviz_bridge.r_hat(c) if np.ptp(c) > 0 and c.shape[1] > 3 else math.inf for c in chains])


def ess_tail(walks: FloatArray) -> FloatArray:
    """Return the effective sample size in the tails, from the indicators of the 5 % and 95 % quantiles.

    Parameters
    ----------
    walks
        Values of shape (ensembles, quantities, steps, walkers).

    Returns
    -------
    ndarray, shape (quantities,)
        The smaller of the two tails.
    """
    ensembles, _, steps, walkers = walks.shape
    thresholds = np.quantile(walks, _TAILS, axis=(0, 2, 3))
    times = [indicator_time(walks, np.broadcast_to(t, walks.shape[:2])).mean(axis=0) for t in thresholds]
    return ensembles * steps * walkers / np.max(times, axis=0)


def ess_bulk(walks: FloatArray, tau: FloatArray) -> FloatArray:
    """Return ArviZ's bulk ESS with one chain per walker, from thinned draws: almost equal and much faster."""
    sizes = []
    for k in range(walks.shape[1]):
        every = max(1, int(tau[k] / _ESS_STRIDE))
        chains = np.swapaxes(walks[:, k, ::every], 1, 2)
        sizes.append(arviz_bridge.ess_bulk(chains.reshape(-1, chains.shape[-1])))
    return np.array(sizes)
