"""Comparison of fitted models by their predictions of left-out ratings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import require_kind, require_mapping
from softness_bayes.checking.exactness import largest_pareto_k
from softness_bayes.checking.layout import RATING_HIGH, RATING_LOW
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.fitted import differences
from softness_bayes.results.result import Result
from softness_bayes.runs.left_out import LEAVE, Leave, Refits
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings

Array = NDArray[np.float64]

CLUSTERS = ("fabric", "condition", "participant")
"""Properties shared by ratings or conditions, within which their differences are correlated."""

SMALL_DIFFERENCE = 4.0
"""Difference in expected log predictive density below which data do not distinguish models."""

REFIT = Settings(ensembles=2, max_steps=20_000, goal=Goal(r_hat=1.02, ess=200.0))
"""Settings of a refit without a fabric, which needs draws for only one expectation."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Fitted models, ranked by their predictions.

    Parameters
    ----------
    table
        A row per model, the best first. Columns: rank; elpd, the sum over the units left out of their
        log predictive densities, and se, its standard error; elpd_diff, elpd less the best one's, and
        se_diff, the standard error of that difference unit by unit; se_by_fabric, se_by_condition and
        se_by_participant, that of clusters, where single ratings or conditions are left out (ratings of one go
        together); weight, in the mixture of models that predicts best (stacking); units, number of units left out;
        pareto_k_max and pareto_k_high, the largest Pareto k and how many exceed what the draws allow; unfinished, how
        many refits did not converge; converged, whether the run itself had; model, its distinguishing features. Both
        errors treat units as independent, but not the ratings within one.
    leave
        The kind of unit that was left out; for places in lists, the list.
    interior
        Probability of an interior maximum under each load, averaged over the models with their weights.
    """

    table: pd.DataFrame
    leave: str
    interior: pd.Series[float]

    @property
    def sentence(self) -> str:
        """Statement of whether the data distinguish the best two models."""
        best, second = self.table.iloc[0], self.table.iloc[1]
        gap = abs(float(second["elpd_diff"]))
        errors = {"": float(second["se_diff"])}
        errors |= {f" by {by}": float(second[f"se_by_{by}"]) for by in CLUSTERS if f"se_by_{by}" in second}
        known = {by: error for by, error in errors.items() if np.isfinite(error)}
        by, error = max(known.items(), key=lambda one: one[1]) if known else ("", float("nan"))
        numbers = f"elpd differs by {gap:.1f} (standard error {error:.1f}{by})"
        if gap < SMALL_DIFFERENCE or gap < 2.0 * error:
            return (
                f"the data do not distinguish {best.name} from {second.name}: {numbers}, holding out each {self.leave}"
            )
        return f"{best.name} predicts better than {second.name}: {numbers}, holding out each {self.leave}"

    @property
    def warnings(self) -> list[str]:
        """Return the reasons why numbers of the table are unreliable, one per line."""
        found = []
        for label, row in self.table.iterrows():
            if row["pareto_k_high"]:
                found.append(
                    f"{label}: Pareto k is high for {row['pareto_k_high']} of {row['units']} (largest "
                    f"{row['pareto_k_max']:.2f}): single {self.leave}s influence the posterior too much, so "
                    "its elpd is unreliable"
                )
            if row["unfinished"]:
                found.append(f"{label}: {row['unfinished']} of {row['units']} refits did not converge")
            if not row["converged"]:
                found.append(f"{label}: the run itself has not converged")
        return found


def compare(
    results: Mapping[str, Result],
    leave: str | Leave = "rating",
    settings: Settings = REFIT,
    progress: Callable[[str], None] = lambda _: None,
    executor: Executor | None = None,
) -> Comparison:
    """Rank models fitted to the same ratings, or recorded afferents, by their predictions of those left out.

    Ratings and participants are left out by Pareto-smoothed importance weights on the closed-form densities
    given all others that each result stores, fabrics by refitting the model without each.

    Parameters
    ----------
    results
        At least two results, by their names in the table.
    leave
        Name of the unit to leave out, one of `LEAVE`, or a custom `Leave`.
    settings
        Settings of refits.
    progress
        Function called after each refit.
    executor
        Executor that runs refits instead of `settings.processes` processes, one task per refit, with the same draws.

    Raises
    ------
    InputError
        If there are fewer than two results, one has no ratings, or they are of different data or scales; or the unit to
        leave out is unknown.
    """
    require_mapping("results", results, "{'hertz': result, 'attenuated': other}")
    for label, result in results.items():
        require_kind(f"results: {label}", result, Result, "a Result, as returned by sample or Result.load")
    if leave not in LEAVE and isinstance(leave, str):
        raise InputError(f"compare: cannot hold out {leave!r}; expected one of {', '.join(LEAVE)}")
    leave = LEAVE[leave] if isinstance(leave, str) else leave
    _require_comparable(results)
    rated = all(result.has_ratings for result in results.values())
    if not rated and leave is LEAVE["rating"]:
        leave = LEAVE["response"]
    if not rated and leave is not LEAVE["response"]:
        raise InputError(f"compare: a run without ratings has no {leave.name} to hold out; hold out responses")
    told = differences(dict(results))
    found = {}
    for label, result in results.items():

        def told_of(unit: str, label: str = label) -> None:
            progress(f"{label} without {unit}")

        found[label] = leave.predict(result, Refits(settings, told_of, executor))
    order = sorted(found, key=lambda label: -float(found[label].log_density.sum()))
    best = found[order[0]].log_density
    weights = stacking_weights(np.stack([found[label].log_density for label in order], axis=-1))
    clusters = _clusters(results[order[0]], leave)
    interior = pd.Series(dtype=float)
    if rated:
        interior = sum(w * results[one].inflection()["p_interior"] for w, one in zip(weights, order, strict=True))
    rows = {}
    for rank, (label, weight) in enumerate(zip(order, weights, strict=True), 1):
        left, behind = found[label], found[label].log_density - best
        each = np.arange(behind.size)
        rows[label] = {
            "rank": rank,
            "elpd": left.log_density.sum(),
            "se": clustered_error(left.log_density, each),
            "elpd_diff": behind.sum(),
            "se_diff": clustered_error(behind, each),
            **{f"se_by_{by}": clustered_error(behind, index) for by, index in clusters.items()},
            "weight": weight,
            "units": behind.size,
            "pareto_k_max": np.nanmax(left.pareto_k, initial=-np.inf) if np.isfinite(left.pareto_k).any() else np.nan,
            "pareto_k_high": int((left.pareto_k > largest_pareto_k(left.draws)).sum()),
            "unfinished": left.unfinished,
            "converged": results[label].provenance.ending.converged,
            "model": told[label],
        }
    unit = (results[order[0]].scale.answer if leave is LEAVE["rating"] else "") or leave.name
    return Comparison(pd.DataFrame.from_dict(rows, orient="index").rename_axis("result"), unit, interior)


def _clusters(result: Result, leave: Leave) -> dict[str, NDArray[np.intp]]:
    """Return the clusters of ratings or conditions, by the shared property."""
    if leave.name not in ("rating", "condition"):
        return {}
    ratings = experiment_of(result).ratings
    if leave.name == "condition":
        return {"fabric": ratings.conditions.fabric}
    if result.scale.answer:
        return {"participant": ratings.participant[np.unique(ratings.own_lists, return_index=True)[1]]}
    return {"fabric": ratings.fabric, "condition": ratings.conditions.of_rating, "participant": ratings.participant}


def _require_comparable(results: Mapping[str, Result]) -> None:
    if len(results) < 2:
        raise InputError(f"compare: {len(results)} result, expected at least two")
    first, other = next(iter(results)), ""
    for label, result in results.items():
        if result.has_ratings != results[first].has_ratings or not (result.has_ratings or result.has_afferents):
            raise InputError(f"{label}: a run without ratings is ranked only beside others, with recorded afferents")
        if result.has_ratings and result.scale != results[first].scale:
            raise InputError(
                f"{label}: fits to {result.scale.name} ratings cannot be ranked against fits to "
                f"{results[first].scale.name} ratings ({first}), whose probabilities are of other events"
            )
        other = other or _data_that_differ(results[first], result)
        if other:
            raise InputError(
                f"{label}: fitted to other data than {first} ({other}); models can be ranked only on the same data"
            )


def _data_that_differ(one: Result, two: Result) -> str:
    """Return the first difference between the data of two results, by name; empty if they are the same."""
    for name in ("digest_ratings", "digest_fabrics", "digest_compression", "digest_afferents"):
        if one.attributes.get(name, "") != two.attributes.get(name, ""):
            return name.replace("_", " of ")
    if not one.has_ratings:
        return ""
    intervals = [
        name for name in (RATING_LOW, RATING_HIGH) if any(name in r.group("constant_data") for r in (one, two))
    ]
    if any(name not in r.group("constant_data") for r in (one, two) for name in intervals):
        return "one treats ratings as intervals, whose probabilities are not densities: use --resolution 0 for both"
    constants = (*intervals, "participant_index", "fabric_index", "load_index", "indentation_mm", "force_n")
    pairs = [
        (r.group("observed_data")["rating"], *(r.group("constant_data")[n] for n in constants)) for r in (one, two)
    ]
    for a, b in zip(*pairs, strict=True):
        if a.shape != b.shape or not np.array_equal(a.values, b.values, equal_nan=True):
            return str(a.name)
    return ""


def clustered_error(values: Array, cluster: NDArray[np.intp]) -> float:
    """Return the standard error of a sum of values that are correlated within clusters.

    With G clusters and S_g the sum of the deviations from the mean in cluster g it is sqrt(G / (G - 1) sum_g S_g²), the
    sandwich estimate corrected for few clusters (Cameron and Miller, Journal of Human Resources 50, 317, 2015).
    If every value is its own cluster, it is the error for independent values.

    Parameters
    ----------
    values
        Shape (units,).
    cluster
        Index of each one's cluster, shape (units,).

    Returns
    -------
    float
        NaN with fewer than two clusters.
    """
    _, place = np.unique(cluster, return_inverse=True)
    sums = np.bincount(place, values - values.mean())
    return float(np.sqrt(sums.size / (sums.size - 1) * (sums**2).sum())) if sums.size > 1 else float("nan")


def stacking_weights(log_density: Array) -> Array:
    """Return the weights of the mixture of models that best predicts the left-out data.

    They maximise sum_i log sum_k w_k exp(l_ik) (Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 917, 2018),
    which is concave and increases with each step of the EM algorithm for mixtures.

    Parameters
    ----------
    log_density
        Log predictive density of every unit under every model, shape (units, models).

    Returns
    -------
    ndarray, shape (models,)
    """
    weights = np.full(log_density.shape[1], 1.0 / log_density.shape[1])
    # relative to the best model of each unit, whose weight is at least one over the number of units
    density = np.exp(log_density - log_density.max(axis=1, keepdims=True))
    for _ in range(20_000):
        after = weights * (density / (density @ weights)[:, None]).mean(axis=0)
        if np.abs(after - weights).max() < 1e-10:
            return after
        weights = after
    return weights
