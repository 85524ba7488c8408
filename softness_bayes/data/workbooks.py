"""Excel workbooks: the cells of their sheets, as shown."""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from softness_bayes.data.decimals import SheetNumber
from softness_bayes.data.faults import listing
from softness_bayes.data.sheets import Sheet, cell_text, sheet_of
from softness_bayes.errors import InputError

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
            read = {sheet.title: _cells(sheet) for sheet in book.worksheets}
        filled = {name: (rows, _fill_merged(rows, merged)) for name, (rows, merged) in read.items() if rows}
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
