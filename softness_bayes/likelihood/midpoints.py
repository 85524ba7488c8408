"""Weights of observations at the midpoints of their intervals, from which the search for raters' scales starts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.interval_law import Rows

FloatArray = NDArray[np.float64]

_TINY_WEIGHT = 1e-30


def weights(law: ErrorLaw, errors: FloatArray, parameters: Any, lapsed: Any = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return the weights of observations in the most probable mean, and their curvatures over the weights.

    Intervals count as their midpoints. With lapses, the weight includes the probability that the row is not a lapse.

    Parameters
    ----------
    law, parameters
        As for `interval_law.log_probability`.
    errors
        Errors in spreads, (..., rows), of any precision.
    lapsed
        Density of each row if it is a lapse, relative to that of an error of 0, times the share of lapses; of the same
        shape.

    Returns
    -------
    weight, curvature : ndarray, shape (..., rows)
        Minus the slope of the log density over the error, and minus its second derivative over the weight.
    """
    found = law.weight(errors, parameters)
    if not law.lapses:
        # of Student's t, whose weight is (1 + 1/nu) / (1 + u²/nu)
        bend = found * (2.0 / (1.0 + 1.0 / np.asarray(parameters.nu)[..., None]))
        bend -= 1.0
        return found, bend
    kept = (1.0 - np.asarray(parameters.lapse)[..., None]) * law.kernel(errors, parameters)
    kept += _TINY_WEIGHT  # a row that cannot be a lapse counts, however far away
    share = kept / (lapsed + kept)
    bend = share - 1.0
    bend *= errors
    bend *= errors
    bend += 1.0
    return found * share, bend


def lapse_density(rows: Rows) -> FloatArray:
    """Return the density of every row if it is a lapse, 0 if it cannot be, of the shape of its interval's ends."""
    width = rows.high - rows.low
    return np.asarray(np.exp(rows.lapse) / np.where((width > 0) & (width < np.inf), width, 1.0))
