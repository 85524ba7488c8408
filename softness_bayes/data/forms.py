"""Forms of tables of ratings: pairs of fabrics, means of several raters, covariates of participants."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from softness_bayes.data.columns import (
    GEOMETRIC_MEAN,
    GEOMETRIC_SD,
    MEAN,
    MISSING,
    NAMES,
    OF_CELLS,
    RATERS,
    RATING,
    SD,
    SE,
    SECOND_FABRIC,
)
from softness_bayes.data.faults import listing
from softness_bayes.data.headers import holds_cells
from softness_bayes.data.sheets import SheetNumber
from softness_bayes.data.tables import FloatArray, IntArray, Table, unused_note
from softness_bayes.errors import quoted
from softness_bayes.files.spreadsheet import unescaped
from softness_bayes.readable import counted

_OTHER = {"0": "1", "1": "0", "0.5": "0.5", "1.0": "0", "0.0": "1", "": ""}
"""Answer for the second fabric of a pair, by the answer for the first."""


def unpaired(table: Table) -> Table:
    """Return a table of pairs with two rows per pair, which form a list; other tables are returned unchanged."""
    if SECOND_FABRIC not in table:
        return table
    from scipy.special import betaincinv

    if "list" in table:
        table.faults.add_general(
            f"columns {table.titles[SECOND_FABRIC]!r} and {table.titles['list']!r}: each row is already a "
            "pair, so a list has no meaning; remove one of these columns"
        )
    answers = ["" if text.casefold() in MISSING else text.replace(",", ".") for text in table.cells[RATING.name]]
    for i, text in enumerate(answers):
        if text not in _OTHER:
            expected = "expected 1 if the first fabric of the pair was softer, 0 if the second was, or 0.5 if neither"
            table.fault(i, RATING.name, expected)
    table.labels(SECOND_FABRIC)
    same = [one == other for one, other in zip(table.cells["fabric"], table.cells[SECOND_FABRIC], strict=True)]
    if all(same):
        table.faults.add_general("every pair is of one fabric with itself, expected two different fabrics")
    table.check()
    notes = [f"rows are pairs: 1 means that {table.titles['fabric']} was softer than {table.titles[SECOND_FABRIC]}"]
    told = [float(text) for text, alike in zip(answers, same, strict=True) if alike and text]
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
    kept = np.flatnonzero(~np.array(same))
    both = table.take(np.repeat(kept, 2))
    rows = [
        row
        for i in kept.tolist()
        for row in ((table.cells["fabric"][i], answers[i]), (table.cells[SECOND_FABRIC][i], _OTHER[answers[i]]))
    ]
    cells = {name: texts for name, texts in both.cells.items() if name != SECOND_FABRIC}
    cells |= {"fabric": [name for name, _ in rows], RATING.name: [answer for _, answer in rows]}
    cells["list"] = [str(1 + k // 2) for k in range(len(rows))]
    return both.noted(*notes, cells=cells, titles={**both.titles, "list": table.titles[SECOND_FABRIC]})


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
    if not holds_cells(table.cells):
        return table, None
    table.require(RATERS.name)
    raters = table.numbers(RATERS)
    for i in np.flatnonzero(np.isnan(raters) | (raters != np.round(raters))).tolist():
        if not table.is_faulty(i, RATERS.name):
            table.fault(i, RATERS.name, "expected a whole number")
    known = np.append(raters[~np.isnan(raters)], [] if np.isfinite(raters).any() else 2.0)
    n = int(known.max())
    if known.min() < n:
        table.faults.add_general(
            f"column {table.titles[RATERS.name]!r}: cells of {known.min():g} to {n} raters; expected the same "
            "raters in every cell, because raters' scales differ and the table does not show who is missing"
        )
    notes = []
    if GEOMETRIC_MEAN.name in table:
        name, filed = GEOMETRIC_MEAN.name, table.cells[GEOMETRIC_MEAN.name]
        table.numbers(GEOMETRIC_MEAN)  # text that is not a number above 0 is a fault
        geometric_sd = table.numbers(GEOMETRIC_SD)
        if unused := [table.titles[column.name] for column in (MEAN, SD, SE) if column.name in table]:
            notes.append(f"columns of arithmetic means, not used because there are geometric ones: {', '.join(unused)}")
    else:
        name = MEAN.name
        log_mean, log_sd = _converted(table, n)
        geometric_sd = np.exp(log_sd)
        filed = ["" if np.isnan(value) else SheetNumber(f"{np.exp(value):.15g}") for value in log_mean]
        note = "arithmetic means and standard deviations are converted as if ratings were log-normal, an approximation"
        if SE.name in table and SD.name not in table:
            note = f"column {table.titles[SE.name]!r}: a standard deviation is the standard error times √{n}; {note}"
        notes.append(note)
    told = "with" if np.isfinite(geometric_sd).any() else "without"
    notes = [f"rows are geometric means of {n} raters, {told} the standard deviations of their log ratings", *notes]
    cells = {key: texts for key, texts in table.cells.items() if key not in OF_CELLS}
    titles = {**table.titles, RATING.name: table.titles[name]}
    return table.noted(*notes, cells=cells | {RATING.name: list(filed)}, titles=titles), AggregatedCells(
        n, geometric_sd
    )


def _converted(table: Table, raters: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the log ratings of each cell from arithmetic ones, NaN for faults."""
    mean = table.numbers(MEAN)
    spread = next((column for column in (SD, SE) if column.name in table), None)
    if spread is None:
        table.faults.add_general(
            f"column {table.titles[MEAN.name]!r}: an arithmetic mean alone does not determine the geometric "
            f"one; expected a column {SD.name} or {SE.name} too, or {GEOMETRIC_MEAN.name}"
        )
        return np.log(mean), np.full(len(table), np.nan)
    sd = table.numbers(spread) * (np.sqrt(raters) if spread is SE else 1.0)
    ratio = sd / mean
    for i in np.flatnonzero(~np.isnan(mean) & np.isnan(sd)).tolist():
        if not table.is_faulty(i, spread.name):
            table.fault(i, spread.name, f"expected a {spread.label.partition(' of')[0]} with the mean")
    if np.isfinite(ratio).any() and (scattered := float(np.nanmedian(ratio))) > MOST_SCATTERED:
        table.faults.add_general(
            f"column {table.titles[spread.name]!r}: standard deviations are {scattered:.2g} times the means "
            f"(median); beyond {MOST_SCATTERED:g}, a few large ratings dominate an arithmetic mean, and the "
            f"geometric mean cannot be derived from it; expected columns {GEOMETRIC_MEAN.name} and "
            f"{GEOMETRIC_SD.name}"
        )
    variance = np.log1p(ratio**2)
    return np.log(mean) - 0.5 * variance, np.sqrt(variance)


OWN_COLUMNS = frozenset(
    {*NAMES, "finger", "ratings", "effect", "effect_low", "effect_high", "quantity", "median", "low", "high"}
    | {"ratio"}
)
"""Names of columns next to covariates in the tables of a run, and names of columns in tables of ratings."""


def covariates_in(table: Table, participants: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Return the covariates of a table by name, each with one text per participant, and the notes of the table.

    A column is a covariate if no participant has two different texts in it (ignoring empty cells and codes for missing
    numbers) and some participant has several rows; with one row each, any column would be constant. Texts are as
    written, and empty if all cells are. Notes list the columns that are covariates, and those that were renamed.

    Parameters
    ----------
    table
        All rows of the table, including those without a rating.
    participants
        Names of the participants to keep.
    """
    notes = list(table.notes)
    by = table.cells.get("participant", ())
    if not table.others or len(set(by)) == len(by):
        return {}, notes
    found, varying = {}, []
    for title, texts in table.others.items():
        told: dict[str, dict[str, None]] = {name: {} for name in by}
        for name, text in zip(by, texts, strict=True):
            told[name].setdefault(text)
        known = {name: [text for text in own if text.casefold() not in MISSING] for name, own in told.items()}
        several = [name for name, own in known.items() if len(own) > 1]
        if several and 2 * len(several) < len(known):
            varying.append(f"column {quoted(title)} is not a covariate: it varies within {quoted(several[0])}")
        elif not several and any(known.values()):
            found[title] = tuple((known[name] or [*told[name]])[0] for name in participants)
    # what is a covariate is not unused
    unused = unused_note([title for title in table.others if title not in found])
    notes = [note for note in notes if note not in unused_note([*table.others])] + unused
    if found:
        notes.append(f"copied to the results as covariates of participants (no model uses them): {listing([*found])}")
    others = {title.casefold() for title in table.others}
    names = {title: _kept_name(title, others) for title in found}
    notes += [
        f"covariate {quoted(title)} is renamed {quoted(name)}, because tables of the run have a column of that name"
        for title, name in names.items()
        if name != unescaped(title)
    ]
    return {names[title]: texts for title, texts in found.items()}, notes + varying


def _kept_name(title: str, others: Collection[str]) -> str:
    """Return the name under which a covariate is stored, changed only if a table of a run has a column of that name."""
    own = name = unescaped(title)
    while name.casefold() in OWN_COLUMNS or (name != own and name.casefold() in others):
        name += " (covariate)"
    return name
