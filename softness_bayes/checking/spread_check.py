"""Check of the standard deviations between the raters of a panel: cells that differ by more than the model allows.

The model has the same noise in every cell. If noise depends on the fabric or the load, or not all cells have the stated
number of raters, the standard deviations of the cells differ by more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from softness_bayes.checking.checks import NEEDED
from softness_bayes.likelihood.contract import Likelihood, Parameters

Array = NDArray[np.float64]


class SpreadCheck(NamedTuple):
    """Comparison of the cells' standard deviations with those that the model expects."""

    p_value: float
    """Probability that replicated standard deviations differ at least as much."""
    spread: float
    """Root mean square of their normal scores; 1 is expected."""

    @property
    def sentence(self) -> str:
        """One line for the user."""
        if self.p_value >= NEEDED:
            return (
                f"spreads: the cells' standard deviations differ no more than the model allows (p = {self.p_value:.2g})"
            )
        return (
            f"spreads: the cells' standard deviations differ more than the model allows (their scores spread "
            f"{self.spread:.2g} times as much, p = {self.p_value:.2g}): noise may depend on the fabric or the load, or "
            "n may differ between cells"
        )


def check_spreads(term: Likelihood, mean_rate: Array, parameters: Parameters, rng: np.random.Generator) -> SpreadCheck:
    """Compare the normal scores of the cells' standard deviations with those of replicates.

    The discrepancy is the sum of squares of the scores, given a draw of all parameters and of the panels' scatter.
    Those of replicates are chi-squared with one degree of freedom per cell.

    Parameters
    ----------
    term
        The standard deviations, as `likelihood.spreads.RaterSpreads`.
    mean_rate
        As for `Likelihood.residual`, shape (draws, ...).
    parameters
        Draws of the parameters of the term's model, shape (draws,).
    rng
        Random generator for the panels' scatter.
    """
    effects = term.draw_effects(rng, mean_rate, parameters)
    squares = term.residual(mean_rate, parameters, effects) ** 2
    cells = squares.shape[-1]
    return SpreadCheck(float(chdtrc(cells, squares.sum(axis=-1)).mean()), float(np.sqrt(squares.mean())))
