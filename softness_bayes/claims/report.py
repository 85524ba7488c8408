"""Tables of the verdicts on the claims: as data, plain text and Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from softness_bayes.claims import CLAIMS, ClaimFinding, ClaimVerdict, Trial
from softness_bayes.touch.contact import Force, Indentation

COLUMNS = {
    "largest": ("largest_total_rate_hz", 1.0),
    "modulus": ("e_fab_kpa", 1e-3),
    "ratio": ("e_fab_per_e_skin", 1.0),
    "force": ("peak_force_n", 1.0),
    "radius": ("contact_radius_per_finger_radius", 1.0),
    "drop": ("drop", 1.0),
    "levelling": ("change_over_last_decade", 1.0),
    "growth": ("growth_distal_to_proximal", 1.0),
    "setback": ("largest_fall_on_the_way", 1.0),
    "best_centre": ("best_centre_mm", 1e3),
    "depth_spread": ("depth_spread", 1.0),
    "correlation": ("correlation_with_e_fab", 1.0),
    "slope": ("rating_slope", 1.0),
    "slope_needed": ("rating_slope_needed", 1.0),
}
"""Field of `Numbers` -> its column in the table of loads, and units of the column in one of the field."""


def claims_table(trials: Sequence[Trial]) -> pd.DataFrame:
    """Return one row per readings, priors, kind of load and claim.

    Columns: readings, priors, control, claim, verdict (at the priors' medians), numbers (behind the verdict, for each
    load), p_holds, p_fails, p_silent (over draws of the prior; empty without draws), statement, criterion.
    """
    return pd.DataFrame(
        {
            **_keys(trial),
            "claim": finding.claim.name,
            "verdict": finding.verdict.value,
            "numbers": finding.numbers,
            **{
                f"p_{kind.value}": finding.shares.get(kind, np.nan)
                for kind in (ClaimVerdict.HOLDS, ClaimVerdict.FAILS, ClaimVerdict.SILENT)
            },
            "statement": finding.claim.statement,
            "criterion": finding.claim.criterion,
        }
        for trial in trials
        for finding in trial.findings
    )


def loads_table(trials: Sequence[Trial]) -> pd.DataFrame:
    """Return the numbers at the priors' medians, one row per readings, priors, kind of load and load.

    Cells are empty where no receptor fires. Where `interior` is false, the columns of the maximum are those of the
    grid's end.
    """
    rows: list[dict[str, Any]] = []
    for trial in trials:
        for k, load in enumerate(trial.loads):
            held = {
                "indentation_mm": load.depth * 1e3 if isinstance(load, Indentation) else np.nan,
                "force_n": load.newton if isinstance(load, Force) else np.nan,
            }
            numbers = {
                column: getattr(trial.median, field)[0, k] * factor for field, (column, factor) in COLUMNS.items()
            }
            rows.append({**_keys(trial), **held, "interior": bool(trial.median.interior[0, k]), **numbers})
    return pd.DataFrame(rows)


def markdown(trials: Sequence[Trial]) -> str:
    """Return one Markdown table per prior set: rows are claims and kinds of load, columns are readings."""
    parts = [_explanation(trials), "", *(f"- *{c.name}*: {c.statement}. Criterion: {c.criterion}." for c in CLAIMS)]
    readings = list(dict.fromkeys(trial.readings for trial in trials))
    for prior_set in dict.fromkeys(trial.prior_set for trial in trials):
        some = [trial for trial in trials if trial.prior_set == prior_set]
        parts += ["", f"Priors `{prior_set}`:", "", f"| claim | held | {' | '.join(readings)} |"]
        parts.append("|---" * (2 + len(readings)) + "|")
        for k, claim in enumerate(CLAIMS):
            for control in dict.fromkeys(trial.control for trial in some):
                cells = [_cell(trial.findings[k], "**") for trial in some if trial.control == control]
                parts.append(f"| {claim.name} | {control} | {' | '.join(cells)} |")
    return "\n".join(parts) + "\n"


def plain(trials: Sequence[Trial]) -> str:
    """Return aligned text: for each claim, one line per kind of load, prior set and readings."""
    names = [" ".join((trial.readings, trial.prior_set, trial.control)) for trial in trials]
    width = max(map(len, names))
    parts = [_explanation(trials)]
    for k, claim in enumerate(CLAIMS):
        parts += ["", f"{claim.name}: {claim.statement}", f"  holds if: {claim.criterion}"]
        parts += [f"  {name:{width}}  {_cell(trial.findings[k])}" for name, trial in zip(names, trials, strict=True)]
    return "\n".join(parts)


def _keys(trial: Trial) -> dict[str, str]:
    return {"readings": trial.readings, "priors": trial.prior_set, "control": trial.control}


def _cell(finding: ClaimFinding, strong: str = "") -> str:
    """Return verdict, probability that the claim holds, and the numbers behind the verdict."""
    text, share = f"{strong}{finding.verdict.value}{strong}", finding.shares.get(ClaimVerdict.HOLDS, 0.0)
    if finding.shares and (finding.verdict in (ClaimVerdict.HOLDS, ClaimVerdict.FAILS) or share > 0):
        text += f" ({100 * share:.0f} %)"
    return f"{text} {finding.numbers}".rstrip()


def _explanation(trials: Sequence[Trial]) -> str:
    """Explain the numbers, and name the loads."""
    loads = {trial.control: ", ".join(map(str, trial.loads)) for trial in trials}
    held = "; ".join(f"{control} {texts}" for control, texts in loads.items())
    drawn = next((len(trial.draws.largest) for trial in trials if trial.draws is not None), 0)
    share = f", in brackets the share of {drawn} draws of the prior for which the claim holds" if drawn else ""
    return (
        f"Verdicts at the priors' medians{share}; then the numbers behind them in the order of the "
        f"loads ({held}): – where no receptor fires or there is no turning point (maximum), † where the "
        "contact radius at the maximum exceeds R/2 and Hertz's geometry is questionable."
    )
