"""The ruler: how much of what free means predict a run's chain keeps, and how far it is from people's means.

The scale of the ruler begins where all fabrics are alike and ends at free means. Its unit is the log density of answers
that are left out (elpd), with errors by clusters of answers about the same fabric.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.people.free_means import FreeMeans

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

NORMAL_90 = 1.6449
"""Standard errors on either side of a 90 % interval."""

SEEN = 2.0
"""Standard errors by which free means have to predict better than equal ones, so that there is something to keep."""


KEPT = 0.9
"""Share of the ruler that a chain has to keep; one that certainly keeps less does not follow the ratings."""

TOLD = 0.1
"""Largest half-width of the share's 90 % interval with which a loss would have been seen: one of a fifth is found with
a probability of 95 %."""


class Ruler(NamedTuple):
    """The share of the predictive density that a chain keeps."""

    share: float
    """Share between all fabrics alike (0) and free means (1); NaN if free means predict no better than equal ones."""
    share_low: float
    share_high: float
    """90 % limits."""
    gain: float
    """Log density of the answers under free means over that with all fabrics alike."""
    lost: float
    """Log density under free means over that under the chain."""
    lost_se: float
    misfit: float
    """Standard deviation of people's means about the chain's, beyond their own error, in units of the ratings; of
    magnitude estimates, of their logarithms."""

    @property
    def loses(self) -> bool:
        """True if the chain predicts worse than free means, beyond the error."""
        return bool(np.isfinite(self.share) and self.lost > NORMAL_90 * self.lost_se)


class Following(NamedTuple):
    """Answers to whether a chain follows the ratings: the one rule, from the table of its ruler."""

    keeps: bool | None
    """True if it loses nothing beyond the error and a loss would have been seen; False if it loses; None if the table
    does not tell."""
    rejected: bool
    """True if it certainly keeps less than `KEPT`."""


def following(table: pd.DataFrame) -> Following:
    """Return whether a chain follows the ratings, from the table of its ruler (`of_run.people_tables`)."""
    rows = table.to_dict("index")
    share, low, high = (float(rows["share"][name]) for name in ("value", "low", "high"))
    if not np.isfinite(share):
        return Following(None, False)
    if rows["lost"]["low"] > 0:
        return Following(False, bool(high < KEPT))
    return Following(True if 0.5 * (high - low) <= TOLD else None, False)


def ruler(free: FreeMeans, chain: Array, predicted: Array) -> Ruler:
    """Return the ruler of a run.

    Parameters
    ----------
    free
        People's own means.
    chain
        Log density of each answer given all others under the chain, shape (answers,).
    predicted
        Rating of the typical rater that the chain predicts, in the unit of `free.rating`, shape (conditions,).
    """
    over = _by_cluster(free.log_density - free.log_density_alike, free.cluster)
    kept = _by_cluster(chain - free.log_density_alike, free.cluster)
    gain, lost, lost_se = over.sum(), (over - kept).sum(), _error(over - kept)
    share = half = np.nan
    if gain > SEEN * _error(over):
        share = kept.sum() / gain
        half = NORMAL_90 * _error(kept - share * over) / gain
    logs = free.scale.axis == "log"
    people, ours = (np.log(free.rating), np.log(predicted)) if logs else (free.rating, predicted)
    apart = people.mean(axis=0) - ours
    noise = people - people.mean(axis=1, keepdims=True)
    excess = apart.var(ddof=1) - noise.var(axis=0).mean() if apart.size > 1 else 0.0
    numbers = share, share - half, share + half, gain, lost, lost_se, np.sqrt(max(excess, 0.0))
    return Ruler(*map(float, numbers))


def _by_cluster(values: Array, cluster: NDArray[np.intp]) -> Array:
    groups = np.unique(cluster, return_inverse=True)[1]
    return np.bincount(groups, values).astype(float)


def _error(sums: Array) -> float:
    """Return the standard error of the total of independent sums."""
    n = sums.size
    return float(np.sqrt(n) * sums.std(ddof=1)) if n > 1 else float("inf")
