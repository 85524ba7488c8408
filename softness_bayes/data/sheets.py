"""Files of tables in all formats, recognised by their first bytes: the cells of their sheets, and their lines."""

from __future__ import annotations

import bz2
import csv
import gzip
import io
import lzma
import os
import re
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time
from decimal import Decimal
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.files.records import as_json, parse_json
from softness_bayes.data.texts import SheetNumber, listing

if TYPE_CHECKING:
    import pandas as pd

    TableSource: TypeAlias = str | Path | pd.DataFrame
else:
    TableSource = object
"""A file or a DataFrame."""

LARGEST = 2**28
"""Largest size of a table's file, also when it is unpacked [bytes]."""

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


# files


class _File(NamedTuple):
    """A file: its path, its bytes, unpacked if they were compressed, and the SHA-256 of all of them."""

    path: Path
    content: bytes
    digest: str

    def sheet(self, rows: Iterable[tuple[Sequence[str], int]], which: str = "", **others: Any) -> Sheet:
        """Return one of its sheets, which is named if there are several."""
        return sheet_of(rows, f"{self.path}{which}", f"{self.path.name}{which}", self.digest, **others)

    def require_size(self, rows: int, columns: int, size: int) -> None:
        """Raise an error for a table that is too large."""
        if rows * columns > MOST_CELLS or size > LARGEST:
            raise InputError(
                f"{self.path}: {rows} rows of {columns} columns with {size >> 20} MB, expected at most "
                f"{MOST_CELLS} cells and {LARGEST >> 20} MB"
            )


def sheets_of(source: TableSource, kind: str) -> dict[str, Sheet]:
    """Return the sheets of a file by name; a text file or a DataFrame has one.

    Raises
    ------
    InputError
        If the source cannot be read.
    """
    if not isinstance(source, (str, os.PathLike)):
        import pandas as pd

        if not isinstance(source, pd.DataFrame):
            raise InputError(f"expected the path of a table or a pandas DataFrame, got {type(source).__name__}")
        rows, digest = _rows_of_frame(source, place := f"DataFrame of {kind}")
        return {"": sheet_of(rows, place, place, digest)}
    path = Path(source)
    content = _content(path)
    file = _File(path, content, sha256(content).hexdigest())
    for _ in range(2):  # a compressed file may hold a workbook
        what, read = next(
            ((what, read) for starts, what, read in _FORMATS if file.content.startswith(starts)), ("", None)
        )
        if not what:
            break
        if read is None:
            raise InputError(f"{path}: this is {what}")
        found = _opened(file, what, read)
        if not isinstance(found, bytes):
            return found if isinstance(found, dict) else {"": file.sheet(_rows_of_frame(found, str(path))[0])}
        if len(found) > LARGEST:
            raise InputError(f"{path}: unpacks to more than {LARGEST >> 20} MB, expected a table")
        file = file._replace(content=found)
    frame = _json(file)
    return {"": _text_sheet(file) if frame is None else file.sheet(_rows_of_frame(frame, str(path), first=1)[0])}


def is_workbook(path: Path) -> bool:
    """Return whether a file may have several sheets."""
    return os.path.isfile(path) and _content(path).startswith(b"PK")


def _content(path: Path) -> bytes:
    try:
        with open(path, "rb") as file:
            content = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except ValueError as error:  # a path with a NUL character
        raise InputError(f"{quoted(str(path))}: {error}") from None
    if len(content) > LARGEST:
        raise InputError(f"{path}: is larger than {LARGEST >> 20} MB, expected a table of ratings or fabrics")
    return content


def _opened(file: _File, what: str, read: Callable[[_File], Any]) -> Any:
    """Return what a library reads: the sheets of a workbook, a DataFrame, or the unpacked bytes."""
    try:
        return read(file)
    except ImportError as error:
        missing = (error.name or "pyarrow").partition(".")[0]
        raise InputError(f"{file.path}: {what}s are read with {missing}, which is not installed: {INSTALL}") from None
    except InputError:
        raise
    except Exception as error:  # damaged files end in errors of many kinds
        if what == "compressed":
            raise InputError(f"{file.path}: a compressed file that cannot be unpacked ({error})") from None
        raise InputError(f"{file.path}: not a {what} that can be read ({type(error).__name__})") from None


def _unpacked(opened: Callable[[Any], Any]) -> Callable[[_File], bytes]:
    def read(file: _File) -> bytes:
        with opened(io.BytesIO(file.content)) as content:
            return content.read(LARGEST + 1)

    return read


_DOCUMENTS = {
    "mimetype": "an OpenDocument file",
    "word/": "a text document",
    "ppt/": "a presentation",
    "Index/": "a Numbers document",
}
"""First letters of a file in an archive -> the document that such an archive is."""


def _zip(file: _File) -> dict[str, Sheet] | bytes:
    """Return the sheets of a workbook, or the content of the one file of an archive."""
    with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
        names = archive.namelist()
        if any(name.startswith("xl/") for name in names):
            size = sum(one.file_size for one in archive.infolist())
            if size <= UNPACKED:
                return _workbook_sheets(file)
            raise InputError(
                f"{file.path}: unpacks to {size >> 20} MB, expected at most {UNPACKED >> 20} MB; save the table alone "
                "as .csv"
            )
        for mark, what in _DOCUMENTS.items():
            if any(name.startswith(mark) for name in names):
                raise InputError(f"{file.path}: this is {what}: save its table as .xlsx or .csv")
        if len(names) != 1:
            raise InputError(f"{file.path}: an archive of {len(names)} files, expected one table")
        return archive.open(names[0]).read(LARGEST + 1)


def _parquet(file: _File) -> pd.DataFrame:
    import pyarrow.parquet

    about = pyarrow.parquet.ParquetFile(io.BytesIO(file.content)).metadata
    size = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
    file.require_size(about.num_rows, about.num_columns, size)
    return _frame("read_parquet", engine="pyarrow")(file)


def _frame(name: str, **options: Any) -> Callable[[_File], pd.DataFrame]:
    """Return a reader of pandas for a file in memory."""

    def read(file: _File) -> pd.DataFrame:
        import pandas as pd

        return getattr(pd, name)(io.BytesIO(file.content), **options)

    return read


def _spss(file: _File) -> pd.DataFrame:
    import pandas as pd
    import pyreadstat

    with tempfile.NamedTemporaryFile(suffix=".sav", delete=False) as copy:
        copy.write(file.content)  # it reads from a path only
    try:
        _, about = pyreadstat.read_sav(copy.name, metadataonly=True)
        file.require_size(about.number_rows or 0, about.number_columns or 0, 0)
        return _labelled(lambda labels: pd.read_spss(copy.name, convert_categoricals=labels))
    finally:
        os.unlink(copy.name)


def _labelled(read: Callable[[bool], pd.DataFrame]) -> pd.DataFrame:
    """Return numbers that know the labels of their values, such as the names of fabrics."""
    import pandas as pd

    numbers, labels = read(False), read(True)
    cells = numbers.astype(object)
    for name in numbers.columns:
        pairs = zip(numbers[name], labels[name], strict=True)
        told = [
            SheetNumber(_text_of(x), shown=y) if isinstance(y, str) and not isinstance(x, str) else x for x, y in pairs
        ]
        cells[name] = pd.Series(told, dtype=object, index=cells.index)  # as text, they would lose their labels
    return cells


_STATA = (b"<stata_dta>", *(bytes([k, 1 + order, 1]) for k in range(110, 120) for order in (0, 1)))
_PAGE = (b"<!DOCTYPE", b"<!doctype", b"<html", b"<HTML")
_FORMATS: tuple[tuple[bytes | tuple[bytes, ...], str, Callable[[_File], Any] | None], ...] = (
    (b"PK\x03\x04", "workbook", _zip),
    (b"\x1f\x8b", "compressed", _unpacked(gzip.open)),
    (b"BZh", "compressed", _unpacked(bz2.open)),
    (b"\xfd7zXZ", "compressed", _unpacked(lzma.open)),
    (b"PAR1", "Parquet file", _parquet),
    ((b"ARROW1", b"FEA1"), "Feather file", _frame("read_feather")),
    ((b"$FL2", b"$FL3"), "SPSS file", _spss),
    (
        _STATA,
        "Stata file",
        lambda file: _labelled(lambda named: _frame("read_stata", convert_categoricals=named)(file)),
    ),
    (b"\xd0\xcf\x11\xe0", "an old workbook: save it as .xlsx", None),
    (
        tuple(bytes([0x80, k]) for k in range(2, 6)),
        "a pickle, which could run code: save the table with to_csv or to_parquet",
        None,
    ),
    (b"\x89HDF", "an HDF5 file: save the table as .csv or .parquet", None),
    ((b"RDX", b"RDA", b"X\n\0"), "a file of R: save the table with write.csv", None),
    (b"%PDF", "a PDF: copy the table into a spreadsheet, and save it as .csv", None),
    (_PAGE, "a web page: save its table as .csv", None),
    ((b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"<svg"), "a picture: type its table into a spreadsheet", None),
    (b"SQLite format 3", "a database: save its table as .csv", None),
    (b"\x93NUMPY", "an array of NumPy: save a table with column names as .csv", None),
    (b"MATLAB 5.0", "a MATLAB file: save the table with writetable", None),
    ((b"7z\xbc\xaf", b"Rar!", b"\x28\xb5\x2f\xfd"), "a packed file: unpack it", None),
    (b"{\\rtf", "a text document: save its table as .csv", None),
    (b"<?xml", "an XML file: save its table as .csv", None),
    (b"version https://git-lfs", "a pointer to a file that is not downloaded: run git lfs pull", None),
    ((b"HEADER RECORD*", bytes(12) + b"\xc2\xea\x81\x60"), "a SAS file: save the table as .csv", None),
)
"""First bytes of a file, what it is, and what reads it, if anything does."""


def _json(file: _File) -> pd.DataFrame | None:
    """Return the rows of a JSON file: records, one in each line or in a list, or columns; None for other text."""
    if not re.match(rb"(?:\xef\xbb\xbf)?\s*[\[{]", file.content[:100]):
        return None
    import pandas as pd

    try:
        text = file.content.decode("utf-8-sig")
        try:
            found = parse_json(text)
        except ValueError:
            found = [parse_json(line) for line in text.splitlines() if line.strip()]
    except ValueError as problem:
        if file.path.suffix.casefold() in (".json", ".jsonl", ".ndjson"):
            raise InputError(f"{file.path}: JSON that cannot be read ({problem})") from None
        return None
    if isinstance(found, dict) and len(lists := [one for one in found.values() if isinstance(one, list)]) == 1:
        found = lists[0]
    try:
        if isinstance(found, dict) and {"columns", "data"} <= found.keys():
            return pd.DataFrame(found["data"], columns=found["columns"], dtype=object)
        if isinstance(found, dict) or (found and all(isinstance(one, dict) for one in found)):
            return pd.DataFrame(found, dtype=object)
        raise ValueError
    except (ValueError, TypeError):
        raise InputError(
            f'{file.path}: JSON, expected a list of records such as {{"fabric": "felt", "rating": 5}}'
        ) from None


# text


def _text_sheet(file: _File) -> Sheet:
    """Return the rows of a text file with commas, semicolons, tabs, bars or spaces between cells.

    Raises
    ------
    InputError
        If it is not such a file; the message names file and row.
    """
    text, notes = _decode(file.path, file.content)
    told = re.match('"?sep=([,;\t|])"?\n', text)  # Excel's own line before the header
    if told:
        text = f"\n{text[told.end() :]}"  # a blank row keeps the numbers of the others
    separator = told[1] if told else _separator(text)
    return file.sheet(_rows(file.path, text, separator), between_commas=separator == ",", notes=notes)


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


def _text_of(value: Any) -> str:
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


def _rows_of_frame(frame: pd.DataFrame, place: str, first: int = 0) -> tuple[list[tuple[Sequence[str], int]], str]:
    """Return the rows of a DataFrame, of which a named index is a column, and the SHA-256 of their cells.

    Parameters
    ----------
    frame
        The DataFrame.
    place
        Its name, for errors.
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
    header = [_text_of(title) for title in frame.columns]
    columns = [[_text_of(value) for value in frame.iloc[:, j].to_numpy()] for j in range(frame.shape[1])]
    body = list(zip(*columns, strict=True))
    digest = sha256(repr((header, [[*map(str, row)] for row in body])).encode()).hexdigest()
    return [(header, -1), *((row, k) for k, row in enumerate(body, first))], digest


# workbooks

INSTALL = "pip install 'softness-bayes[tables]'"
"""Command that installs what reads workbooks, Parquet, Feather and SPSS files."""

UNPACKED = 2**26
"""Largest size of an unpacked workbook [bytes]."""


def _workbook_sheets(file: _File) -> dict[str, Sheet]:
    """Return the sheets of a workbook that have cells, with the values of their formulas."""
    import openpyxl

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # styles and validations that openpyxl does not know
        # without read_only, openpyxl makes every cell of merged regions, of links and up to the last cell
        book = openpyxl.load_workbook(io.BytesIO(file.content), data_only=True, read_only=True)
        shown = [sheet for sheet in book.worksheets if sheet.sheet_state == "visible"] or book.worksheets
        read = {sheet.title: _cells(sheet) for sheet in shown}
        hidden = [sheet.title for sheet in book.worksheets if sheet.title not in read]
    said = (f"hidden sheets are not read: {listing(hidden)}",) if hidden else ()
    filled = {name: (rows, (*told, *said)) for name, (rows, told) in read.items() if rows}
    return {
        name: file.sheet(_numbered(rows), f", sheet {name!r}" if len(filled) > 1 else "", notes=notes)
        for name, (rows, notes) in filled.items()
    }


def _numbered(rows: Mapping[int, Mapping[int, str]]) -> Iterator[tuple[list[str], int]]:
    """Yield the cells of each row up to its last one, and its number."""
    for number, cells in sorted(rows.items()):
        yield [cells.get(j, "") for j in range(1, max(cells, default=0) + 1)], number


def _cells(sheet: Any) -> tuple[dict[int, dict[int, str]], tuple[str, ...]]:
    """Return the texts of the cells that exist in a sheet, by row and column from 1, and notes."""
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
    return rows, (*_fill_merged(rows, [CellRange(one.ref) for one in merged]), *told)


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
    text = _text_of(cell.value)
    form = (cell.number_format or "").split(";")[0]
    if isinstance(text, SheetNumber) and "%" in form:
        return SheetNumber(f"{Decimal(f'{100 * Decimal(text):.15g}'):f}%")
    # a format of whole numbers with zeros in front, and text before and after them
    shown = re.fullmatch(r'((?:"[^"]*"|\.|[-_ ])*)(0+)((?:"[^"]*"|\.)*)', form)
    if isinstance(text, SheetNumber) and text.isdigit() and shown:
        before, after = (re.sub(r'"|\\(?=.)', "", part) for part in (shown[1], shown[3]))
        return SheetNumber(text, shown=f"{before}{text.zfill(len(shown[2]))}{after}")
    return text
