"""File of a result: groups, tables, and checksums to detect changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from softness_bayes import arviz_bridge
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.spreadsheet import table_of
from softness_bayes.results.checksums import CHECKSUMS, Changes, changes, checksums
from softness_bayes.results.seal import is_broken, seal_of
from softness_bayes.supplied import require_trusted

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SCHEMA = 2
"""Version of the layout; newer versions are rejected on reading. The first had neither tables nor checksums."""

SUMMARY_TABLE = "summary"
"""Name of the table that every result has."""

TABLES = "tables"
"""Group of the tables, each as JSON of its columns, so that no change of a CSV file matters."""


class FileContents(NamedTuple):
    """Contents of a file."""

    tree: xr.DataTree
    tables: dict[str, pd.DataFrame]
    verified: bool
    """True if the checksums show no change."""


def content_of(tree: xr.DataTree, tables: Mapping[str, pd.DataFrame]) -> bytes:
    """Return the content of the file of a result: its groups and tables, with checksums of each part and of all."""
    import xarray as xr

    text = xr.Dataset({name: ((), _text_of(table)) for name, table in tables.items()})
    whole = tree.assign({TABLES: xr.DataTree(text)})
    whole.attrs = {**tree.attrs, "schema_version": SCHEMA}
    whole.attrs[CHECKSUMS] = checksums(whole)
    return arviz_bridge.netcdf(whole, seal_of)


def read(
    path: Path, index: Mapping[str, str | list[str]], verify: bool = True, trust_code: bool = False
) -> FileContents:
    """Read a file into memory.

    Parameters
    ----------
    path
        The file.
    index
        For a file of the first layout, tables that may exist next to it as CSV, with the columns that identify a row.
    verify
        Whether to reject a file that was changed since it was written.
    trust_code
        As for `require_trusted`.

    Raises
    ------
    InputError
        If it cannot be read, was changed, is not the file of a result that this version knows, or names code that is
        not trusted.
    """
    if verify:
        _require_whole(path)
    try:
        tree = arviz_bridge.read_netcdf(path)
    except Exception as error:  # HDF5 and the libraries above it have no common error class
        raise InputError(f"{path}: not a readable result ({error!s:.200})") from None
    schema = _schema(path, tree)
    _require_trusted(path, tree, trust_code)
    if schema == 1:
        return FileContents(tree, _old_tables(path, index), False)
    if verify:
        _require_unchanged(path, changes(tree))
    tables = _tables(path, tree)
    rest = tree.filter(lambda node: node.name != TABLES)
    rest.attrs = {name: value for name, value in tree.attrs.items() if name != CHECKSUMS}
    return FileContents(rest, tables, verify)


def _require_whole(path: Path) -> None:
    try:
        broken = is_broken(path)
    except OSError as error:
        raise InputError(f"{path}: not a readable result ({error!s:.200})") from None
    if broken:
        raise InputError(
            f"{path}: damaged since it was written: it does not have the checksum that stands at its end; restore it "
            "from a copy, or delete it, and 'softness-bayes resume' writes it again from the checkpoint of the run"
        )


def _require_unchanged(path: Path, found: Changes) -> None:
    said = [f"{what} {_listed(parts)}" for what, parts in zip(("no", "changed or added"), found, strict=True) if parts]
    if said:
        raise InputError(
            f"{path}: damaged, or changed since it was written: {', '.join(said)}; restore the file from a "
            f"copy, or, if the change was intended, accept it in Python: Result.load({str(path)!r}, "
            "verify=False).save(DIRECTORY)"
        )


def _schema(path: Path, tree: xr.DataTree) -> int:
    """Return the version of the layout of a file that has one."""
    if "posterior" not in tree.children or "schema_version" not in tree.attrs:
        raise InputError(f"{path}: not a result of softness-bayes: no posterior or no schema version")
    schema = tree.attrs["schema_version"]
    if not isinstance(schema, (int, np.integer)) or schema < 1:
        raise InputError(f"{path}: schema {schema!r:.40}, expected a number from 1 to {SCHEMA}")
    if schema > SCHEMA:
        raise InputError(
            f"{path}: schema {schema} is newer than {SCHEMA}, the latest that this version reads; read it with "
            "the version of softness-bayes that wrote it, or a later one"
        )
    return int(schema)


def _require_trusted(path: Path, tree: xr.DataTree, trust_code: bool) -> None:
    """Check the names of code in the attributes and in variables of text, such as the laws of fabrics' moduli."""
    groups = [node.to_dataset() for name, node in tree.children.items() if name != TABLES]
    texts = [v.values.ravel() for group in groups for v in group.data_vars.values() if v.dtype.kind not in "biufc"]
    attributes = {name: value for name, value in tree.attrs.items() if name != CHECKSUMS}
    require_trusted(str(path), [attributes, *texts], trust_code)


def _listed(parts: Sequence[str], most: int = 3) -> str:
    return ", ".join(parts[:most]) + (f" and {len(parts) - most} more" if len(parts) > most else "")


def _text_of(table: pd.DataFrame) -> str:
    columns = table.reset_index().to_dict("list")
    return as_json({"index": list(table.index.names), "columns": columns}, "table")


def _tables(path: Path, tree: xr.DataTree) -> dict[str, pd.DataFrame]:
    import pandas as pd

    if TABLES not in tree.children or SUMMARY_TABLE not in tree[TABLES].data_vars:
        raise InputError(f"{path}: no table {SUMMARY_TABLE!r} in group {TABLES!r}")
    tables = {}
    for name, text in tree[TABLES].data_vars.items():
        try:
            found: dict[str, Any] = parse_json(str(text.values))
            tables[str(name)] = pd.DataFrame(found["columns"]).set_index(found["index"])
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{path}: {name!r} of group {TABLES!r} is not a table") from None
    return tables


def _old_tables(path: Path, every: Mapping[str, str | list[str]]) -> dict[str, pd.DataFrame]:
    tables = {}
    for name, index in every.items():
        file = path.with_name(f"{name}.csv")
        if not file.is_file():
            if name == SUMMARY_TABLE:
                raise InputError(
                    f"{file}: no such file; a result of schema 1 needs its {SUMMARY_TABLE} in the same folder "
                    f"as {path.name}"
                )
            continue
        try:
            tables[name] = table_of(file, index)
        except (OSError, ValueError, KeyError) as error:  # no text, no table, or no such column
            raise InputError(
                f"{file}: not the table that was written with {path.name} ({error}); was it saved by a "
                "spreadsheet program?"
            ) from None
    return tables
