"""Ranks of fabrics by softness for each draw: ties, pairs, and agreement with observed ranks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError

Array = NDArray[np.float64]

TIED = 0.95
"""Share of draws with equal ratings above which two fabrics are considered tied."""

FEWEST = 3
"""Smallest number of fabrics whose order can be compared with an observed one."""


class Places(NamedTuple):
    """Places of some fabrics, 1 for the softest; fabrics with equal ratings share their places equally."""

    place: Array
    """Place of each fabric in each draw, averaged over ties, shape (draws, fabrics)."""
    probability: Array
    """Probability of each place, shape (fabrics, places): all rows and all columns sum to 1."""


def places(rating: ArrayLike) -> Places:
    """Return the places of fabrics from draws of ratings, shape (draws, fabrics); the highest rating is first."""
    import pandas as pd

    rating = np.asarray(rating, float)
    first, last = (np.asarray(pd.DataFrame(-rating).rank(axis=1, method=method)) for method in ("min", "max"))
    share = 1.0 / (last - first + 1.0)
    held = (np.where((first <= k) & (k <= last), share, 0.0).mean(axis=0) for k in range(1, rating.shape[1] + 1))
    return Places(0.5 * (first + last), np.stack([*held], axis=1))


class Pairs(NamedTuple):
    """Probabilities of the order of each two fabrics, each of shape (fabrics, fabrics)."""

    softer: Array
    """That the fabric of the row has the higher rating than that of the column."""
    tie: Array
    """That both have the same."""


def pairs(rating: ArrayLike) -> Pairs:
    """Return the probabilities of the order of each two fabrics from draws of their ratings, (draws, fabrics)."""
    rating = np.asarray(rating, float)
    rows = [rating[:, k, None] for k in range(rating.shape[1])]
    softer = np.array([(one > rating).mean(axis=0) for one in rows])
    return Pairs(softer, np.array([(one == rating).mean(axis=0) for one in rows]))


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


class RankAgreement(NamedTuple):
    """Agreement of a predicted order with an observed one; 1 for the same order, -1 for the opposite one."""

    value: float
    """Median over the draws."""
    low: float
    """5 % limit over the draws, which reflects posterior uncertainty."""
    high: float
    """95 % limit."""
    se: float
    """Standard error of the value for other fabrics of this kind, by leaving out each in turn (jackknife)."""


def rank_correlation(measure: str, one: Array, other: Array) -> float:
    """Return Spearman's correlation or Kendall's tau-b of two sets of ranks with ties; NaN if one is constant."""
    from scipy.stats import kendalltau, spearmanr

    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return float("nan")
    return float((spearmanr if measure == "spearman" else kendalltau)(one, other).statistic)


def agreement(place: Array, observed: ArrayLike) -> dict[str, RankAgreement]:
    """Return the agreement of places in draws, shape (draws, fabrics), with observed ranks, shape (fabrics,).

    Draws in which all fabrics tie are left out.

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
        value, low, high = np.quantile(known, [0.5, 0.05, 0.95]) if known.size else np.full(3, np.nan)
        found[name] = RankAgreement(float(value), float(low), float(high), jackknife(measure, middle, observed))
    return found


def jackknife(measure: Callable[[Array, Array], float], one: Array, other: Array) -> float:
    """Return the standard error of a measure of two rankings; NaN where it is not defined without some fabric."""
    n = one.size
    left = np.array([measure(np.delete(one, k), np.delete(other, k)) for k in range(n)])
    return float(np.sqrt((n - 1) / n * ((left - left.mean()) ** 2).sum()))
