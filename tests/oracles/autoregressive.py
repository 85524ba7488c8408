"""Walks of known autocorrelation."""

import numpy as np
from scipy.signal import lfilter


def autoregressive(rng, shape, tau):
    """Standard normal AR(1) processes along axis 1 of (ensembles, steps, walkers, quantities)."""
    rho = (tau - 1) / (tau + 1)
    noise = rng.standard_normal(shape)
    noise[:, 0] /= np.sqrt(1 - rho**2)
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=1)


def walks(values):
    return np.moveaxis(values, -1, 1)
