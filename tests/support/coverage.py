"""Fits of simulated data, and how often their intervals cover the truth."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from softness_bayes.likelihood.magnitude import LogRatings
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings

MASS = 0.9
REPLICATES = 20
# the pooled coverage needs a few hundred independent draws, not a publication's thousands
ENOUGH = Settings(
    ensembles=2,
    max_steps=4000,
    processes=1,
    goal=Goal(r_hat=1.02, ess=200.0),
)


class Case(NamedTuple):
    """What a replicate is fitted with; carried to the worker processes by name."""

    mistake: Callable[[LogRatings], LogRatings]
    settings: Settings


def covered(positions: NDArray[np.float64]) -> int:
    """Number of truths inside the central interval of the given mass."""
    return int((np.abs(positions - 0.5) <= 0.5 * MASS).sum())


def coverage_holds(positions: NDArray[np.float64]) -> bool:
    """Return whether the number of covered truths is what intervals of the right mass give.

    Within the central 99.8 % of the binomial law. The parameters of one fit are not independent: of
    (replicates, parameters) positions, as many are counted as independent as if correlated by 0.1.
    """
    effective = round(positions.size / (1 + 0.1 * (positions.shape[1] - 1)))
    low, high = binom.interval(0.998, effective, MASS)
    return bool(low <= covered(positions) * effective / positions.size <= high)
