"""Excel workbooks: the cells of their sheets, as shown."""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, time
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from softness_bayes.data.faults import listing
from softness_bayes.data.sheets import Sheet, SheetNumber, sheet_of
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json

INSTALL = "pip install 'softness-bayes[tables]'"
"""Command that installs what reads workbooks, Parquet, Feather and SPSS files."""

_SHOWN = re.compile(r'((?:"[^"]*"|\.|[-_ ])*)(0+)((?:"[^"]*"|\.)*)')
"""A format of whole numbers with zeros in front, and text before and after them."""

UNPACKED = 2**26
"""Largest size of an unpacked workbook [bytes]."""


def workbook_sheets(path: Path, content: bytes, digest: str) -> dict[str, Sheet]:
    """Return the sheets of a workbook that have cells, with the values of their formulas."""
    try:
        import openpyxl
    except ImportError:
        raise InputError(f"{path}: workbooks are read with openpyxl, which is not installed: {INSTALL}") from None
    try:
        _require_bounded(path, content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and validations that openpyxl does not know
            # without read_only, openpyxl makes every cell of merged regions, of links and up to the last cell
            book = openpyxl.load_workbook(io.BytesIO(content), data_only=True, read_only=True)
            read = {sheet.title: _cells(sheet) for sheet in book.worksheets}
        filled = {name: (rows, _fill_merged(rows, merged)) for name, (rows, merged) in read.items() if rows}
    except InputError:
        raise
    except Exception as error:  # damaged archives and XML end in errors of many kinds
        raise InputError(f"{path}: not a workbook that can be read ({type(error).__name__})") from None
    return {
        name: sheet_of(
            _numbered(rows),
            str(path) if len(filled) == 1 else f"{path}, sheet {name!r}",
            path.name if len(filled) == 1 else f"{path.name}, sheet {name!r}",
            digest,
            notes=notes,
        )
        for name, (rows, notes) in filled.items()
    }


def _numbered(rows: Mapping[int, Mapping[int, str]]) -> Iterator[tuple[list[str], int]]:
    """Yield the cells of each row up to its last one, and its number."""
    for number, cells in sorted(rows.items()):
        yield [cells.get(j, "") for j in range(1, max(cells, default=0) + 1)], number


def _require_bounded(path: Path, content: bytes) -> None:
    """Raise an error for a workbook that would unpack to more than a table needs, before it is unpacked."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(one.file_size for one in archive.infolist())
    if size > UNPACKED:
        raise InputError(
            f"{path}: unpacks to {size >> 20} MB, expected at most {UNPACKED >> 20} MB; save the table alone as .csv"
        )


def _cells(sheet: Any) -> tuple[dict[int, dict[int, str]], list[Any]]:
    """Return the texts of the cells that exist, by row and column from 1, and the merged regions of a sheet."""
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
    return rows, [CellRange(one.ref) for one in merged]


def _fill_merged(rows: dict[int, dict[int, str]], merged: Sequence[Any]) -> list[str]:
    """Give the rows with data the value of the cells that are merged within a column; return a note if there are any.

    Of cells that are merged otherwise only the first one has a value.
    """
    numbers = sorted(rows)
    for one in merged:
        value = rows.get(one.min_row, {}).get(one.min_col, "")
        down = one.min_col == one.max_col and value
        for number in numbers[bisect_left(numbers, one.min_row) : bisect_right(numbers, one.max_row)]:
            row = rows[number]
            for column in [j for j in row if one.min_col <= j <= one.max_col]:
                del row[column]
            if down or number == one.min_row:
                row[one.min_col] = value
    places = sorted(str(one) for one in merged if one.min_col == one.max_col and one.min_row < one.max_row)
    return [f"merged cells {listing(places)}: their value is used in each row"] if places else []


def _excel_text(cell: Any) -> str:
    """Return a cell's text; a percentage is that number, and a whole number knows the text that is shown, as P01."""
    text = cell_text(cell.value)
    form = (cell.number_format or "").split(";")[0]
    if isinstance(text, SheetNumber) and "%" in form:
        return SheetNumber(f"{Decimal(f'{100 * Decimal(text):.15g}'):f}%")
    if isinstance(text, SheetNumber) and text.isdigit() and (match := _SHOWN.fullmatch(form)):
        before, zeros, after = match.groups()
        words = [re.sub(r'"|\\(?=.)', "", part) for part in (before, after)]
        return SheetNumber(text, shown=f"{words[0]}{text.zfill(len(zeros))}{words[1]}")
    return text


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
    return _other_text(value)


def _other_text(value: Any) -> str:
    """Return the text of a value that is neither text nor a number of the usual kinds."""
    import pandas as pd

    if isinstance(value, datetime) and value.time() == time():
        value = value.date()  # as a day is shown
    if isinstance(value, (dict, list)):
        return as_json(value, "a cell")
    if value is None or (pd.api.types.is_scalar(value) and pd.isna(value)):
        return ""
    return SheetNumber(value) if pd.api.types.is_number(value) else str(value)
