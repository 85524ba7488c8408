"""Table of the raters with their covariates as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.data import Ratings

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

PROBABILITY = 0.9
"""Probability between the limits of a rater's effect."""


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
    import pandas as pd

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
