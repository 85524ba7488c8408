"""Sheets: rows of cells, of which the first is the header."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from softness_bayes.errors import InputError, quoted

MOST_COLUMNS = 2**14
"""Largest number of columns of a table, that of spreadsheet programs."""

MOST_CELLS = 2**24
"""Largest number of cells of a table, with the empty ones between others."""


class SheetNumber(str):
    """A number that the file holds as one, not as text: its decimal mark is a point.

    Attributes
    ----------
    shown
        The text that the program of the file shows for it, such as P01 or a label of a value.
    """

    shown: str

    def __new__(cls, value: object, shown: str = "") -> SheetNumber:
        """Make the text of a number."""
        made = super().__new__(cls, value)
        made.shown = shown or str(made)
        return made


def shown(cell: str) -> str:
    """Return the text of a cell as its program shows it."""
    return cell.shown if isinstance(cell, SheetNumber) else cell


@dataclass(frozen=True)
class Sheet:
    """Rows of stripped cells, of which the first is the header; blank rows are left out."""

    place: str
    """File, and sheet if there are several, for errors."""
    label: str
    """Name of the file, for notes."""
    digest: str
    """SHA-256 of the file's bytes."""
    records: Sequence[Sequence[str]]
    lines: Sequence[int]
    """Line of each row in the file; -1 for a header without one."""
    between_commas: bool = False
    """True if commas separate the cells."""
    notes: tuple[str, ...] = ()
    columns: Sequence[str] = ()
    """Title of the column that each row is from, if the rows of the file held several values."""
    made: tuple[str, ...] = ()
    """Titles that such a file did not have; errors name those of `columns`."""

    @property
    def header(self) -> Sequence[str]:
        """The titles."""
        return self.records[0]

    @property
    def body(self) -> Sequence[Sequence[str]]:
        """The rows below the header."""
        return self.records[1:]

    @property
    def titled(self) -> str:
        """Place of the header in words."""
        return f"{self.place}: header" if self.lines[0] < 0 else f"{self.place}: row {self.lines[0]}"

    def noted(self, *notes: str, **changes: Any) -> Sheet:
        """Return the sheet with further notes, and other changes."""
        return replace(self, notes=(*self.notes, *notes), **changes)

    def headed(self) -> Sheet:
        """Return the sheet with rows as long as the header.

        Raises
        ------
        InputError
            If there is no row below the header, two columns have the same title, or a row is longer than the header.
        """
        if len(self.records) < 2:
            raise InputError(f"{self.place}: there is no row below the header")
        header = self.header
        for title, count in Counter(title.casefold() for title in header if title).items():
            if count > 1:
                raise InputError(f"{self.titled}: {count} columns are called {quoted(title)}, expected one")
        used = max((j + 1 for j, title in enumerate(header) if title), default=0)
        for record, row in zip(self.body, self.lines[1:], strict=True):
            if beyond := [cell for cell in record[used:] if cell]:
                more = (
                    f"; is {quoted(header[0])} a title of the table? The header must be the first row"
                    if used == 1
                    else ""
                )
                raise InputError(
                    f"{self.place}: row {row}: {quoted(beyond[-1])} is beyond the {used} columns of the header{more}"
                )
        return replace(self, records=[[*record[:used], *[""] * (used - len(record))] for record in self.records])


def sheet_of(
    rows: Iterable[tuple[Sequence[str], int]],
    place: str,
    label: str,
    digest: str,
    *,
    between_commas: bool = False,
    notes: Sequence[str] = (),
) -> Sheet:
    """Return the sheet of some rows of cells with their lines.

    Raises
    ------
    InputError
        If the table is too large.
    """
    records: list[list[str]] = []
    lines: list[int] = []
    size = 0
    for record, line in rows:
        size += max(len(record), len(records[0]) if records else 0)
        if len(record) > MOST_COLUMNS or size > MOST_CELLS:
            what = f"{len(record)} columns, expected at most {MOST_COLUMNS}"
            if len(record) <= MOST_COLUMNS:
                what = f"more than {MOST_CELLS} cells, with the empty ones up to the last column"
            raise InputError(f"{place}: row {line}: {what}; is there a stray cell far from the table?")
        cells = [cell if isinstance(cell, SheetNumber) else cell.strip() for cell in record]
        if any(cells):
            records.append(cells)
            lines.append(line)
    return Sheet(place, label, digest, records, lines, between_commas, tuple(notes))
