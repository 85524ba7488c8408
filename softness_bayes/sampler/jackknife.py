"""Jackknife errors of arbitrary statistics of correlated draws, with groups of chains left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

GROUPS = 20
"""Number of groups of consecutive draws; the relative uncertainty of the error is then one sixth."""


def jackknife(statistic: Callable[[NDArray[np.bool_]], float | FloatArray], draws: int) -> FloatArray:
    """Return the Monte-Carlo standard error of a statistic by leaving out one group of draws at a time.

    Groups are consecutive draws and so preserve the correlations within chains. The error is NaN with fewer than two
    draws per group.

    Parameters
    ----------
    statistic
        Function of a mask of draws that returns the value, or values, for the selected draws.
    draws
        Number of draws, in order of the chains.
    """
    if draws < 2 * GROUPS:
        return np.asarray(np.full(np.shape(statistic(np.ones(draws, dtype=bool))), np.nan))
    group = np.arange(draws) * GROUPS // draws
    without = np.array([statistic(group != k) for k in range(GROUPS)])
    return np.asarray(np.sqrt((GROUPS - 1) * without.var(axis=0)))
