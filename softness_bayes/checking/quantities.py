"""Test quantities of ratings: summaries of a data set that a model should reproduce.

Each is computed in the same way from observed and replicated ratings, without using any parameter. All start from an
additive fit of participants and conditions to log ratings (or to z-scores), which is not biased by missing ratings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri, smirnovi

from softness_bayes.likelihood.layout import ROUNDING, Additive, Layout

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

TAIL = 0.9
"""Share of the replicates' largest deviations beyond which the probability of larger ones is extrapolated."""

CLEAR = 2.0
"""Number of standard errors by which an interior maximum of mean ratings must exceed both ends."""


class RatingsTurn(NamedTuple):
    """Turn of mean log ratings along the fabrics of each load, every field of shape (..., loads)."""

    interior: Array
    """1 with an interior maximum, 0 without; NaN with fewer than three moduli or without residual spread."""
    modulus: Array
    """E_fab at the maximum [Pa]; NaN unless it is interior."""
    drop: Array
    """Fall of the mean log rating from the maximum to the stiffest fabric; 0 if that is the maximum."""


def find_turn(layout: Layout, fit: Additive) -> RatingsTurn:
    """Locate the maximum of the mean log rating under each load (the minimum if ratings fall with the response).

    It is interior if it exceeds the means of the softest and of the stiffest fabric by `CLEAR` standard
    errors of their difference. Its place is the vertex of the parabola through it and its neighbours in
    ln E_fab.
    """
    count = layout.design.cells.sum(axis=0)
    found = [_turn_of_load(layout, fit, count, np.flatnonzero(layout.load == k)) for k in layout.loads]
    return RatingsTurn(*(np.stack(field, axis=-1) for field in zip(*found, strict=True)))


def _turn_of_load(layout: Layout, fit: Additive, count: Array, conditions: IndexArray) -> tuple[Array, ...]:
    conditions = conditions[np.argsort(layout.modulus[conditions], kind="stable")]
    mean, x = layout.sign * fit.condition[..., conditions], np.log(layout.modulus[conditions])
    if np.unique(x).size < 3 or not (fit.sd > ROUNDING).all():
        return (np.full(mean.shape[:-1], np.nan),) * 3
    top = mean.argmax(axis=-1)
    peak = mean.max(axis=-1)
    rows = count[conditions]
    interior = (top > 0) & (top < x.size - 1)
    for end in (0, -1):
        error = fit.sd * np.sqrt(1.0 / rows[top] + 1.0 / rows[end])
        interior &= peak - mean[..., end] > CLEAR * error
    middle = np.clip(top, 1, x.size - 2)
    left, here, right = (np.take_along_axis(mean, (middle + k)[..., None], -1)[..., 0] for k in (-1, 0, 1))
    before, after = x[middle] - x[middle - 1], x[middle + 1] - x[middle]
    with np.errstate(divide="ignore", invalid="ignore"):
        rise, fall = (here - left) / before, (right - here) / after
        slope, bend = (rise * after + fall * before) / (before + after), 2.0 * (fall - rise) / (before + after)
        offset = np.clip(np.where(bend < 0, -slope / bend, 0.0), -before, after)
    return interior.astype(float), np.where(interior, np.exp(x[middle] + offset), np.nan), peak - mean[..., -1]


class Columns(Enum):
    """The columns of a quantity, one value each."""

    ALL = "all ratings"
    CONDITION = "each condition"
    LOAD = "each load"
    PARTICIPANT = "each participant"


@dataclass(frozen=True)
class Quantity:
    """A test quantity.

    Parameters
    ----------
    name
        As in tables.
    new_participants
        Whether replicates are for new participants instead of those in the data.
    columns
        Entities for which the quantity has one value each.
    of
        Values of data sets, shape (..., columns).
    centre
        Summary of the replicates in a table.
    """

    name: str
    new_participants: bool
    columns: Columns
    of: Callable[[Layout, Additive], Array]
    centre: Callable[[Array], np.floating] = np.median


TURNS_OVER, PLACE, DROP = "turns over", "inflection e_fab_kpa", "drop beyond inflection"
"""The quantities of the turning point (maximum; the paper's inflection) under each load."""


def _spread_of_participants(_: Layout, fit: Additive) -> Array:
    present = fit.participant[..., np.isfinite(fit.participant).reshape(-1, fit.participant.shape[-1]).all(axis=0)]
    if present.shape[-1] < 2:
        return np.full((*present.shape[:-1], 1), np.nan)
    spread = present.std(axis=-1, ddof=1, keepdims=True)
    return np.where(spread > 0.0, spread, np.nan)


def _in_spreads(extreme: Array, sd: Array) -> Array:
    """Return an extreme residual in standard deviations, NaN if there are no deviations."""
    return np.where(sd > ROUNDING, extreme / np.maximum(sd, ROUNDING), np.nan)[..., None]


QUANTITIES = (
    Quantity("mean log rating", False, Columns.CONDITION, lambda _, fit: fit.condition),
    Quantity(TURNS_OVER, False, Columns.LOAD, lambda layout, fit: find_turn(layout, fit).interior, np.mean),
    Quantity(PLACE, False, Columns.LOAD, lambda layout, fit: 1e-3 * find_turn(layout, fit).modulus),
    Quantity(DROP, False, Columns.LOAD, lambda layout, fit: find_turn(layout, fit).drop),
    Quantity("participant log mean", False, Columns.PARTICIPANT, lambda _, fit: fit.participant),
    Quantity("spread of participants", True, Columns.ALL, _spread_of_participants),
    Quantity("residual spread", False, Columns.ALL, lambda _, fit: fit.sd[..., None]),
    Quantity("largest residual / sd", False, Columns.ALL, lambda _, fit: _in_spreads(fit.largest, fit.sd)),
    Quantity("smallest residual / sd", False, Columns.ALL, lambda _, fit: _in_spreads(fit.smallest, fit.sd)),
)
"""The test quantities, in the order of their table."""

SUMMARIES = tuple(one.name for one in QUANTITIES if one.name not in (TURNS_OVER, PLACE, DROP))
"""Names of those that are not about the turning point."""

PIT = "LOO-PIT"
"""Name of the check of LOO-PIT values in the table."""


class QuantityCheck(NamedTuple):
    """One number of the data compared with its replicates."""

    observed: float
    replicated: float
    """Median of the replicates with a value; for yes-no quantities, the share of yes."""
    low: float
    high: float
    """Limits of the replicates, joint over the columns."""
    p_value: float
    """P(replicate > observed) + P(equal) / 2 among replicates with a value; NaN if the data or replicates have none."""
    p_joint: float
    """Probability that any column of a replicate deviates as much (`joint_p_values`)."""


def check_values(
    observed: Array,
    replicated: Array,
    centre: Callable[[Array], np.floating] = np.median,
    probability: float = 0.9,
) -> list[QuantityCheck]:
    """Compare values of the data with those of replicates, with one result per column.

    Parameters
    ----------
    observed
        Shape (columns,).
    replicated
        Shape (replicates, columns).
    centre
        Summary of the replicates of a column.
    probability
        Share of replicates with all columns within the limits.
    """
    found = []
    columns = observed, replicated.T, *joint_limits(replicated, probability), joint_p_values(observed, replicated)
    for value, each, low, high, p_joint in zip(*columns, strict=True):
        known = each[np.isfinite(each)]
        middle = float(centre(known)) if known.size else np.nan
        above = 0.5 * ((known > value).mean() + (known >= value).mean()) if known.size else np.nan
        p_value = float(above) if np.isfinite(value) else np.nan
        found.append(QuantityCheck(float(value), middle, float(low), float(high), p_value, float(p_joint)))
    return found


def joint_p_values(observed: Array, replicated: Array) -> Array:
    """Return the probability that any column of a replicate deviates as much as each of the data, shape (columns,).

    Deviations are in standard deviations of the replicates, about their mean. The tail beyond nine tenths of the
    replicates' largest deviations is exponential or lighter: the probability there is that of a further exponential
    excess, given the k observed ones, (1 + x / (k mean))^-k. NaN for columns without a value.
    """
    known = np.isfinite(observed) & np.isfinite(replicated).any(axis=0)
    found = np.full(observed.shape, np.nan)
    if not known.any():
        return found
    mean, sd = np.nanmean(replicated[:, known], axis=0), np.nanstd(replicated[:, known], axis=0)

    def deviation(values: Array) -> Array:
        apart = np.abs(values - mean)
        return np.asarray(np.divide(apart, sd, out=np.where(apart > 0, np.inf, 0.0), where=sd > ROUNDING))

    largest = np.sort(np.nan_to_num(deviation(replicated[:, known])).max(axis=1))
    size = largest.size
    limit = largest[int(TAIL * size)]
    further = largest[int(TAIL * size) + 1 :] - limit
    own = deviation(observed[known])
    counted = (size - np.searchsorted(largest, own * (1.0 - 1e-9)) + 1.0) / (size + 1.0)
    ratio = np.maximum(own - limit, 0.0) / max(float(further.sum()), ROUNDING)
    beyond = (1.0 - TAIL) * (1.0 + ratio) ** -further.size
    found[known] = np.where(own > limit, beyond, counted)
    return found


def joint_limits(replicated: Array, probability: float) -> tuple[Array, Array]:
    """Return limits that contain a share of the replicates in all columns at once, by equal ranks in every column.

    Columns with missing values get limits of their own, over the replicates that have a value.
    """
    size, columns = replicated.shape
    whole = np.isfinite(replicated).all(axis=0)
    low, high = np.full(columns, np.nan), np.full(columns, np.nan)
    tail = 0.5 * (1.0 - probability)
    for k in np.flatnonzero(~whole):
        known = replicated[:, k][np.isfinite(replicated[:, k])]
        if known.size:
            low[k], high[k] = np.quantile(known, [tail, 1.0 - tail])
    if whole.any():
        values = np.sort(replicated[:, whole], axis=0)
        rank = np.argsort(np.argsort(replicated[:, whole], axis=0), axis=0)
        depth = np.minimum(rank, size - 1 - rank).min(axis=1)  # distance of the outermost column from the ends
        cut = int(np.quantile(depth, 1.0 - probability, method="lower"))
        low[whole], high[whole] = values[cut], values[size - 1 - cut]
    return low, high


def simultaneous_band(size: int, points: ArrayLike, probability: float) -> tuple[Array, Array]:
    """Return limits that contain the empirical distribution function of uniform values with given probability.

    Parameters
    ----------
    size
        Number of values.
    points
        Increasing points inside (0, 1) at which values are counted, shape (points,).
    probability
        Smallest probability of staying within all limits.

    Returns
    -------
    low, high : ndarray, shape (points,)
        Smallest and largest share of values up to each point.
    """
    # either side alone half as often, a bound that is 2e-5 wide at 0.9: SciPy takes a second to import the exact law
    points, half = np.asarray(points, float), float(smirnovi(size, 0.5 * (1.0 - probability)))
    return np.maximum(points - half, 0.0), np.minimum(points + half, 1.0)


def uniformity_p_value(values: ArrayLike, points: ArrayLike) -> float:
    """Return the probability that independent uniform values deviate at least as much at some point as these.

    Counts at some points deviate less than those at all, so that the probability is an upper limit, and a close one for
    many points.

    Parameters
    ----------
    values
        Numbers between 0 and 1, shape (values,); a value at a point counts as below it. Ranks 0 to L are written as
        (rank + 1) / (L + 1).
    points
        Rising points inside (0, 1), shape (points,).
    """
    from scipy.stats import kstwo

    values, points = np.sort(np.asarray(values, float)), np.asarray(points, float)
    share = np.searchsorted(values, points * (1.0 + 1e-12), side="right") / values.size
    return float(kstwo.sf(np.abs(share - points).max(), values.size))


DOUBTFUL = 0.05
"""Probability with which a correct model fails any check of its turning points, and the same for all other checks."""

NEEDED = 0.8
"""Power above which a passed check means that the model reproduces the turning point."""

EXCESS = "levelled_shortfall"
"""Variable of `constant_data`: amount by which mean ratings under a response that levels off exceed the model's."""

FALL = "fall beyond inflection / expected"
"""The test quantity of `fall` under each load."""

LARGEST_RATIO = 10.0
"""Multiple of the predicted fall up to which falls of simulated tables are reported; a smaller one is lost in noise."""


def plateau(layout: Layout, response: Array) -> Array:
    """Return responses held at their peak, so that they never fall with the fabric's modulus under a load.

    Parameters
    ----------
    layout
        Moduli and loads of the conditions.
    response
        Shape (..., conditions).
    """
    held = np.array(response, float)
    for load in layout.loads:
        here = np.flatnonzero(layout.load == load)
        here = here[np.argsort(layout.modulus[here], kind="stable")]
        held[..., here] = np.maximum.accumulate(response[..., here], axis=-1)
    return held


def excess_of_plateau(layout: Layout, model: Array, level: Array) -> Array:
    """Return the excess of mean ratings under a response that levels off, shape (conditions,).

    Parameters
    ----------
    layout
        Design of the ratings.
    model, level
        Ratings replicated under the model and, with the same draws, effects and noise, under the response that levels
        off; shape (tables, rows).
    """
    return np.asarray((layout.fit(level).condition - layout.fit(model).condition).mean(axis=0))


def fall(layout: Layout, condition: Array, expected: Array, excess: Array) -> Array:
    """Return the fall of mean ratings beyond the peak, as a multiple of the fall that the model predicts.

    It is the slope of a regression. The dependent variable is the mean rating minus its expectation under a response
    that levels off; the regressor is the model's expectation minus the same.

    Parameters
    ----------
    layout
        Moduli, loads and numbers of ratings of the conditions.
    condition
        Mean (log) rating of each condition, shape (..., conditions).
    expected, excess
        Mean ratings that the model expects, and `excess_of_plateau`; shape (conditions,).

    Returns
    -------
    ndarray, shape (..., loads)
        NaN if the model's response does not fall within the range of the fabrics.
    """
    count, found = layout.design.cells.sum(axis=0), []
    for load in layout.loads:
        here = np.flatnonzero(layout.load == load)
        weight = count[here] / count[here].sum()
        more = excess[here] - weight @ excess[here]
        squares = weight @ more**2
        if squares < 1e-12:  # (log) ratings that vary by less than 1e-6 do not fall
            found.append(np.full(condition.shape[:-1], np.nan))
            continue
        found.append(1.0 - ((condition[..., here] - expected[here]) @ (weight * more)) / squares)
    return np.stack(found, axis=-1)


def fall_p_value(observed: float, replicates: Array) -> float:
    """Return the probability that a replicate's fall is larger, from their normal law; NaN if they do not vary."""
    spread = replicates.std(ddof=1)
    return float(ndtr((replicates.mean() - observed) / spread)) if spread > 0 else math.nan


def power(replicates: Array, level: float) -> tuple[float, float]:
    """Return the probability that a response that levels off fails the check under one load, and its standard error.

    Parameters
    ----------
    replicates
        Falls of replicates of the model, shape (replicates,).
    level
        Probability of a smaller fall below which the check fails.
    """
    spread = replicates.std(ddof=1)
    if not spread > 0:
        return math.nan, math.nan
    score = 1.0 / spread + float(ndtri(level))
    slope = math.exp(-0.5 * score**2) / math.sqrt(2.0 * math.pi) / spread
    return float(ndtr(score)), slope / math.sqrt(2.0 * replicates.size)


class Reproduction(NamedTuple):
    """Verdict on the turning point under one load."""

    load: str
    reproduced: bool | None
    """None if the ratings do not decide."""
    checks: Mapping[str, pd.Series]
    """Rows of the table of checks by quantity."""


def turns_reproduced(table: pd.DataFrame) -> list[Reproduction]:
    """Decide for each load whether the model reproduces the turning point.

    The model fails if the fall is smaller than those of its replicates; where its response does not fall within the
    range of the fabrics, if the ratings turn over all the same. Otherwise it passes if a response that levels off would
    fail in at least `NEEDED` of the tables; with less power, the ratings do not decide.

    Parameters
    ----------
    table
        From `check_table.check_table`.
    """
    checks = table[table.index.get_level_values("law") == "posterior"].droplevel("law")
    found = []
    for load in dict.fromkeys(checks.loc[[TURNS_OVER], "load"]):
        rows = {str(name): row for name, row in checks[checks["load"] == load].iterrows()}
        failed = any(rows[name]["p_adjusted"] < DOUBTFUL for name in (FALL, TURNS_OVER))  # NaN is not
        able = np.isfinite(rows[TURNS_OVER]["observed"]) and rows[FALL]["power"] >= NEEDED
        found.append(Reproduction(load, False if failed else True if able else None, rows))
    return found
