"""Predictive check of fabrics: deviations of their mean ratings from the fitted response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters
from softness_bayes.likelihood.left_out import summing
from softness_bayes.likelihood.pieces import part_of, pieces
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.readable import percent

Array = NDArray[np.float64]

FABRIC_SPREAD = "omega"
"""Name of the parameter of models with random effects of fabrics."""

NEEDED = 0.05
"""Predictive p-value below which deviations of fabrics are considered real."""

NOTICED = 0.8
"""Power for which the detectable deviation is reported."""


class FabricCheck(NamedTuple):
    """Comparison of the fabrics' mean ratings with the response.

    A condition is a fabric under a load. The sum of squares between conditions is the sum of two parts: that
    between fabrics, whose deviations are the same under every load, and that within fabrics, whose deviations
    differ between loads.
    """

    p_value: float
    """Probability that replicated ratings vary at least as much between fabrics as the observed ones."""
    deviation: float
    """Standard deviation between fabrics estimated from the excess, in the (log) rating."""
    condition_p_value: float = 1.0
    """As `p_value`, between conditions."""
    condition_deviation: float = 0.0
    """As `deviation`, between conditions."""
    within_p_value: float = np.nan
    """As `p_value`, between the loads of a fabric; NaN if each fabric has only one load."""
    noticed: float = np.nan
    """Approximate standard deviation between conditions that would be detected with power `NOTICED`."""
    worst: int = 0
    """Index of the condition with the largest deviation in standard errors."""
    worst_residual: float = 0.0
    """Its mean residual, in the (log) rating."""
    worst_errors: float = 0.0
    """Mean residual in standard errors."""
    unit: str = MAGNITUDE.unit
    """Unit of deviations, for sentences."""
    remedy: bool = True
    """True if a model with an effect per fabric is available; there is none for z-scores."""

    def sentence(self, conditions: Sequence[str]) -> str:
        """One line for the user; `conditions` names each condition."""
        unit = self.unit
        if min(self.p_value, self.condition_p_value) >= NEEDED:
            return (
                "fabrics: no mean rating deviates from the response by more than noise explains (p = "
                f"{self.condition_p_value:.2g}, {len(conditions)} means; power: deviations of about "
                f"{self.noticed:.1g} (sd) in the {unit} would be detected in {percent(NOTICED)} of such "
                "tables)"
            )
        if self.condition_p_value >= NEEDED:
            found = (
                f"deviate from the response alike under every load, by about {self.deviation:.2g} (sd) in the {unit}"
            )
            return f"fabrics: {found}, more than noise explains (p = {self.p_value:.2g}); {self._remedy}"
        side = "above" if self.worst_residual > 0 else "below"
        return (
            f"fabrics: mean ratings deviate from the response by about {self.condition_deviation:.2g} (sd) in the "
            f"{unit}, more than noise explains (p = {self.condition_p_value:.2g}); most of all "
            f"{conditions[self.worst]}, {abs(self.worst_residual):.2g} {side} it "
            f"({abs(self.worst_errors):.1f} standard errors); {self._remedy}"
        )

    @property
    def _remedy(self) -> str:
        """Advice about deviations, which depends on whether they are the same under every load."""
        if self.within_p_value < NEEDED:
            return "they differ between the loads of a fabric, so the response may be wrong: try other readings"
        alone = (
            "" if np.isfinite(self.within_p_value) else " (with one load per fabric the response may be wrong instead)"
        )
        remedy = ": add --prior omega='halfnormal(0.5)'" if self.remedy else f", and {self.unit}s have none"
        return f"without an effect per fabric the intervals are too narrow{remedy}{alone}"


def mean_residuals(
    observation: Likelihood, mean_rate: Array, parameters: Parameters, effects: Effects
) -> tuple[Array, Array]:
    """Return the number of ratings of each condition, and their mean residual at every draw, 0 if there are none.

    Parameters
    ----------
    observation, mean_rate, parameters, effects
        As for `check_fabrics`.

    Returns
    -------
    count : ndarray, shape (conditions,)
    mean : ndarray, shape (draws, conditions)
    """
    design = observation.design
    count = np.bincount(design.condition, minlength=design.n_conditions).astype(float)
    member = summing(design.condition, count.size)
    mean = np.empty((len(mean_rate), count.size))
    for k in pieces(len(mean_rate), design.n_rows):
        residual = observation.residual(mean_rate[k], part_of(parameters, k), part_of(effects, k))
        mean[k] = (member @ residual.T).T / np.maximum(count, 1.0)
    return count, mean


def exceeded_along(along: Array, weight: Array, steep: NDArray[np.bool_], spread: Array) -> float:
    """Return the probability, averaged over draws, that replicated ratings deviate at least as much along slopes.

    The sum of along² / weight over steep groups, in units of spread², has a chi-squared law with a degree of freedom
    for each.

    Parameters
    ----------
    along, weight
        Residuals projected on each group's slopes, and the sum of the squares of these, shape (draws, groups).
    steep
        Whether a group has a slope, likewise.
    spread
        Standard deviation of single residuals, shape (draws,).

    Returns
    -------
    float
        NaN if no group has a slope in any draw.
    """
    squares = np.divide(along**2, weight, out=np.zeros_like(weight), where=steep).sum(axis=1)
    freedom = steep.sum(axis=1)
    judged = freedom > 0
    if not judged.any():
        return np.nan
    return float(chdtrc(freedom[judged], squares[judged] / spread[judged] ** 2).mean())


def check_fabrics(observation: Likelihood, mean_rate: Array, parameters: Parameters, effects: Effects) -> FabricCheck:
    """Compare the variation of residuals between fabrics, and between conditions, with that of replicates.

    The discrepancy is T = sum_c n_c (mean residual of condition c)², given a draw of all parameters and
    effects; likewise for fabrics. Residuals of replicated ratings are N(0, varsigma²), so their T / varsigma²
    follows a chi-squared law with one degree of freedom for each condition or fabric: no replicate needs to be
    drawn. At a single draw the p-value is uniform under the model; its mean over draws varies less, which makes the
    check conservative.

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
    count, mean = mean_residuals(observation, mean_rate, parameters, effects)
    rated = np.flatnonzero(count > 0)
    count, mean = count[rated], mean[:, rated]
    spread = np.broadcast_to(model.error_sd(parameters), mean.shape[:1])
    fabrics, fabric = np.unique(design.fabric[rated], return_inverse=True)
    size, sums = np.bincount(fabric, count).astype(float), (summing(fabric, fabrics.size) @ (count * mean).T).T
    between, everywhere = (sums**2 / size).sum(axis=1), (count * mean**2).sum(axis=1)
    within = rated.size - fabrics.size
    errors = (np.sqrt(count) * mean / spread[:, None]).mean(axis=0)
    worst = int(np.abs(errors).argmax())
    # a deviation's variance, times n/varsigma², is added to the scale of the law
    scale = chdtri(rated.size, NEEDED) / chdtri(rated.size, NOTICED)
    return FabricCheck(
        _p_value(between, spread, fabrics.size),
        _deviation(between, spread, size),
        _p_value(everywhere, spread, rated.size),
        _deviation(everywhere, spread, count),
        _p_value(np.maximum(everywhere - between, 0.0), spread, within) if within else np.nan,
        float(np.median(spread) * np.sqrt((scale - 1.0) / count.mean())),
        int(rated[worst]),
        float(mean[:, worst].mean()),
        float(errors[worst]),
        model.scale.unit,
        FABRIC_SPREAD in model.needs,
    )


def _p_value(squares: Array, spread: Array, freedom: int) -> float:
    """Return the mean probability of a larger sum of squares, from sums at draws of the posterior."""
    return float(chdtrc(freedom, squares / spread**2).mean())


def _deviation(squares: Array, spread: Array, count: Array) -> float:
    """Return the standard deviation between groups estimated from sums of squares in excess of noise."""
    excess = (squares / count.size - spread**2) / count.mean()
    return float(np.sqrt(max(np.median(excess), 0.0)))
