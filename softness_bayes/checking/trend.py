"""Trend of ratings with the fabrics' modulus: rank correlations under each load, and their errors."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from softness_bayes.checking.quantities import Layout
from softness_bayes.likelihood.additive_fit import by_participants
from softness_bayes.likelihood.design import Design

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

LEVEL = 0.05
"""Two-sided p-value below which ratings are considered to rise or fall."""

LIMITS = (0.05, 0.95)
"""Quantiles that an interval lies between."""

FEWEST_FABRICS = 5
"""Smallest number of fabrics for a permutation of whole fabrics; fewer have too few orders to reach `LEVEL`."""

RESAMPLES, SHUFFLES = 500, 1999
"""Number of random weights of the participants, and of random orders of the fabrics if there are too many for all."""

_ALL_ORDERS = 720  # of six fabrics
_SEED = 0  # the same seed for every table, so that the result depends only on the data
_CELLS = 2_000_000  # total size of matrices solved at once
_ROUNDING = 1e-9  # means closer than this are tied


class Correlation(NamedTuple):
    """Spearman's rank correlation of mean ratings with E_fab, and its interval over participants."""

    value: float
    """NaN if moduli or means are all the same."""
    low: float
    high: float
    """5 and 95 % limits; NaN with one participant."""


class Trend(NamedTuple):
    """The trend of a table's ratings with stiffness."""

    loads: tuple[Correlation, ...]
    """Under each load, over its fabrics."""
    fabrics: tuple[int, ...]
    """Fabrics under each load."""
    mean: Correlation
    """Mean over loads with a correlation, weighted by their number of fabrics minus one."""
    p_value: float
    """Two-sided p-value of the mean correlation for a random order of the fabrics."""
    shuffled: str
    """Units permuted for the p-value: whole fabrics or, if there are few, the ratings of each participant."""

    @property
    def sign(self) -> int:
        """+1 if ratings clearly rise with stiffness, -1 if they clearly fall, 0 if the table does not decide."""
        return int(np.sign(self.mean.value)) if self.p_value <= LEVEL else 0


class KnownPart(NamedTuple):
    """The part of a table with known moduli."""

    layout: Layout
    rows: NDArray[np.bool_]
    """True for ratings of these fabrics, shape (rows,)."""
    conditions: NDArray[np.bool_]
    """True for their conditions, shape (conditions,)."""
    left_out: int
    """Number of rated fabrics without a known modulus."""


def known_part(layout: Layout, known: NDArray[np.bool_]) -> KnownPart:
    """Return the part of a table with known moduli, which alone shows a trend with stiffness.

    If fewer than two rated fabrics have one, it is the whole table.

    Parameters
    ----------
    layout
        Design of the ratings.
    known
        True for fabrics whose modulus was measured or bracketed, shape (fabrics,).
    """
    design, rated = layout.design, np.unique(layout.design.fabric)
    if known[rated].sum() < 2:
        known = np.ones_like(known)
    conditions = known[design.fabric]
    rows, place = conditions[design.condition], np.cumsum(conditions) - 1
    part = Design(
        place[design.condition[rows]], design.participant[rows], design.fabric[conditions], design.n_participants
    )
    kept = replace(layout, design=part, modulus=layout.modulus[conditions], load=layout.load[conditions])
    return KnownPart(kept, rows, conditions, int((~known[rated]).sum()))


def find_trend(layout: Layout, ratings: FloatArray) -> Trend:
    """Return the rank correlation of the fabrics' mean (log) ratings with their moduli under each load.

    Means are those of the additive fit of participants and conditions. Intervals come from randomly weighted
    participants (the Bayesian bootstrap: Rubin, Annals of Statistics 9, 130, 1981), which leaves no condition without
    ratings. The p-value compares the mean correlation with those of random orders of the fabrics, or of all orders.
    With fewer than `FEWEST_FABRICS` fabrics it permutes each participant's ratings under each load instead, with the
    normal approximation of Spearman's correlation in blocks (Page's test, with gaps and ties).

    Parameters
    ----------
    layout
        Design of the ratings, and the moduli.
    ratings
        Shape (rows,).
    """
    design = layout.design
    y = layout.scale.additive(ratings)
    weights = np.ones((1, design.n_participants))
    if (design.cells.sum(axis=1) > 0).sum() > 1:
        random = np.random.default_rng(_SEED).exponential(size=(RESAMPLES, design.n_participants))
        weights = np.concatenate([weights, random])
    means = condition_means(layout, y, weights)
    found, shared = _correlations(layout, means), _shares(layout)
    if np.unique(design.fabric).size >= FEWEST_FABRICS:
        p_value, shuffled = _p_of_fabrics(layout, means[0]), "the order of the fabrics"
    else:
        p_value, shuffled = _p_of_participants(layout, y), "the order of each participant's ratings"
    each, mean = tuple(map(_with_limits, found)), _with_limits(_mean(found, shared))
    return Trend(each, tuple(some.size for some in _by_load(layout)), mean, p_value, shuffled)


def condition_means(layout: Layout, y: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the condition effects of the additive fit, with weighted participants.

    Parameters
    ----------
    layout
        Design of the ratings.
    y
        Ratings on the additive scale, shape (rows,).
    weights
        Positive, shape (k, participants).

    Returns
    -------
    ndarray, shape (k, conditions)
        Condition means, with mean 0 over the conditions.
    """
    design = layout.design
    cells, count = design.cells, np.maximum(design.cells.sum(axis=1), 1.0)
    mean = np.bincount(design.participant, y, design.n_participants) / count
    within = np.zeros_like(cells)
    np.add.at(within, (design.participant, design.condition), y - mean[design.participant])
    size = design.n_conditions
    if by_participants(cells):
        return _means_by_participants(layout, y, weights)
    found, step = np.empty((len(weights), size)), max(1, _CELLS // size**2)
    for first in range(0, len(weights), step):
        w = weights[first : first + step]
        total = w @ cells
        laplacian = total[..., None] * np.eye(size) - cells.T @ ((w / count)[..., None] * cells)
        # means are known up to a constant, which is removed; in a disconnected table, up to one for each part; where
        # everybody rated one condition alone, nothing but rounding is left of the trace
        trace, rows = np.trace(laplacian, axis1=1, axis2=2), total.sum(axis=-1)
        scale = np.where(trace > 1e-6 * rows, trace, rows)[:, None, None]
        ridge = 1.0 / size + 1e-9 * scale * np.eye(size)
        found[first : first + step] = np.linalg.solve(laplacian + ridge, (w @ within)[..., None])[..., 0]
    return found - found.mean(axis=-1, keepdims=True)


def _means_by_participants(layout: Layout, y: FloatArray, weights: FloatArray) -> FloatArray:
    """Return `condition_means` by solving for the participants, of whom there are fewer than conditions."""
    from scipy.sparse.csgraph import connected_components  # imported here because it takes a third of a second

    design = layout.design
    cells = design.cells
    total = np.zeros_like(cells)
    np.add.at(total, (design.participant, design.condition), y - y.mean())
    shared = (cells @ cells.T) > 0
    _, part_of_person = connected_components(shared)
    part = part_of_person[cells.argmax(axis=0)]
    member = np.eye(part.max() + 1)[part]
    found = np.empty((len(weights), design.n_conditions))
    for k, w in enumerate(weights):
        own = w[:, None] * cells
        inverse = 1.0 / np.maximum(own.sum(axis=0), 1e-300)
        laplacian = np.diag(own.sum(axis=1)) - (own * inverse) @ own.T
        aim = w * total.sum(axis=1) - own @ (inverse * (w @ total))
        # known up to a constant for each part of the table, which is taken from the means
        scale = np.sqrt(np.maximum(np.diagonal(laplacian), 1e-300))
        person = np.linalg.lstsq(laplacian / scale[:, None] / scale, aim / scale, rcond=1e-10)[0] / scale
        found[k] = inverse * (w @ (total - cells * person[:, None]))
    found -= (found @ (member / member.sum(axis=0))) @ member.T
    return found - found.mean(axis=-1, keepdims=True)


def mean_correlation(layout: Layout, values: FloatArray) -> FloatArray:
    """Return the mean rank correlation over loads of values (rows, conditions) with E_fab, shape (rows,)."""
    return _mean(_correlations(layout, values), _shares(layout))


def _by_load(layout: Layout) -> list[IndexArray]:
    return [np.flatnonzero(layout.load == k) for k in layout.loads]


def _shares(layout: Layout) -> FloatArray:
    """Return the weight of each load: its number of fabrics minus one."""
    return np.array([some.size - 1.0 for some in _by_load(layout)])


def _correlations(layout: Layout, values: FloatArray) -> FloatArray:
    """Return the rank correlation under each load of values (rows, conditions), shape (loads, rows)."""
    return np.stack([_spearman(layout.modulus[some], values[:, some]) for some in _by_load(layout)])


def _p_of_fabrics(layout: Layout, mean: FloatArray) -> float:
    """Return the two-sided p-value of the mean correlation under orders of the fabrics, the same under every load.

    Moduli are ranked over all fabrics, not over those of each load.
    """
    rated, first, place = np.unique(layout.design.fabric, return_index=True, return_inverse=True)
    rank = _ranks(layout.modulus[first])
    if math.factorial(rated.size) <= _ALL_ORDERS:
        orders = np.array([*itertools.permutations(range(rated.size))])
    else:
        shuffled = np.random.default_rng(_SEED).permuted(np.tile(np.arange(rated.size), (SHUFFLES, 1)), axis=1)
        orders = np.concatenate([np.arange(rated.size)[None], shuffled])
    found = np.stack([_correlation(rank[orders[:, place[some]]], _ranks(mean[some])) for some in _by_load(layout)])
    statistic = np.abs(_mean(found, _shares(layout)))
    # the first order is the observed one, which is included
    return float(np.mean(~(statistic < statistic[0] - _ROUNDING)))


def _p_of_participants(layout: Layout, y: FloatArray) -> float:
    """Return the two-sided p-value of the ranks' products within participants and loads, each permuted separately."""
    design = layout.design
    block = design.participant * (int(layout.load.max()) + 1) + layout.load[design.condition]
    x, total, variance = layout.modulus[design.condition], 0.0, 0.0
    for k in np.unique(block):
        one, other = (_ranks(values[block == k]) for values in (x, y))
        one, other = one - one.mean(), other - other.mean()
        if one.size > 1:
            total += float(one @ other)
            variance += float(one @ one) * float(other @ other) / (one.size - 1)
    return float(2.0 * ndtr(-abs(total) / math.sqrt(variance))) if variance > 0 else 1.0


def _spearman(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return rank correlations of x, shape (k,), with every row of y, shape (rows, k); NaN if one is constant."""
    return _correlation(_ranks(y), _ranks(x))


def _correlation(rows: FloatArray, x: FloatArray) -> FloatArray:
    """Return the correlation of every row, shape (rows, k), with x; NaN if one is constant."""
    rows, x = rows - rows.mean(axis=1, keepdims=True), x - x.mean()
    size = np.sqrt((x @ x) * (rows**2).sum(axis=1))
    return np.divide(rows @ x, size, out=np.full(len(rows), np.nan), where=size > 0)


def _ranks(values: FloatArray) -> FloatArray:
    """Return ranks from 1 along the last axis; ties (up to rounding errors) share their mean rank."""
    order = np.argsort(values, axis=-1)
    ordered = np.take_along_axis(values, order, -1)
    apart = np.diff(ordered, axis=-1) > _ROUNDING * np.maximum(np.ptp(values, axis=-1, keepdims=True), 1e-6)
    place, edge = np.arange(values.shape[-1]), np.ones((*values.shape[:-1], 1), dtype=bool)
    first = np.maximum.accumulate(np.where(np.concatenate([edge, apart], -1), place, 0), axis=-1)
    after = np.where(np.concatenate([apart, edge], -1), place, place.size)
    last = np.minimum.accumulate(after[..., ::-1], axis=-1)[..., ::-1]
    found = np.empty(values.shape)
    np.put_along_axis(found, order, 1.0 + 0.5 * (first + last), -1)
    return found


def _mean(found: FloatArray, weight: FloatArray) -> FloatArray:
    """Return weighted means over loads of correlations (loads, resamples); NaN if no load has one."""
    known = np.isfinite(found) & (weight[:, None] > 0)
    total = (known * weight[:, None]).sum(axis=0)
    summed = (np.where(known, found, 0.0) * weight[:, None]).sum(axis=0)
    return np.divide(summed, total, out=np.full_like(summed, np.nan), where=total > 0)


def _with_limits(found: FloatArray) -> Correlation:
    """Return the first value with the limits of the following ones."""
    known = found[1:][np.isfinite(found[1:])]
    low, high = np.quantile(known, LIMITS).tolist() if known.size else (math.nan, math.nan)
    return Correlation(float(found[0]), low, high)
