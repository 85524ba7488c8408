"""Errors of the fabrics' moduli: their evidence in the ratings, and their effect on the conclusions.

Both follow from the slope of the response in the logarithm of a fabric's modulus. If moduli are wrong, mean ratings
deviate along that slope, by the same relative error under every load. To first order, an error of a modulus moves the
posterior mean of a quantity by its posterior covariance with the slope of the log-likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.checks import NEEDED, exceeded_along, mean_residuals
from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters
from softness_bayes.likelihood.left_out import summing
from softness_bayes.sampler.jackknife import jackknife

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

STEP = 0.05
"""Change of the log modulus over which slopes are computed, a third of typical errors between laboratories."""

ERRORS = (0.05, 0.10, 0.20)
"""Relative errors of the moduli for which consequences are reported."""

DIRECTIONS = 24
"""Number of fabrics up to which moduli are changed one at a time; with more, all are changed at once in this many
random directions."""

FLAT = 1e-6
"""Slope of the (log) rating in the log modulus below which a condition carries no information about the modulus."""

LINEAR = 1.0
"""Shift, in posterior standard deviations, up to which the first-order approximation is useful; larger actual shifts
are smaller than predicted, because the posterior moves along its ridges."""

CLEAR = 2.0
"""Number of Monte-Carlo standard errors above which a shift is reported."""


class ModulusCheck(NamedTuple):
    """Comparison of the mean ratings' deviations along the slope of the response with noise."""

    p_value: float
    """Probability that replicated ratings deviate at least as much; NaN if no condition has a slope."""

    def sentence(self, exact: bool) -> str:
        """Return one line for the user; `exact` is whether moduli were taken as exact."""
        if not np.isfinite(self.p_value):
            return "moduli: where no receptor fires, the ratings do not show errors of the moduli"
        beyond = "" if exact else " beyond those given"
        if self.p_value >= NEEDED:
            return (
                f"moduli: the ratings show no errors{beyond} (p = {self.p_value:.2g}). This check has little "
                "power, because the fit absorbs most effects of wrong moduli"
            )
        remedy = "give the errors of your measurement (--modulus-cv 0.15, or a column effective_modulus_cv)"
        return (
            f"moduli: mean ratings deviate along the response as if moduli were wrong{beyond} (p = "
            f"{self.p_value:.2g}); "
            f"{remedy if exact else 'they may be larger than stated, or the response may be wrong'}"
        )


def check_moduli(
    observation: Likelihood, mean_rate: Array, slope: Array, parameters: Parameters, effects: Effects
) -> ModulusCheck:
    """Compare the residuals along the slope of the response in the log modulus with those of replicates.

    The discrepancy is T = sum over fabrics of (sum_c n_c d_c r_c)² / sum_c n_c d_c², over the conditions c of a fabric,
    with mean residuals r_c, numbers n_c and slopes d_c, given a draw of all parameters and effects. T / varsigma² of
    replicated ratings follows a chi-squared law with one degree of freedom for each fabric that has a slope. The fit
    absorbs most of the effect of wrong moduli, so that the check is conservative.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        N/N_ref [Hz], shape (draws, conditions).
    slope
        Derivative of `Likelihood.drive` in each condition with respect to its fabric's log modulus, likewise.
    parameters, effects
        Draws of the rating model's parameters, shape (draws,), and of the effects given them.
    """
    design, model = observation.design, observation.model
    count, mean = mean_residuals(observation, mean_rate, parameters, effects)
    spread = np.broadcast_to(model.error_sd(parameters), mean.shape[:1])
    fabric = summing(design.fabric, design.n_fabrics)
    weight = (fabric @ (count * slope**2).T).T
    steep = weight > count.sum() / design.n_fabrics * FLAT**2
    along = np.where(steep, (fabric @ (count * slope * mean).T).T, 0.0)
    return ModulusCheck(exceeded_along(along, weight, steep, spread))


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
    observation: Likelihood, rates: tuple[Array, Array], parameters: Parameters, signs: Array, step: float = STEP
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
    found = []
    for sign in signs[:, observation.fabric_of_rate]:
        up, down = (np.where(sign == 0, middle, np.where(sign * side > 0, higher, lower)) for side in (1.0, -1.0))
        difference = observation.log_likelihood(up, parameters) - observation.log_likelihood(down, parameters)
        found.append(difference / (2.0 * step))
    return np.stack(found, axis=-1)


class Shift(NamedTuple):
    """Shift of a posterior mean by independent relative errors of all moduli, to first order."""

    sd: float
    """Standard deviation of the shift, in posterior standard deviations of the quantity and per unit error."""
    mcse: float
    """Monte-Carlo standard error of that."""


def posterior_shift(quantity: Array, score: Array, share: float = 1.0) -> Shift:
    """Return the shift of the posterior mean of a quantity due to errors of the moduli.

    d E[q] / d log E_f = Cov(q, d log L / d log E_f) over the posterior. The Monte-Carlo noise of the squared
    covariances, which accumulates over fabrics, is subtracted.

    Parameters
    ----------
    quantity
        Draws in order of the chains, shape (draws,); draws with NaN are left out.
    score, share
        From `scores` and `directions`.
    """
    known = np.isfinite(quantity)
    if known.sum() < 2 or not quantity[known].std() > 0:
        return Shift(np.nan, np.nan)
    q, s = quantity[known], score[known]

    def covariance(kept: NDArray[np.bool_]) -> Array:
        chosen = q[kept] - q[kept].mean()
        spread = chosen.std() or np.nan  # constant draws have no shift
        return np.asarray(chosen @ (s[kept] - s[kept].mean(axis=0)) / chosen.size / spread)

    each = covariance(np.ones(q.size, dtype=bool))
    error = jackknife(covariance, q.size)
    if not np.isfinite(error).all():
        return Shift(np.nan, np.nan)
    squared = share * ((each**2).sum() - (error**2).sum())
    # delta method, plus the variance of squared noise
    noise = share * np.sqrt((4.0 * each**2 * error**2 + 2.0 * error**4).sum())
    sd = float(np.sqrt(max(squared, 0.0)))
    return Shift(sd, float(noise / (2.0 * sd)) if sd > 0 else float(np.sqrt(noise)))


def shift_table(names: Sequence[str], shifts: Sequence[Shift]) -> pd.DataFrame:
    """Return the effect of errors of the moduli on each quantity.

    Returns
    -------
    DataFrame
        A row per quantity: shift_5, shift_10 and shift_20, standard deviation of the shift of its posterior mean, in
        posterior standard deviations, if all moduli that are taken as exact had independent errors of 5, 10 and 20 %,
        to first order; each with its Monte-Carlo error, NAME_mcse.
    """
    import pandas as pd

    rows = []
    for one in shifts:
        row = {}
        for error in ERRORS:
            row[_column(error)] = error * one.sd
            row[f"{_column(error)}_mcse"] = error * one.mcse
        rows.append(row)
    return pd.DataFrame(rows, index=pd.Index([*names], name="quantity"))


def _column(error: float) -> str:
    return f"shift_{100 * error:.0f}"


class MovedMost(NamedTuple):
    """The quantity that errors of 10 % of the moduli would move most."""

    name: str
    shift: float
    """Standard deviation of the shift of its posterior mean, in posterior standard deviations."""


def moved_most(table: pd.DataFrame) -> MovedMost | None:
    """Return the quantity of a `shift_table` with the largest shift; None if no shift exceeds its noise."""
    clear = table[table["shift_10"] >= CLEAR * table["shift_10_mcse"]]
    if clear.empty:
        return None
    most = int(clear["shift_10"].to_numpy().argmax())
    return MovedMost(str(clear.index[most]), float(clear["shift_10"].iloc[most]))


def shift_sentences(table: pd.DataFrame) -> list[str]:
    """Describe how far conclusions would shift if moduli taken as exact were wrong.

    Parameters
    ----------
    table
        From `shift_table`; quantities with Monte-Carlo errors of the same size are left out.
    """
    columns = [_column(error) for error in ERRORS]
    clear = table[table[columns[0]] >= CLEAR * table[f"{columns[0]}_mcse"]]
    if clear.empty:
        return []
    *smaller, largest = (f"{100 * error:.0f} %" for error in ERRORS)
    said = [
        f"if the moduli had independent errors of {', '.join(smaller)} or {largest}, posterior means would "
        "move by these numbers of posterior standard deviations (to first order; larger shifts than "
        f"{LINEAR:g} are only a rough guide: repeat the run with the errors)"
    ]
    for name, row in clear.iterrows():
        moved = ", ".join(_moved(row[column], row[f"{column}_mcse"]) for column in columns)
        said.append(f"  {name}: {moved}")
    return said


def _moved(shift: float, error: float) -> str:
    return f"{shift:.2g} ± {error:.1g}" if shift <= LINEAR else f"more than {LINEAR:g}"
