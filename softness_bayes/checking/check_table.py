"""Predictive checks of a run as a table and as sentences, from the groups of its result alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.layout import Additive, Layout, groups_in, layout_of, values_in
from softness_bayes.checking.levelled import DOUBTFUL, fall_p_value
from softness_bayes.checking.quantities import (
    DROP,
    PLACE,
    QUANTITIES,
    TURNS_OVER,
    Columns,
    Quantity,
    QuantityCheck,
    check_quantity,
)
from softness_bayes.checking.reproduction import FALL, alternative, turning_sentences
from softness_bayes.checking.uniformity import uniformity_p_value
from softness_bayes.provenance import Provenance

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

PROBABILITY = 0.9
"""Share of replicates within the limits."""

ALL = "all"
"""Label for a quantity over all loads, fabrics or participants."""

NEW_PARTICIPANTS = "rating_of_new_participants"
"""Name of the replicated ratings of new participants in the group `posterior_predictive`."""

LOO_PIT, PARETO_K = "loo_pit", "loo_pareto_k"
"""Variables of the group `constant_data`: each rating's LOO-PIT value, and Pareto k of its importance weights."""

CONDITIONS, FABRICS = "deviations of mean ratings", "fabrics' own deviations"
EXPONENTS, NOISE, PIT = "participants' own exponents", "participants' own noise", "LOO-PIT"
DEVIATIONS = "standard deviations of cells"
ALONG, FINGERS = "deviations along the response's slope", "raters' deviations along the skin's slope"
"""Checks of residuals at posterior draws, besides the test quantities."""
ONE_SIDED = (CONDITIONS, FABRICS, EXPONENTS, NOISE, ALONG, FINGERS, DEVIATIONS, PIT)
"""Checks whose p-value is the probability of larger deviations: large p-values indicate small deviations, not a
fault."""

PIT_POINTS = np.arange(1, 100) / 100
"""Points at which the distribution function of LOO-PIT values is evaluated."""


def check_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return every test quantity of the data compared with its replicates.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        Columns: law (whose replicates: prior or posterior), quantity, participants (same: those who
        rated; new: drawn from the model), load, fabric, participant (or all of them), observed,
        replicated (median; share for "turns over"), low, high (limits of 90 % of the replicates, joint
        over the rows of one quantity), p_value: probability of a replicate above the observed value; power, on the
        rows of "turns over": share of tables from a response that levels off at its peak in which presence, place,
        drop or fall would lie outside the range of the replicates, and its Monte-Carlo standard error, power_mcse.
        Posterior p-values are conservative, because the replicates come from a fit to the data. The p-value of
        the LOO-PIT treats its values as independent; their dependence makes it conservative too.
    """
    import pandas as pd

    layout = layout_of(tree)
    observed = values_in(tree, "observed_data", "rating")
    prior = values_in(tree, "prior_predictive", "rating")[0]
    fit = layout.fit(observed)
    rows = []
    for law, replicates in (("prior", {False: prior, True: prior}), ("posterior", _posterior_replicates(tree))):
        fits = {anew: layout.fit(ratings) for anew, ratings in replicates.items()}
        for quantity in QUANTITIES:
            anew = quantity.new_participants
            findings = check_quantity(quantity, layout, fit, fits[anew], PROBABILITY)
            kind = "new" if anew or law == "prior" else "same"
            labels = _labels(tree, layout, quantity.columns)
            rows += [_row(law, quantity.name, kind, *label, one) for label, one in zip(labels, findings, strict=True)]
    rows += _levelled_rows(tree, layout, fit, fits[False], rows)
    of = Provenance(tree.attrs).residuals
    for name, deviation, p_value in (
        (CONDITIONS, of.condition_deviation, of.condition_p_value),
        (FABRICS, of.fabric_deviation, of.fabric_p_value),
        (EXPONENTS, of.exponent_deviation, of.exponent_p_value),
        *([(NOISE, of.noise_deviation, of.noise_p_value)] if of.noise_check else []),
        (ALONG, np.nan, of.modulus_p_value),
        *([(FINGERS, np.nan, of.finger_p_value)] if of.finger_check else []),
        *([(DEVIATIONS, np.nan, of.spread_p_value)] if of.spread_check else []),
    ):
        rows.append(
            _row("posterior", name, "same", ALL, ALL, ALL, QuantityCheck(deviation, np.nan, np.nan, np.nan, p_value))
        )
    pit = values_in(tree, "constant_data", LOO_PIT)
    p_value = uniformity_p_value(pit, PIT_POINTS)
    rows.append(_row("posterior", PIT, "same", ALL, ALL, ALL, QuantityCheck(pit.mean(), 0.5, np.nan, np.nan, p_value)))
    return pd.DataFrame(rows).set_index(["law", "quantity"])


def _levelled_rows(
    tree: xr.DataTree, layout: Layout, data: Additive, replicates: Additive, rows: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return the rows of fall beyond the turning point; the power of their check is added to the rows of presence."""
    levelled = alternative(tree, layout, replicates)
    if levelled is None:
        return []
    labels = _labels(tree, layout, Columns.LOAD)
    powers = {load: one for (load, _, _), one in zip(labels, levelled.power, strict=True)}
    for row in rows:
        if row["law"] == "posterior" and row["quantity"] == TURNS_OVER:
            row["power"], row["power_mcse"] = powers[str(row["load"])]
    observed, replicated = (levelled.quantity.of(layout, fit) for fit in (data, replicates))
    p_values = [fall_p_value(observed[[k]], replicated[:, k])[0] for k in range(observed.size)]
    findings = check_quantity(levelled.quantity, layout, data, replicates, PROBABILITY)
    findings = [one._replace(p_value=float(p)) for one, p in zip(findings, p_values, strict=True)]
    return [_row("posterior", FALL, "same", *label, one) for label, one in zip(labels, findings, strict=True)]


class CheckedQuantity(NamedTuple):
    """A test quantity of the data and of the posterior's replicates."""

    quantity: Quantity
    labels: list[tuple[str, str, str]]
    """Load, fabric and participant of every column, `ALL` where it is over all of them."""
    findings: list[QuantityCheck]
    """The comparison of every column, as in `check_table`."""
    replicated: Array
    """Shape (replicates, columns); NaN for replicates without a value."""


def posterior_quantities(tree: xr.DataTree, quantities: Sequence[Quantity] = QUANTITIES) -> list[CheckedQuantity]:
    """Return the test quantities in `check_table` for each replicate.

    Parameters
    ----------
    tree
        The groups of a result.
    quantities
        The quantities to compare.
    """
    layout = layout_of(tree)
    fit = layout.fit(values_in(tree, "observed_data", "rating"))
    fits = {anew: layout.fit(ratings) for anew, ratings in _posterior_replicates(tree).items()}
    return [
        CheckedQuantity(
            quantity,
            _labels(tree, layout, quantity.columns),
            check_quantity(quantity, layout, fit, replicates, PROBABILITY),
            quantity.of(layout, replicates),
        )
        for quantity in quantities
        for replicates in [fits[quantity.new_participants]]
    ]


def check_sentences(table: pd.DataFrame) -> list[str]:
    """Describe whether the model reproduces the turning point under each load, and which other quantities it does not.

    Parameters
    ----------
    table
        From `check_table`.
    """
    return [*turning_sentences(table), *doubt_sentences(table)]


def doubts(table: pd.DataFrame) -> list[str]:
    """Return the quantities, other than the turning point, that the model does not reproduce, each with its worst case.

    Parameters
    ----------
    table
        From `check_table`.
    """
    checks = table[table.index.get_level_values("law") == "posterior"].droplevel("law")
    others = checks[~checks.index.isin([TURNS_OVER, PLACE, DROP, FALL])]
    found = []
    for name in dict.fromkeys(others.index):
        rows = others.loc[[name]]
        rows = rows[np.isfinite(rows["p_value"])]
        if rows.empty:
            continue
        p_values = rows["p_value"] if name in ONE_SIDED else rows["p_value"].map(_two_sided)
        if p_values.min() < DOUBTFUL / len(rows):
            worst = rows.iloc[int(np.argmin(p_values))]
            where = " ".join(str(worst[k]) for k in ("fabric", "load", "participant") if worst[k] != ALL)
            found.append(f"{name}{f' ({where})' if where else ''}")
    return found


def doubt_sentences(table: pd.DataFrame) -> list[str]:
    """Describe the quantities, other than the turning point, that the model does not reproduce.

    Parameters
    ----------
    table
        From `check_table`.
    """
    return [unreproduced_sentence(doubts(table))]


def unreproduced_sentence(names: Sequence[str]) -> str:
    """Describe quantities, other than the turning point, that the model does not reproduce; names from `doubts`."""
    if not names:
        return "predictive checks: the model reproduces all other test quantities"
    return f"predictive checks: the model does not reproduce {', '.join(names)} (see predictive_checks.csv)"


def _posterior_replicates(tree: xr.DataTree) -> dict[bool, Array]:
    """Return the posterior replicates of ratings, (draws, rows), keyed by whether participants are new."""
    names = {False: "rating", True: NEW_PARTICIPANTS}
    return {anew: values_in(tree, "posterior_predictive", name)[0] for anew, name in names.items()}


def _two_sided(p_value: float) -> float:
    return 2.0 * min(p_value, 1.0 - p_value)


def _row(
    law: str, quantity: str, participants: str, load: str, fabric: str, participant: str, finding: QuantityCheck
) -> dict[str, Any]:
    return {
        "law": law,
        "quantity": quantity,
        "participants": participants,
        "load": load,
        "fabric": fabric,
        "participant": participant,
        **finding._asdict(),
        "power": np.nan,
        "power_mcse": np.nan,
    }


def _labels(tree: xr.DataTree, layout: Layout, columns: Columns) -> list[tuple[str, str, str]]:
    """Return load, fabric and participant of every column of a quantity."""
    groups = {"fabric": "constant_data", "participant": "log_likelihood_participant"}
    fabric, participant = (values_in(tree, group, what).astype(str) for what, group in groups.items())
    load = groups_in(tree).names
    match columns:
        case Columns.CONDITION:
            return [(load[k], fabric[f], ALL) for k, f in zip(layout.load, layout.design.fabric, strict=True)]
        case Columns.LOAD:
            return [(load[k], ALL, ALL) for k in layout.loads]
        case Columns.PARTICIPANT:
            return [(ALL, ALL, name) for name in participant]
        case _:
            return [(ALL, ALL, ALL)]
