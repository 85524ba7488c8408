"""Stored run: its groups, tables and provenance, in a file that ends with the checksum of all of it.

HDF5 trusts what it reads. A single damaged byte can send it into an endless loop
(https://github.com/HDFGroup/hdf5/issues/1707) or end the process. The checksum is therefore verified before any library
reads the file. HDF5 does not read beyond the end that it has noted itself, so that every program opens the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base import arviz_bridge
from softness_bayes.base.errors import InputError
from softness_bayes.base.files.records import as_json, parse_json, require_trusted
from softness_bayes.base.files.whole import seal_of, unsealed
from softness_bayes.checking.layout import BATCH, UNCERTAIN, loads_in
from softness_bayes.checking.provenance import Provenance
from softness_bayes.likelihood.scales import Scale
from softness_bayes.parameters.declared import FABRIC_MODULUS, PARAMETERS
from softness_bayes.touch.contact import Finger, Load
from softness_bayes.touch.readings import Readings

if TYPE_CHECKING:
    import xarray as xr

    from softness_bayes.data import Fabrics

Array = NDArray[np.float64]


SCHEMA = 1
"""Version of the layout, the only one that is read."""

SUMMARY_TABLE = "summary"
"""Name of the table that every result has."""

TABLES = "table_data"
"""Group of the tables, each as JSON of its columns, so that no change of a CSV file matters."""


def content_of(tree: xr.DataTree, tables: Mapping[str, pd.DataFrame]) -> bytes:
    """Return the content of the file of a result: its groups and tables, and the checksum of all."""
    import xarray as xr

    stored = {
        name: {"index": list(table.index.names), "columns": table.reset_index().to_dict("list")}
        for name, table in tables.items()
    }
    text = xr.Dataset({name: ((), as_json(table, "table")) for name, table in stored.items()})
    whole = tree.assign({TABLES: xr.DataTree(text)})
    whole.attrs = {**tree.attrs, "schema_version": float(SCHEMA)}
    return arviz_bridge.netcdf(whole, seal_of)


def read_file(path: Path, verify: bool = True, trust_code: bool = False) -> tuple[xr.DataTree, dict[str, pd.DataFrame]]:
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
    tables = _tables(path, tree)
    del tree[TABLES]
    # text variables that are no labels: laws of the fabrics' moduli
    variables = [v for node in tree.children.values() for v in node.data_vars.values()]
    texts = [v.values.ravel() for v in variables if v.dtype.kind not in "biufc"]
    require_trusted(str(path), [dict(tree.attrs), *texts], trust_code)
    return tree, tables


def _tables(path: Path, tree: xr.DataTree) -> dict[str, pd.DataFrame]:
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


@dataclass(frozen=True, eq=False)
class Stored:
    """Groups, tables and provenance of a finished run.

    Parameters
    ----------
    tree
        The groups of ``posterior.nc``, with the provenance in its attributes.
    table
        The summary, one row per parameter.
    tables
        Further tables by name, from `TABLES`.
    source
        The file that it was read from, for messages.
    """

    tree: xr.DataTree
    table: pd.DataFrame
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    source: str = "result"

    @property
    def attributes(self) -> dict[str, Any]:
        """Provenance as stored: schema, versions, command, seed, digests, readings, verdict.

        A missing attribute raises an `InputError`.
        """
        from softness_bayes.results.lookup import Named

        return Named({str(name): value for name, value in self.tree.attrs.items()}, "attribute", self.source)

    @property
    def provenance(self) -> Provenance:
        """Provenance as typed records: settings, end of the run, findings of checks."""
        return Provenance(self.attributes)

    def group(self, name: str) -> xr.Dataset:
        """Return one group of ``posterior.nc`` as a dataset.

        Raises
        ------
        InputError
            If the result has no such group. The dataset raises it for a missing variable.
        """
        from softness_bayes.results.lookup import Group, MissingError

        if name not in self.tree.children:
            raise MissingError(f"{self.source}: no group '{name}'; it has {', '.join(self.tree.children)}")
        if name not in self._groups:
            self._groups[name] = Group.of(self.tree[name].to_dataset(), f"{self.source}: group '{name}'")
        return self._groups[name]

    @cached_property
    def _groups(self) -> dict[str, xr.Dataset]:
        """The groups that were read before: making a dataset takes ten milliseconds, and a report reads 300."""
        return {}

    @property
    def has_ratings(self) -> bool:
        """True if the run was on ratings, alone or with compression data."""
        return "rating" in self.group("observed_data")

    @property
    def has_compression(self) -> bool:
        """True if the run was on compression data, alone or with ratings."""
        return "plate_force_n" in self.group("observed_data")

    @property
    def has_afferents(self) -> bool:
        """True if the run was on recorded afferents, alone or with other data."""
        return "recorded_rate_hz" in self.group("observed_data")

    def _require_ratings(self) -> None:
        if not self.has_ratings:
            raise InputError("result: without ratings there are no loads, response curves or turning points")

    @property
    def finger(self) -> Finger:
        """The finger of the run."""
        from softness_bayes.model.fingers import finger_of

        return finger_of(self.provenance.asked.options.get("finger", {}))

    @property
    def recorded_sentences(self) -> list[str]:
        """Sentences on what the recorded afferents of the run say of the chain."""
        from softness_bayes.checking.sentences import recorded_sentences

        return recorded_sentences(self.provenance.recorded)

    @property
    def readings(self) -> Readings:
        """The readings of the run."""
        return self.provenance.readings

    @property
    def scale(self) -> Scale:
        """The scale of the ratings."""
        return self.provenance.rating_model.rating_scale

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads of the data.

        Raises
        ------
        InputError
            If the run had no ratings, as for all members that depend on the response.
        """
        self._require_ratings()
        return loads_in(self.group("constant_data"))

    @property
    def fabrics(self) -> Fabrics:
        """The fabrics of the data, with moduli computed under the readings of the run.

        Raises
        ------
        InputError
            If the run had no ratings.
        """
        self._require_ratings()
        from softness_bayes.data import Fabrics

        constant = self.group("constant_data")
        return Fabrics(
            tuple(str(name) for name in constant["fabric"].values),
            effective_modulus=constant["effective_modulus_kpa"].values * 1e3,
            poisson_ratio=constant["poisson_ratio"].values,
            batch=tuple(constant[BATCH].values) if BATCH in constant else (),
            digest=self.provenance.rating_data.digest_fabrics,
        )

    def values(self, size: int | None = None) -> dict[str, Array]:
        """Return every parameter of the model by name, in natural units: draws, or the fixed value.

        Parameters
        ----------
        size
            Number of draws, evenly spaced over the run; by default all.
        """
        posterior, constant = self.group("posterior"), self.group("constant_data")
        names = [name for name, variable in posterior.items() if variable.dims == ("chain", "draw")]
        # draws of all chains interleaved in time, so that evenly spaced ones cover the whole run
        columns = {str(name): posterior[name].values.T.ravel() for name in names}
        total = next(iter(columns.values())).size
        if FABRIC_MODULUS in posterior:
            moduli = posterior[FABRIC_MODULUS].values.swapaxes(0, 1).reshape(total, -1)
            columns |= {
                f"{FABRIC_MODULUS}[{fabric}]": moduli[:, k] for k, fabric in enumerate(posterior[UNCERTAIN].values)
            }
        pick = np.arange(total) if size is None or size >= total else np.linspace(0, total - 1, size).astype(int)
        held = {str(name): constant[name].values for name in constant.data_vars if name in PARAMETERS}
        return {**held, **{name: column[pick] for name, column in columns.items()}}
