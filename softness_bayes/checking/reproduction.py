"""Whether a model reproduces the turning point of the ratings, load by load, and whether they could tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.levelled import NEEDED, Power, Tables, departs, fall, power
from softness_bayes.checking.quantities import DROP, PLACE, TURNS_OVER, Additive, Columns, Layout, Quantity

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

LEVELLED, SHORTFALL = "levelled_predictive", "levelled_shortfall"
"""Group of what tables of a response that levels off show, and the variable of `constant_data` with how much more
it gives than the model."""

FALL = "fall beyond inflection / expected"
"""The test quantity of `levelled.fall` under each load."""


class Alternative(NamedTuple):
    """A run's response levelled at its peak, as the check of the turning point needs it."""

    quantity: Quantity
    """The fall beyond the turning point."""
    power: list[Power]
    """Of each load."""


def alternative(tree: xr.DataTree, layout: Layout, replicates: Additive) -> Alternative | None:
    """Return the levelled response of a result; None if it stores none.

    Parameters
    ----------
    tree
        The groups of a result.
    layout
        Who rated what.
    replicates
        Fits of the posterior's replicated ratings.
    """
    if LEVELLED not in tree.children:
        return None
    shortfall = np.zeros(layout.design.n_conditions)
    shortfall[layout.design.condition] = tree["constant_data"].to_dataset()[SHORTFALL].values
    expected = replicates.condition.mean(axis=0)
    stored = tree[LEVELLED].to_dataset().isel(chain=0)
    names = [f"levelled_{name}" for name in LEVELLED_NAMES]
    other = Tables(*(stored[name].values[:, layout.loads] for name in names))
    found = power(other, Tables.of(layout, replicates, expected, shortfall))
    quantity = Quantity(FALL, False, Columns.LOAD, lambda layout, fit: fall(layout, fit.condition, expected, shortfall))
    return Alternative(quantity, found)


LEVELLED_NAMES = ("turns_over", "e_fab_kpa", "drop", "fall")
"""Variables of the group `LEVELLED` without their prefix, in the order of `levelled.Tables`."""


class Reproduction(NamedTuple):
    """Whether the model reproduces what the ratings under one load show of a turning point."""

    load: str
    reproduced: bool | None
    """None where the ratings cannot tell."""
    seen: str
    """What the ratings show, how many of the replicates do, and what the check could have noticed."""


def inflection_reproduced(table: pd.DataFrame) -> list[Reproduction]:
    """Judge load by load whether the model reproduces the turning point.

    It does not if presence, place, drop or fall lies beyond the replicates' reach (`levelled.departs`). Else it does
    if a response that levels off at its peak would fail in at least `levelled.NEEDED` of the tables; if not, the
    ratings cannot tell.

    Parameters
    ----------
    table
        From `criticism.check_table`.
    """
    checks = table[table.index.get_level_values("law") == "posterior"].droplevel("law")
    found = []
    for load in dict.fromkeys(checks.loc[[TURNS_OVER], "load"]):
        rows = {str(name): row for name, row in checks[checks["load"] == load].iterrows()}
        row = rows[TURNS_OVER]
        if np.isnan(row["observed"]):
            found.append(Reproduction(load, None, "too few fabrics or ratings"))
            continue
        p_values = np.array([rows[name]["p_value"] for name in (TURNS_OVER, PLACE, DROP)], float)
        beyond = np.array(rows[FALL]["p_value"] if FALL in rows else np.nan, float)
        able = row.get("power", np.nan) >= NEEDED
        reproduced = False if departs(p_values, beyond) else True if able else None
        found.append(Reproduction(load, reproduced, f"{_seen(rows)}; {_noticed(rows)}"))
    return found


def turning_sentences(table: pd.DataFrame) -> list[str]:
    """Say what `inflection_reproduced` found, one line for each load after one that says what a yes needs."""
    words = {True: "yes", False: "no", None: "ratings cannot tell"}
    head = (
        f"turning point (maximum) reproduced? yes if this check would fail in at least {NEEDED:.0%} of tables where "
        "the response levels off at its peak instead"
    )
    return [head, *(f"{load}: {words[answer]}, {seen}" for load, answer, seen in inflection_reproduced(table))]


def _seen(rows: dict[str, pd.Series]) -> str:
    """Say what the ratings show of a turning point, and what the model's tables do."""
    row, place, beyond = rows[TURNS_OVER], rows[PLACE], rows.get(FALL)
    share = row["replicated"]
    if row["observed"]:
        seen = f"ratings turn over at {place['observed']:.3g} kPa, {share:.0%} of the model's tables do"
        if np.isfinite(place["low"]):
            seen += f" (at {place['low']:.3g} to {place['high']:.3g})"
    else:
        seen = f"ratings show no clear turn, {share:.0%} of the model's tables do"
    if beyond is not None and np.isfinite(beyond["observed"]):
        seen += (
            f"; they fall beyond the peak by {beyond['observed']:.2g} of what is expected "
            f"({beyond['low']:.2g} to {beyond['high']:.2g} in the model's tables)"
        )
    return seen


def _noticed(rows: dict[str, pd.Series]) -> str:
    """Say what the check could have noticed."""
    row, beyond = rows[TURNS_OVER], rows.get(FALL)
    if np.isnan(row.get("power", np.nan)):
        return "what this check would notice is not known"
    if beyond is None or np.isnan(beyond["replicated"]):
        return "the model's response does not fall within the fabrics' range"
    return f"if it levelled off, {100 * row['power']:.3g} ± {100 * row['power_mcse']:.1g}% of tables would fail"
