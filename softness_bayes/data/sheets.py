"""Sheets: rows of cells with their lines, from text files, workbooks and DataFrames."""

from __future__ import annotations

import csv
import io
import re
import warnings
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time
from decimal import Decimal
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.records import as_json
from softness_bayes.data.decimals import SheetNumber
from softness_bayes.data.faults import listing

if TYPE_CHECKING:
    import pandas as pd

MOST_COLUMNS = 2**14
"""Largest number of columns of a table, that of spreadsheet programs."""

MOST_CELLS = 2**24
"""Largest number of cells of a table, with the empty ones between others."""


@dataclass(frozen=True)
class Sheet:
    """Rows of stripped cells, some of which may be titles; blank rows are left out."""

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

    def noted(self, *notes: str, **changes: Any) -> Sheet:
        """Return the sheet with further notes, and other changes."""
        return replace(self, notes=(*self.notes, *notes), **changes)


def sheet_of(rows: Iterable[tuple[Sequence[str], int]], place: str, label: str, digest: str, **others: Any) -> Sheet:
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
    return Sheet(place, label, digest, records, lines, **others)


# text


def text_sheet(path: Path, content: bytes, digest: str) -> Sheet:
    """Return the rows of a text file with commas, semicolons, tabs, bars or spaces between cells.

    Raises
    ------
    InputError
        If it is not such a file; the message names file and row.
    """
    text, notes = _decode(path, content)
    told = re.match('"?sep=([,;\t|])"?\n', text)  # Excel's own line before the header
    if told:
        text = f"\n{text[told.end() :]}"  # a blank row keeps the numbers of the others
    separator = told[1] if told else _separator(text)
    rows = _rows(path, text, separator)
    return sheet_of(rows, str(path), path.name, digest, between_commas=separator == ",", notes=notes)


def _decode(path: Path, content: bytes) -> tuple[str, tuple[str, ...]]:
    """Return the text of a file, each newline one character, and notes."""
    notes: tuple[str, ...] = ()
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        if wide:
            raise InputError(f"{path}: {error.reason} in UTF-16, expected a table saved as CSV") from None
        japanese = _is_shift_jis(content)
        text = content.decode("cp932" if japanese else "latin-1")
        notes = (f"not UTF-8: read as {'Shift-JIS' if japanese else 'Latin-1'}",)
    if control := re.search("[\x00-\x08\x0e-\x1f]", text):
        utf16 = content.count(0) > len(content) // 4
        remedy = "; is it UTF-16 without a byte-order mark? Save it as UTF-8" if utf16 else ""
        line = 1 + text.count("\n", 0, control.start())
        raise InputError(
            f"{path}: not a text file, expected a table saved as CSV: control character {control[0]!r} in line {line}"
            f"{remedy}"
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
    pairs = (match.encode("cp932") for match in re.findall("[\u3041-\u30fe\u4e00-\u9fff]{2}", text))
    return any(max(pair[1], pair[3]) >= 0x80 and min(pair[0], pair[2]) < 0xA0 for pair in pairs)


def _separator(text: str) -> str:
    """Return the separator of the cells: the one of the first lines, or spaces if every line has as many words."""
    lines = [re.sub(r'"[^"]*"', "", line) for line in text.split("\n", 200)[:200] if line.strip()]
    header = next((line for line in lines if not line.startswith("#")), lines[0])
    if there := [mark for mark in ",;\t" if mark in header]:
        # of a comma in a title and the separator, the latter is in every line as often
        return max(
            there, key=lambda mark: (sum(line.count(mark) == header.count(mark) for line in lines), header.count(mark))
        )
    # a preamble may have none
    later = max(",;\t|", key=lambda mark: sum(mark in line for line in lines))
    if 2 * sum(later in line for line in lines) > len(lines):
        return later
    words = {len(line.split()) for line in lines}
    return " " if words == {max(words)} and max(words) > 2 else ","


def _rows(path: Path, text: str, separator: str) -> Iterator[tuple[list[str], int]]:
    """Yield the cells of each row, as many as it has, and the line where it starts.

    Raises
    ------
    InputError
        If a quotation mark is never closed, or a cell is too long.
    """
    end = "\x1f"  # end mark behind the last row, a character that occurs in no table
    reader = csv.reader(io.StringIO(f"{text}\n{end}"), delimiter=separator, skipinitialspace=True)
    line = 1
    try:
        for record in reader:
            if record == [end]:
                return
            if record and record[-1].endswith(end):
                break
            yield record, line
            line = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: row {line}: {error} (is a quotation mark never closed?)") from None
    raise InputError(f"{path}: row {line}: a quotation mark is never closed")


# typed values


def cell_text(value: Any) -> str:
    """Return the text of a typed value: names as they are, numbers with all their digits, nothing if missing."""
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, np.bool_)):
        return str(bool(value)).upper()
    if isinstance(value, (int, np.integer)):
        return SheetNumber(int(value))
    if isinstance(value, (float, np.floating)):
        if np.isnan(value):
            return ""
        return SheetNumber(int(value) if float(value).is_integer() and abs(float(value)) < 2**53 else value)
    import pandas as pd

    if isinstance(value, datetime) and value.time() == time():
        value = value.date()  # as a day is shown
    if isinstance(value, (dict, list)):
        return as_json(value, "a cell")
    if value is None or (pd.api.types.is_scalar(value) and pd.isna(value)):
        return ""
    return SheetNumber(value) if pd.api.types.is_number(value) else str(value)


def frame_sheet(frame: pd.DataFrame, place: str, label: str = "", digest: str = "", first: int = 0) -> Sheet:
    """Return the rows of a DataFrame, of which a named index is a column.

    Parameters
    ----------
    frame
        The DataFrame.
    place, label
        As of `Sheet`.
    digest
        That of the file; by default that of the cells.
    first
        Number of the first row: 0, as `iloc` counts them.
    """
    if frame.columns.nlevels > 1:
        raise InputError(f"{place}: the columns have {frame.columns.nlevels} levels, expected one")
    if any(name is not None for name in frame.index.names):
        try:
            frame = frame.reset_index()
        except ValueError as error:
            raise InputError(f"{place}: {error}, expected columns of different names") from None
    header = [cell_text(title) for title in frame.columns]
    columns = [[cell_text(value) for value in frame.iloc[:, j].to_numpy()] for j in range(frame.shape[1])]
    body = list(zip(*columns, strict=True))
    digest = digest or sha256(repr((header, [[*map(str, row)] for row in body])).encode()).hexdigest()
    return sheet_of([(header, -1), *((row, k) for k, row in enumerate(body, first))], place, label or place, digest)


# workbooks

INSTALL = "pip install 'softness-bayes[tables]'"
"""Command that installs what reads workbooks, Parquet, Feather and SPSS files."""

UNPACKED = 2**26
"""Largest size of an unpacked workbook [bytes]."""


def workbook_sheets(path: Path, content: bytes, digest: str) -> dict[str, Sheet]:
    """Return the sheets of a workbook that have cells, with the values of their formulas."""
    try:
        import openpyxl
    except ImportError:
        raise InputError(f"{path}: workbooks are read with openpyxl, which is not installed: {INSTALL}") from None
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(one.file_size for one in archive.infolist())
        if size > UNPACKED:  # before it is unpacked
            raise InputError(
                f"{path}: unpacks to {size >> 20} MB, expected at most {UNPACKED >> 20} MB; save the table alone as "
                ".csv"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and validations that openpyxl does not know
            # without read_only, openpyxl makes every cell of merged regions, of links and up to the last cell
            book = openpyxl.load_workbook(io.BytesIO(content), data_only=True, read_only=True)
            shown = [sheet for sheet in book.worksheets if sheet.sheet_state == "visible"] or book.worksheets
            read = {sheet.title: _cells(sheet) for sheet in shown}
            hidden = [sheet.title for sheet in book.worksheets if sheet.title not in read]
        said = (f"hidden sheets are not read: {listing(hidden)}",) if hidden else ()
        filled = {
            name: (rows, (*_fill_merged(rows, merged), *told, *said))
            for name, (rows, merged, told) in read.items()
            if rows
        }
    except InputError:
        raise
    except Exception as error:  # damaged archives and XML end in errors of many kinds
        raise InputError(f"{path}: not a workbook that can be read ({type(error).__name__})") from None
    which = {name: f", sheet {name!r}" if len(filled) > 1 else "" for name in filled}
    return {
        name: sheet_of(_numbered(rows), f"{path}{which[name]}", f"{path.name}{which[name]}", digest, notes=notes)
        for name, (rows, notes) in filled.items()
    }


def _numbered(rows: Mapping[int, Mapping[int, str]]) -> Iterator[tuple[list[str], int]]:
    """Yield the cells of each row up to its last one, and its number."""
    for number, cells in sorted(rows.items()):
        yield [cells.get(j, "") for j in range(1, max(cells, default=0) + 1)], number


def _cells(sheet: Any) -> tuple[dict[int, dict[int, str]], list[Any], tuple[str, ...]]:
    """Return the texts of the cells that exist, by row and column from 1, the merged regions of a sheet, and notes."""
    from openpyxl.cell.read_only import ReadOnlyCell
    from openpyxl.worksheet._reader import WorkSheetParser
    from openpyxl.worksheet.cell_range import CellRange

    book, rows = sheet.parent, {}
    # the parser of openpyxl itself: iter_rows would fill the gaps between cells and not tell the merged regions
    with sheet._get_source() as source:
        parser = WorkSheetParser(
            source,
            sheet._shared_strings,
            data_only=True,
            epoch=book.epoch,
            date_formats=book._date_formats,
            timedelta_formats=book._timedelta_formats,
        )
        for row, cells in parser.parse():
            texts = {cell["column"]: _excel_text(ReadOnlyCell(sheet, **cell)) for cell in cells}
            if filled := {column: text for column, text in texts.items() if text}:
                rows[row] = filled
    merged = [] if parser.merged_cells is None else parser.merged_cells.mergeCell
    hidden = [row for row in rows if parser.row_dimensions.get(str(row), {}).get("hidden") in ("1", "true")]
    told = (f"hidden rows are read, too ({len(hidden)}, the first is row {hidden[0]})",) if hidden else ()
    return rows, [CellRange(one.ref) for one in merged], told


def _fill_merged(rows: dict[int, dict[int, str]], merged: Sequence[Any]) -> tuple[str, ...]:
    """Give the rows with data the value of the cells that are merged within a column; return a note if there are any.

    Of cells that are merged otherwise only the first one has a value.
    """
    for one in merged:
        value = rows.get(one.min_row, {}).get(one.min_col, "")
        down = one.min_col == one.max_col and value
        for number in [number for number in rows if one.min_row <= number <= one.max_row]:
            for column in [j for j in rows[number] if one.min_col <= j <= one.max_col]:
                del rows[number][column]
            if down or number == one.min_row:
                rows[number][one.min_col] = value
    places = sorted(str(one) for one in merged if one.min_col == one.max_col and one.min_row < one.max_row)
    return (f"merged cells {listing(places)}: their value is used in each row",) if places else ()


def _excel_text(cell: Any) -> str:
    """Return a cell's text; a percentage is that number, and a whole number knows the text that is shown, as P01."""
    text = cell_text(cell.value)
    form = (cell.number_format or "").split(";")[0]
    if isinstance(text, SheetNumber) and "%" in form:
        return SheetNumber(f"{Decimal(f'{100 * Decimal(text):.15g}'):f}%")
    # a format of whole numbers with zeros in front, and text before and after them
    shown = re.fullmatch(r'((?:"[^"]*"|\.|[-_ ])*)(0+)((?:"[^"]*"|\.)*)', form)
    if isinstance(text, SheetNumber) and text.isdigit() and shown:
        before, after = (re.sub(r'"|\\(?=.)', "", part) for part in (shown[1], shown[3]))
        return SheetNumber(text, shown=f"{before}{text.zfill(len(shown[2]))}{after}")
    return text
