"""People's own answer beside the chain of one run, from the groups of its result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.checking.agreement import predicted_ratings
from softness_bayes.checking.layout import LOAD_GROUP, layout_of, values_in
from softness_bayes.checking.provenance import Provenance
from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood.scales import PAIRS, RANKS
from softness_bayes.model.options import ModelOptions
from softness_bayes.people.answers import left_out_of_draws, told_pairs
from softness_bayes.people.free_means import FreeMeans
from softness_bayes.people.psychometric import psychometric_table
from softness_bayes.people.ruler import ruler

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def people_tables(
    found: FreeMeans, ratings: Ratings, options: ModelOptions, tree: xr.DataTree
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return people's own means by load and fabric, and the ruler of the run.

    Parameters
    ----------
    found
        People's own means of the ratings.
    ratings, options
        The ratings, and the model of the run.
    tree
        The groups of its result.

    Returns
    -------
    DataFrame
        Index load and fabric; columns people, people_low, people_high and p_highest (`FreeMeans.table`).
    DataFrame
        `ruler.ruler`.
    """
    means = found.table().set_index(["load", "fabric"])[["people", "people_low", "people_high", "p_highest"]]
    return means, _ruler_of(found, ratings, options, tree)


def orders_of(found: FreeMeans, merged: bool) -> xr.DataArray:
    """Return the orders of pairs by people's own means (`FreeMeans.p_orders`), as a variable of a result.

    Parameters
    ----------
    found
        People's own means.
    merged
        Whether the loads are groups of loads.
    """
    import xarray as xr

    fabrics = list(found.fabrics)
    axes = {LOAD_GROUP if merged else "load": list(found.loads), "fabric": fabrics, "other_fabric": fabrics}
    return xr.DataArray(found.p_orders.astype(np.float32), axes)


def threshold_table(ratings: Ratings, tree: xr.DataTree) -> pd.DataFrame:
    """Return psychometric quantities of each reference (`psychometric_table`), of people's answers and of the chain's.

    Those of the chain are of the same pairs with the probabilities that it predicts; the column `answers` tells which.
    """
    import pandas as pd

    modulus = values_in(tree, "constant_data", "effective_modulus_kpa").astype(float)
    density = values_in(tree, "log_likelihood", "rating")[0][:, told_pairs(ratings)[:, 0]]
    chance = np.exp(density.astype(float)).mean(axis=0)
    guess = Provenance(tree.attrs).asked.options.get("guess")
    known = None if isinstance(guess, str) else guess
    parts = {"people": None, "chain": chance}
    found = [psychometric_table(ratings, modulus, won, known).assign(answers=name) for name, won in parts.items()]
    return pd.concat(found, ignore_index=True)


def _ruler_of(found: FreeMeans, ratings: Ratings, options: ModelOptions, tree: xr.DataTree) -> pd.DataFrame:
    if options.scale == RANKS:
        density = values_in(tree, "log_likelihood_participant", "ratings_of_participant")[0]
        density = density[:, np.unique(ratings.participant)]
    else:
        density = values_in(tree, "log_likelihood", "rating")[0]
    if options.scale == PAIRS:
        density = density[:, told_pairs(ratings)[:, 0]]
    layout = layout_of(tree)
    predicted = predicted_ratings(tree, layout).mean(axis=0)
    at = dict(zip(zip(layout.design.fabric, layout.load, strict=True), predicted, strict=True))
    ours = np.array([at[pair] for pair in zip(found.fabric, found.load, strict=True)])
    return ruler(found, left_out_of_draws(density.astype(float)), ours)
