"""Tables of a result: the summary of each quantity with its Monte-Carlo errors, and the raters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base import arviz_bridge
from softness_bayes.checking.exactness import resample
from softness_bayes.data import Ratings
from softness_bayes.sampler.chain_statistics import ess_tail, r_hat_between

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

PROBABILITY = 0.9
"""Probability within the shortest interval of a quantity, and between the limits of a rater's effect."""


def summarise(names: Sequence[str], values: FloatArray) -> pd.DataFrame:
    """Return mean, standard deviation, interval and Monte-Carlo errors of each quantity, unrounded.

    Bulk ESS and Monte-Carlo errors treat every walker as a chain, tail ESS uses autocorrelation times of tail
    indicators, and R-hat compares the ensembles.

    Parameters
    ----------
    names
        Quantities, one row each.
    values
        Their draws after the burn-in, shape (ensembles, draws, walkers, quantities).
    """
    walks = np.moveaxis(values, -1, 1)
    tails, r_hats = ess_tail(walks), r_hat_between(walks)
    rows = {}
    for k, name in enumerate(names):
        chains = np.swapaxes(walks[:, k], 1, 2).reshape(-1, walks.shape[2])
        low, high = arviz_bridge.hdi(chains, PROBABILITY)
        rows[name] = {
            "mean": chains.mean(),
            "sd": chains.std(ddof=1),
            "hdi_low": low,
            "hdi_high": high,
            "hdi_prob": PROBABILITY,
            "ess_bulk": arviz_bridge.ess_bulk(chains),
            "ess_tail": tails[k],
            "r_hat": r_hats[k],
            "mcse_mean": arviz_bridge.mcse(chains, "mean"),
            "mcse_sd": arviz_bridge.mcse(chains, "sd"),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def reweighted(table: pd.DataFrame, draws: FloatArray, log_weight: FloatArray) -> pd.DataFrame:
    """Return a summary with means, standard deviations, intervals and Monte-Carlo errors of weighted draws.

    Parameters
    ----------
    table
        Summary of all draws, a row for each quantity.
    draws
        Draws that have weights, shape (draws, quantities).
    log_weight
        Log weights of the draws, shape (draws,).
    """
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    efficiency = 1.0 / (weight**2).sum() / weight.size
    chosen = draws[resample(log_weight, len(draws))]
    found = table.assign(mean=chosen.mean(axis=0), sd=chosen.std(axis=0, ddof=1))
    limits = [arviz_bridge.hdi(column, PROBABILITY) for column in chosen.T]
    found["hdi_low"], found["hdi_high"] = np.transpose(limits)
    # the weighted draws are a subset of all, and their effective number is reduced by the weights
    share = min(1.0, weight.size / float(table["ess_bulk"].max()))
    for name in ("ess_bulk", "ess_tail"):
        found[name] = np.minimum(table[name] * efficiency, weight.size * efficiency)
    for name in ("mcse_mean", "mcse_sd"):
        found[name] = table[name] / np.sqrt(share * efficiency)
    return found


def rater_table(tree: xr.DataTree, ratings: Ratings) -> pd.DataFrame | None:
    """Return a row for each rater; None if the table of ratings had no covariates.

    Parameters
    ----------
    tree
        The groups of a result.
    ratings
        Its ratings.

    Returns
    -------
    DataFrame
        By participant: the number of ratings; if the model has individual rating scales, the rater's deviation on the
        additive scale of the model, as median (effect) with 90 % limits; and the covariates by name, as text.
    """
    if not ratings.covariates:
        return None
    people, posterior = ratings.participants, tree["posterior"].to_dataset()
    table = pd.DataFrame({"participant": people, "ratings": np.bincount(ratings.participant, minlength=len(people))})
    if "participant_effect" in posterior:
        own = posterior["participant_effect"].values.reshape(-1, len(people))
        tail = 0.5 * (1.0 - PROBABILITY)
        table["effect"], table["effect_low"], table["effect_high"] = np.quantile(own, [0.5, tail, 1.0 - tail], axis=0)
    return with_covariates(table.set_index("participant"), ratings)


def with_covariates(table: pd.DataFrame, ratings: Ratings) -> pd.DataFrame:
    """Add covariates to a table of raters; they are empty for other rows, such as the population."""
    place = {name: k for k, name in enumerate(ratings.participants)}
    rows = [place.get(str(name), -1) for name in table.index.get_level_values("participant")]
    return table.assign(**{name: [(*own, "")[k] for k in rows] for name, own in ratings.covariates.items()})
