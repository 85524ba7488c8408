"""Check of plate forces: exponent of force against indentation, compared with replicates of the fitted skin."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.plate import CompressionForces

Array = NDArray[np.float64]

FEW_POINTS = 10
"""Number of forces per finger below which the check of the exponent is called weak."""

HERTZ_EXPONENT = 1.5
"""Exponent of force against indentation for skin that does not stiffen."""


class ExponentCheck(NamedTuple):
    """Check of the growth of forces with indentation under the fitted skin."""

    observed: float
    """Exponent in the data."""
    low: float
    high: float
    """Limits of 90 % of the replicates."""
    p_value: float
    """Two-sided predictive p-value."""
    points: float
    """Mean number of forces per finger."""

    @property
    def sentence(self) -> str:
        """One line for the user."""
        if not math.isfinite(self.observed):
            return "compression: no finger was pressed to two indentations, so the growth of force cannot be checked"
        steeper = "steeper than" if self.observed > HERTZ_EXPONENT else "no steeper than"
        weak = (
            f"; with {self.points:.2g} forces per finger this check has little power"
            if self.points < FEW_POINTS
            else ""
        )
        return (
            f"compression: force grows as indentation to the power {self.observed:.2f} ({steeper} Hertz's "
            f"{HERTZ_EXPONENT}); replicated: {self.low:.2f} to {self.high:.2f} (90 %), p = {self.p_value:.2g}{weak}"
        )


def check_exponent(forces: CompressionForces, replicated: Array) -> ExponentCheck:
    """Compare the exponent of force against indentation with that of replicated forces (draws, rows) [N]."""
    observed, again = float(forces.exponent(forces.values)), forces.exponent(replicated)
    low, high = np.quantile(again, [0.05, 0.95])
    tail = min(float((again >= observed).mean()), float((again <= observed).mean()))
    return ExponentCheck(observed, float(low), float(high), min(1.0, 2.0 * tail), forces.n_rows / forces.n_fingers)
