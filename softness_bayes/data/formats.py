"""Files of tables in all formats, recognised by their first bytes, and DataFrames: the cells of their sheets."""

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
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeAlias

from softness_bayes.data.delimited import text_sheet
from softness_bayes.data.sheets import MOST_CELLS, Sheet, SheetNumber, sheet_of
from softness_bayes.data.workbooks import INSTALL, cell_text, workbook_sheets
from softness_bayes.errors import InputError, quoted
from softness_bayes.files.json_text import parse_json

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

    def sheet(self, frame: pd.DataFrame, first: int = 0) -> dict[str, Sheet]:
        """Return a DataFrame that was read from the file as its only sheet, with the number of its first row."""
        return {"": frame_sheet(frame, str(self.path), self.path.name, self.digest, first)}

    def require_size(self, rows: int, columns: int, size: int) -> None:
        """Raise an error for a table that is too large."""
        if rows * columns > MOST_CELLS or size > LARGEST:
            raise InputError(
                f"{self.path}: {rows} rows of {columns} columns with {size >> 20} MB, expected at most "
                f"{MOST_CELLS} cells and {LARGEST >> 20} MB"
            )


_Reader: TypeAlias = Callable[[_File], "_File | dict[str, Sheet]"]
"""Returns the sheets of a file by name, or the file in it."""


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
        read = next((read for starts, read in _FORMATS if file.content.startswith(starts)), None)
        found = file if read is None else read(file)
        if isinstance(found, dict):
            return found
        file = found
    return _json_sheet(file) or {"": text_sheet(path, file.content, file.digest)}


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


def _unpacked(open_file: Callable[[IO[bytes]], Any]) -> Callable[[_File], _File]:
    def unpack(file: _File) -> _File:
        try:
            content = open_file(io.BytesIO(file.content)).read(LARGEST + 1)
        except Exception as error:  # damaged archives end in errors of many kinds
            raise InputError(f"{file.path}: a compressed file that cannot be unpacked ({error})") from None
        if len(content) > LARGEST:
            raise InputError(f"{file.path}: unpacks to more than {LARGEST >> 20} MB, expected a table")
        return file._replace(content=content)

    return unpack


def _zip(file: _File) -> _File | dict[str, Sheet]:
    """Return the sheets of a workbook, or the one file of an archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
            names = archive.namelist()
    except Exception:
        names = ["xl/"]  # the message is that of a workbook
    if any(name.startswith(("xl/", "[Content")) for name in names):
        return workbook_sheets(file.path, file.content, file.digest)
    if "mimetype" in names:
        return _refuse("an OpenDocument file: save the table as .xlsx or .csv")(file)
    if len(names) != 1:
        raise InputError(f"{file.path}: an archive of {len(names)} files, expected one table")
    return _unpacked(lambda content: zipfile.ZipFile(content).open(names[0]))(file)


def _refuse(what: str) -> Callable[[_File], Any]:
    def refuse(file: _File) -> Any:
        raise InputError(f"{file.path}: this is {what}")

    return refuse


def _by_library(read: Callable[[_File], Any], what: str) -> Callable[[_File], dict[str, Sheet]]:
    """Return a reader of DataFrames by an optional library."""

    def sheets(file: _File) -> dict[str, Sheet]:
        try:
            return file.sheet(read(file))
        except ImportError as error:
            missing = error.name or "pyarrow"
            raise InputError(
                f"{file.path}: {what} files are read with {missing}, which is not installed: {INSTALL}"
            ) from None
        except InputError:
            raise
        except Exception as error:  # these libraries have errors of many kinds
            raise InputError(f"{file.path}: not a {what} file that can be read ({type(error).__name__})") from None

    return sheets


def _parquet(file: _File) -> Any:
    import pandas as pd
    import pyarrow.parquet

    about = pyarrow.parquet.ParquetFile(io.BytesIO(file.content)).metadata
    size = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
    file.require_size(about.num_rows, about.num_columns, size)
    return pd.read_parquet(io.BytesIO(file.content), engine="pyarrow")


def _feather(file: _File) -> Any:
    import pyarrow.feather

    return pyarrow.feather.read_feather(io.BytesIO(file.content))


def _spss(file: _File) -> Any:
    import pandas as pd
    import pyreadstat

    with tempfile.NamedTemporaryFile(suffix=".sav", delete=False) as copy:
        copy.write(file.content)  # it reads from a path only
    try:
        _, about = pyreadstat.read_sav(copy.name, metadataonly=True)
        file.require_size(about.number_rows or 0, about.number_columns or 0, 0)
        return _labelled(*(pd.read_spss(copy.name, convert_categoricals=named) for named in (False, True)))
    finally:
        os.unlink(copy.name)


def _stata(file: _File) -> Any:
    import pandas as pd

    return _labelled(*(pd.read_stata(io.BytesIO(file.content), convert_categoricals=named) for named in (False, True)))


def _labelled(numbers: pd.DataFrame, labels: pd.DataFrame) -> pd.DataFrame:
    """Return numbers that know the labels of their values, such as the names of fabrics."""
    import pandas as pd

    cells = numbers.astype(object)
    for name in numbers.columns:
        pairs = zip(numbers[name], labels[name], strict=True)
        told = [
            SheetNumber(cell_text(x), shown=y) if isinstance(y, str) and not isinstance(x, str) else x for x, y in pairs
        ]
        cells[name] = pd.Series(told, dtype=object, index=cells.index)  # as text, they would lose their labels
    return cells


_FORMATS: Sequence[tuple[bytes | tuple[bytes, ...], _Reader]] = (
    (b"PK\x03\x04", _zip),
    (b"\x1f\x8b", _unpacked(lambda content: gzip.GzipFile(fileobj=content))),
    (b"BZh", _unpacked(bz2.BZ2File)),
    (b"\xfd7zXZ", _unpacked(lzma.LZMAFile)),
    (b"PAR1", _by_library(_parquet, "Parquet")),
    ((b"ARROW1", b"FEA1"), _by_library(_feather, "Feather")),
    ((b"$FL2", b"$FL3"), _by_library(_spss, "SPSS")),
    (
        (b"<stata_dta>", *(bytes([k, 1 + order, 1]) for k in range(110, 120) for order in (0, 1))),
        _by_library(_stata, "Stata"),
    ),
    (b"\xd0\xcf\x11\xe0", _refuse("an old workbook: save it as .xlsx")),
    (
        tuple(bytes([0x80, k]) for k in range(2, 6)),
        _refuse("a pickle, which could run code: save the table with to_csv or to_parquet"),
    ),
    (b"\x89HDF", _refuse("an HDF5 file: save the table as .csv or .parquet")),
    ((b"RDX", b"RDA"), _refuse("a file of R: save the table with write.csv")),
    (b"%PDF", _refuse("a PDF: copy the table into a spreadsheet, and save it as .csv")),
    ((b"<!DOCTYPE", b"<!doctype", b"<html", b"<HTML"), _refuse("a web page: save its table as .csv")),
)
"""First bytes of a file, and what reads it."""


def _json_sheet(file: _File) -> dict[str, Sheet] | None:
    """Return the rows of a JSON file: records, one in each line or in a list, or columns; None for other text."""
    import pandas as pd

    if not re.match(rb"(?:\xef\xbb\xbf)?\s*[\[{]", file.content[:100]):
        return None
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
            frame = pd.DataFrame(found["data"], columns=found["columns"], dtype=object)
        elif isinstance(found, dict) or (found and all(isinstance(one, dict) for one in found)):
            frame = pd.DataFrame(found, dtype=object)
        else:
            raise ValueError
    except (ValueError, TypeError):
        raise InputError(
            f'{file.path}: JSON, expected a list of records such as {{"fabric": "felt", "rating": 5}}'
        ) from None
    return file.sheet(frame, first=1)


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
    digest = digest or hashlib.sha256(repr((header, [[*map(str, row)] for row in body])).encode()).hexdigest()
    return sheet_of([(header, -1), *((row, k) for k, row in enumerate(body, first))], place, label or place, digest)
