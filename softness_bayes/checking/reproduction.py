"""Check of the turning point: its reproduction by the model under each load, and the power of the check."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.layout import Additive, Layout
from softness_bayes.checking.levelled import DOUBTFUL, NEEDED, Power, Tables, departs, fall, power
from softness_bayes.checking.quantities import DROP, PLACE, TURNS_OVER, Columns, Quantity
from softness_bayes.defaults import shown_of
from softness_bayes.readable import number, percent

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

LEVELLED, SHORTFALL = "levelled_predictive", "levelled_shortfall"
"""Group with the test quantities of tables from a response that levels off, and the variable of `constant_data` with
the amount by which its mean ratings exceed the model's."""

FALL = "fall beyond inflection / expected"
"""The test quantity of `levelled.fall` under each load."""

LARGEST_RATIO = 10.0
"""Multiple of the predicted fall up to which falls of simulated tables are reported; a smaller one is lost in noise."""


class Alternative(NamedTuple):
    """Response of a run levelled at its peak, for the check of the turning point."""

    quantity: Quantity
    """The fall beyond the turning point."""
    power: list[Power]
    """Of each load."""


def alternative(tree: xr.DataTree, layout: Layout, replicates: Additive) -> Alternative | None:
    """Return the levelled response of a result; None if it stores none, or none of the groups of its loads.

    Parameters
    ----------
    tree
        The groups of a result.
    layout
        Rater, fabric and load of each rating.
    replicates
        Fits of the posterior's replicated ratings.
    """
    if LEVELLED not in tree.children:
        return None
    stored = tree[LEVELLED].to_dataset().isel(chain=0)
    names = [f"levelled_{name}" for name in LEVELLED_NAMES]
    other = Tables(*(stored[name].values[:, layout.loads] for name in names))
    shortfall = np.zeros(layout.design.n_conditions)
    shortfall[layout.design.condition] = tree["constant_data"].to_dataset()[SHORTFALL].values
    expected = replicates.condition.mean(axis=0)
    found = power(other, Tables.of(layout, replicates, expected, shortfall))
    quantity = Quantity(FALL, False, Columns.LOAD, lambda layout, fit: fall(layout, fit.condition, expected, shortfall))
    return Alternative(quantity, found)


LEVELLED_NAMES = ("turns_over", "e_fab_kpa", "drop", "fall")
"""Variables of the group `LEVELLED` without their prefix, in the order of `levelled.Tables`."""


class Reproduction(NamedTuple):
    """Verdict on the turning point under one load."""

    load: str
    reproduced: bool | None
    """None if the ratings do not decide."""
    seen: str
    """The turn in the ratings, its frequency among replicates, and the power of the check, in words."""


def inflection_reproduced(table: pd.DataFrame) -> list[Reproduction]:
    """Decide for each load whether the model reproduces the turning point.

    The model fails if presence, place, drop or fall lies outside the range of the replicates (`levelled.departs`).
    Otherwise it passes if a response that levels off at its peak would fail in at least `levelled.NEEDED` of the
    tables; with less power, the ratings do not decide.

    Parameters
    ----------
    table
        From `check_table.check_table`.
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
    """Describe the findings of `inflection_reproduced`: the criterion, then one line per load."""
    words = {True: "yes", False: "no", None: "not shown by the ratings"}
    head = (
        "does the model reproduce the turning point (maximum)? The answer is yes only if the check has the "
        f"power to reject a response that levels off at its peak in at least {percent(NEEDED)} of simulated "
        "tables"
    )
    found = inflection_reproduced(table)
    shown = shown_of(len(found))
    lines = [f"{load}: {words[answer]}; {seen}" for load, answer, seen in (found[k] for k in shown)]
    if len(shown) < len(found):
        counts = ", ".join(f"{word} {sum(one.reproduced is answer for one in found)}" for answer, word in words.items())
        chance = f"for a correct model, at most about {DOUBTFUL * len(found):.1g} would be no by chance"
        lines.insert(0, f"of {len(found)} loads: {counts} ({chance}); {len(shown)} of them:")
    return [head, *lines]


def _seen(rows: dict[str, pd.Series]) -> str:
    """Describe the turn in the ratings, and in the tables that the model simulates."""
    row, place, beyond = rows[TURNS_OVER], rows[PLACE], rows.get(FALL)
    share = row["replicated"]
    if row["observed"]:
        where = f", at {number(place['low'])} to {number(place['high'])} kPa" if np.isfinite(place["low"]) else ""
        at, others = number(place["observed"]), f"so do {percent(share)} of simulated tables{where}"
        seen = f"the ratings turn over at {at} kPa ({others})"
    else:
        seen = f"the ratings show no clear turning point ({percent(share)} of simulated tables show one)"
    return seen + ("" if beyond is None or not np.isfinite(beyond["observed"]) else _fall(beyond))


def _fall(beyond: pd.Series) -> str:
    """Describe the fall of the ratings beyond the peak of the response, in units of the predicted one."""
    low, high, ratio = beyond["low"], beyond["high"], beyond["observed"]
    if max(abs(low), abs(high)) > LARGEST_RATIO:
        return "; the fall that is predicted beyond the peak is too small to compare with noise"
    way = "fall" if ratio >= 0 else "rise"
    return (
        f"; beyond the peak they {way} by {abs(ratio):.2g} times the predicted fall "
        f"(simulated tables: {low:.2g} to {high:.2g})"
    )


def _noticed(rows: dict[str, pd.Series]) -> str:
    """Describe the power of the check."""
    row, beyond = rows[TURNS_OVER], rows.get(FALL)
    if np.isnan(row.get("power", np.nan)):
        return "the power of this check is not known"
    if beyond is None or np.isnan(beyond["replicated"]):
        return "the model's response does not fall within the range of the fabrics"
    power = f"{100 * row['power']:.3g} ± {100 * row['power_mcse']:.1g}%"
    return f"a response that levels off would fail in {power} of simulated tables"
