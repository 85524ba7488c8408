"""File of a result: groups, tables, and a checksum of all of it at its end.

HDF5 trusts what it reads. A single damaged byte can send it into an endless loop
(https://github.com/HDFGroup/hdf5/issues/1707) or end the process. The checksum is therefore verified before any library
reads the file. HDF5 does not read beyond the end that it has noted itself, so that every program opens the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softness_bayes import arviz_bridge
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.whole import seal_of, unsealed
from softness_bayes.supplied import require_trusted

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SCHEMA = 1
"""Version of the layout, the only one that is read."""

SUMMARY_TABLE = "summary"
"""Name of the table that every result has."""

TABLES = "table_data"
"""Group of the tables, each as JSON of its columns, so that no change of a CSV file matters."""


def content_of(tree: xr.DataTree, tables: Mapping[str, pd.DataFrame]) -> bytes:
    """Return the content of the file of a result: its groups and tables, and the checksum of all."""
    import xarray as xr

    text = xr.Dataset({name: ((), _text_of(table)) for name, table in tables.items()})
    whole = tree.assign({TABLES: xr.DataTree(text)})
    whole.attrs = {**tree.attrs, "schema_version": float(SCHEMA)}
    return arviz_bridge.netcdf(whole, seal_of)


def read(path: Path, verify: bool = True, trust_code: bool = False) -> tuple[xr.DataTree, dict[str, pd.DataFrame]]:
    """Read the groups and the tables of a file into memory.

    Parameters
    ----------
    path
        The file.
    verify
        Whether to reject a file that was changed since it was written.
    trust_code
        As for `require_trusted`.

    Raises
    ------
    InputError
        If it cannot be read, was changed, is not the file of a result of this schema, or names code that is not
        trusted.
    """
    try:
        if verify and unsealed(path.read_bytes()) is None:
            raise InputError(
                f"{path}: damaged, or changed since it was written: it does not end with its checksum; restore it from "
                "a copy, or delete it, and 'softness-bayes resume' writes it again from the checkpoint of the run; if "
                f"the change was intended, accept it in Python: Result.load({str(path)!r}, verify=False)"
                ".save(DIRECTORY)"
            )
        tree = arviz_bridge.read_netcdf(path)
    except InputError:
        raise
    except Exception as error:  # HDF5 and the libraries above it have no common error class
        raise InputError(f"{path}: not a readable result ({error!s:.200})") from None
    schema = tree.attrs.get("schema_version")
    if "posterior" not in tree.children or schema is None:
        raise InputError(f"{path}: not a result of softness-bayes: no posterior or no schema version")
    if schema != SCHEMA:
        raise InputError(
            f"{path}: schema {schema!r:.40}, expected {SCHEMA}, the only one that this version reads; read it with the "
            "version of softness-bayes that wrote it"
        )
    groups = tree.filter(lambda node: node.name != TABLES)
    groups.attrs = dict(tree.attrs)
    # text variables that are no labels: laws of the fabrics' moduli
    variables = [v for node in groups.children.values() for v in node.data_vars.values()]
    texts = [v.values.ravel() for v in variables if v.dtype.kind not in "biufc"]
    require_trusted(str(path), [groups.attrs, *texts], trust_code)
    return groups, _tables(path, tree)


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
