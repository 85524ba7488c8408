"""Share of the differences between fabrics that a prediction explains: a flat prediction explains none."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, fdtri

from softness_bayes.checking.layout import ROUNDING, Additive, Layout

FloatArray = NDArray[np.float64]

LEVEL = 1e-3
"""p-value below which fabrics clearly differ."""

FLAT = 0.1
"""Explained share below which a prediction is flat; and share of the differences under all loads below which those
under one load are negligible."""


class Explained(NamedTuple):
    """Share of the differences between fabrics that a prediction explains, under one load or under all of them."""

    share: float
    """Explained share of their variance beyond noise, median over draws; negative if the prediction has the opposite
    trend, NaN if fabrics do not differ."""
    low: float
    high: float
    """5 and 95 % limits over draws."""
    spread: float
    """Standard deviation of mean (log) ratings between fabrics, beyond noise."""
    p_value: float
    """p-value of the differences under noise alone; NaN if the noise is unknown."""
    visible: float
    """Standard deviation between fabrics that would have been detected."""
    matters: bool
    """True if these differences are more than a tenth of those under all loads."""

    @property
    def flat(self) -> bool:
        """True if the prediction is flat although fabrics differ."""
        return bool(self.p_value < LEVEL and self.share < FLAT and self.matters)


def explain(layout: Layout, fit: Additive, predicted: FloatArray) -> list[Explained]:
    """Return the explained share under each load, then under all of them; the means of loads are removed.

    Let S be the sum of squares of the fabrics' means about the mean of their load, S_m that of the differences from the
    prediction, and n the part of either due to noise. The share is 1 - (S_m - n) / (S - n). An F-test of S against
    the residuals of the additive fit decides whether fabrics differ.

    Parameters
    ----------
    layout
        Design of the ratings.
    fit
        The additive fit of the ratings.
    predicted
        Predicted (log) rating of each condition, up to a constant of each draw, shape (draws, conditions).
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
    """Return the explained share of a sum of squares, from its degrees of freedom and those of the residuals' sd."""
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
