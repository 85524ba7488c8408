"""People's own answers in sentences: who is highest, which pairs are decided, and how much of it a chain keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.readable import chance, number, percent
from softness_bayes.likelihood.scales import Scale
from softness_bayes.people.ruler import Fit

CLEAR, DECIDED = 0.9, 0.95
"""Probabilities from which a fabric is the highest rated, and from which the order of a pair is decided."""

MOST_NAMED = 4
"""Largest number of fabrics that are named as possibly the highest."""


def highest_sentences(
    table: pd.DataFrame, word: str, scale: Scale, chain: Mapping[str, str] = MappingProxyType({})
) -> list[str]:
    """Return a sentence for each load on the fabric that people rated highest.

    Parameters
    ----------
    table
        Columns load, fabric, people, people_low, people_high and p_highest of `FreeMeans.table`.
    word
        `FreeMeans.word`.
    scale
        Scale of the ratings.
    chain
        The fabric that a chain predicts to be highest, by load, in place of people's lowest.
    """
    return [
        _highest(rows.sort_values("people", ascending=False), word, scale, chain.get(str(load), ""))
        for load, rows in table.groupby("load", sort=False)
    ]


def _highest(rows: pd.DataFrame, word: str, scale: Scale, chain: str) -> str:
    load = str(rows["load"].iloc[0])
    at, top = f" at {load}" if load else "", rows.iloc[0]
    if math.isnan(top["p_highest"]):
        return (
            f"{top['fabric']} has the highest mean{at}, {_value(top['people'], scale)}; the table does not show how "
            "uncertain the means are"
        )
    lowest = rows.iloc[-1]
    last = f"; the lowest mean is that of {lowest['fabric']}, {_interval(lowest, scale)}" if len(rows) > 1 else ""
    last = f"; chain: {chain}" if chain else last
    first = rows.sort_values("p_highest", ascending=False)
    best = first.iloc[0]
    if best["p_highest"] >= CLEAR or len(rows) == 1:
        sure = f" (probability {chance(best['p_highest'])})" if len(rows) > 1 else ""
        return f"{best['fabric']} is the {word}{at}{sure}, {_interval(best, scale)}{last}"
    count = min(int(np.searchsorted(first["p_highest"].cumsum(), CLEAR)) + 1, MOST_NAMED)
    named = [f"{row['fabric']} ({chance(row['p_highest'])})" for _, row in first.head(count).iterrows()]
    others = " or another one" if first["p_highest"].head(count).sum() < CLEAR else ""
    return f"the {word}{at} is {' or '.join(named)}{others}{last}"


def _interval(row: pd.Series, scale: Scale) -> str:
    ends = [_value(row[name], scale) for name in ("people", "people_low", "people_high")]
    return "{} ({} to {}){}".format(*ends, " of those it met are below it" if scale.answer else "")


def _value(value: float, scale: Scale) -> str:
    """Return a mean as text; of comparisons, the share of those met that it is placed above."""
    return percent(value) if scale.answer else number(value)


def pairs_sentence(loads: Sequence[str], p_orders: NDArray[np.float64]) -> str:
    """Return how many pairs of fabrics people tell apart under each load (`FreeMeans.p_orders`); empty without any."""
    told: list[str] = []
    for load, found in zip(loads, p_orders, strict=True):
        sure = found[np.triu_indices(len(found), 1)]
        sure = sure[~np.isnan(sure)]
        decided = int((np.maximum(sure, 1.0 - sure) >= DECIDED).sum())
        pairs = "" if told else " pairs of fabrics"
        told += [f"{decided} of {sure.size}{pairs}{f' at {load}' if load else ''}"] if sure.size else []
    return f"{', '.join(told)} are decided ({percent(DECIDED)} sure of the order)" if told else ""


def ruler_sentence(table: pd.DataFrame, scale: Scale) -> str:
    """Return a sentence on how much of people's differences a chain keeps, from the table of its ruler."""
    rows = table.to_dict("index")
    (share, low, high), misfit = (rows["share"][name] for name in ("value", "low", "high")), rows["misfit"]["value"]
    if math.isnan(share):
        return (
            "people's answers do not tell the fabrics apart: means of their own predict no better than one for all, so "
            "there is nothing that the chain could keep or lose"
        )
    units = f"{percent(misfit)} of the answers" if scale.answer else f"{number(misfit, 2)} units of the ratings"
    size = f"a factor of {number(math.exp(misfit))}" if scale.axis == "log" else units
    kept = "all of it"
    if low < 1.0:
        ends = (percent(min(max(end, 0.0), 1.0)) for end in (share, low, high))
        kept = "{} (90 % interval {} to {})".format(*ends)
    return (
        f"of what people's own means predict beyond 'all fabrics alike', the chain keeps {kept}; people's means "
        f"scatter about the chain's by {size} (sd)"
    )


def fit_faults(fit: Fit) -> list[str]:
    """Describe why a fit has failed, most important reason first; empty if it has not."""
    said = [fit.direction.direction_note] if fit.direction.against_data else []
    return [*said, "the chain certainly loses a part of what people agree on"] if fit.follows.rejected else said


def untestable_sentence(fit: Fit) -> str:
    """Describe why agreement with the ratings is no test of the model; empty if it is one."""
    if not fit.untestable:
        return ""
    return (
        f"the agreement with the ratings tests nothing: {fit.free_moduli} moduli are free to follow {fit.means} "
        "mean ratings; measure moduli, or rate under more loads"
    )


def silence_note(fit: Fit) -> str:
    """Describe the share of silence in the posterior and its meaning; empty for little silence or a wrong direction."""
    if not fit.mostly_silent or fit.direction.against_data:
        return ""
    return (
        f"no receptor fires in {percent(fit.silent_conditions)} of posterior draws and conditions; there the "
        "model predicts one rating for all fabrics, and only the prior and the absence of firing constrain skin "
        "and receptors. Check the units of moduli and loads, and whether the priors suit these fingers "
        "(--priors in-vivo)"
    )


def needed_sentences(fabrics: Sequence[str], loads_known: bool) -> list[str]:
    """Return lines on what has to be measured before skin and receptors can be fitted, with an example."""
    lines = ["to fit skin and receptors, this has to be known as well:"]
    if not loads_known:
        lines.append(
            "- how hard people pressed: a column force_n or indentation_mm of the ratings, as it was set or measured"
        )
    lines += [
        "- how stiff the fabrics are: a table of fabrics, given with --fabrics, with what was measured "
        "(bending_rigidity_n_m, or tensile_modulus_mpa and thickness_mm, or effective_modulus_kpa); where nothing was, "
        "brackets that contain the modulus for certain. Write your numbers in place of LOW and HIGH:",
        "    fabric,effective_modulus_low_kpa,effective_modulus_high_kpa",
        *(f"    {name},LOW,HIGH" for name in fabrics[:3]),
        *(["    ..."] if len(fabrics) > 3 else []),
    ]
    return lines
