"""Table and figure of coverage with uncertain inputs: ``python -m softness_bayes.tools.coverage_page [--results DIR]``.

The program reads the stored tables of `input_coverage` and `finger_coverage` and computes the share of 90 % intervals
that contain the true value, with its 95 % confidence limits. It prints the table in the form used in
`docs/calibration.md` and writes the figure next to the tables, as `coverage_with_uncertain_inputs.png`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv

from softness_bayes.readable import percent
from softness_bayes.tools.coverage import rows_of

FIGURE = "coverage_with_uncertain_inputs.png"

CONTROL, WRONG, DECLARED = range(3)
"""Roles of situations, which have colours of their own."""


class Situation(NamedTuple):
    """One case of a stored table."""

    meaning: str
    role: int


KEPT: Mapping[str, Mapping[str, Situation]] = {
    "input_errors/coverage.csv": {
        "true moduli": Situation("exact moduli and loads (control)", CONTROL),
        "taken as exact": Situation("moduli off by 15 %, taken as exact", WRONG),
        "omega freed": Situation("moduli off by 15 %, taken as exact, `omega` freed", WRONG),
        "errors declared": Situation("moduli off by 15 %, errors declared", DECLARED),
        "loads taken as exact": Situation("loads off by 5 %, taken as exact", WRONG),
        "load errors declared": Situation("loads off by 5 %, errors declared", DECLARED),
    },
    "finger_spreads/coverage.csv": {
        "typical fingers": Situation("one finger (control)", CONTROL),
        "taken as typical": Situation("raters' own b, taken as one finger", WRONG),
        "own fingers": Situation("raters' own b, `--individual b`", DECLARED),
    },
    "finger_spreads/b_m.csv": {
        "taken as typical": Situation("raters' own b and m, taken as one finger", WRONG),
        "own fingers": Situation("raters' own b and m, `--individual b,m`", DECLARED),
    },
    "finger_spreads/b_m_sigma_0.csv": {
        "taken as typical": Situation("raters' own b, m and sigma_0, taken as one finger", WRONG),
        "own fingers": Situation("raters' own b, m and sigma_0, `--individual b,m,sigma_0`", DECLARED),
    },
}
"""Meaning of each case of a stored table, by the file of the table."""

CHECKED: Mapping[str, str] = {"input_errors": "modulus_p", "finger_spreads": "finger_p"}
"""Column with the p-value of the check that should detect the problem, by the folder of the table."""

WALKED = ("input_errors", "finger_spreads")
"""Folders in which the fits of some laboratories in `coverage.csv`, by weighted draws, are repeated by MCMC in
`walks.csv`."""

LEVEL = 0.05
"""p-value below which a check reports a problem."""

INSIDE = 0.05, 0.95
"""Shares of the draws below the truth between which the truth lies in the 90 % interval."""

WANTED = 0.85, 0.95
"""Required coverage of 90 % intervals."""


class CoverageShare(NamedTuple):
    """Share of laboratories whose intervals contain the true value, and its confidence limits."""

    situation: str
    role: int
    quantity: str
    tables: int
    share: float
    noticed: float
    """Share of the laboratories in which the run's own check reported a problem."""
    low: float
    """Lower 95 % limit of the share (Clopper and Pearson)."""
    high: float


def counted(folder: Path) -> list[CoverageShare]:
    """Return the shares for all stored tables in a results folder, in the order of `KEPT`."""
    found = []
    for name, situations in KEPT.items():
        rows = rows_of(folder / name)
        checked = CHECKED[Path(name).parent.name]
        for case, situation in situations.items():
            own = [row for row in rows if row["case"] == case]
            for quantity in dict.fromkeys(row["quantity"] for row in own):
                of = [row for row in own if row["quantity"] == quantity]
                noticed = float(np.mean([float(row[checked]) < LEVEL for row in of]))
                found.append(_share(situation, quantity, [float(row["below"]) for row in of], noticed))
    return found


def agreement(folder: Path) -> str:
    """Return how many fits in a folder needed MCMC, and how far it differs from weighted draws in fits made by both."""
    fitted, ranked = rows_of(folder / "coverage.csv"), rows_of(folder / "walks.csv")
    walked, weighted = (
        {(row["lab"], row["case"], row["quantity"]): float(row["below"]) for row in rows} for rows in (ranked, fitted)
    )
    needed = {(row["lab"], row["case"]) for row in fitted if row["steps"] != "0"}
    every = len({(row["lab"], row["case"]) for row in fitted})
    both = np.array([(share, weighted[key]) for key, share in walked.items() if key in weighted])
    inside = (both >= INSIDE[0]) & (both <= INSIDE[1])
    fits = len({key[:2] for key in walked if key in weighted})
    difference = both[:, 1] - both[:, 0]
    return (
        f"This was so in {len(needed)} of {every} fits. {fits} of the fits were also made by MCMC: the shares of draws "
        f"below the true values differ by "
        f"{difference.mean():.3f} on average, with a standard deviation of {difference.std():.3f}, and "
        f"{(inside[:, 0] != inside[:, 1]).sum()} of {len(both)} intervals hold the truth in one of the two alone."
    )


def _share(situation: Situation, quantity: str, below: Sequence[float], noticed: float) -> CoverageShare:
    # a turning point that occurs in no draw counts as not covered
    hits, n = sum(INSIDE[0] <= share <= INSIDE[1] for share in below), len(below)
    low = float(betaincinv(hits, n - hits + 1, 0.025)) if hits else 0.0
    high = float(betaincinv(hits + 1, n - hits, 0.975)) if hits < n else 1.0
    return CoverageShare(situation.meaning, situation.role, quantity, n, hits / n, noticed, low, high)


def page_lines(found: Sequence[CoverageShare]) -> list[str]:
    """Return the table in Markdown: one row per situation, one column per quantity."""
    quantities = list(dict.fromkeys(share.quantity for share in found))
    lines = ["| situation | laboratories | noticed | " + " | ".join(quantities) + " |"]
    lines.append("|" + "---|" * (3 + len(quantities)))
    for situation in dict.fromkeys(share.situation for share in found):
        own = {share.quantity: share for share in found if share.situation == situation}
        cells = [_cell(own.get(quantity)) for quantity in quantities]
        first = max(own.values(), key=lambda share: share.tables)
        lines.append(f"| {situation} | {first.tables} | {percent(first.noticed)} | " + " | ".join(cells) + " |")
    return lines


def _cell(share: CoverageShare | None) -> str:
    return "" if share is None else f"{share.share:.2f} ({share.low:.2f}–{share.high:.2f})"


def draw(found: Sequence[CoverageShare], path: Path) -> None:
    """Plot all shares with their limits, one panel per quantity, to a PNG file."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    quantities = list(dict.fromkeys(share.quantity for share in found))
    situations = list(dict.fromkeys(share.situation for share in found))
    figure, panels = plt.subplots(
        1,
        len(quantities),
        figsize=(2.5 + 1.4 * len(quantities), 1.2 + 0.27 * len(situations)),
        dpi=110,
        sharey=True,
        layout="constrained",
    )
    for panel, quantity in zip(np.atleast_1d(panels), quantities, strict=True):
        panel.axvspan(*WANTED, color="0.9")
        panel.axvline(0.9, color="0.6", linewidth=0.8)
        for share in _of(found, quantity):
            place = situations.index(share.situation)
            reach = [[share.share - share.low], [share.high - share.share]]
            panel.errorbar(share.share, place, xerr=reach, fmt="o", markersize=4, color=f"C{share.role}")
        panel.set_title(quantity.replace("turning point at", "turn at"), fontsize=8)
        panel.set_xlim(0, 1)
        panel.set_xticks([0, 0.5, 0.9], ["0", "0.5", "0.9"], fontsize=8)
    panels = np.atleast_1d(panels)
    panels[0].set_yticks(range(len(situations)), [situation.replace("`", "") for situation in situations], fontsize=8)
    panels[0].invert_yaxis()
    figure.supxlabel("share of 90 % intervals that hold the truth, with its 95 % limits", fontsize=8)
    # omit the library's version, so that the same numbers give an identical file
    figure.savefig(path, metadata={"Software": None})
    plt.close(figure)


def _of(found: Iterable[CoverageShare], quantity: str) -> list[CoverageShare]:
    return [share for share in found if share.quantity == quantity]


def main() -> None:
    """Print the table and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--results", type=Path, default=Path("notebooks/results"), help="folder of the kept tables")
    folder: Path = parser.parse_args().results
    found = counted(folder)
    print("\n".join(page_lines(found)))
    for name in WALKED:
        print(agreement(folder / name))
    draw(found, folder / FIGURE)


if __name__ == "__main__":
    main()
