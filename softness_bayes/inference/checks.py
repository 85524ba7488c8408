"""Predictive checks: whether the fitted model makes data like those that were seen."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from softness_bayes.inference.observation import RatingParameters
from softness_bayes.inference.scales import ObservedRatings

Array = NDArray[np.float64]

NEEDED = 0.05
"""Predictive p-value below which deviations between fabrics are said to be real."""


class FabricCheck(NamedTuple):
    """Whether whole fabrics deviate from the response by more than noise explains."""

    p_value: float
    """Probability that replicated ratings spread at least as much between fabrics as the real ones."""
    deviation: float
    """Standard deviation between fabrics that the excess amounts to, in the (log) rating."""
    logarithmic: bool = True
    """Whether the model is one of log ratings; that of z-scores has no effect per fabric to offer."""

    @property
    def sentence(self) -> str:
        """One line for the user."""
        if self.p_value >= NEEDED:
            return f"fabrics: no deviations of their own beyond noise (p = {self.p_value:.2g})"
        quantity = "log rating" if self.logarithmic else "z-score"
        remedy = ": add --prior omega='halfnormal(0.5)'" if self.logarithmic else ", and z-scores have none"
        return (
            f"fabrics: deviate from the response by about {self.deviation:.2g} in the {quantity}, more than "
            f"noise explains (p = {self.p_value:.2g}); without an effect per fabric the intervals are too "
            f"narrow{remedy}"
        )


def check_fabrics(
    observation: ObservedRatings, mean_rate: Array, parameters: RatingParameters, effects: Any
) -> FabricCheck:
    """Compare the residuals' spread between fabrics with what the model replicates.

    The discrepancy is T = sum_f n_f (mean residual of fabric f)², given a draw of all parameters and
    effects. Residuals of replicated ratings are N(0, varsigma²), so their T / varsigma² follows a
    chi-squared law with one degree of freedom for each fabric: no replicate needs to be drawn.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        N/N_ref [Hz], shape (draws, conditions).
    parameters, effects
        Draws of the rating model's parameters, shape (draws,), and of the effects given them.
    """
    design = observation.design
    residual = observation.residual(mean_rate, parameters, effects)
    fabric = design.fabric[design.condition]
    count = np.bincount(fabric, minlength=design.n_fabrics).astype(float)
    seen = count > 0
    member = (fabric[:, None] == np.flatnonzero(seen)) / count[seen]
    between = (count[seen] * (residual @ member) ** 2).sum(axis=1)
    variance = np.broadcast_to(np.asarray(parameters.varsigma, float) ** 2, between.shape)
    p_value = float(chdtrc(seen.sum(), between / variance).mean())
    excess = (between / seen.sum() - variance) / count[seen].mean()
    deviation = float(np.sqrt(max(np.median(excess), 0.0)))
    return FabricCheck(p_value, deviation, observation.model.logarithmic)
