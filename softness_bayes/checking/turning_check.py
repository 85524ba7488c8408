"""Check of the turning point: whether the model reproduces it under each load, and the power of the check.

The alternative is derived from the run itself: each replicated table is simulated again with the same draw, effects and
noise, but with the response held at its peak for all stiffer fabrics. The check is applied to these tables; the share
that fails is its power.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from softness_bayes.checking.quantities import DROP, PLACE, TURNS_OVER, above, find_turn
from softness_bayes.likelihood.layout import Additive, Layout

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FloatArray = NDArray[np.float64]

DOUBTFUL = 0.05
"""Two-sided p-value below which a model does not reproduce a test quantity."""

NEEDED = 0.8
"""Power above which a passed check means that the model reproduces the turning point."""

PLATEAU, EXCESS = "levelled_predictive", "levelled_shortfall"
"""Group with the test quantities of tables from a response that levels off, and the variable of `constant_data` with
the amount by which its mean ratings exceed the model's."""

FALL = "fall beyond inflection / expected"
"""The test quantity of `fall` under each load."""

LARGEST_RATIO = 10.0
"""Multiple of the predicted fall up to which falls of simulated tables are reported; a smaller one is lost in noise."""


def plateau(layout: Layout, response: FloatArray) -> FloatArray:
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


def fall(layout: Layout, condition: FloatArray, expected: FloatArray, excess: FloatArray) -> FloatArray:
    """Return the fall of mean ratings beyond the peak, as a multiple of the fall that the model predicts.

    It is the slope of a regression. The dependent variable is the mean rating minus its expectation under a response
    that levels off; the regressor is the model's expectation minus the same. The slope is expected to be 1 under the
    model, and 0 under the response that levels off.

    Parameters
    ----------
    layout
        Moduli, loads and numbers of ratings of the conditions.
    condition
        Mean (log) rating of each condition, shape (..., conditions).
    expected, excess
        Mean ratings that the model expects, and the excess over them of a response that levels off; shape
        (conditions,).

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


class TurnQuantities(NamedTuple):
    """Test quantities of the turning point in tables of ratings, every field of shape (tables, loads)."""

    turns_over: FloatArray
    e_fab_kpa: FloatArray
    drop: FloatArray
    """These three as in `quantities.RatingsTurn`."""
    fall: FloatArray
    """As in `fall`."""

    @classmethod
    def of(cls, layout: Layout, fit: Additive, expected: FloatArray, excess: FloatArray) -> TurnQuantities:
        """Return the test quantities of the fits of some tables."""
        return cls(*find_turn(layout, fit), fall(layout, fit.condition, expected, excess))


def plateau_quantities(layout: Layout, model: FloatArray, other: FloatArray) -> tuple[TurnQuantities, FloatArray]:
    """Return test quantities of tables of the response that levels off, and its excess over the model.

    Parameters
    ----------
    layout
        Design of the ratings.
    model, other
        Ratings replicated under the model and, with the same draws, effects and noise, under the response that levels
        off; shape (tables, rows).

    Returns
    -------
    quantities : TurnQuantities
    excess : ndarray, shape (conditions,)
        Of mean ratings.
    """
    fit, expected = layout.fit(other), layout.fit(model).condition.mean(axis=0)
    excess = fit.condition.mean(axis=0) - expected
    return TurnQuantities.of(layout, fit, expected, excess), excess


def departs(p_values: FloatArray, fall_p_value: FloatArray) -> NDArray[np.bool_]:
    """Return whether test quantities lie outside the range of the replicates.

    Half of `DOUBTFUL` is assigned to a fall that is too small, as for a response that levels off. Presence, place and
    drop share the other half, or all of it if the model's response does not fall.

    Parameters
    ----------
    p_values
        Probabilities of larger values of presence, place and drop; shape (..., 3), NaN if not known.
    fall_p_value
        From `fall_p_value`, shape (...).
    """
    falls = np.isfinite(fall_p_value)
    level = np.where(falls, 0.5, 1.0) * DOUBTFUL / np.maximum(np.isfinite(p_values).sum(axis=-1), 1)
    two_sided = np.where(np.isfinite(p_values), 2.0 * np.minimum(p_values, 1.0 - p_values), 1.0).min(axis=-1)
    too_small = np.where(falls, 1.0 - fall_p_value, 1.0) < 0.5 * DOUBTFUL
    return np.asarray(too_small | (two_sided < level))


def fall_p_value(values: FloatArray, replicates: FloatArray) -> FloatArray:
    """Return the probability that a replicate's fall is larger, from their mean and standard deviation.

    The fall is linear in the means of many ratings, hence normal. Counting would be too coarse in the tail of some
    hundred replicates.
    """
    spread = replicates.std(ddof=1)
    if not spread > 0:
        return np.full(np.shape(values), np.nan)
    return np.asarray(ndtr((replicates.mean() - values) / spread))


class Power(NamedTuple):
    """Power of a check: the share of tables under one load in which it rejects the alternative."""

    value: float
    error: float
    """Its Monte-Carlo standard error."""


def power(alternative: TurnQuantities, replicates: TurnQuantities, groups: int = 20) -> list[Power]:
    """Return the power of the check of each load, NaN if there are too few ratings.

    Its error is estimated by a jackknife over groups of tables, and is at least the binomial error.

    Parameters
    ----------
    alternative, replicates
        Tables made under the alternative and under the model, pairs of the same draw.
    groups
        Number of groups.
    """
    found, size = [], len(alternative.turns_over)
    group = np.arange(size) % groups
    for load in range(alternative.turns_over.shape[1]):
        if not np.isfinite(alternative.turns_over[:, load]).all():
            found.append(Power(np.nan, np.nan))
            continue
        share, *left = (
            _share_that_fails(*(TurnQuantities(*(v[kept, load] for v in q)) for q in (alternative, replicates)))
            for kept in (group >= 0, *(group != g for g in range(groups)))
        )
        smoothed = (share * size + 0.5) / (size + 1.0)
        variance = max((groups - 1) * float(np.var(left)), smoothed * (1.0 - smoothed) / size)
        found.append(Power(share, math.sqrt(variance)))
    return found


def _share_that_fails(alternative: TurnQuantities, replicates: TurnQuantities) -> float:
    """Return the share of alternative tables, under one load, that lie outside the range of the replicates."""
    shown = zip(alternative[:3], replicates[:3], strict=True)
    p_values = np.stack([above(values, others) for values, others in shown], axis=-1)
    return float(departs(p_values, fall_p_value(alternative.fall, replicates.fall)).mean())


class PlateauCheck(NamedTuple):
    """Fall of ratings and replicates beyond the peak, and the power of the check, of each load."""

    observed: FloatArray
    """Shape (loads,)."""
    replicated: FloatArray
    """Shape (replicates, loads)."""
    power: list[Power]


def check_plateau(tree: xr.DataTree, layout: Layout, data: Additive, replicates: Additive) -> PlateauCheck:
    """Compare the ratings of a result with its response that levels off.

    Parameters
    ----------
    tree
        The groups of the result.
    layout
        Rater, fabric and load of each rating.
    data, replicates
        Fits of the ratings, and of the posterior's replicated ones.
    """
    stored = tree[PLATEAU].to_dataset().isel(chain=0)
    other = TurnQuantities(*(stored[f"levelled_{name}"].values[:, layout.loads] for name in TurnQuantities._fields))
    excess = np.zeros(layout.design.n_conditions)
    excess[layout.design.condition] = tree["constant_data"].to_dataset()[EXCESS].values
    expected = replicates.condition.mean(axis=0)
    same = TurnQuantities.of(layout, replicates, expected, excess)
    return PlateauCheck(fall(layout, data.condition, expected, excess), same.fall, power(other, same))


class Reproduction(NamedTuple):
    """Verdict on the turning point under one load."""

    load: str
    reproduced: bool | None
    """None if the ratings do not decide."""
    checks: Mapping[str, pd.Series]
    """Rows of the table of checks by quantity."""


def turns_reproduced(table: pd.DataFrame) -> list[Reproduction]:
    """Decide for each load whether the model reproduces the turning point.

    The model fails if presence, place, drop or fall lies outside the range of the replicates (`departs`). Otherwise it
    passes if a response that levels off at its peak would fail in at least `NEEDED` of the tables; with less power, the
    ratings do not decide.

    Parameters
    ----------
    table
        From `check_table.check_table`.
    """
    checks = table[table.index.get_level_values("law") == "posterior"].droplevel("law")
    found = []
    for load in dict.fromkeys(checks.loc[[TURNS_OVER], "load"]):
        rows = {str(name): row for name, row in checks[checks["load"] == load].iterrows()}
        reproduced = None
        if np.isfinite(rows[TURNS_OVER]["observed"]):
            p_values = np.array([rows[name]["p_value"] for name in (TURNS_OVER, PLACE, DROP)], float)
            beyond = np.array(rows[FALL]["p_value"], float)
            able = rows[TURNS_OVER]["power"] >= NEEDED
            reproduced = False if departs(p_values, beyond) else True if able else None
        found.append(Reproduction(load, reproduced, rows))
    return found
