"""Check for individual fingers: deviations of ratings as if raters' skin differed more than in the model.

If a rater's skin is stiffer or softer than the typical one, the rater's ratings deviate along the slope of the response
in ln b. The slope is not proportional to the response, so that neither the rater's scale nor an exponent can account
for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.checks import NEEDED, exceeded_along
from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters
from softness_bayes.likelihood.left_out import summing
from softness_bayes.likelihood.pieces import part_of, pieces

Array = NDArray[np.float64]

STEP = 0.1
"""Half-width, in ln b, of the secant for the slope."""

FLAT = 1e-6
"""Root mean square slope below which ratings carry no information about the rater's skin."""


class FingerCheck(NamedTuple):
    """Comparison of the raters' deviations along the slope in ln b with noise."""

    p_value: float
    """Probability that replicated ratings deviate at least as much; NaN if no rater's response has a slope."""

    def sentence(self, individual: bool) -> str:
        """Return one line for the user; `individual` is whether the model has individual fingers."""
        if not np.isfinite(self.p_value):
            return (
                "fingers: no rater's response depends on the skin, so the ratings do not inform "
                "differences between fingers"
            )
        if self.p_value >= NEEDED:
            more = "more than the model allows" if individual else ""
            return f"fingers: the ratings do not show that the raters' skin differs {more}".rstrip() + (
                f" (p = {self.p_value:.2g})"
            )
        if individual:
            return (
                "fingers: raters deviate as if their skin also differed in other parameters (p = "
                f"{self.p_value:.2g}); add more of b, m and sigma_0 to --individual"
            )
        return (
            f"fingers: raters deviate as if their skin differed (p = {self.p_value:.2g}); --individual b "
            "samples by how much"
        )


def check_fingers(
    observation: Likelihood, mean_rate: Array, slope: Array, parameters: Parameters, effects: Effects
) -> FingerCheck:
    """Compare each rater's residuals along the slope of the response in ln b with those of replicates.

    The discrepancy is T = sum over raters of (sum_i d_i r_i)² / sum_i d_i², over a rater's rows i, with residuals r_i
    and with slopes d_i about the rater's mean, given a draw of all parameters and effects. T / varsigma² of replicated
    ratings follows a chi-squared law with one degree of freedom for each rater who has a slope.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        As for `Likelihood.residual`, shape (draws, ...).
    slope
        Derivative of `Likelihood.drive` in each condition with respect to ln b, shape (draws, conditions).
    parameters, effects
        Draws of the rating model's parameters, shape (draws,), and of the effects given them.
    """
    design = observation.design
    cells = design.cells
    rows = np.maximum(cells.sum(axis=1), 1.0)
    mean = slope @ (cells / rows[:, None]).T
    squares = slope**2 @ cells.T - rows * mean**2
    steep = squares > rows * FLAT**2
    along = np.empty_like(mean)
    member = summing(design.participant, design.n_participants)
    for k in pieces(len(slope), design.n_rows):
        residual = observation.residual(mean_rate[k], part_of(parameters, k), part_of(effects, k))
        about = slope[k][:, design.condition] - mean[k][:, design.participant]
        along[k] = (member @ (residual * about).T).T
    spread = np.broadcast_to(observation.model.error_sd(parameters), len(slope))
    return FingerCheck(exceeded_along(along, squares, steep, spread))
