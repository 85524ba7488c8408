"""Lists that commands read: the tables of a study, and fabrics in an observed order."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.data import FABRICS_BESIDE
from softness_bayes.data.columns import ORDER, Request
from softness_bayes.data.reading import read_table, read_titled
from softness_bayes.data.sheets import TableSource
from softness_bayes.data.texts import Marks

COLUMNS = ("table", "data", "fabrics", "compression")
"""Columns of such a file: a name, and paths from the file's own folder on."""

RATINGS = "ratings.csv"
"""Table of ratings in a folder of its own, which has that folder's name."""

SUFFIXES = (".csv", ".tsv", ".txt", ".xlsx", ".xlsm", ".parquet", ".pq")
"""Suffixes of the files that count as tables in a folder."""

COMPRESSION_BESIDE = "compression.csv"
"""Table of forces that `simulate` leaves beside ratings, which is not a table of ratings."""

_NAME = re.compile(r"\w[\w.+-]*")


class Listed(NamedTuple):
    """One table of a study, by its files."""

    name: str
    data: Path | None
    fabrics: Path | None = None
    compression: Path | None = None


def list_tables(source: Path) -> list[Listed]:
    """Return the tables of a study, in the order of the file, or by name.

    Parameters
    ----------
    source
        A file with the columns `COLUMNS`, of which only `data` or `compression` is needed; or a folder, whose tables
        are the files with one of `SUFFIXES`, but for ``fabrics.csv`` and ``compression.csv``, and the folders with a
        ``ratings.csv``.

    Raises
    ------
    InputError
        If there is none, a column or a cell is missing, or a name is given twice or cannot be a folder's.
    """
    found = _of_folder(source) if source.is_dir() else _of_file(source)
    if not found:
        raise InputError(
            f"{source}: no table in this folder; expected files such as P01.csv, or folders with {RATINGS}"
        )
    seen: set[str] = set()
    for one in found:
        if not _NAME.fullmatch(one.name):
            raise InputError(
                f"{source}: table {quoted(one.name)}: expected a name of letters, digits, '_', '-', '+' and "
                "'.', because it becomes the name of a folder"
            )
        if one.name.casefold() in seen:
            raise InputError(f"{source}: table {quoted(one.name)} is listed twice")
        seen.add(one.name.casefold())
    return found


def _of_folder(folder: Path) -> list[Listed]:
    beside = {FABRICS_BESIDE, COMPRESSION_BESIDE}
    found = []
    for path in sorted(folder.iterdir()):
        if path.is_dir() and (path / RATINGS).is_file():
            found.append(Listed(path.name, path / RATINGS))
        elif path.is_file() and path.suffix.casefold() in SUFFIXES and path.name not in beside and path.name[0] != ".":
            found.append(Listed(path.stem, path))
    return found


def _of_file(path: Path) -> list[Listed]:
    table = read_titled(path, ORDER, {})
    cells = {title.casefold(): texts for title, texts in table.cells.items()}
    if unknown := [title for title in cells if title and title not in COLUMNS]:
        raise InputError(f"{table.header}: column {quoted(unknown[0])}; expected some of {', '.join(COLUMNS)}")
    if not {"data", "compression"} & {*cells}:
        raise InputError(f"{table.header}: no column 'data'; expected some of {', '.join(COLUMNS)}")
    found = []
    for i, row in enumerate(table.rows):
        texts = {title: str(column[i]) for title, column in cells.items()}
        paths = {name: path.parent / texts[name] if texts.get(name) else None for name in COLUMNS[1:]}
        given = paths["data"] or paths["compression"]
        if given is None:
            raise InputError(f"{table.place}: row {row}, column 'data': is empty, expected the path of a table")
        found.append(Listed(texts.get("table") or given.stem, **paths))
    return found


def read_order(path: TableSource, decimal: Marks = None) -> dict[str, float]:
    """Return a rank for each fabric in a table, smaller for softer ones; several rows are averaged.

    Parameters
    ----------
    path
        Table with the columns `fabric`, and `rank` (1 for the softest) or `rating` (higher for softer).
    decimal
        Decimal mark, "," or "."; by default inferred from the file, which is rejected if ambiguous.

    Raises
    ------
    InputError
        If a column or a cell is missing, or there are both ranks and ratings.
    """
    table = read_table(path, Request(ORDER, {}, decimal))
    table.require("fabric")
    given = [name for name in ("rank", "rating") if name in table]
    if len(given) != 1:
        raise InputError(f"{table.place}: expected a column 'rank' or a column 'rating', but not both")
    values = table.numbers(given[0])
    for i in np.flatnonzero(np.isnan(values)).tolist():
        table.problem(i, given[0], "is empty")
    labels = np.array(table.labels("fabric"))
    table.check()
    sign = 1.0 if given == ["rank"] else -1.0
    return {str(name): sign * float(values[labels == name].mean()) for name in dict.fromkeys(labels.tolist())}
