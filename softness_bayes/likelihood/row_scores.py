"""Cumulative probabilities and normal scores of rows, for checks of residuals (model.md 9)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.interval_law import Rows, clipped

FloatArray = NDArray[np.float64]

_TINY = 1e-290


def below(law: ErrorLaw, rows: Rows, expected: FloatArray, spread: FloatArray, parameters: Any) -> FloatArray:
    """Return the probability below each exact number, or below each interval plus half its own; without lapses."""
    ends = [clipped((end - expected) / spread) for end in (rows.low, rows.high)]
    low, high = (ndtr(law.normal_scores(end, parameters)) for end in ends)
    return np.asarray(0.5 * (low + high))


def score_at(
    law: ErrorLaw, rows: Rows, share: FloatArray, expected: FloatArray, spread: FloatArray, parameters: Any
) -> FloatArray:
    """Return normal scores of the rows, (..., rows); an interval's is taken at a given `share` of its probability.

    With uniform random shares, the scores of intervals are also standard normal under the model.
    """
    ends = [clipped((end - expected) / spread) for end in (rows.low, rows.high)]
    low, high = (law.normal_scores(end, parameters) for end in ends)
    # computed from the tail in which both probabilities are small
    flip = low + high > 0
    near, far = np.where(flip, -high, low), np.where(flip, -low, high)
    part = np.where(flip, 1.0 - share, share)
    p, q = ndtr(near), ndtr(far)
    found = ndtri(np.clip(p + part * (q - p), _TINY, None))
    found = np.where(rows.low == rows.high, far, np.clip(found, near, far))
    return np.where(flip, -found, found)
