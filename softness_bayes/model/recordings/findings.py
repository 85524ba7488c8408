"""Findings about recorded afferents: fit beside a table of effects, distance from the paper, agreement of sources."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from softness_bayes.base.laws import LogNormal
from softness_bayes.base.readable import number, percent
from softness_bayes.data.measurements import Afferents
from softness_bayes.parameters.declared import PARAMETERS, PRIOR_SETS, SHAREABLE
from softness_bayes.touch.contact import SkinDisplacement

Array = NDArray[np.float64]

DOUBTFUL = 0.01
"""Probability below which two sources contradict each other."""

MUCH_WORSE = 1.5
"""Ratio of residual sds above which the model is much worse than the table of effects."""

NEAR_ZERO = 1.0
"""Rate [Hz] at which logs of observed rates are cut off, where the fit of the table of effects starts."""


def log_additive_sd(data: Afferents) -> float:
    """Return the residual sd [Hz] of the table ln rate = load + curvature + distance, fitted to the rates.

    It knows nothing of skin or receptors: a model that explains the data should not be much worse. NaN if the table has
    as many effects as there are rows.
    """
    from scipy.optimize import least_squares  # imported here because it takes a quarter of a second

    texts = np.array([str(load) for load in data.loads]), data.curvature, data.distance
    columns = [np.ones(len(data))]
    for values in texts:
        columns += [(values == level).astype(float) for level in np.unique(values)[1:]]
    design, observed = np.column_stack(columns), data.observed
    if np.linalg.matrix_rank(design) >= len(data):
        return float("nan")
    start = np.linalg.lstsq(design, np.log(np.maximum(observed, NEAR_ZERO)), rcond=None)[0]
    fitted = least_squares(lambda effects: observed - np.exp(np.minimum(design @ effects, 50.0)), start)
    return float(np.sqrt(np.mean(fitted.fun**2)))


def shifts(draws: Mapping[str, Array], displacement: SkinDisplacement) -> dict[str, float]:
    """Return how far each parameter is from its default prior, the paper's values, in that prior's sd.

    A parameter that is defined in no draw is left out: sigma_0 where the current at rest exceeds half of the largest,
    so that it would be negative.

    Parameters
    ----------
    draws
        Posterior draws of `SHAREABLE` parameters as the recordings have them, in natural units.
    displacement
        Reading of the skin, which determines the prior of m.
    """
    usual = PRIOR_SETS["default"].get(displacement, {})
    found = {}
    for name in SHAREABLE:
        prior = usual.get(name, PARAMETERS[name].prior)
        if name in draws and isinstance(prior, LogNormal):
            with np.errstate(invalid="ignore", divide="ignore"):
                logs = np.log(draws[name])
            if np.isfinite(logs).any():
                found[name] = float((np.mean(logs[np.isfinite(logs)]) - np.log(prior.median)) / prior.sd_log)
    return found


class Agreement(NamedTuple):
    """Agreement of two sources of data about the parameters that one model gives both."""

    first: str
    second: str
    chi_square: float
    """Squared distance of the sources' posterior modes by the sum of their covariances."""
    degrees: int
    """Number of common parameters."""

    @property
    def p_value(self) -> float:
        """Probability of at least this distance if both sources have the same parameters."""
        return float(chdtrc(self.degrees, self.chi_square))

    @property
    def contradicts(self) -> bool:
        """True if `p_value` is below `DOUBTFUL`."""
        return self.p_value < DOUBTFUL

    @property
    def said(self) -> str:
        """The agreement as a sentence."""
        found = f"chi-square {number(self.chi_square)} on {self.degrees} parameters, p = {self.p_value:.2g}"
        if self.contradicts:
            return f"{self.first} and {self.second} contradict each other under this model ({found}): do not pool them"
        return f"{self.first} and {self.second} do not contradict each other ({found})"


class RecordedFindings(NamedTuple):
    """Findings of a run about its recorded afferents."""

    residual_sd: float
    """Residual sd about the posterior mean of the rates [Hz]."""
    additive_sd: float
    """The same about `log_additive_sd`'s table."""
    shifts: Mapping[str, float]
    """As `shifts`."""
    rest: tuple[float, float, float]
    """Current at rest over the rheobase: 5, 50 and 95 % quantiles."""
    fires_at_rest: float
    """Share of draws in which afferents fire without stress."""
    agreements: tuple[Agreement, ...]

    def record(self) -> dict[str, Any]:
        """Return the findings as JSON data."""
        return {**self._asdict(), "shifts": dict(self.shifts), "agreements": [one._asdict() for one in self.agreements]}

    @classmethod
    def recorded(cls, record: Mapping[str, Any]) -> RecordedFindings:
        """Return the findings of a record."""
        agreements = tuple(Agreement(**one) for one in record["agreements"])
        return cls(**{**record, "rest": tuple(record["rest"]), "agreements": agreements})

    @property
    def faults(self) -> tuple[str, ...]:
        """Features that the model does not reproduce, in words."""
        worse = self.residual_sd > MUCH_WORSE * self.additive_sd  # NaN is not
        apart = (f"{one.first} and {one.second} together" for one in self.agreements if one.contradicts)
        return (*(("the recorded rates as well as a table of effects does",) if worse else ()), *apart)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The findings in words."""
        low, middle, high = map(number, self.rest)
        beside = (
            ""
            if np.isnan(self.additive_sd)
            else (
                f"; a table of effects of load, curvature and distance, without skin or receptors, leaves "
                f"{number(self.additive_sd)} Hz"
            )
        )
        moved = ", ".join(f"{name} {value:+.1f}" for name, value in self.shifts.items())
        return (
            f"recorded rates: the model leaves a residual sd of {number(self.residual_sd)} Hz{beside}",
            f"recorded afferents against the paper's values, in sd of their priors: {moved}",
            f"current at rest: {middle} of the rheobase ({low} to {high}, 90 %); firing at rest in "
            f"{percent(self.fires_at_rest)} of draws",
            *(one.said for one in self.agreements),
        )
