"""Check for individual noise: differences between raters in the scatter about their regression lines."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import polygamma

from softness_bayes.checking.checks import NEEDED
from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters
from softness_bayes.likelihood.left_out import summing
from softness_bayes.likelihood.pieces import part_of, pieces

Array = NDArray[np.float64]

FEWEST = 3
"""Smallest number of ratings of a rater whose scatter is checked."""

REFERENCE = 4000
"""Number of draws of raters' scatter under equal noise for the comparison."""

_SEED = 0
_LEAST = 1e-300


class NoiseCheck(NamedTuple):
    """Comparison of raters' scatter with equal noise."""

    p_value: float
    """Probability that the scatter of replicated ratings differs as much between raters; NaN with fewer than two."""
    deviation: float
    """Standard deviation of log noise between raters, estimated from the excess."""

    def sentence(self, individual: bool, remedy: bool, robust: bool) -> str:
        """Return one line for the user.

        Parameters
        ----------
        individual
            Whether the model has individual noise.
        remedy
            Whether a model with individual noise is available.
        robust
            Whether the errors already have heavy tails, or lapses.
        """
        if not np.isfinite(self.p_value):
            return "noise: the raters' scatter cannot be compared, because fewer than two gave three ratings or more"
        if self.p_value >= NEEDED:
            more = " more than the model allows" if individual else ""
            return f"noise: no evidence that raters' noise differs{more} (p = {self.p_value:.2g})"
        size = f"by about {self.deviation:.2g} (sd of its log; p = {self.p_value:.2g})"
        if individual:
            return f"noise: raters' noise differs {size} beyond what the model allows: look for single outliers"
        advice = (
            "--individual varsigma gives each a separate noise level"
            if remedy
            else ("this model has the same noise for all")
        )
        return (
            f"noise: some raters scatter more than others, {size}, but the model treats their ratings as "
            f"equally reliable: {advice}{'' if robust else '. Single outliers look the same (--errors student)'}"
        )


def check_noise(observation: Likelihood, mean_rate: Array, parameters: Parameters, effects: Effects) -> NoiseCheck:
    """Compare the scatter of raters' residuals with that expected for equal noise.

    The discrepancy is Bartlett's, T = N ln(sum_p S_p / N) - sum_p n_p ln(S_p / n_p), with S_p the sum of squares of
    rater p's n_p residuals given a draw of all parameters and effects. Residuals of replicated ratings are independent
    and normal with a common standard deviation, which cancels: T has the law for chi-squared S_p, from which it is
    drawn once. Raters with fewer than `FEWEST` ratings are left out.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        As for `Likelihood.residual`, shape (draws, ...).
    parameters, effects
        Draws of the rating model's parameters, shape (draws,), and of the effects given them.
    """
    design = observation.design
    rows = design.cells.sum(axis=1)
    judged = rows >= FEWEST
    if judged.sum() < 2:
        return NoiseCheck(np.nan, 0.0)
    member, count = summing(design.participant, design.n_participants), rows[judged]
    squares = np.empty((len(mean_rate), design.n_participants))
    for k in pieces(len(mean_rate), design.n_rows):
        residual = observation.residual(mean_rate[k], part_of(parameters, k), part_of(effects, k))
        squares[k] = (member @ (residual * residual).T).T
    squares = np.maximum(squares[:, judged], _LEAST)
    law = _reference(tuple(count.tolist()))
    found = _discrepancy(squares, count)
    above = law.size - np.searchsorted(law, found * (1.0 - 1e-12))
    # half of the variance of log S, part of which is due to chance
    log_noise = 0.5 * (np.log(squares / count) - np.log(squares.sum(axis=1) / count.sum())[:, None])
    chance = 0.25 * polygamma(1, 0.5 * count).mean()
    excess = float(np.median(log_noise.var(axis=1, ddof=1))) - float(chance)
    return NoiseCheck(float(((above + 1.0) / (law.size + 1.0)).mean()), float(np.sqrt(max(excess, 0.0))))


def _discrepancy(squares: Array, count: Array) -> Array:
    every = count.sum()
    whole = every * np.log(squares.sum(axis=-1) / every)
    return np.asarray(whole - (count * np.log(squares / count)).sum(axis=-1))


@lru_cache(maxsize=8)
def _reference(count: tuple[float, ...]) -> Array:
    """Return sorted discrepancies for raters with the given numbers of ratings and equal noise."""
    rows = np.array(count)
    squares = np.random.default_rng(_SEED).chisquare(rows, (REFERENCE, rows.size))
    return np.sort(_discrepancy(squares, rows))
