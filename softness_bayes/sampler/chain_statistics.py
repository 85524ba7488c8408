"""R-hat between ensembles, and effective sample sizes of their walkers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.sampler.autocorrelation import indicator_time

FloatArray = NDArray[np.float64]

_TAILS = (0.05, 0.95)
_ESS_STRIDE = 3  # draws for the bulk ESS in each autocorrelation time
_TAIL_STRIDE = 20  # likewise for the tails, whose indicators change faster: the size is a few percent too small
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


def ess_tail(walks: FloatArray, tau: FloatArray | None = None) -> FloatArray:
    """Return the effective sample size in the tails, from the indicators of the 5 % and 95 % quantiles.

    Parameters
    ----------
    walks
        Values of shape (ensembles, quantities, steps, walkers).
    tau
        Autocorrelation time of each quantity [steps]. If it is given and long, the draws are thinned: almost the same
        result, and faster.

    Returns
    -------
    ndarray, shape (quantities,)
        The smaller of the two tails.
    """
    ensembles, quantities, steps, walkers = walks.shape
    sizes = []
    for k in range(quantities):
        every = 1 if tau is None else max(1, int(tau[k] / _TAIL_STRIDE))
        walk = walks[:, k, ::every]
        thresholds = np.quantile(walk, _TAILS)
        times = [every * indicator_time(walk, np.broadcast_to(t, ensembles)).mean() for t in thresholds]
        sizes.append(ensembles * steps * walkers / np.max(times))
    return np.array(sizes)


def ess_bulk(walks: FloatArray, tau: FloatArray) -> FloatArray:
    """Return ArviZ's bulk ESS with one chain per walker, from thinned draws: almost equal and much faster."""
    sizes = []
    for k in range(walks.shape[1]):
        every = max(1, int(tau[k] / _ESS_STRIDE))
        chains = np.swapaxes(walks[:, k, ::every], 1, 2)
        sizes.append(arviz_bridge.ess_bulk(chains.reshape(-1, chains.shape[-1])))
    return np.array(sizes)
