"""Ranges of parameters that move: from a prior's lowest hundredth to its highest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softness_bayes.parameters.declared import Parameter
from softness_bayes.parameters.priors import LogNormal, LogUniform

TAIL = 0.01
"""Probability of the prior beyond each end of a range."""

DIGITS = 5
"""Significant digits of a value: what is shown is what is computed with."""

STEPS = 500
"""Steps from one end to the other."""


def rounded(value: float) -> float:
    """Return a value to `DIGITS` significant digits."""
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True)
class Span:
    """One parameter that may be moved.

    Parameters
    ----------
    name, meaning, unit
        As the parameter is declared.
    low, high, start
        Ends, and where it starts [unit].
    logarithmic
        Whether places are even in the logarithm.
    """

    name: str
    meaning: str
    unit: str
    low: float
    high: float
    start: float
    logarithmic: bool

    def place(self, value: float) -> float:
        """Return where a value lies along the range: its decimal logarithm, or itself."""
        return float(np.log10(value)) if self.logarithmic else value

    def value(self, place: float) -> float:
        """Return the value at a place, the inverse of `place`."""
        return rounded(10.0**place if self.logarithmic else place)


def span_of(parameter: Parameter, start: float) -> Span:
    """Return the central 98 % of a parameter's prior, wider if it starts outside of that."""
    start, largest = rounded(start), parameter.largest
    low, high = (rounded(float(end)) for end in np.asarray(parameter.prior.quantile([TAIL, 1.0 - TAIL]), float))
    low, high = min(low, start), max(min(high, largest), start)
    return Span(
        parameter.name,
        parameter.meaning,
        "" if parameter.unit == "–" else parameter.unit,
        low,
        high,
        start,
        low > 0 and isinstance(_innermost(parameter.prior), (LogNormal, LogUniform)),
    )


def _innermost(prior: Any) -> Any:
    """Return the law that a cut one or one of either sign is made of."""
    while hasattr(prior, "law"):
        prior = prior.law
    return prior
