"""Files of tables in all formats, recognised by their first bytes: the cells of their sheets."""

from __future__ import annotations

import bz2
import gzip
import hashlib
import io
import lzma
import os
import re
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.files.records import parse_json
from softness_bayes.data.decimals import SheetNumber
from softness_bayes.data.sheets import (
    INSTALL,
    MOST_CELLS,
    Sheet,
    cell_text,
    frame_sheet,
    text_sheet,
    workbook_sheets,
)

if TYPE_CHECKING:
    import pandas as pd

    TableSource: TypeAlias = str | Path | pd.DataFrame
else:
    TableSource = object
"""A file or a DataFrame."""

LARGEST = 2**28
"""Largest size of a table's file, also when it is unpacked [bytes]."""


class _File(NamedTuple):
    """A file: its path, its bytes, unpacked if they were compressed, and the SHA-256 of all of them."""

    path: Path
    content: bytes
    digest: str

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
        return {"": frame_sheet(source, f"DataFrame of {kind}")}
    path = Path(source)
    content = _content(path)
    file = _File(path, content, hashlib.sha256(content).hexdigest())
    for _ in range(2):  # a compressed file may hold a workbook
        what, read = next(
            ((what, read) for starts, what, read in _FORMATS if file.content.startswith(starts)), ("", None)
        )
        if what and read is None:
            raise InputError(f"{path}: this is {what}")
        found = _opened(file, what, read) if read else None
        if isinstance(found, bytes) and len(found) > LARGEST:
            raise InputError(f"{path}: unpacks to more than {LARGEST >> 20} MB, expected a table")
        if isinstance(found, dict):
            return found
        if found is None:
            break
        if not isinstance(found, bytes):
            return {"": frame_sheet(found, str(path), path.name, file.digest)}
        file = file._replace(content=found)
    frame = _json(file)
    if frame is not None:
        return {"": frame_sheet(frame, str(path), path.name, file.digest, first=1)}
    return {"": text_sheet(path, file.content, file.digest)}


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
        raise InputError(
            f"{file.path}: {what} files are read with {missing}, which is not installed: {INSTALL}"
        ) from None
    except InputError:
        raise
    except Exception as error:  # damaged files end in errors of many kinds
        if what == "compressed":
            raise InputError(f"{file.path}: a compressed file that cannot be unpacked ({error})") from None
        raise InputError(f"{file.path}: not a {what} file that can be read ({type(error).__name__})") from None


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
    try:
        with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
            names = archive.namelist()
            if any(name.startswith("xl/") for name in names):
                return workbook_sheets(file.path, file.content, file.digest)
            for mark, what in _DOCUMENTS.items():
                if any(name.startswith(mark) for name in names):
                    raise InputError(f"{file.path}: this is {what}: save its table as .xlsx or .csv")
            if len(names) != 1:
                raise InputError(f"{file.path}: an archive of {len(names)} files, expected one table")
            return archive.open(names[0]).read(LARGEST + 1)
    except zipfile.BadZipFile:
        return workbook_sheets(file.path, file.content, file.digest)


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
            SheetNumber(cell_text(x), shown=y) if isinstance(y, str) and not isinstance(x, str) else x for x, y in pairs
        ]
        cells[name] = pd.Series(told, dtype=object, index=cells.index)  # as text, they would lose their labels
    return cells


_STATA = (b"<stata_dta>", *(bytes([k, 1 + order, 1]) for k in range(110, 120) for order in (0, 1)))
_PAGE = (b"<!DOCTYPE", b"<!doctype", b"<html", b"<HTML")
_FORMATS: tuple[tuple[bytes | tuple[bytes, ...], str, Callable[[_File], Any] | None], ...] = (
    (b"PK\x03\x04", "compressed", _zip),
    (b"\x1f\x8b", "compressed", _unpacked(gzip.open)),
    (b"BZh", "compressed", _unpacked(bz2.open)),
    (b"\xfd7zXZ", "compressed", _unpacked(lzma.open)),
    (b"PAR1", "Parquet", _parquet),
    ((b"ARROW1", b"FEA1"), "Feather", _frame("read_feather")),
    ((b"$FL2", b"$FL3"), "SPSS", _spss),
    (_STATA, "Stata", lambda file: _labelled(lambda named: _frame("read_stata", convert_categoricals=named)(file))),
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
