"""Tables of other programs as sheets: Excel workbooks, Parquet files and DataFrames."""

from __future__ import annotations

import hashlib
import io
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, time
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from softness_bayes.data.content import content_of
from softness_bayes.data.delimited import text_sheet
from softness_bayes.data.headers import Sought, understood
from softness_bayes.data.names import listing
from softness_bayes.data.sheets import Sheet, SheetNumber, sheet_of
from softness_bayes.data.synonyms import key
from softness_bayes.errors import InputError, quoted

if TYPE_CHECKING:
    import pandas as pd

    TableSource: TypeAlias = str | Path | pd.DataFrame
else:
    TableSource = object
"""A file or a DataFrame."""

INSTALL = "pip install 'softness-bayes[tables]'"
"""Command that installs what reads workbooks and Parquet files."""

_WORKBOOKS = (".xlsx", ".xlsm")
_PARQUET = (".parquet", ".pq")
_OTHERS = (".xls", ".xlsb", ".ods", ".numbers")
_ZEROS = re.compile("0{2,}")


def read_sheet(source: TableSource, sought: Sought, renames: Mapping[str, str]) -> Sheet:
    """Return the sheet of a file or DataFrame that has the columns looked for.

    Raises
    ------
    InputError
        If the file cannot be read, or it is not clear which of its sheets is meant.
    """
    if not isinstance(source, (str, os.PathLike)):
        return _frame_sheet(_require_frame(source), f"DataFrame of {sought.sheet}")
    path = Path(source)
    content, suffix = content_of(path), path.suffix.casefold()
    if suffix in _WORKBOOKS:
        return _chosen(path, _workbook(path, content), sought, renames)
    if suffix in _PARQUET:
        return _parquet(path, content)
    if suffix in _OTHERS:
        raise InputError(f"{path}: {suffix} files cannot be read; save the table as .csv, .xlsx or .parquet")
    return text_sheet(path, content)


def has_sheet(source: str | Path, sought: Sought, renames: Mapping[str, str]) -> bool:
    """Return whether a workbook of several sheets has one for the columns looked for."""
    path = Path(source)
    if path.suffix.casefold() not in _WORKBOOKS:
        return False
    sheets = _workbook(path, content_of(path))
    return len(sheets) > 1 and len(_candidates(sheets, sought, renames)) == 1


def _candidates(sheets: Mapping[str, Sheet], sought: Sought, renames: Mapping[str, str]) -> list[str]:
    """Return the sheets with the name that is looked for, or with the columns that mark it."""
    named = [name for name in sheets if key(name) == sought.sheet]
    titles = {name: _understood(sheet, sought, renames) for name, sheet in sheets.items()}
    for marks in (sought.marks, sought.otherwise):
        named = named or [name for name, known in titles.items() if any(names <= known for names in marks)]
    return named


def _understood(sheet: Sheet, sought: Sought, renames: Mapping[str, str]) -> set[str]:
    """Return the columns of a sheet that are known."""
    try:
        return {*understood(sheet.header, renames, sought, sheet.titled).at}
    except InputError:
        return set()


def _chosen(path: Path, sheets: Mapping[str, Sheet], sought: Sought, renames: Mapping[str, str]) -> Sheet:
    """Return the one sheet of a workbook that is meant."""
    if not sheets:
        raise InputError(f"{path}: the workbook is empty, expected a header and rows")
    chosen = list(sheets) if len(sheets) == 1 else _candidates(sheets, sought, renames)
    if len(chosen) != 1:
        raise InputError(
            f"{path}: {len(chosen) or 'none'} of the sheets {listing([quoted(name) for name in sheets])} may "
            f"contain the {sought.sheet}; rename the right one to {sought.sheet!r}"
        )
    return sheets[chosen[0]]


def _workbook(path: Path, content: bytes) -> dict[str, Sheet]:
    """Return the sheets of a workbook that have cells, with the values of their formulas."""
    try:
        import openpyxl
    except ImportError:
        raise InputError(f"{path}: workbooks are read with openpyxl, which is not installed: {INSTALL}") from None
    digest = hashlib.sha256(content).hexdigest()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and validations that openpyxl does not know
            book = openpyxl.load_workbook(io.BytesIO(content), data_only=True)
            sheets = book.worksheets
            cells = {one.title: [[_excel_text(cell) for cell in row] for row in one.iter_rows()] for one in sheets}
            merged = {one.title: _filled(one, cells[one.title]) for one in sheets}
    except Exception as error:  # damaged archives and XML end in errors of many kinds
        raise InputError(f"{path}: not a workbook that can be read ({type(error).__name__})") from None
    filled = {name: rows for name, rows in cells.items() if any(any(row) for row in rows)}
    return {
        name: sheet_of(
            _numbered(rows, 1),
            str(path) if len(filled) == 1 else f"{path}, sheet {name!r}",
            path.name if len(filled) == 1 else f"{path.name}, sheet {name!r}",
            digest,
            notes=merged[name],
        )
        for name, rows in filled.items()
    }


def _filled(sheet: Any, cells: list[list[str]]) -> list[str]:
    """Give every row of cells that are merged within a column their value; return a note if there are any."""
    found = [one for one in sheet.merged_cells.ranges if one.min_col == one.max_col and one.min_row < one.max_row]
    for one in found:
        for row in cells[one.min_row : one.max_row]:
            row[one.min_col - 1] = cells[one.min_row - 1][one.min_col - 1]
    places = sorted(str(one) for one in found)
    return [f"merged cells {listing(places)}: their value is used in each row"] if found else []


def _excel_text(cell: Any) -> str:
    """Return a cell's text; percentages, and whole numbers that are shown with zeros in front, are as shown."""
    text = cell_text(cell.value)
    if isinstance(text, SheetNumber) and "%" in (cell.number_format or ""):
        return SheetNumber(f"{100 * Decimal(text):f}%")
    if isinstance(cell.value, int) and _ZEROS.fullmatch(cell.number_format or ""):
        return text.zfill(len(cell.number_format))
    return text


def _parquet(path: Path, content: bytes) -> Sheet:
    """Return the sheet of a Parquet file."""
    import pandas as pd

    try:
        frame = pd.read_parquet(io.BytesIO(content), engine="pyarrow")
    except ImportError:
        raise InputError(f"{path}: Parquet files are read with pyarrow, which is not installed: {INSTALL}") from None
    except Exception as error:  # pyarrow has errors of many kinds
        raise InputError(f"{path}: not a Parquet file that can be read ({type(error).__name__})") from None
    return _frame_sheet(frame, str(path), path.name, hashlib.sha256(content).hexdigest())


def _require_frame(source: object) -> pd.DataFrame:
    import pandas as pd

    if not isinstance(source, pd.DataFrame):
        raise InputError(f"expected the path of a table or a pandas DataFrame, got {type(source).__name__}")
    return source


def _frame_sheet(frame: pd.DataFrame, place: str, label: str = "", digest: str = "") -> Sheet:
    """Return the sheet of a DataFrame; rows are counted from 0, as `iloc` counts them.

    Parameters
    ----------
    frame
        The columns; a named index is one too.
    place, label
        As of `Sheet`.
    digest
        That of the file; by default that of the cells.
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
    digest = (
        digest or hashlib.sha256(repr((header, [[str(cell) for cell in row] for row in body])).encode()).hexdigest()
    )
    return sheet_of([(header, -1), *_numbered(body, 0)], place, label or place, digest)


def _numbered(rows: Iterable[Sequence[str]], first: int) -> Iterator[tuple[Sequence[str], int]]:
    return ((row, k) for k, row in enumerate(rows, first))


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
    if value is None or (pd.api.types.is_scalar(value) and pd.isna(value)):
        return ""
    return SheetNumber(value) if pd.api.types.is_number(value) else str(value)
