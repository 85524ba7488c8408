"""Files of tables in all formats, recognised by their first bytes, and DataFrames."""

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
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeAlias

from softness_bayes.data.columns import key, summarises
from softness_bayes.data.delimited import LARGEST, content_of, text_grid
from softness_bayes.data.faults import listing
from softness_bayes.data.headers import Sought, understood
from softness_bayes.data.rules import sheet_of
from softness_bayes.data.sheets import MOST_CELLS, Grid, Sheet, SheetNumber, grid_of
from softness_bayes.data.workbooks import INSTALL, cell_text, workbook_grids
from softness_bayes.errors import InputError, quoted
from softness_bayes.files.json_text import as_json, parse_json

if TYPE_CHECKING:
    import pandas as pd

    TableSource: TypeAlias = str | Path | pd.DataFrame
else:
    TableSource = object
"""A file or a DataFrame."""


class _File(NamedTuple):
    """A file: its path, its bytes, unpacked if they were compressed, and the SHA-256 of all of them."""

    path: Path
    content: bytes
    digest: str


def read_sheet(source: TableSource, sought: Sought, renames: Mapping[str, str]) -> Sheet:
    """Return the sheet of a file or DataFrame that has the columns looked for.

    Raises
    ------
    InputError
        If the file cannot be read, or it is not clear which of its sheets is meant.
    """
    if not isinstance(source, (str, os.PathLike)):
        return sheet_of(_frame_grid(_require_frame(source), f"DataFrame of {sought.sheet}"), sought.sheet)
    path = Path(source)
    grids = _grids(path)
    if len(grids) == 1:
        return sheet_of(next(iter(grids.values())), sought.sheet)
    return _chosen(path, _sheets(grids, sought), sought, renames)


def has_sheet(source: str | Path, sought: Sought, renames: Mapping[str, str]) -> bool:
    """Return whether a workbook of several sheets has one for the columns looked for."""
    path = Path(source)
    content = content_of(path) if os.path.isfile(path) else b""
    if not content.startswith(b"PK"):
        return False
    grids = _grids(path)
    return len(grids) > 1 and len(_candidates(_sheets(grids, sought), sought, renames)) == 1


def _sheets(grids: Mapping[str, Grid], sought: Sought) -> dict[str, Sheet]:
    """Return the sheets of a workbook, each read as the table looked for, without those that are none."""
    found = {}
    for name, grid in grids.items():
        try:
            found[name] = sheet_of(grid, sought.sheet)
        except InputError:
            if key(name) == sought.sheet:
                raise
    return found


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
        return {*understood(sheet, renames, sought).at}
    except InputError:
        return set()


def _chosen(path: Path, sheets: Mapping[str, Sheet], sought: Sought, renames: Mapping[str, str]) -> Sheet:
    """Return the one sheet of a workbook that is meant, or several of one form below each other."""
    if not sheets:
        raise InputError(f"{path}: the workbook is empty, expected a header and rows")
    chosen = list(sheets) if len(sheets) == 1 else _candidates(sheets, sought, renames)
    if len(chosen) == 1:
        return sheets[chosen[0]]
    headers = {frozenset(title.casefold() for title in sheets[name].header) for name in chosen}
    if len(chosen) > 1 and len(headers) == 1:
        return _stacked(path, {name: sheets[name] for name in chosen}, sought, renames)
    raise InputError(
        f"{path}: {len(chosen) or 'none'} of the sheets {listing([quoted(name) for name in sheets])} may "
        f"contain the {sought.sheet}; rename the right one to {sought.sheet!r}"
    )


def _stacked(path: Path, sheets: Mapping[str, Sheet], sought: Sought, renames: Mapping[str, str]) -> Sheet:
    """Return the rows of several sheets with the same titles, whose names are the participants if no column is."""
    left = [name for name in sheets if summarises(name)]
    kept = {name: sheet for name, sheet in sheets.items() if name not in left}
    first = next(iter(kept.values()))
    people = "participant" in sought.names and "participant" not in _understood(first, sought, renames)
    title = "participant" if people else "sheet"
    titles = [text.casefold() for text in first.header]
    body: list[list[str]] = []
    rows: list[int] = []
    for name, sheet in kept.items():
        order = [[text.casefold() for text in sheet.header].index(text) for text in titles]
        body += [[name, *(row[j] for j in order)] for row in sheet.body]
        rows += sheet.rows
    grid = grid_of(
        [([title, *first.header], -1), *zip(body, rows, strict=True)],
        f"{path}, sheets {listing([quoted(name) for name in kept])}",
        path.name,
        first.digest,
        notes=[
            *dict.fromkeys(note for sheet in kept.values() for note in sheet.notes),
            f"{len(kept)} sheets are read below each other; their names are the column {title!r}",
            *([f"sheets of statistics are left out: {listing(left)}"] if left else []),
        ],
    )
    return sheet_of(grid, sought.sheet)


# formats


def _grids(path: Path) -> dict[str, Grid]:
    """Return the rows of each sheet of a file; a text file has one."""
    content = content_of(path)
    file = _File(path, content, hashlib.sha256(content).hexdigest())
    for _ in range(2):  # a compressed file may hold a workbook
        for starts, read in _FORMATS:
            if file.content.startswith(starts):
                found = read(file)
                if isinstance(found, dict):
                    return found
                file = found
                break
        else:
            break
    grid = _json_grid(file)
    return {"": text_grid(path, file.content, file.digest) if grid is None else grid}


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


def _zip(file: _File) -> _File | dict[str, Grid]:
    """Return the sheets of a workbook, or the one file of an archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
            names = archive.namelist()
    except Exception:
        names = ["xl/"]  # the message is that of a workbook
    if any(name.startswith(("xl/", "[Content")) for name in names):
        return workbook_grids(file.path, file.content, file.digest)
    if "mimetype" in names:
        return _refuse("an OpenDocument file: save the table as .xlsx or .csv")(file)
    if len(names) != 1:
        raise InputError(f"{file.path}: an archive of {len(names)} files, expected one table")
    return _unpacked(lambda content: zipfile.ZipFile(content).open(names[0]))(file)


def _refuse(what: str) -> Callable[[_File], Any]:
    def refuse(file: _File) -> Any:
        raise InputError(f"{file.path}: this is {what}")

    return refuse


def _arrow(read: Callable[[_File], Any], what: str) -> Callable[[_File], dict[str, Grid]]:
    """Return a reader of frames by an optional library."""

    def frames(file: _File) -> dict[str, Grid]:
        try:
            frame = read(file)
        except ImportError as error:
            missing = error.name or "pyarrow"
            raise InputError(
                f"{file.path}: {what} files are read with {missing}, which is not installed: {INSTALL}"
            ) from None
        except InputError:
            raise
        except Exception as error:  # these libraries have errors of many kinds
            raise InputError(f"{file.path}: not a {what} file that can be read ({type(error).__name__})") from None
        return {"": _frame_grid(frame, str(file.path), file.path.name, file.digest)}

    return frames


def _require_size(file: _File, rows: int, columns: int, size: int) -> None:
    if rows * columns > MOST_CELLS or size > LARGEST:
        raise InputError(
            f"{file.path}: {rows} rows of {columns} columns with {size >> 20} MB, expected at most "
            f"{MOST_CELLS} cells and {LARGEST >> 20} MB"
        )


def _parquet(file: _File) -> Any:
    import pandas as pd
    import pyarrow.parquet

    about = pyarrow.parquet.ParquetFile(io.BytesIO(file.content)).metadata
    size = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
    _require_size(file, about.num_rows, about.num_columns, size)
    return pd.read_parquet(io.BytesIO(file.content), engine="pyarrow")


def _feather(file: _File) -> Any:
    import pyarrow.feather
    import pyarrow.ipc

    if file.content.startswith(b"ARROW1"):
        reader = pyarrow.ipc.open_file(io.BytesIO(file.content))
        rows = 0
        for k in range(reader.num_record_batches):
            batch = reader.get_batch(k)
            rows += batch.num_rows
            _require_size(file, rows, len(reader.schema), batch.nbytes)
        return reader.read_pandas()
    return pyarrow.feather.read_feather(io.BytesIO(file.content))


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


def _spss(file: _File) -> Any:
    import pandas as pd
    import pyreadstat

    with tempfile.NamedTemporaryFile(suffix=".sav", delete=False) as copy:
        copy.write(file.content)  # it reads from a path only
    try:
        _, about = pyreadstat.read_sav(copy.name, metadataonly=True)
        _require_size(file, about.number_rows or 0, about.number_columns or 0, 0)
        return _labelled(*(pd.read_spss(copy.name, convert_categoricals=named) for named in (False, True)))
    finally:
        os.unlink(copy.name)


def _stata(file: _File) -> Any:
    import pandas as pd

    return _labelled(*(pd.read_stata(io.BytesIO(file.content), convert_categoricals=named) for named in (False, True)))


_FORMATS: Sequence[tuple[bytes | tuple[bytes, ...], Callable[[_File], Any]]] = (
    (b"PK\x03\x04", _zip),
    (b"\x1f\x8b", _unpacked(lambda content: gzip.GzipFile(fileobj=content))),
    (b"BZh", _unpacked(bz2.BZ2File)),
    (b"\xfd7zXZ", _unpacked(lzma.LZMAFile)),
    (b"PAR1", _arrow(_parquet, "Parquet")),
    ((b"ARROW1", b"FEA1"), _arrow(_feather, "Feather")),
    ((b"$FL2", b"$FL3"), _arrow(_spss, "SPSS")),
    (
        (b"<stata_dta>", *(bytes([k, 1 + order, 1]) for k in range(110, 120) for order in (0, 1))),
        _arrow(_stata, "Stata"),
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
"""First bytes of a file, and what reads it: the rows of its sheets, or the file in it."""


def _json_grid(file: _File) -> Grid | None:
    """Return the rows of a JSON file: records, one in each line or in a list, or columns; None for other text."""
    if not re.match(rb"(?:\xef\xbb\xbf)?\s*[\[{]", file.content[:100]):
        return None
    named = file.path.suffix.casefold() in (".json", ".jsonl", ".ndjson")
    try:
        found = parse_json(file.content.decode("utf-8-sig"))
    except ValueError as problem:
        try:
            lines = file.content.decode("utf-8-sig").splitlines()
            found = [parse_json(line) for line in lines if line.strip()]
        except ValueError:
            if named:
                raise InputError(f"{file.path}: JSON that cannot be read ({problem})") from None
            return None
    if isinstance(found, dict) and len(lists := [one for one in found.values() if isinstance(one, list)]) == 1:
        found = lists[0]
    if isinstance(found, dict) and isinstance(found.get("columns"), list) and isinstance(found.get("data"), list):
        found = [dict(zip(found["columns"], row, strict=False)) for row in found["data"] if isinstance(row, list)]
    elif isinstance(found, dict) and found and all(isinstance(one, list) for one in found.values()):
        found = [dict(zip(found, row, strict=False)) for row in zip(*found.values(), strict=False)]
    if not (isinstance(found, list) and found and all(isinstance(one, dict) for one in found)):
        raise InputError(f'{file.path}: JSON, expected a list of records such as {{"fabric": "felt", "rating": 5}}')
    header = [*dict.fromkeys(str(name) for record in found for name in record)]
    body = [[_json_text(record.get(name)) for name in header] for record in found]
    return grid_of(
        [(header, -1), *((row, k) for k, row in enumerate(body, 1))], str(file.path), file.path.name, file.digest
    )


def _json_text(value: Any) -> str:
    return as_json(value, "a cell") if isinstance(value, (dict, list)) else cell_text(value)


def _require_frame(source: object) -> pd.DataFrame:
    import pandas as pd

    if not isinstance(source, pd.DataFrame):
        raise InputError(f"expected the path of a table or a pandas DataFrame, got {type(source).__name__}")
    return source


def _frame_grid(frame: pd.DataFrame, place: str, label: str = "", digest: str = "") -> Grid:
    """Return the rows of a DataFrame; rows are counted from 0, as `iloc` counts them.

    Parameters
    ----------
    frame
        The columns; a named index is one too.
    place, label
        As of `Grid`.
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
    return grid_of([(header, -1), *((row, k) for k, row in enumerate(body))], place, label or place, digest)
