"""Sheets: a header and rows of cells as they stand in a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from softness_bayes.data.second_headers import joined
from softness_bayes.errors import InputError, quoted

MOST_COLUMNS = 2**14
"""Largest number of columns of a table, that of spreadsheet programs."""

MOST_CELLS = 2**24
"""Largest number of cells of a table, with the empty ones between others."""


class SheetNumber(str):
    """A number that the file holds as one, not as text: its decimal mark is a point."""


@dataclass(frozen=True)
class Sheet:
    """A header and rows of stripped cells; blank rows are left out."""

    place: str
    """File, and sheet if there are several, for errors."""
    label: str
    """Name of the file, for notes."""
    digest: str
    """SHA-256 of the file's bytes."""
    header: Sequence[str]
    body: Sequence[Sequence[str]]
    """Cells of each row, as many as the header has."""
    rows: Sequence[int]
    """Line of each row in the file."""
    titled: str
    """Place of the header: `place` and its row."""
    padded: Counter[tuple[int, str]] = field(default_factory=Counter)
    """Number of cells with spaces at their ends, by column and by text without the spaces."""
    between_commas: bool = False
    """True if commas separate the cells."""
    notes: tuple[str, ...] = ()
    columns: Sequence[str] = ()
    """Title of the column that each row is from, if it was a wide table."""
    made: tuple[str, ...] = ()
    """Titles that a wide table did not have; errors name those of `columns`."""


def sheet_of(
    lines: Iterable[tuple[Sequence[str], int]],
    place: str,
    label: str,
    digest: str,
    *,
    between_commas: bool = False,
    notes: Sequence[str] = (),
) -> Sheet:
    """Return the sheet of some rows of cells.

    Parameters
    ----------
    lines
        Cells of each row, and its line; the first row that is not blank is the header, whose line is -1 if it has none.
    place, label, digest, between_commas, notes
        As of `Sheet`.

    Raises
    ------
    InputError
        If there is no row below the header, two columns have the same title, a row is longer than the header, or the
        table is too large.
    """
    records: list[list[str]] = []
    rows: list[int] = []
    padded: Counter[tuple[int, str]] = Counter()
    size = 0
    for record, line in lines:
        size += max(len(record), len(records[0]) if records else 0)
        if len(record) > MOST_COLUMNS or size > MOST_CELLS:
            what = f"{len(record)} columns, expected at most {MOST_COLUMNS}"
            if len(record) <= MOST_COLUMNS:
                what = f"more than {MOST_CELLS} cells, with the empty ones up to the last column"
            raise InputError(f"{place}: row {line}: {what}; is there a stray cell far from the table?")
        cells = [cell if isinstance(cell, SheetNumber) else cell.strip() for cell in record]
        padded.update((j, cell) for j, cell in enumerate(cells) if cell != record[j])
        if any(cells):
            records.append(cells)
            rows.append(line)
    header, body = records[0] if records else [], records[1:]
    if len(body) > 1 and (two := joined(header, body[0])):
        header, body, rows, notes = two.titles, body[1:], [rows[0], *rows[2:]], [*notes, two.note]
    if not body:
        raise InputError(f"{place}: there is no row below the header")
    titled = f"{place}: header" if rows[0] < 0 else f"{place}: row {rows[0]}"
    for title, count in Counter(title.casefold() for title in header if title).items():
        if count > 1:
            raise InputError(f"{titled}: {count} columns are called {quoted(title)}, expected one")
    used = max((j + 1 for j, title in enumerate(header) if title), default=0)
    for record, row in zip(body, rows[1:], strict=True):
        beyond = [cell for cell in record[used:] if cell]
        if beyond:
            title = (
                f"; is {quoted(header[0])} a title of the table? The header must be the first row" if used == 1 else ""
            )
            raise InputError(
                f"{place}: row {row}: {quoted(beyond[-1])} is beyond the {used} columns of the header{title}"
            )
    body = [[*record[:used], *[""] * (used - len(record))] for record in body]
    return Sheet(place, label, digest, header[:used], body, rows[1:], titled, padded, between_commas, tuple(notes))
