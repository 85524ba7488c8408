"""Power of the check of the turning point against a response that levels off at its peak.

The alternative is derived from the run itself: each replicated table is simulated again with the same draw, effects and
noise, but with the response held at its peak for all stiffer fabrics. The check is applied to these tables; the share
that fails is its power.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from softness_bayes.checking.layout import Additive, Layout
from softness_bayes.checking.quantities import find_turn

FloatArray = NDArray[np.float64]

DOUBTFUL = 0.05
"""Two-sided p-value below which a model does not reproduce a test quantity."""

NEEDED = 0.8
"""Power above which a passed check means that the model reproduces the turning point."""


GROUPS = 20
"""Number of groups of tables for the jackknife."""

LEAST_SHORTFALL = 1e-6
"""Variation of the model's fall in mean (log) ratings below which there is no fall."""


class Power(NamedTuple):
    """Power of a check: the share of tables under one load in which it rejects the alternative."""

    value: float
    error: float
    """Its Monte-Carlo standard error."""


def levelled(layout: Layout, response: FloatArray) -> FloatArray:
    """Return responses held at their peak, so that they never fall with the fabric's modulus under a load.

    Parameters
    ----------
    layout
        Moduli and loads of the conditions.
    response
        Shape (..., conditions).
    """
    found = np.array(response, float)
    for load in layout.loads:
        here = np.flatnonzero(layout.load == load)
        here = here[np.argsort(layout.modulus[here], kind="stable")]
        found[..., here] = np.maximum.accumulate(response[..., here], axis=-1)
    return found


def fall(layout: Layout, condition: FloatArray, expected: FloatArray, shortfall: FloatArray) -> FloatArray:
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
    expected, shortfall
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
        less = shortfall[here] - weight @ shortfall[here]
        squares = weight @ less**2
        if squares < LEAST_SHORTFALL**2:
            found.append(np.full(condition.shape[:-1], np.nan))
            continue
        found.append(1.0 - ((condition[..., here] - expected[here]) @ (weight * less)) / squares)
    return np.stack(found, axis=-1)


class Tables(NamedTuple):
    """Test quantities of the turning point in tables of ratings, every field of shape (tables, loads)."""

    interior: FloatArray
    modulus: FloatArray
    drop: FloatArray
    """These three as in `quantities.RatingsTurn`."""
    fall: FloatArray
    """As in `fall`."""

    @classmethod
    def of(cls, layout: Layout, fit: Additive, expected: FloatArray, shortfall: FloatArray) -> Tables:
        """Return the test quantities of the fits of some tables."""
        return cls(*find_turn(layout, fit), fall(layout, fit.condition, expected, shortfall))


def compare_levelled(layout: Layout, model: FloatArray, other: FloatArray) -> tuple[Tables, FloatArray]:
    """Return test quantities of tables of the levelled response, and its excess over the model in each condition.

    Parameters
    ----------
    layout
        Design of the ratings.
    model, other
        Ratings replicated under the model and, with the same draws, effects and noise, under the levelled response;
        shape (tables, rows).
    """
    fit, expected = layout.fit(other), layout.fit(model).condition.mean(axis=0)
    shortfall = fit.condition.mean(axis=0) - expected
    return Tables.of(layout, fit, expected, shortfall), shortfall


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


def power(alternative: Tables, replicates: Tables) -> list[Power]:
    """Return the power of the check of each load, NaN if there are too few ratings.

    Its error is estimated by a jackknife over groups of tables, and is at least the binomial error.

    Parameters
    ----------
    alternative, replicates
        Tables made under the alternative and under the model, pairs of the same draw.
    """
    found = []
    for k in range(alternative.interior.shape[1]):
        other, same = (Tables(*(field[:, k] for field in tables)) for tables in (alternative, replicates))
        if not np.isfinite(other.interior).all():
            found.append(Power(np.nan, np.nan))
            continue
        size, share = other.interior.size, _share_that_fails(other, same)
        group = np.arange(size) % GROUPS
        left = [_share_that_fails(*(Tables(*(f[group != g] for f in t)) for t in (other, same))) for g in range(GROUPS)]
        smoothed = (share * size + 0.5) / (size + 1.0)
        variance = max((GROUPS - 1) * float(np.var(left)), smoothed * (1.0 - smoothed) / size)
        found.append(Power(share, math.sqrt(variance)))
    return found


def _share_that_fails(alternative: Tables, replicates: Tables) -> float:
    """Return the share of alternative tables, under one load, that lie outside the range of the replicates."""
    shown = zip(alternative[:3], replicates[:3], strict=True)
    p_values = np.stack([_above(values, others) for values, others in shown], axis=-1)
    return float(departs(p_values, fall_p_value(alternative.fall, replicates.fall)).mean())


def _above(values: FloatArray, replicates: FloatArray) -> FloatArray:
    """Return P(replicate > value) + P(equal) / 2 among replicates with a value; NaN if the value or all are missing."""
    known = np.sort(replicates[np.isfinite(replicates)])
    if known.size == 0:
        return np.full(values.shape, np.nan)
    below, up_to = (np.searchsorted(known, values, side) for side in ("left", "right"))
    return np.where(np.isfinite(values), 1.0 - 0.5 * (below + up_to) / known.size, np.nan)
