"""Tables of cell means over n raters who each rated every fabric under every load, as published in papers."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data.columns import GEOMETRIC_MEAN, GEOMETRIC_SD, MEAN, OF_CELLS, RATERS, RATING, SD, SE
from softness_bayes.data.headers import holds_cells
from softness_bayes.data.sheets import SheetNumber
from softness_bayes.data.tables import Table
from softness_bayes.errors import quoted

FloatArray = NDArray[np.float64]

PANEL = "raters"
"""Name of the panel in a table without a column of participants."""

MOST_SCATTERED = 1.0
"""Largest median ratio of standard deviation to mean for which arithmetic means are converted."""

SIMULATED_CELLS = 4000
"""Number of simulated cells from which the error of a conversion is measured."""


class AggregatedCells(NamedTuple):
    """Numbers of raters and standard deviations of cells whose geometric means are the ratings."""

    raters: int
    """Number of raters of each cell."""
    geometric_sd: FloatArray | None
    """Geometric standard deviation of the raters' ratings, (n,), NaN for cells without one; None if no cell has one."""

    def take(self, rows: NDArray[np.intp]) -> AggregatedCells:
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
    raters, n = table.numbers(RATERS), 2
    for i in np.flatnonzero(np.isnan(raters) | (raters != np.round(raters))).tolist():
        if not table.is_faulty(i, RATERS.name):
            table.fault(i, RATERS.name, f"expected a whole number, got {quoted(table.cells[RATERS.name][i])}")
    known = raters[~np.isnan(raters)]
    if known.size:
        n = int(known.max())
    if known.size and known.min() < known.max():
        table.faults.add_general(
            f"column {table.titles[RATERS.name]!r}: cells of {known.min():g} to {n} raters; expected the same "
            "raters in every cell, because raters' scales differ and the table does not show who is missing"
        )
    if GEOMETRIC_MEAN.name in table:
        name, note = GEOMETRIC_MEAN.name, ""
        filed = table.cells[name]
        table.numbers(GEOMETRIC_MEAN)  # text that is not a number above 0 is a fault
        geometric_sd = table.numbers(GEOMETRIC_SD)
    else:
        name = MEAN.name
        log_mean, log_sd = _converted(table, n)
        geometric_sd = np.exp(log_sd)
        filed = ["" if np.isnan(value) else SheetNumber(f"{np.exp(value):.15g}") for value in log_mean]
        note = "" if table.faults else conversion_note(n, float(np.nanmedian(log_sd)))
        if note and SD.name not in table:
            note = f"column {table.titles[SE.name]!r}: a standard deviation is the standard error times √{n}; {note}"
    told = "with" if np.isfinite(geometric_sd).any() else "without"
    notes = [f"rows are geometric means of {n} raters, {told} the standard deviations of their log ratings"]
    notes += [note] if note else []
    if name == GEOMETRIC_MEAN.name and (unused := [table.titles[x.name] for x in (MEAN, SD, SE) if x.name in table]):
        notes.append(f"columns of arithmetic means, not used because there are geometric ones: {', '.join(unused)}")
    cells = {key: texts for key, texts in table.cells.items() if key not in OF_CELLS}
    made = replace(
        table,
        cells=cells | {RATING.name: list(filed)},
        titles={**table.titles, RATING.name: table.titles[name]},
        notes=(*table.notes, *notes),
    )
    return made, AggregatedCells(n, geometric_sd)


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
            table.fault(i, spread.name, f"expected a {spread.label.partition(' of')[0]} with the mean, got ''")
    if np.isfinite(ratio).any() and (scattered := float(np.nanmedian(ratio))) > MOST_SCATTERED:
        table.faults.add_general(
            f"column {table.titles[spread.name]!r}: standard deviations are {scattered:.2g} times the means "
            f"(median); beyond {MOST_SCATTERED:g}, a few large ratings dominate an arithmetic mean, and the "
            f"geometric mean cannot be derived from it; expected columns {GEOMETRIC_MEAN.name} and "
            f"{GEOMETRIC_SD.name}"
        )
    variance = np.log1p(ratio**2)
    return np.log(mean) - 0.5 * variance, np.sqrt(variance)


class ConversionError(NamedTuple):
    """Errors of the converted values of a cell, measured on simulated raters."""

    mean: float
    """Relative error of the geometric mean (root mean square)."""
    of_standard_error: float
    """Relative error of its standard error."""
    spread: float
    """Relative error of the standard deviation of log ratings (root mean square)."""
    bias: float
    """Relative bias of the standard deviation of log ratings."""


def conversion_error(raters: int, log_sd: float) -> ConversionError:
    """Return the error of converted means and standard deviations for log-normal raters of given number and scatter."""
    log = log_sd * np.random.default_rng(0).standard_normal((SIMULATED_CELLS, min(raters, 1000)))
    rating = np.exp(log)
    mean, spread = rating.mean(axis=1), log.std(axis=1, ddof=1)
    variance = np.log1p((rating.std(axis=1, ddof=1) / mean) ** 2)
    off = np.log(mean) - 0.5 * variance - log.mean(axis=1)
    ratio = np.sqrt(variance) / spread - 1.0
    size = float(np.sqrt((off**2).mean()))
    return ConversionError(
        size, size * np.sqrt(log.shape[1]) / log_sd, float(np.sqrt((ratio**2).mean())), float(ratio.mean())
    )


def conversion_note(raters: int, log_sd: float) -> str:
    """Return the note that a conversion is an approximation, with its measured error."""
    found = conversion_error(raters, log_sd)
    return (
        "arithmetic means and standard deviations are converted as if ratings were log-normal, an approximation: for "
        f"{raters} simulated raters as scattered as these a converted mean is off by {100 * found.mean:.1f} % (rms, "
        f"{found.of_standard_error:.2f} of its standard error), a converted standard deviation of log ratings by "
        f"{100 * found.spread:.0f} %, with a bias of {100 * found.bias:+.0f} %"
    )
