"""Slider ranges of parameters: the central 98 % of each prior."""

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
    """Range of one parameter with a slider.

    Parameters
    ----------
    name, meaning, unit
        As in the parameter's declaration.
    low, high, start
        Ends and initial value [unit].
    logarithmic
        True for a logarithmic scale.
    """

    name: str
    meaning: str
    unit: str
    low: float
    high: float
    start: float
    logarithmic: bool

    def place(self, value: float) -> float:
        """Return the slider position of a value: log10 of it on a logarithmic scale, else the value itself."""
        return float(np.log10(value)) if self.logarithmic else value

    def value(self, place: float) -> float:
        """Return the value at a slider position, the inverse of `place`."""
        return rounded(10.0**place if self.logarithmic else place)


def span_of(parameter: Parameter, start: float) -> Span:
    """Return the central 98 % of a parameter's prior, extended to include its initial value."""
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
    """Return the underlying law of a truncated or sign-symmetric law."""
    while hasattr(prior, "law"):
        prior = prior.law
    return prior
