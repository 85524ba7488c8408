"""Weights of observations at the midpoints of their intervals, from which the search for raters' scales starts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.interval_law import Rows

FloatArray = NDArray[np.float64]

_TINY_WEIGHT = 1e-30


def weights(
    law: ErrorLaw, rows: Rows, errors: FloatArray, spread: FloatArray, parameters: Any
) -> tuple[FloatArray, FloatArray]:
    """Return the weights of observations in the most probable mean, and their curvatures over the weights.

    Intervals count as their midpoints. With lapses, the weight includes the probability that the row is not a lapse.

    Parameters
    ----------
    law, rows, spread, parameters
        As for `interval_law.log_probability`.
    errors
        Errors in spreads, (..., rows), of any precision.

    Returns
    -------
    weight, curvature : ndarray, shape (..., rows)
        Minus the slope of the log density over the error, and minus its second derivative over the weight.
    """
    found = law.weight(errors, parameters)
    square = errors * errors
    if not law.lapses:
        # of Student's t, whose weight is (nu + 1) / (nu + u²)
        nu = np.asarray(parameters.nu)[..., None]
        return found, 1.0 - square * found * (2.0 / (nu + 1.0))
    width = rows.high - rows.low
    width = np.where((width > 0) & (width < np.inf), width, 1.0)
    lapsed = (np.exp(rows.lapse) / width).astype(errors.dtype)
    lapse = np.asarray(parameters.lapse)[..., None]
    lapsed = lapsed * (lapse * spread * np.exp(-law.log_density(np.zeros(1), parameters))).astype(errors.dtype)
    kept = (1.0 - lapse) * law.kernel(errors, parameters)
    kept += _TINY_WEIGHT  # a row that cannot be a lapse counts, however far away
    lapsed += kept
    share = np.divide(kept, lapsed, out=kept)
    return found * share, 1.0 - (1.0 - share) * square
