"""How far a run's conclusions rest on eps, what is added to a silent fabric's rate: its draws weighted for another one.

eps is declared, not measured, and decides what silent fabrics say (model.md 9). The response does not contain it, so
that another eps changes the likelihood of a draw alone: the ratio of the two likelihoods is the draw's weight. Where
many fabrics are silent the posterior moves farther than draws can be weighted; what remains then is its first
derivative, d E[q] / d ln eps = Cov(q, d log L / d ln eps).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.inference.curves import Inflection, Outcome
from softness_bayes.inference.observation import RatingParameters
from softness_bayes.inference.scales import ObservedRatings

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

FACTORS = (0.25, 0.5, 2.0, 4.0)
"""What eps is multiplied by."""

LARGEST_K, LEAST_ESS = 0.7, 50.0
"""Pareto k of the weights beyond which, and effective draws below which, nothing is said."""

INDEX = ["eps_hz", "quantity"]

INTERIOR, PLACE = "p_interior ", "log_e_fab_kpa "
"""What the names of quantities of a load begin with."""


class Weights(NamedTuple):
    """Weights that turn draws under one eps into draws under another."""

    weight: Array
    """Adding up to 1, shape (draws,)."""
    pareto_k: float
    """Shape of the tail of the raw ones."""

    @classmethod
    def of(cls, log_ratio: Array) -> Weights:
        """Return the Pareto-smoothed weights of some log ratios, shape (draws,)."""
        (log_weight,), (k,) = arviz_bridge.psis(log_ratio[None])
        return cls(np.exp(log_weight), float(k))

    @property
    def ess(self) -> float:
        """Effective number of draws."""
        return float(1.0 / (self.weight**2).sum())

    @property
    def usable(self) -> bool:
        """Whether averages under the weights mean anything."""
        return self.ess >= LEAST_ESS and self.pareto_k <= LARGEST_K

    def mean(self, values: Array) -> Array:
        """Return the mean over the first axis, of the draws that have a value; NaN where none has."""
        return _mean(values, self.weight)


def eps_table(
    ratings: ObservedRatings,
    mean_rate: Array,
    parameters: RatingParameters,
    named: dict[str, Array],
    inflection: Inflection,
    loads: Sequence[str],
) -> pd.DataFrame:
    """Return what another eps would change.

    Parameters
    ----------
    ratings
        The ratings, under a model with a logarithm of the response.
    mean_rate
        N/N_ref [Hz] at some draws, shape (draws, conditions).
    parameters
        The rating model's parameters there; eps is one number.
    named
        Sampled parameters by name, shape (draws,).
    inflection
        Where the response turns over at these draws, shape (draws, loads).
    loads
        Names of the loads.

    Returns
    -------
    DataFrame
        Index eps_hz and quantity; mean under the eps of the run (mean) and under the other (other_mean), and their
        difference (shift) in standard deviations of the quantity or, for a probability, as it is; ess and pareto_k of
        the weights, and whether these are good enough (usable); in the same units what doubling eps changes to first
        order (per_doubling). Quantities are the parameters, and for each load the probability of an interior maximum
        and the natural logarithm of its E_fab in kPa.
    """
    import pandas as pd

    eps = float(np.asarray(parameters.eps))
    values = dict(named)
    for k, load in enumerate(loads):
        values[f"{INTERIOR}{load}"] = (inflection.outcome[:, k] == Outcome.INTERIOR).astype(float)
        values[f"{PLACE}{load}"] = np.log(inflection.modulus[:, k] * 1e-3)
    matrix = np.stack([*values.values()], axis=-1)
    even = np.full(len(matrix), 1.0 / len(matrix))
    mean = _mean(matrix, even)
    spread = np.sqrt(_mean((matrix - mean) ** 2, even))
    unit = np.where([name.startswith(INTERIOR) for name in values], 1.0, spread)
    usual = ratings.log_likelihood(mean_rate, parameters)
    step = 1e-3
    up, down = (ratings.log_likelihood(mean_rate, parameters._replace(eps=eps * np.exp(h))) for h in (step, -step))
    slope = (up - down) / (2.0 * step)
    doubling = np.log(2.0) * _in_units(_mean((matrix - mean) * (slope - slope.mean())[:, None], even), unit)
    rows = []
    for factor in FACTORS:
        other = ratings.log_likelihood(mean_rate, parameters._replace(eps=factor * eps))
        weights = Weights.of(other - usual)
        moved = weights.mean(matrix)
        shift = _in_units(moved - mean, unit)
        for name, *numbers in zip(values, mean, moved, shift, doubling, strict=True):
            rows.append((factor * eps, name, *numbers, weights.ess, weights.pareto_k, weights.usable))
    columns = [*INDEX, "mean", "other_mean", "shift", "per_doubling", "ess", "pareto_k", "usable"]
    return pd.DataFrame(rows, columns=columns).set_index(INDEX)


def eps_sentence(table: pd.DataFrame) -> str:
    """Say in one line what the table holds."""
    apart = table.reset_index()
    good, poor = apart[apart["usable"]], apart[~apart["usable"]]
    said = []
    if len(good):
        among = ", ".join(f"{value:g}" for value in dict.fromkeys(good["eps_hz"]))
        said.append(f"with eps {among} Hz {_largest(good, 'shift')}")
    if len(poor):
        found = dict(zip(poor["eps_hz"].tolist(), poor["ess"].tolist(), strict=True))
        among = ", ".join(f"{eps:g} (ESS {ess:.0f})" for eps, ess in found.items())
        said.append(f"the draws' weights are too uneven to tell with eps {among} Hz (fit with --fix eps=VALUE)")
        said.append(f"doubling it, to first order, {_largest(poor, 'per_doubling')}")
    return "sensitivity to eps: " + "; ".join(said)


def _largest(rows: pd.DataFrame, column: str) -> str:
    """Say which quantities of each kind change most."""
    kinds = {name: _kind(name) for name in rows["quantity"]}
    said = []
    for kind, text in _KINDS.items():
        some = rows[rows["quantity"].map(kinds) == kind].dropna(subset=[column])
        if len(some):
            at = int(some[column].abs().to_numpy().argmax())
            name = str(some["quantity"].iloc[at]).removeprefix(kind)
            said.append(text.format(abs(float(some[column].iloc[at])), name))
    return ", ".join(said)


_KINDS = {
    "": "moves means by up to {:.2g} sd ({})",
    INTERIOR: "the probability of an interior maximum by up to {:.2g} ({})",
    PLACE: "the log of its E_fab by up to {:.2g} sd ({})",
}


def _kind(quantity: str) -> str:
    return next((kind for kind in (INTERIOR, PLACE) if quantity.startswith(kind)), "")


def _in_units(change: Array, unit: Array) -> Array:
    """Return changes in given units; 0 where a quantity does not vary, NaN where it has no value."""
    return np.where(np.isnan(change), np.nan, np.divide(change, unit, out=np.zeros_like(change), where=unit > 0))


def _mean(values: Array, weight: Array) -> Array:
    known = np.isfinite(values)
    shared = np.where(known, weight[:, None], 0.0)
    total, summed = shared.sum(axis=0), (shared * np.where(known, values, 0.0)).sum(axis=0)
    return np.divide(summed, total, out=np.full_like(summed, np.nan), where=total > 0)
