"""Response of the receptor population to each condition."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.contact import HERTZ_LIMIT, Contact

Array = NDArray[np.float64]


class Response(NamedTuple):
    """The population's response, each field of shape (..., conditions)."""

    total_rate: Array
    """Sum of the receptors' firing rates [spikes/s]."""
    responding: Array
    """Number of receptors that fire."""
    mean_rate: Array
    """Mean rate of the receptors that fire [Hz]; NaN if none fire."""
    mean_interval: Array
    """Mean inter-spike interval of the receptors that fire [s]; NaN if none fire."""
    peak_stress: Array
    """Stress at receptor depth on the contact's axis [Pa]."""
    contact: Contact
    """State of the contact."""


class BeyondHertz(NamedTuple):
    """Shares of draws × conditions with a large contact (model.md 3)."""

    questionable: float
    """Share with a > `HERTZ_LIMIT` R."""
    meaningless: float
    """Share with a >= R."""

    @classmethod
    def of(cls, extent: Array) -> Self:
        """Return the shares for given ratios of contact radius to fingertip radius."""
        return cls(float((extent > HERTZ_LIMIT).mean()), float((extent >= 1.0).mean()))
