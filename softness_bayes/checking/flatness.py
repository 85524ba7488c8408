"""Whether a prediction follows the differences between fabrics that ratings show, or runs flat through them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, fdtri

from softness_bayes.checking.quantities import ROUNDING, Additive, Layout

FloatArray = NDArray[np.float64]

LEVEL = 1e-3
"""p-value below which fabrics differ beyond doubt."""

FLAT = 0.1
"""Share of these differences below which a prediction is flat; and of all loads', below which one load's are few."""


class Explained(NamedTuple):
    """What a prediction explains of the differences between the fabrics under one load, or under all of them."""

    share: float
    """Of their variance beyond noise, median over draws; negative where the prediction runs the other way. NaN where
    fabrics do not differ."""
    low: float
    high: float
    """5 and 95 % limits over draws."""
    spread: float
    """Standard deviation of mean (log) ratings between fabrics, beyond noise."""
    p_value: float
    """Of mean ratings that differ as much by noise alone; NaN where nothing tells noise from differences."""
    visible: float
    """Standard deviation between fabrics that would have been seen."""
    matters: bool
    """Whether these differences are more than a tenth of those under all loads."""

    @property
    def flat(self) -> bool:
        """True if the prediction is flat where fabrics differ."""
        return bool(self.p_value < LEVEL and self.share < FLAT and self.matters)


def explain(layout: Layout, fit: Additive, predicted: FloatArray) -> list[Explained]:
    """Return what a prediction explains under each load, then under all of them, loads' own means taken away.

    With S the sum of squares of the fabrics' means about the mean of their load, S_m that of what the prediction
    leaves of them, and n what noise alone would make of either, the share is 1 - (S_m - n) / (S - n). Whether fabrics
    differ is an F-test of S against the residuals of the additive fit.

    Parameters
    ----------
    layout
        Who rated what.
    fit
        The additive fit of the ratings.
    predicted
        (Log) rating that is predicted of each condition, up to a constant of each draw, shape (draws, conditions).
    """
    count = layout.design.cells.sum(axis=0)
    parts = [np.flatnonzero(layout.load == k) for k in layout.loads]
    seen, left = np.zeros(len(parts)), np.zeros((len(parts), len(predicted)))
    for k, some in enumerate(parts):
        seen[k] = _squares(fit.condition[some], count[some])
        left[k] = _squares(fit.condition[some] - predicted[:, some], count[some])
    freedom = np.array([some.size - 1 for some in parts])
    noise, whole = (float(fit.sd), layout.residual_freedom), float(seen.sum())
    each = [_explained(seen[k], left[k], freedom[k], count[p].mean(), *noise, whole) for k, p in enumerate(parts)]
    return [*each, _explained(whole, left.sum(axis=0), int(freedom.sum()), count.mean(), *noise, whole)]


def _explained(
    seen: float, left: FloatArray, freedom: int, count: float, sd: float, residual: int, everything: float
) -> Explained:
    """Return what is explained of a sum of squares with so many degrees of freedom, the residuals' sd having others."""
    if freedom < 1 or not sd > ROUNDING:
        unknown = math.nan
        return Explained(unknown, unknown, unknown, unknown, unknown, unknown, False)
    noise = freedom * sd**2
    p_value = float(fdtrc(freedom, residual, seen / noise))
    visible = sd * np.sqrt(max(float(fdtri(freedom, residual, 1.0 - LEVEL)) - 1.0, 0.0) / count)
    spread = np.sqrt(max(seen - noise, 0.0) / freedom / count)
    matters = seen - noise > FLAT * everything
    if not seen > noise:
        return Explained(np.nan, np.nan, np.nan, 0.0, p_value, float(visible), False)
    shares = 1.0 - (left - noise) / (seen - noise)
    low, share, high = np.quantile(shares, (0.05, 0.5, 0.95)).tolist()
    return Explained(share, low, high, float(spread), p_value, float(visible), bool(matters))


def _squares(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return weighted sums of squares about the weighted mean, over the last axis."""
    centre = (values @ weight / weight.sum())[..., None]
    return (values - centre) ** 2 @ weight
