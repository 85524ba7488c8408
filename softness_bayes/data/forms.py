"""Forms of tables of ratings: pairs of fabrics, means of several raters, covariates of participants."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from softness_bayes.base.files.spreadsheet import unescaped
from softness_bayes.base.readable import counted
from softness_bayes.data.columns import GEOMETRIC_MEAN, GEOMETRIC_SD, NAMES, NUMBERS, OF_CELLS, holds_cells
from softness_bayes.data.tables import FloatArray, IntArray, Table, grouped, unused_note
from softness_bayes.data.texts import SheetNumber, is_missing, listing

_OTHER = {"0": "1", "1": "0", "0.5": "0.5", "1.0": "0", "0.0": "1", "": ""}
"""Answer for the second fabric of a pair, by the answer for the first."""


def unpaired(table: Table) -> Table:
    """Return a table of pairs with two rows per pair, which form a list; other tables are returned unchanged."""
    if "fabric_2" not in table:
        return table
    from scipy.special import betaincinv

    first, second = (table.titles[name] for name in ("fabric", "fabric_2"))
    answers = ["" if is_missing(text) else text.replace(",", ".") for text in table.texts("rating")]
    for i in (i for i, text in enumerate(answers) if text not in _OTHER):
        expected = "expected 1 if the first fabric of the pair was softer, 0 if the second was, or 0.5 if neither"
        table.fault(i, "rating", expected)
    pairs = [*zip(table.texts("fabric"), table.labels("fabric_2"), strict=True)]
    same = np.array([one == other for one, other in pairs])
    if "list" in table:
        table.refuse("each row is already a pair, so a list has no meaning")
    if same.all():
        table.refuse("every pair is of one fabric with itself, expected two different fabrics")
    table.check()
    notes = [f"rows are pairs: 1 means that {first} was softer than {second}"]
    told = [float(answers[i]) for i in np.flatnonzero(same) if answers[i]]
    if told:
        called = len(told) - told.count(0.5)
        rates = []
        for count, total in ((called, len(told)), (told.count(1.0), called)):
            low, high = 100 * betaincinv(count + 0.5, total - count + 0.5, (0.05, 0.95))  # Jeffreys' interval
            rates.append(f"{count} of {total} (90 % interval {low:.0f} to {high:.0f} %)")
        notes.append(
            f"{counted(len(told), 'catch trial')} (a fabric with itself), which the model does not use: one was called "
            f"softer in {rates[0]}, the rate of false alarms; the first one in {rates[1]}, beyond 50 % a bias to it"
        )
    kept = np.flatnonzero(~same).tolist()
    rows = table.take(np.repeat(kept, 2))
    rows = rows.with_texts("fabric", [name for i in kept for name in pairs[i]])
    rows = rows.with_texts("rating", [text for i in kept for text in (answers[i], _OTHER[answers[i]])])
    return rows.with_texts("fabric_2", [str(1 + k) for k in range(len(kept)) for _ in (0, 1)], *notes).called(
        {"fabric_2": "list"}
    )


PANEL = "raters"
"""Name of the panel in a table without a column of participants."""

MOST_SCATTERED = 1.0
"""Largest median ratio of standard deviation to mean for which arithmetic means are converted."""


class AggregatedCells(NamedTuple):
    """Numbers of raters and standard deviations of cells whose geometric means are the ratings."""

    raters: int
    """Number of raters of each cell."""
    geometric_sd: FloatArray | None
    """Geometric standard deviation of the raters' ratings, (n,), NaN for cells without one; None if no cell has one."""

    def take(self, rows: IntArray) -> AggregatedCells:
        """Return a selection of the cells."""
        kept = None if self.geometric_sd is None else self.geometric_sd[rows]
        return self._replace(geometric_sd=None if kept is None or np.isnan(kept).all() else kept)


def cells_of(table: Table) -> tuple[Table, AggregatedCells | None]:
    """Return a table of cells with geometric means as ratings, and its `AggregatedCells`; other tables as they are.

    Arithmetic means are converted as if a cell's ratings were log-normal. Errors are recorded as faults of the table.
    """
    if not holds_cells(table.titles):
        return table, None
    table.require("n")
    raters = table.numbers("n")
    for i in np.flatnonzero(np.isnan(raters) | (raters != np.round(raters))).tolist():
        if not table.is_faulty(i, "n"):
            table.fault(i, "n", "expected a whole number")
    known = np.append(raters[~np.isnan(raters)], [] if np.isfinite(raters).any() else 2.0)
    n = int(known.max())
    if known.min() < n:
        table.refuse(
            f"column {table.titles['n']!r}: cells of {known.min():g} to {n} raters; expected the same "
            "raters in every cell, because raters' scales differ and the table does not show who is missing"
        )
    notes = []
    if "geometric_mean" in table:
        name = "geometric_mean"
        table.numbers(name)  # text that is not a number above 0 is a fault
        geometric_sd = table.numbers("geometric_sd")
        if unused := [table.titles[name] for name in ("mean", "sd", "se") if name in table]:
            notes.append(f"columns of arithmetic means, not used because there are geometric ones: {', '.join(unused)}")
    else:
        name = "mean"
        log_mean, log_sd = _converted(table, n)
        geometric_sd = np.exp(log_sd)
        means = ["" if np.isnan(value) else SheetNumber(f"{np.exp(value):.15g}") for value in log_mean]
        table = table.with_texts(name, means)
        note = "arithmetic means and standard deviations are converted as if ratings were log-normal, an approximation"
        if "se" in table and "sd" not in table:
            note = f"column {table.titles['se']!r}: a standard deviation is the standard error times √{n}; {note}"
        notes.append(note)
    told = "with" if np.isfinite(geometric_sd).any() else "without"
    notes = [f"rows are geometric means of {n} raters, {told} the standard deviations of their log ratings", *notes]
    table = table.noted(*notes).called({**dict.fromkeys(OF_CELLS, ""), name: "rating"})
    return table, AggregatedCells(n, geometric_sd)


def _converted(table: Table, raters: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the log ratings of each cell from arithmetic ones, NaN for faults."""
    mean, mean_title = table.numbers("mean"), table.titles["mean"]
    name = next((name for name in ("sd", "se") if name in table), None)
    if name is None:
        table.refuse(
            f"column {mean_title!r}: an arithmetic mean alone does not determine the geometric one; expected a column "
            f"sd or se too, or {GEOMETRIC_MEAN.name}"
        )
        return np.log(mean), np.full(len(table), np.nan)
    sd = table.numbers(name) * (np.sqrt(raters) if name == "se" else 1.0)
    for i in np.flatnonzero(~np.isnan(mean) & np.isnan(sd)).tolist():
        if not table.is_faulty(i, name):
            table.fault(i, name, f"expected a {NUMBERS[name].label.partition(' of')[0]} with the mean")
    ratio = sd / mean
    if np.isfinite(ratio).any() and (scattered := float(np.nanmedian(ratio))) > MOST_SCATTERED:
        table.refuse(
            f"column {table.titles[name]!r}: standard deviations are {scattered:.2g} times the means "
            f"(median); beyond {MOST_SCATTERED:g}, a few large ratings dominate an arithmetic mean, and the "
            f"geometric mean cannot be derived from it; expected columns {GEOMETRIC_MEAN.name} and "
            f"{GEOMETRIC_SD.name}"
        )
    variance = np.log1p(ratio**2)
    return np.log(mean) - 0.5 * variance, np.sqrt(variance)


OWN_COLUMNS = {*NAMES, "finger", "ratings", "effect", "effect_low", "effect_high", "quantity", "median", "low", "high"}
OWN_COLUMNS |= {"ratio"}
"""Names of columns next to covariates in the tables of a run, and names of columns in tables of ratings."""


def covariates_in(table: Table, participants: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Return the covariates of a table by name, each with one text per participant, and the notes of the table.

    A column is a covariate if no participant has two different texts in it (ignoring empty cells and codes for missing
    numbers) and some participant has several rows; with one row each, any column would be constant. Texts are as
    written, and empty if all cells are.

    Parameters
    ----------
    table
        All rows of the table, including those without a rating.
    participants
        Names of the participants to keep.
    """
    others, by = table.others, table.texts("participant")
    if not others or "participant" not in table or len(set(by)) == len(by):
        return {}, [*table.notes]
    rows, found = grouped(by), dict[str, tuple[str, ...]]()
    for title, texts in others.items():
        told = {name: [*dict.fromkeys(texts[i] for i in own)] for name, own in rows.items()}
        known = {name: [text for text in own if not is_missing(text)] for name, own in told.items()}
        if any(known.values()) and all(len(own) < 2 for own in known.values()):
            found[title] = tuple((known[name] or told[name])[0] for name in participants)
    # what is a covariate is not unused
    unused = unused_note([title for title in others if title not in found])
    notes = [note for note in table.notes if note not in unused_note([*others])] + unused
    if found:
        notes.append(f"copied to the results as covariates of participants (no model uses them): {listing([*found])}")
    taken = {title.casefold() for title in others}
    return {_kept_name(title, taken): texts for title, texts in found.items()}, notes


def _kept_name(title: str, others: Collection[str]) -> str:
    """Return the name under which a covariate is stored, changed only if a table of a run has a column of that name."""
    own = name = unescaped(title)
    while name.casefold() in OWN_COLUMNS or (name != own and name.casefold() in others):
        name += " (covariate)"
    return name
