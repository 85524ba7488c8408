"""Detection of unusual raters: ratings with a trend opposite to all others, and constant ratings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from softness_bayes.checking.quantities import Layout
from softness_bayes.checking.trend import condition_means

FloatArray = NDArray[np.float64]

LEVEL = 0.01
"""Probability that any rater of a table is reported by chance."""

FEWEST = 5
"""Smallest number of conditions of a rater whose order is compared, and of ratings that may all be the same."""


class Apart(NamedTuple):
    """Indices of unusual raters."""

    against: dict[int, float]
    """Correlation with the means of all others, significantly below 0, by rater."""
    constant: tuple[int, ...]
    """Raters whose ratings are all equal, if those of others are not."""


def raters_apart(layout: Layout, ratings: FloatArray) -> Apart:
    """Return the raters with a trend opposite to the others, and those whose ratings are all equal.

    A trend is opposite if the rank correlation between the rater's condition means and the additive fit of all other
    raters is significantly below 0 at level `LEVEL` divided by the number of raters.

    Parameters
    ----------
    layout
        Rater, fabric and load of each rating.
    ratings
        Shape (rows,).
    """
    design, y = layout.design, layout.scale.additive(ratings)
    people = np.unique(design.participant)
    equal = [
        int(k)
        for k in people
        if (own := ratings[design.participant == k]).size >= FEWEST and np.ptp(own) == 0 and np.ptp(ratings) > 0
    ]
    against: dict[int, float] = {}
    if people.size < 3:
        return Apart(against, tuple(equal) if people.size > 1 else ())
    weights = np.ones((people.size, design.n_participants))
    # a tiny weight keeps the conditions rated only by this rater
    weights[np.arange(people.size), people] = 1e-9
    others = condition_means(layout, y, weights)
    for place, k in enumerate(people.tolist()):
        rows = design.participant == k
        rated = np.flatnonzero(design.cells[k] * (design.cells.sum(axis=0) - design.cells[k]) > 0)
        if rated.size < FEWEST or k in equal:
            continue
        own = np.bincount(design.condition[rows], y[rows], design.n_conditions)[rated] / design.cells[k, rated]
        r = _rank_correlation(own, others[place, rated])
        if r < 0:
            n = rated.size
            p = float(stdtr(n - 2, r * np.sqrt((n - 2) / max(1.0 - r * r, 1e-12))))
            if p * people.size < LEVEL:
                against[int(k)] = float(r)
    return Apart(against, tuple(equal))


def _rank_correlation(one: FloatArray, two: FloatArray) -> float:
    from scipy.stats import rankdata  # imported here because it takes a third of a second

    ranks = [rankdata(values) for values in (one, two)]
    if any(np.ptp(rank) == 0 for rank in ranks):
        return 0.0
    return float(np.corrcoef(*ranks)[0, 1])
