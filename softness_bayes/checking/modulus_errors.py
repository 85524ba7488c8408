"""Effect of errors of the fabrics' moduli on the conclusions.

To first order, an error of a modulus moves the posterior mean of a quantity by its posterior covariance with the slope
of the log-likelihood in the logarithm of the modulus.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.checking.checks import MODULUS_STEP
from softness_bayes.likelihood.contract import Likelihood, Parameters
from softness_bayes.sampler.chain_statistics import jackknife

Array = NDArray[np.float64]

ERROR = 0.1
"""Relative error of the moduli for which consequences are reported; those of others are in proportion."""

DIRECTIONS = 24
"""Number of fabrics up to which moduli are changed one at a time; with more, all are changed at once in this many
random directions."""

LINEAR = 1.0
"""Shift, in posterior standard deviations, up to which the first-order approximation is useful; larger actual shifts
are smaller than predicted, because the posterior moves along its ridges."""

CLEAR = 2.0
"""Number of Monte-Carlo standard errors above which a shift is reported."""


def directions(fabrics: NDArray[np.intp], total: int) -> tuple[Array, float]:
    """Return directions in which log moduli are changed, and the weight of each in a sum over fabrics.

    Parameters
    ----------
    fabrics
        Fabrics whose moduli may be wrong.
    total
        Number of all fabrics.

    Returns
    -------
    signs : ndarray, shape (directions, fabrics)
        1, -1 or 0. Sums over directions of squared derivatives, times the weight, are sums over fabrics: random
        signs make the derivatives of different fabrics cancel on average (Hutchinson).
    share : float
        The weight.
    """
    if fabrics.size <= DIRECTIONS:
        return np.eye(total)[fabrics], 1.0
    signs = np.zeros((DIRECTIONS, total))
    signs[:, fabrics] = np.random.default_rng(0).choice([-1.0, 1.0], (DIRECTIONS, fabrics.size))
    return signs, 1.0 / DIRECTIONS


def scores(
    observation: Likelihood,
    rates: tuple[Array, Array],
    parameters: Parameters,
    signs: Array,
    step: float = MODULUS_STEP,
) -> Array:
    """Return derivatives of the log-likelihood along directions of the log moduli, shape (draws, directions).

    Parameters
    ----------
    observation
        The ratings.
    rates
        N/N_ref [Hz] with all log moduli lower and higher by `step`, each of shape (draws, columns).
    parameters
        Draws of the rating model's parameters.
    signs
        From `directions`.
    """
    lower, higher = rates
    middle = 0.5 * (lower + higher)
    observation = observation.for_sampling()  # differences need no more accuracy than the walk
    found = []
    for sign in signs[:, observation.design.fabric[observation.condition_of_rate]]:
        up, down = (np.where(sign == 0, middle, np.where(sign * side > 0, higher, lower)) for side in (1.0, -1.0))
        difference = observation.log_likelihood(up, parameters) - observation.log_likelihood(down, parameters)
        found.append(difference / (2.0 * step))
    return np.stack(found, axis=-1)


def posterior_shift(quantity: Array, score: Array, share: float = 1.0) -> tuple[float, float]:
    """Return the shift of the posterior mean of a quantity due to errors of the moduli.

    d E[q] / d log E_f = Cov(q, d log L / d log E_f) over the posterior. The Monte-Carlo noise of the squared
    covariances, which accumulates over fabrics, is subtracted.

    Parameters
    ----------
    quantity
        Draws in order of the chains, shape (draws,); draws with NaN are left out.
    score, share
        From `scores` and `directions`.

    Returns
    -------
    sd, mcse : float
        Standard deviation of the shift by independent relative errors of all moduli, to first order, in posterior
        standard deviations of the quantity and per unit error; and its Monte-Carlo standard error.
    """
    known = np.isfinite(quantity)
    if known.sum() < 2 or not quantity[known].std() > 0:
        return np.nan, np.nan
    q, s = quantity[known], score[known]

    def covariance(kept: NDArray[np.bool_]) -> Array:
        chosen = q[kept] - q[kept].mean()
        spread = chosen.std() or np.nan  # constant draws have no shift
        return np.asarray(chosen @ (s[kept] - s[kept].mean(axis=0)) / chosen.size / spread)

    each = covariance(np.ones(q.size, dtype=bool))
    error = jackknife(covariance, q.size)
    if not np.isfinite(error).all():
        return np.nan, np.nan
    squared = share * ((each**2).sum() - (error**2).sum())
    # delta method, plus the variance of squared noise
    noise = share * np.sqrt((4.0 * each**2 * error**2 + 2.0 * error**4).sum())
    sd = float(np.sqrt(max(squared, 0.0)))
    return sd, float(noise / (2.0 * sd)) if sd > 0 else float(np.sqrt(noise))


def shift_table(shifts: Mapping[str, tuple[float, float]]) -> pd.DataFrame:
    """Return the effect of errors of the moduli on quantities by name, from their `posterior_shift`.

    Returns
    -------
    DataFrame
        A row per quantity: shift_10, standard deviation of the shift of its posterior mean, in posterior standard
        deviations, if all moduli that are taken as exact had independent errors of 10 %, to first order; and
        shift_10_mcse, its Monte-Carlo error.
    """
    table = pd.DataFrame(dict(shifts), index=["shift_10", "shift_10_mcse"]).T
    return ERROR * table.rename_axis("quantity")


def clear_shifts(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a `shift_table` whose shifts exceed their Monte-Carlo errors."""
    return table[table["shift_10"] >= CLEAR * table["shift_10_mcse"]]


class MovedMost(NamedTuple):
    """The quantity that errors of 10 % of the moduli would move most."""

    name: str
    shift: float
    """Standard deviation of the shift of its posterior mean, in posterior standard deviations."""


def moved_most(table: pd.DataFrame) -> MovedMost | None:
    """Return the quantity of a `shift_table` with the largest shift; None if no shift exceeds its noise."""
    clear = clear_shifts(table)
    if clear.empty:
        return None
    most = int(clear["shift_10"].to_numpy().argmax())
    return MovedMost(str(clear.index[most]), float(clear["shift_10"].iloc[most]))
