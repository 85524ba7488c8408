"""Monte-Carlo errors of any statistic of correlated draws, by leaving out groups of chains."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

GROUPS = 20
"""Groups of consecutive draws; with so many the error itself is uncertain by a sixth."""


def jackknife(statistic: Callable[[NDArray[np.bool_]], float | FloatArray], draws: int) -> FloatArray:
    """Monte-Carlo standard error of a statistic, from leaving out one group of draws after the other.

    Groups are consecutive draws, so that chains, or long parts of a chain, stay together with the correlations within
    them; NaN with fewer draws than two for each group.

    Parameters
    ----------
    statistic
        Value, or values, from the draws that are marked.
    draws
        How many there are, chain after chain.
    """
    if draws < 2 * GROUPS:
        return np.asarray(np.full(np.shape(statistic(np.ones(draws, dtype=bool))), np.nan))
    group = np.arange(draws) * GROUPS // draws
    without = np.array([statistic(group != k) for k in range(GROUPS)])
    return np.asarray(np.sqrt((GROUPS - 1) * without.var(axis=0)))
