"""Predicted ratings of a typical rater beside the given ones, and the fabrics that are predicted to be highest."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.checking.check_table import posterior_quantities
from softness_bayes.checking.layout import groups_in, layout_of, values_in
from softness_bayes.checking.quantities import QUANTITIES, Columns
from softness_bayes.likelihood.layout import Layout

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

TIED = 0.95
"""Share of draws with equal ratings above which two fabrics are considered tied."""

FEWEST = 3
"""Smallest number of fabrics whose order can be compared with an observed one."""


def places(rating: ArrayLike) -> tuple[Array, Array]:
    """Return the places of fabrics, 1 for the softest, from draws of ratings, shape (draws, fabrics).

    Returns
    -------
    place, probability : ndarray
        Place of each fabric in each draw, averaged over ties, (draws, fabrics); and the probability of each place,
        (fabrics, places), where fabrics with equal ratings share their places equally: all rows and columns sum to 1.
    """
    rating = np.asarray(rating, float)
    first, last = (np.asarray(pd.DataFrame(-rating).rank(axis=1, method=method)) for method in ("min", "max"))
    share = 1.0 / (last - first + 1.0)
    held = (np.where((first <= k) & (k <= last), share, 0.0).mean(axis=0) for k in range(1, rating.shape[1] + 1))
    return 0.5 * (first + last), np.stack([*held], axis=1)


def pairs(rating: ArrayLike) -> tuple[Array, Array]:
    """Return the probabilities of the order of each two fabrics from draws of their ratings, (draws, fabrics).

    Returns
    -------
    softer, tie : ndarray
        Probability that the fabric of the row has a higher rating than that of the column, and of equal ones.
    """
    rating = np.asarray(rating, float)
    rows = [rating[:, k, None] for k in range(rating.shape[1])]
    return np.array([(one > rating).mean(axis=0) for one in rows]), np.array(
        [(one == rating).mean(axis=0) for one in rows]
    )


def ties(tie: Array, order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the index of each fabric's group of ties, shape (fabrics,); 0 for a fabric without ties.

    Members of a group are consecutive in the order and tie with its first member with probability `TIED` or more.
    """
    found, group, first = np.zeros(order.size, np.intp), 0, order[0]
    for below in order[1:]:
        if tie[first, below] >= TIED:
            group += not found[first]
            found[first] = found[below] = group
        else:
            first = below
    return found


def rank_correlation(measure: str, one: Array, other: Array) -> float:
    """Return Spearman's correlation or Kendall's tau-b of two sets of ranks with ties; NaN if one is constant."""
    from scipy.stats import kendalltau, spearmanr

    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return float("nan")
    return float((spearmanr if measure == "spearman" else kendalltau)(one, other).statistic)


def agreement(place: Array, observed: ArrayLike) -> dict[str, dict[str, float]]:
    """Return the agreement of places in draws, shape (draws, fabrics), with observed ranks, shape (fabrics,).

    Draws in which all fabrics tie are left out.

    Returns
    -------
    dict of dict
        By measure, 1 for the same order and -1 for the opposite one: the median over the draws (value), their 5 and
        95 % limits, which reflect posterior uncertainty (low, high), and the standard error of the value for other
        fabrics of this kind, by leaving out each in turn (se).

    Raises
    ------
    InputError
        If there are fewer than `FEWEST` fabrics, or all observed ranks are the same.
    """
    observed = np.asarray(observed, float)
    if observed.size < FEWEST or np.ptp(observed) == 0:
        raise InputError(
            f"rank: {observed.size} fabrics with observed ranks ({np.unique(observed).size} distinct); "
            f"expected {FEWEST} fabrics or more, and more than one rank"
        )
    found, middle = {}, place.mean(axis=0)
    for name in ("spearman", "kendall"):
        measure = partial(rank_correlation, name)
        each = np.array([measure(one, observed) for one in place])
        known = each[np.isfinite(each)]
        ends = np.quantile(known, [0.5, 0.05, 0.95]) if known.size else np.full(3, np.nan)
        found[name] = dict(zip(("value", "low", "high"), map(float, ends), strict=True))
        found[name]["se"] = jackknife(measure, middle, observed)
    return found


def jackknife(measure: Callable[[Array, Array], float], one: Array, other: Array) -> float:
    """Return the standard error of a measure of two rankings; NaN where it is not defined without some fabric."""
    n = one.size
    left = np.array([measure(np.delete(one, k), np.delete(other, k)) for k in range(n)])
    return float(np.sqrt((n - 1) / n * ((left - left.mean()) ** 2).sum()))


TYPICAL = "typical_rating_of_condition"
"""Name of the predicted rating of a typical participant, by fabric and then load, in the group `predictions`."""

RATERS_OF_CELLS = "raters"
"""Variable of `constant_data` with the number of raters per cell, if ratings are means."""


def predicted_ratings(tree: xr.DataTree, layout: Layout) -> Array:
    """Return the rating of a typical rater in every condition of a layout, (draws, conditions)."""
    constant = tree["constant_data"].to_dataset()
    rows = constant["fabric_index"].values * constant["load"].size + constant["load_index"].values
    # stored by fabric and then load; a condition of a layout may contain several of these
    stored_of = np.unique(rows, return_inverse=True)[1]
    values = values_in(tree, "predictions", TYPICAL)[0].astype(float)
    share = np.zeros((values.shape[1], layout.design.n_conditions))
    np.add.at(share, (stored_of, layout.design.condition), 1.0)
    if share.shape[0] == share.shape[1]:  # without products, so that equal ratings remain equal
        return np.asarray(values[:, share.argmax(axis=0)])
    return np.asarray(values @ (share / share.sum(axis=0)))


class HighestRated(NamedTuple):
    """The fabric that most probably has the highest rating under one load."""

    load: str
    fabric: str
    probability: float
    """Probability of the highest rating by a typical rater among the fabrics rated under this load, divided equally
    among ties."""
    error: float
    """Its Monte-Carlo standard error."""
    fabrics: int
    """Number of fabrics rated under this load."""

    @property
    def clear(self) -> bool:
        """True if the fabric is more probably the highest than not, even allowing for Monte-Carlo error."""
        return self.probability - 2.0 * self.error > 0.5


def highest_rated(tree: xr.DataTree) -> tuple[HighestRated, ...]:
    """Return the fabric with the highest predicted rating under each load with at least two.

    Parameters
    ----------
    tree
        The groups of a result on ratings.
    """
    layout = layout_of(tree)
    predicted = predicted_ratings(tree, layout)
    fabrics, loads = values_in(tree, "constant_data", "fabric").astype(str), groups_in(tree).names
    found = []
    for load in layout.loads:
        here = np.flatnonzero(layout.load == load)
        if here.size < 2:
            continue
        share = places(predicted[:, here])[1][:, 0]
        best = int(share.argmax())
        error = float(np.sqrt(share[best] * (1.0 - share[best]) / len(predicted)))
        name = str(fabrics[layout.design.fabric[here[best]]])
        found.append(HighestRated(loads[load], name, float(share[best]), error, here.size))
    return tuple(found)


def fabric_rating_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return rated and predicted mean ratings of every fabric under every load.

    Predictions are means of replicated ratings by the same participants, so that the band includes both the scatter of
    the actual number of ratings and the uncertainty of the model. The means are those of the additive fit to the
    participants (`layout.Layout.fit`), for magnitude estimates geometric ones. Because the replicates come from a
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
    layout = layout_of(tree)
    (means,) = posterior_quantities(tree, [one for one in QUANTITIES if one.columns is Columns.CONDITION])
    rated = np.array([finding.observed for finding in means.findings])
    low, middle, high = np.quantile(means.replicated, (0.05, 0.5, 0.95), axis=0)
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
