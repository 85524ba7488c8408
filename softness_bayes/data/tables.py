"""CSV files as named columns of text: encodings, separators, decimal marks, and errors that name the place."""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.data.columns import LABELS, NUMBERS, Column
from softness_bayes.data.decimals import MARKS, Cell, Reading, decimal_mark, plain
from softness_bayes.data.headers import Sought, understood
from softness_bayes.data.names import guess, listing, natural
from softness_bayes.data.units import Unit
from softness_bayes.errors import InputError, quoted
from softness_bayes.files.spreadsheet import unescaped

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""Texts for a missing number, in any case. Only an empty name is missing: NA may be initials."""

_CONTROL = re.compile("[\x00-\x08\x0e-\x1f]")
_JAPANESE = re.compile("[\u3041-\u30fe\u4e00-\u9fff]{2}")
_END = "\x1f"  # end mark behind the last row, a character that occurs in no table


@dataclass(frozen=True)
class Table:
    """The known columns of a file, as stripped text under their standard names."""

    path: Path
    digest: str
    """SHA-256 of the file's bytes."""
    cells: Mapping[str, Sequence[str]]
    titles: Mapping[str, str]
    """Standard name of a column -> its name in the file's header."""
    units: Mapping[str, Unit]
    """Standard name of a column -> its unit, where that is not the one in the standard name."""
    rows: IntArray
    """Line of each row in the file; the header is line 1."""
    decimal: str
    grouped: bool
    """Whether the other mark may group thousands: the user named the decimal mark, or a number shows it."""
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def error(self, i: int, name: str, problem: str) -> InputError:
        """Return the error that names file, row and column of a cell."""
        return InputError(f"{self.path}: row {self.rows[i]}, column {self.titles[name]!r}: {problem}")

    def take(self, index: IntArray) -> Table:
        """Return the rows at `index`."""
        cells = {name: [texts[i] for i in index] for name, texts in self.cells.items()}
        return replace(self, cells=cells, rows=self.rows[index])

    def require(self, name: str) -> None:
        """Raise an error for a table without the column `name`."""
        if name not in self:
            raise InputError(
                f"{self.path}: no column {name!r}, and no --column {name}=... says which it is; "
                + "; ".join([f"known columns: {', '.join(self.titles) or 'none'}", *self.notes])
            )

    def labels(self, name: str) -> Sequence[str]:
        """Return a column of names; an empty one is an error."""
        self.require(name)
        for i, text in enumerate(self.cells[name]):
            if not text:
                raise self.error(i, name, "expected a name, got ''")
        return self.cells[name]

    def numbers(self, column: Column) -> FloatArray:
        """Return a column of numbers [SI], NaN for a missing cell or column."""
        values = np.full(len(self), np.nan)
        for i, text in enumerate(self.cells.get(column.name, ())):
            if text.casefold() in MISSING:
                continue
            try:
                number = plain(text, self.decimal, self.grouped)
            except ValueError as error:
                raise self.error(i, column.name, f"{error}, got {quoted(text)}") from None
            try:
                values[i] = column.parse(number, text, self.units.get(column.name))
            except ValueError as error:
                remedy = "; if commas are decimal marks, add --decimal , and if they group thousands, --decimal ."
                remedy = "" if self.grouped or "," not in text else remedy
                raise self.error(i, column.name, f"{error}{remedy}") from None
        return values


def read_table(path: str | Path, sought: Sought, renames: Mapping[str, str], decimal: str | None = None) -> Table:
    """Read the known columns of a CSV file.

    Understood are commas, semicolons and tabs between cells; decimal commas where commas do not
    separate cells; grouped thousands where they cannot be decimals; UTF-8 with or without a byte-order mark,
    UTF-16 with one, and Latin-1; quoted cells; blank lines. Names of columns may differ in case. Other columns
    are left out, with a note.

    Parameters
    ----------
    path
        The file.
    sought
        The columns that may have other names and units than the standard ones; notes say which do.
    renames
        Name of a column here -> its name in the file; those that the file lacks are ignored
        (`check_renames` refuses those that no file has).
    decimal
        What stands before the decimals of a number, "," or "."; the other one groups thousands. Left out, the
        numbers tell, or the table is refused.

    Raises
    ------
    InputError
        If the file is not a table with at least one row, or a number may have decimals or grouped thousands;
        the message names file and row.
    """
    if decimal not in (None, *MARKS):
        raise InputError(f"decimal is {decimal!r}, expected one of {', '.join(map(repr, MARKS))}")
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    text, notes = _decode(path, content)
    separator = _separator(text)
    header, body, rows, first, padded = _records(path, text, separator)
    at, units, found = understood(header, renames, sought, f"{path}: row {first}")
    notes += found
    cells = {name: [record[j] for record in body] for name, j in at.items()}
    for name in (name for name in LABELS if name in at):
        total = Counter(cells[name])
        if both := [f"'{label}'" for label in natural(total) if 0 < padded[at[name], label] < total[label]]:
            notes.append(f"column {name!r}: {listing(both)} with spaces at the ends and without are taken as the same")
    cells |= {name: [unescaped(text) for text in cells[name]] for name in LABELS if name in cells}
    unused = [title for j, title in enumerate(header) if title and j not in at.values()]
    if unused:
        notes.append(f"unused columns: {listing(unused)}")
    titles = {name: header[j] for name, j in at.items()}
    reading = Reading(decimal or ".")
    if decimal is None:
        reading = _found_mark(path, cells, titles, rows, between_commas=separator == ",")
    if reading.note:
        notes.append(reading.note)
    return Table(
        path=path,
        digest=hashlib.sha256(content).hexdigest(),
        cells=cells,
        titles=titles,
        units=units,
        rows=np.array(rows, dtype=np.intp),
        decimal=reading.mark,
        grouped=decimal is not None or reading.grouped,
        notes=tuple(notes),
    )


def check_renames(renames: Mapping[str, str], *tables: Table) -> None:
    """Raise an error for renames of unknown columns, or to names that no table has."""
    for name, actual in renames.items():
        if name not in (*LABELS, *NUMBERS):
            known = (*LABELS, *NUMBERS)
            raise InputError(
                f"--column {name}={actual}: no column is called {name!r} here{guess(name, known)}; "
                f"expected one of {', '.join(known)}"
            )
        if all(table.titles.get(name, "").casefold() != actual.casefold() for table in tables):
            files = " or ".join(dict.fromkeys(str(table.path) for table in tables))
            raise InputError(f"--column {name}={actual}: there is no column {actual!r} in {files}")


def read_only(values: ArrayLike, kind: type) -> NDArray:
    """Return a copy of `values` that cannot be written to."""
    array: NDArray = np.array(values, dtype=kind)
    array.setflags(write=False)
    return array


def _decode(path: Path, content: bytes) -> tuple[str, list[str]]:
    """Return the text of a file, each newline one character, and notes."""
    notes: list[str] = []
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        if wide:
            raise InputError(f"{path}: {error.reason} in UTF-16, expected a table saved as CSV") from None
        if _is_shift_jis(content):
            line = 1 + content.count(b"\n", 0, error.start)
            raise InputError(
                f"{path}: row {line}: the text is encoded in Shift-JIS, expected UTF-8; save the table as 'CSV UTF-8'"
            ) from None
        text = content.decode("latin-1")
        notes.append("not UTF-8: read as Latin-1")
    if control := _CONTROL.search(text):
        line = 1 + text.count("\n", 0, control.start())
        raise InputError(
            f"{path}: not a text file, expected a table saved as CSV: control character {control[0]!r} in line {line}"
        )
    if not text.strip():
        raise InputError(f"{path}: the file is empty, expected a header and rows")
    return text.replace("\r\n", "\n").replace("\r", "\n"), notes


def _is_shift_jis(content: bytes) -> bool:
    """Return whether bytes that are not UTF-8 are Japanese text in Shift-JIS.

    Latin-1 has letters where Shift-JIS has second bytes, and typographic quotes of Windows where it has first ones:
    two Japanese characters side by side, one of them of two bytes beyond ASCII, do not occur in it.
    """
    try:
        text = content.decode("cp932")
    except UnicodeDecodeError:
        return False
    pairs = (match[0].encode("cp932") for match in _JAPANESE.finditer(text))
    return any(max(pair[1], pair[3]) >= 0x80 and min(pair[0], pair[2]) < 0xA0 for pair in pairs)


def _separator(text: str) -> str:
    """Return the separator of the header's cells."""
    header = re.sub(r'"[^"]*"', "", text.lstrip().partition("\n")[0])
    return max(",;\t", key=header.count)


def _found_mark(
    path: Path,
    cells: Mapping[str, Sequence[str]],
    titles: Mapping[str, str],
    rows: Sequence[int],
    between_commas: bool,
) -> Reading:
    """Return the decimal mark that the numbers of a table show.

    Raises
    ------
    InputError
        If they do not decide between two.
    """
    numbers = [[Cell(t, titles[n], r) for t, r in zip(cells[n], rows, strict=True)] for n in NUMBERS if n in cells]
    filled = [[c for c in column if c.text.casefold() not in MISSING] for column in numbers]
    reading = decimal_mark(filled, between_commas)
    if reading.unclear is not None:
        raise InputError(_unclear(path, reading.unclear))
    return reading


def _unclear(path: Path, cell: Cell) -> str:
    """Return the message for a number that can be read in two ways."""
    other = cell.text.replace(",", "").replace(".", "")
    return (
        f"{path}: {cell.place}: {cell.text!r} may be {cell.text.replace(',', '.')} or {other}, and no number of this "
        "table decides between them; name the decimal mark with --decimal . or --decimal ,"
    )


def _records(
    path: Path, text: str, separator: str
) -> tuple[list[str], list[list[str]], list[int], int, Counter[tuple[int, str]]]:
    """Return header, non-blank rows, their lines, the header's line, and the number of cells with spaces at their ends.

    That number is by column and by the cell's text without the spaces.
    """
    records: list[list[str]] = []
    rows: list[int] = []
    padded: Counter[tuple[int, str]] = Counter()
    for record, line in _rows(path, text, separator):
        cells = [cell.strip() for cell in record]
        padded.update((j, cell) for j, cell in enumerate(cells) if cell != record[j])
        if any(cells):
            records.append(cells)
            rows.append(line)
    header, body = records[0] if records else [], records[1:]
    if not body:
        raise InputError(f"{path}: there is no row below the header")
    for title, count in Counter(title.casefold() for title in header if title).items():
        if count > 1:
            raise InputError(f"{path}: row {rows[0]}: {count} columns are called {quoted(title)}, expected one")
    used = max(j + 1 for j, title in enumerate(header) if title)
    for record, row in zip(body, rows[1:], strict=True):
        beyond = [cell for cell in record[used:] if cell]
        if beyond:
            raise InputError(f"{path}: row {row}: {quoted(beyond[-1])} stands beyond the {used} columns of the header")
    return header[:used], [[*record[:used], *[""] * (used - len(record))] for record in body], rows[1:], rows[0], padded


def _rows(path: Path, text: str, separator: str) -> Iterator[tuple[list[str], int]]:
    """Yield the cells of each row, as many as it has, and the line where it starts.

    Raises
    ------
    InputError
        If a quotation mark is never closed, or a cell is too long.
    """
    reader = csv.reader(io.StringIO(f"{text}\n{_END}"), delimiter=separator, skipinitialspace=True)
    line, record = 1, [_END]
    try:
        for record in reader:
            if record == [_END]:
                return
            if record and record[-1].endswith(_END):
                break
            yield record, line
            line = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: row {line}: {error} (is a quotation mark never closed?)") from None
    raise InputError(f"{path}: row {line}: a quotation mark is never closed")
