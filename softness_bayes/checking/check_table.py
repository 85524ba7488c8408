"""Predictive checks of a run as a table, from the groups of its result alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.checking.checks import LOADS
from softness_bayes.checking.layout import groups_in, layout_of, ratings_in, values_in
from softness_bayes.checking.provenance import Provenance
from softness_bayes.checking.quantities import (
    DOUBTFUL,
    DROP,
    EXCESS,
    FALL,
    PIT,
    PLACE,
    QUANTITIES,
    TURNS_OVER,
    Columns,
    Quantity,
    QuantityCheck,
    check_values,
    fall,
    fall_p_value,
    power,
    uniformity_p_value,
)
from softness_bayes.likelihood.layout import Additive, Layout

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
Label = tuple[str, str, str]
"""Load, fabric and participant, `ALL` where a quantity is over all of them."""

ALL = "all"
"""Label for a quantity over all loads, fabrics or participants."""

NEW_PARTICIPANTS = "rating_of_new_participants"
"""Name of the replicated ratings of new participants in the group `posterior_predictive`."""

LOO_PIT, PARETO_K = "loo_pit", "loo_pareto_k"
"""Variables of the group `constant_data`: each rating's LOO-PIT value, and Pareto k of its importance weights."""

PIT_POINTS = np.arange(1, 100) / 100
"""Points at which the distribution function of LOO-PIT values is evaluated."""


class CheckedQuantity(NamedTuple):
    """A test quantity of the data and of replicates."""

    quantity: Quantity
    labels: list[Label]
    findings: list[QuantityCheck]
    """The comparison of every column, as in `check_table`."""
    replicated: Array
    """Shape (replicates, columns); NaN for replicates without a value."""


def posterior_quantities(tree: xr.DataTree, quantities: Sequence[Quantity] = QUANTITIES) -> list[CheckedQuantity]:
    """Return the test quantities of the data and of the posterior's replicates.

    Parameters
    ----------
    tree
        The groups of a result.
    quantities
        The quantities to compare.
    """
    layout = layout_of(tree)
    data = layout.fit(ratings_in(tree))
    return _checked(tree, layout, data, _posterior_fits(tree, layout), quantities)


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
        over the rows of one quantity), p_value: probability of a replicate above the observed value; p_adjusted:
        probability that a correct model deviates as much in any check (`adjusted`), which decides; power, on the rows
        of the fall beyond the turning point: probability that it rejects a response that levels off at its peak, with
        its Monte-Carlo standard error, power_mcse.
        Posterior p-values are conservative, because the replicates come from a fit to the data. The p-value of
        the LOO-PIT treats its values as independent; their dependence makes it conservative too.
    """
    layout = layout_of(tree)
    data = layout.fit(ratings_in(tree))
    prior, posterior = layout.fit(values_in(tree, "prior_predictive", "rating")[0]), _posterior_fits(tree, layout)
    rows = []
    for law, replicates in (("prior", {False: prior, True: prior}), ("posterior", posterior)):
        for one in _checked(tree, layout, data, replicates, QUANTITIES):
            kind = "new" if one.quantity.new_participants or law == "prior" else "same"
            each = zip(one.labels, one.findings, strict=True)
            rows += [_row(law, one.quantity.name, kind, label, finding) for label, finding in each]
    rows += _fall_rows(tree, layout, data, posterior[False])
    for finding in Provenance(tree.attrs).findings.values():
        if finding.quantity != LOADS:
            rows.append(_whole(finding.quantity, finding.estimate, np.nan, finding.p_value))
    pit = values_in(tree, "constant_data", LOO_PIT)
    rows.append(_whole(PIT, pit.mean(), 0.5, uniformity_p_value(pit, PIT_POINTS)))
    table = pd.DataFrame(rows)
    return table.assign(p_adjusted=adjusted(table)).drop(columns="p_joint").set_index(["law", "quantity"])


def adjusted(table: pd.DataFrame) -> pd.Series:
    """Return the p-value of each row, adjusted so that a correct model fails any check with probability `DOUBTFUL`.

    Quantities are combined by Holm's method (Scand. J. Stat. 6, 65, 1979). The turning points, whose check has a level
    of its own, count as one test for each load: of the fall beyond the peak or, where the model predicts none, of the
    presence of a turn.

    Parameters
    ----------
    table
        Columns law, quantity, load and p_joint.

    Returns
    -------
    Series
        NaN for rows that do not decide anything: those of the prior, and of place and drop of the turning point.
    """
    p_value, name = table["p_joint"], table["quantity"]
    checked = (table["law"] == "posterior") & np.isfinite(p_value)
    falls = (name == FALL) & checked
    turns = (name == TURNS_OVER) & checked & ~table["load"].isin(table["load"][falls])
    others = checked & ~name.isin([TURNS_OVER, PLACE, DROP, FALL])
    found = p_value.where(falls | turns | others)
    for family, of in ((falls | turns, table["load"]), (others, name)):
        least = p_value[family].groupby(of[family]).min().sort_values()
        for rank, (group, floor) in enumerate((least * np.arange(len(least), 0, -1)).cummax().items()):
            rows = family & (of == group)
            found[rows] = (p_value[rows] * (len(least) - rank)).clip(floor).clip(upper=1.0)
    return found


def doubts(table: pd.DataFrame) -> list[str]:
    """Return the quantities, other than the turning point, that the model does not reproduce, each with its worst case.

    Parameters
    ----------
    table
        From `check_table`.
    """
    checks = table[table.index.get_level_values("law") == "posterior"].droplevel("law")
    failed = checks[(checks["p_adjusted"] < DOUBTFUL) & ~checks.index.isin([TURNS_OVER, FALL])]
    found = []
    for name, rows in failed.groupby(level=0, sort=False):
        worst = rows.iloc[int(rows["p_adjusted"].to_numpy().argmin())]
        where = " ".join(str(worst[k]) for k in ("fabric", "load", "participant") if worst[k] != ALL)
        found.append(f"{name}{f' ({where})' if where else ''}")
    return found


def _posterior_fits(tree: xr.DataTree, layout: Layout) -> dict[bool, Additive]:
    """Return fits of the posterior's replicates, keyed by whether participants are new."""
    names = {False: "rating", True: NEW_PARTICIPANTS}
    return {anew: layout.fit(values_in(tree, "posterior_predictive", name)[0]) for anew, name in names.items()}


def _checked(
    tree: xr.DataTree,
    layout: Layout,
    data: Additive,
    replicates: dict[bool, Additive],
    quantities: Sequence[Quantity],
) -> list[CheckedQuantity]:
    found = []
    for quantity in quantities:
        observed, again = quantity.of(layout, data), quantity.of(layout, replicates[quantity.new_participants])
        findings = check_values(observed, again, quantity.centre)
        found.append(CheckedQuantity(quantity, _labels(tree, layout, quantity.columns), findings, again))
    return found


def _fall_rows(tree: xr.DataTree, layout: Layout, data: Additive, replicates: Additive) -> list[dict[str, Any]]:
    """Return the rows of the fall beyond the turning point under each load, with the power of their check."""
    excess = np.zeros(layout.design.n_conditions)
    excess[layout.design.condition] = values_in(tree, "constant_data", EXCESS)
    expected = replicates.condition.mean(axis=0)
    observed, again = (fall(layout, one.condition, expected, excess) for one in (data, replicates))
    level = DOUBTFUL / max(int(np.isfinite(observed).sum()), 1)
    found, labels = [], _labels(tree, layout, Columns.LOAD)
    for label, value, others, one in zip(labels, observed, again.T, check_values(observed, again), strict=True):
        p_value = fall_p_value(value, others)
        # a fall that is too large is no evidence against a turn
        row = _row("posterior", FALL, "same", label, one._replace(p_value=p_value, p_joint=1.0 - p_value))
        found.append({**row, **dict(zip(("power", "power_mcse"), power(others, level), strict=True))})
    return found


def _whole(quantity: str, observed: float, replicated: float, p_value: float) -> dict[str, Any]:
    """Return the row of a check over all ratings."""
    finding = QuantityCheck(observed, replicated, np.nan, np.nan, p_value, p_value)
    return _row("posterior", quantity, "same", (ALL, ALL, ALL), finding)


def _row(law: str, quantity: str, participants: str, label: Label, finding: QuantityCheck) -> dict[str, Any]:
    return {
        "law": law,
        "quantity": quantity,
        "participants": participants,
        **dict(zip(("load", "fabric", "participant"), label, strict=True)),
        **finding._asdict(),
        "power": np.nan,
        "power_mcse": np.nan,
    }


def _labels(tree: xr.DataTree, layout: Layout, columns: Columns) -> list[Label]:
    """Return load, fabric and participant of every column of a quantity."""
    fabric = values_in(tree, "constant_data", "fabric").astype(str)
    load = groups_in(tree).names
    match columns:
        case Columns.CONDITION:
            return [(load[k], fabric[f], ALL) for k, f in zip(layout.load, layout.design.fabric, strict=True)]
        case Columns.LOAD:
            return [(load[k], ALL, ALL) for k in layout.loads]
        case Columns.PARTICIPANT:
            people = values_in(tree, "log_likelihood_participant", "participant").astype(str)
            return [(ALL, ALL, name) for name in people]
        case _:
            return [(ALL, ALL, ALL)]
