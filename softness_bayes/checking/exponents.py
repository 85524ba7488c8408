"""Check for differences between participants' exponents, which the model takes as equal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters
from softness_bayes.likelihood.left_out import summing
from softness_bayes.likelihood.pieces import part_of, pieces

FloatArray = NDArray[np.float64]


class ExponentSpread(NamedTuple):
    """Check for differences between participants' exponents."""

    p_value: float
    """Probability that replicated residuals depend on the response at least as strongly within participants; NaN if the
    response does not vary for any participant."""
    deviation: float
    """Standard deviation of participants' exponents estimated from the excess."""

    def sentence(self, individual: bool = False, remedy: bool = True) -> str:
        """Describe whether exponents differ, in one line.

        Parameters
        ----------
        individual
            Whether the model has individual exponents.
        remedy
            Whether a model with individual exponents is available.
        """
        more = " more than the model allows" if individual else ""
        if np.isnan(self.p_value):
            return "participants: exponents cannot be compared, because the response varies for no participant"
        if self.p_value >= 0.05:
            return f"participants: no evidence that their exponents differ{more} (p = {self.p_value:.2g})"
        advice = ": --individual gamma gives each a separate exponent" if remedy else ""
        return (
            f"participants: their exponents differ by about {self.deviation:.2g} (standard deviation), more "
            f"than {'the model allows' if individual else 'noise explains'} (p = {self.p_value:.2g})"
            + ("" if individual else f"; the model assumes one exponent for all{advice}")
        )


def check_exponents(
    observation: Likelihood, mean_rate: FloatArray, parameters: Parameters, effects: Effects
) -> ExponentSpread:
    """Compare the dependence of residuals on the response within participants with that of replicates.

    The discrepancy is T = sum_p S_p slope_p², slope_p that of participant p's residuals on the logarithm of
    the response (z-scores: on the standardised response), S_p the sum of squares of the latter about its
    mean. Given a draw of all parameters and effects, T / varsigma² of replicated residuals follows a
    chi-squared law with one degree of freedom for each participant under whom the response varies; draws in which it
    varies for none are left out.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        N/N_ref [Hz], shape (draws, conditions).
    parameters, effects
        Draws of the rating model's parameters, shape (draws,), and of the effects given them.
    """
    design, model = observation.design, observation.model
    x = observation.predictor(mean_rate, parameters)
    count = np.maximum(design.cells.sum(axis=1), 1.0)
    centre = x @ (design.cells / count[:, None]).T
    squares = x**2 @ design.cells.T - count * centre**2
    member, products = summing(design.participant, design.n_participants), np.empty_like(centre)
    for k in pieces(len(x), design.n_rows):
        residual = observation.residual(mean_rate[k], part_of(parameters, k), part_of(effects, k))
        along = residual * x[k][:, design.condition]
        products[k] = (member @ along.T).T - centre[k] * (member @ residual.T).T
    varies = squares > 1e-9 * np.maximum(x**2 @ design.cells.T, 1e-300)
    followed = np.where(varies, products**2 / np.where(varies, squares, 1.0), 0.0).sum(axis=1)
    variance = np.broadcast_to(model.error_sd(parameters) ** 2, followed.shape)
    freedom, telling = varies.sum(axis=1), varies.any(axis=1)
    if not telling.any():
        return ExponentSpread(np.nan, 0.0)
    p_value = float(chdtrc(freedom[telling], (followed / variance)[telling]).mean())
    excess = (followed - freedom * variance)[telling] / np.where(varies, squares, 0.0).sum(axis=1)[telling]
    return ExponentSpread(p_value, float(np.sqrt(max(np.median(excess), 0.0))))
