"""Sheets: rows of cells, and tables of a header with rows of cells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

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
class Grid:
    """Rows of stripped cells, the first of which may be the header; blank rows are left out."""

    place: str
    """File, and sheet if there are several, for errors."""
    label: str
    """Name of the file, for notes."""
    digest: str
    """SHA-256 of the file's bytes."""
    records: Sequence[Sequence[str]]
    lines: Sequence[int]
    """Line of each row in the file; -1 for a header without one."""
    padded: Counter[tuple[int, str]] = field(default_factory=Counter)
    """Number of cells with spaces at their ends, by column and by text without the spaces."""
    between_commas: bool = False
    """True if commas separate the cells."""
    notes: tuple[str, ...] = ()


def grid_of(
    lines: Iterable[tuple[Sequence[str], int]],
    place: str,
    label: str,
    digest: str,
    *,
    between_commas: bool = False,
    notes: Sequence[str] = (),
) -> Grid:
    """Return the grid of some rows of cells with their lines.

    Raises
    ------
    InputError
        If the table is too large.
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
    return Grid(place, label, digest, records, rows, padded, between_commas, tuple(notes))


@dataclass(frozen=True)
class Sheet:
    """A header and rows of stripped cells."""

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
    """As of `Grid`."""
    between_commas: bool = False
    """True if commas separate the cells."""
    notes: tuple[str, ...] = ()
    columns: Sequence[str] = ()
    """Title of the column that each row is from, if the rows of the file held several values."""
    made: tuple[str, ...] = ()
    """Titles that such a file did not have; errors name those of `columns`."""


def headed(grid: Grid) -> Sheet:
    """Return the sheet whose header is the first row of a grid.

    Raises
    ------
    InputError
        If there is no row below the header, two columns have the same title, or a row is longer than the header.
    """
    place, rows = grid.place, grid.lines
    header, body = (grid.records[0] if grid.records else []), grid.records[1:]
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
    return Sheet(
        place,
        grid.label,
        grid.digest,
        header[:used],
        body,
        rows[1:],
        titled,
        grid.padded,
        grid.between_commas,
        grid.notes,
    )
