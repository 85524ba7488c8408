"""Check of the turning point: the fall of mean ratings beyond the peak, compared with a response that levels off there.

The fall is linear in the means of many ratings and therefore nearly normal: its expectation is 1 under the model and 0
under the alternative, whose ratings scatter alike. That gives the power of the check from its scatter over replicates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from softness_bayes.checking.quantities import TURNS_OVER
from softness_bayes.likelihood.layout import Layout

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

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


def excess_of_plateau(layout: Layout, model: FloatArray, level: FloatArray) -> FloatArray:
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


def fall(layout: Layout, condition: FloatArray, expected: FloatArray, excess: FloatArray) -> FloatArray:
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


def fall_p_value(observed: float, replicates: FloatArray) -> float:
    """Return the probability that a replicate's fall is larger, from their normal law; NaN if they do not vary."""
    spread = replicates.std(ddof=1)
    return float(ndtr((replicates.mean() - observed) / spread)) if spread > 0 else math.nan


def power(replicates: FloatArray, level: float) -> tuple[float, float]:
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
