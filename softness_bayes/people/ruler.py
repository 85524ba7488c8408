"""The ruler: how much of what free means predict a run's chain keeps, and how far it is from people's means.

The scale of the ruler begins where all fabrics are alike and ends at free means. Its unit is the log density of answers
that are left out (elpd), with errors by clusters of answers about the same fabric.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.checking.agreement import predicted_ratings
from softness_bayes.checking.identifiability import prior_moments
from softness_bayes.checking.individual import modulus_laws
from softness_bayes.checking.layout import layout_of, values_in
from softness_bayes.checking.provenance import DirectionTaken, Provenance
from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood.scales import PAIRS, RANKS, Scale
from softness_bayes.people.answers import left_out_of_draws, told_pairs

if TYPE_CHECKING:
    import xarray as xr

    from softness_bayes.people.free_means import FreeMeans

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


FREE_SD = 0.5
"""Standard deviation of the law of a log modulus from which it is free to follow the ratings: a factor of 2.3 up or
down with a probability of 90 %."""


class Following(NamedTuple):
    """Answers to whether a chain follows the ratings: the one rule, from the table of its ruler."""

    keeps: bool | None
    """True if it loses nothing beyond the error and a loss would have been seen; False if it loses; None if the table
    does not tell."""
    rejected: bool
    """True if it certainly keeps less than `KEPT`."""


UNKNOWN = Following(None, False)
"""Answer for a chain without a ruler, or for one that may still change."""


class Fit(NamedTuple):
    """Agreement of a model with its ratings, and reasons for not judging it."""

    direction: DirectionTaken
    """The direction of the run, and that of the data."""
    follows: Following
    silent_conditions: float = 0.0
    """Share of draws and conditions in which no receptor fires."""
    free_moduli: int = 0
    """Number of sampled moduli whose laws are so wide that they can follow the ratings."""
    means: int = 1
    """Number of mean ratings: conditions."""

    @property
    def untestable(self) -> bool:
        """True if there are as many free moduli as means, so that the model can follow any ratings."""
        return self.means <= self.free_moduli

    @property
    def mostly_silent(self) -> bool:
        """True if no receptor fires in most draws and conditions."""
        return self.silent_conditions > 0.5

    @property
    def failed(self) -> bool:
        """True if the direction contradicts the data, or the chain certainly loses a part of what people agree on."""
        return self.direction.against_data or self.follows.rejected


def fit_of(tree: xr.DataTree, table: pd.DataFrame | None) -> Fit:
    """Return whether the model of a result follows its ratings.

    Parameters
    ----------
    tree
        The groups of a result.
    table
        The table of its ruler; None on a custom scale, whose free means are not known.
    """
    provenance, constant = Provenance(tree.attrs), tree["constant_data"].to_dataset()
    conditions = np.unique(np.stack([constant["fabric_index"].values, constant["load_index"].values]), axis=1)
    return Fit(
        provenance.direction,
        UNKNOWN if table is None else following(table),
        provenance.silence.posterior_silent_conditions,
        sum(prior_moments(law, np.log)[1] > FREE_SD for law in modulus_laws(constant).values()),
        conditions.shape[1],
    )


def following(table: pd.DataFrame) -> Following:
    """Return whether a chain follows the ratings, from the table of its ruler (`ruler`)."""
    share, low, high = table.loc["share", ["value", "low", "high"]].to_numpy(float)
    if not np.isfinite(share):
        return UNKNOWN
    if table["low"]["lost"] > 0:
        return Following(False, bool(high < KEPT))
    return Following(True if 0.5 * (high - low) <= TOLD else None, False)


def ruler_of_run(free: FreeMeans, ratings: Ratings, scale: Scale, tree: xr.DataTree) -> pd.DataFrame:
    """Return the `ruler` of a run from people's own means of its ratings, and the groups of its result."""
    if scale == RANKS:
        density = values_in(tree, "log_likelihood_participant", "ratings_of_participant")[0]
        density = density[:, np.unique(ratings.participant)]
    else:
        density = values_in(tree, "log_likelihood", "rating")[0]
    if scale == PAIRS:
        density = density[:, told_pairs(ratings)[:, 0]]
    layout = layout_of(tree)
    predicted = predicted_ratings(tree, layout).mean(axis=0)
    at = dict(zip(zip(layout.design.fabric, layout.load, strict=True), predicted, strict=True))
    ours = np.array([at[pair] for pair in zip(free.fabric, free.load, strict=True)])
    return ruler(free, left_out_of_draws(density.astype(float)), ours)


def ruler(free: FreeMeans, chain: Array, predicted: Array) -> pd.DataFrame:
    """Return the ruler of a run.

    Parameters
    ----------
    free
        People's own means.
    chain
        Log density of each answer given all others under the chain, shape (answers,).
    predicted
        Rating of the typical rater that the chain predicts, in the unit of `free.rating`, shape (conditions,).

    Returns
    -------
    DataFrame
        Columns value, low and high (90 % limits, NaN where there are none). Index: share, between all fabrics alike (0)
        and free means (1), NaN if free means predict no better than equal ones; gain, the log density of the answers
        under free means over that with all fabrics alike, for other answers about the same fabrics; lost, that under
        free means over that under the chain; misfit, the standard deviation of people's means about the chain's, beyond
        their own error, in units of the ratings or, of magnitude estimates, of their logarithms.
    """
    each = free.log_density - free.log_density_alike
    groups = np.unique(free.cluster, return_inverse=True)[1]
    over, kept = (np.bincount(groups, values).astype(float) for values in (each, chain - free.log_density_alike))
    gain, lost = over.sum(), (over - kept).sum()
    share = kept.sum() / gain if gain > SEEN * _error(each) else np.nan
    logs = free.scale.axis == "log"
    people, ours = (np.log(free.rating), np.log(predicted)) if logs else (free.rating, predicted)
    apart = people.mean(axis=0) - ours
    noise = people - people.mean(axis=1, keepdims=True)
    excess = apart.var(ddof=1) - noise.var(axis=0).mean() if apart.size > 1 else 0.0
    error = {
        "share": _error(kept - share * over) / gain,
        "gain": _error(each),
        "lost": _error(over - kept),
        "misfit": np.nan,
    }
    value = pd.Series({"share": share, "gain": gain, "lost": lost, "misfit": np.sqrt(max(excess, 0.0))})
    half = NORMAL_90 * pd.Series(error)
    return pd.DataFrame({"value": value, "low": value - half, "high": value + half}).rename_axis("quantity")


def _error(sums: Array) -> float:
    """Return the standard error of the total of independent sums."""
    n = sums.size
    return float(np.sqrt(n) * sums.std(ddof=1)) if n > 1 else float("inf")
