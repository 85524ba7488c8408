"""Rated and predicted softness of every fabric under every load, from the groups of a result alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.check_table import PROBABILITY, posterior_quantities
from softness_bayes.checking.layout import layout_of
from softness_bayes.checking.quantities import QUANTITIES, Columns

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

MEANS = tuple(one for one in QUANTITIES if one.columns is Columns.CONDITION)
"""Name of the test quantity with a value for each fabric and load: the mean rating on the additive scale."""


def fabric_rating_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return rated and predicted mean ratings of every fabric under every load.

    Predictions are means of replicated ratings by the same participants, so that the band includes both the scatter of
    the actual number of ratings and the uncertainty of the model. The means are those of the additive fit to the
    participants (`quantities.Layout.fit`), for magnitude estimates geometric ones. Because the replicates come from a
    fit to the same ratings, the differences are somewhat too small.

    Parameters
    ----------
    tree
        The groups of a result on ratings.

    Returns
    -------
    DataFrame
        Index load and fabric; columns e_fab_kpa, ratings (their number), rated, predicted (median), predicted_low and
        predicted_high (limits of 90 % of the replicates), difference_sd: rated minus the mean of the replicates, on the
        additive scale, in standard deviations of the replicates.
    """
    import pandas as pd

    layout = layout_of(tree)
    (means,) = posterior_quantities(tree, MEANS)
    rated = np.array([finding.observed for finding in means.findings])
    low, middle, high = np.quantile(means.replicated, [0.5 - 0.5 * PROBABILITY, 0.5, 0.5 + 0.5 * PROBABILITY], axis=0)
    spread = means.replicated.std(axis=0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        difference = np.where(spread > 0, (rated - means.replicated.mean(axis=0)) / spread, np.nan)
    natural = layout.scale.natural
    columns = {
        "load": [load for load, _, _ in means.labels],
        "fabric": [fabric for _, fabric, _ in means.labels],
        "e_fab_kpa": layout.modulus * 1e-3,
        "ratings": layout.design.cells.sum(axis=0).astype(int),
        "rated": natural(rated),
        "predicted": natural(middle),
        "predicted_low": natural(low),
        "predicted_high": natural(high),
        "difference_sd": difference,
    }
    return pd.DataFrame(columns).set_index(["load", "fabric"])
