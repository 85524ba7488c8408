"""A finished run: its groups of draws and tables, written to a directory and read back (the files of a result)."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.inference.curves import Outcome

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

SCHEMA = 1
"""Version of the layout of `posterior.nc`; a reader refuses a newer one."""

POSTERIOR, SUMMARY = "posterior.nc", "summary.csv"

GROUPS = (
    "posterior",
    "log_prior",
    "sample_stats",
    "log_likelihood",
    "log_likelihood_loo",
    "posterior_predictive",
    "predictions",
    "prior",
    "prior_predictive",
    "observed_data",
    "constant_data",
)
"""ArviZ groups of a result, in the order in which they are written."""


@dataclass(frozen=True, eq=False)
class Result:
    """Draws, predictions and provenance of one run.

    Parameters
    ----------
    groups
        ArviZ group -> its dataset.
    table
        The summary, one row per parameter.
    attributes
        Provenance: schema, versions, command, seed, digests, readings, verdict.
    """

    groups: Mapping[str, xr.Dataset]
    table: pd.DataFrame
    attributes: Mapping[str, Any]

    @property
    def posterior(self) -> xr.Dataset:
        """Posterior draws, dims chain (every walker) and draw."""
        return self.groups["posterior"]

    def summary(self) -> pd.DataFrame:
        """Return mean, spread, interval and sampling error of every parameter."""
        return self.table.copy()

    def inflection(self) -> pd.DataFrame:
        """Return where the response turns over, one row per load.

        Columns: probabilities of the three outcomes (interior, none, silent) and of an interior
        maximum inside the fabrics' own range; then median and 5-95 % limits of E_fab [kPa],
        E_fab / E_skin and Hertz's force [N] at the maximum over the draws that have one.
        """
        import pandas as pd

        predictions = self.groups["predictions"]
        rows = []
        for load in predictions["load"].values:
            chosen = predictions.sel(load=load)
            outcome = chosen["inflection_outcome"].values
            row: dict[str, Any] = {"load": str(load)}
            for kind in (Outcome.INTERIOR, Outcome.NONE, Outcome.SILENT):
                row[f"p_{kind.name.lower()}"] = float((outcome == kind).mean())
            row["p_inside"] = float(chosen["inflection_inside"].values.mean())
            for name in ("e_fab_kpa", "ratio", "force_n"):
                values = chosen[f"inflection_{name}"].values
                known = values[~np.isnan(values)]
                limits = np.quantile(known, [0.05, 0.5, 0.95]) if known.size else np.full(3, np.nan)
                row[f"{name}_low"], row[name], row[f"{name}_high"] = limits
            rows.append(row)
        return pd.DataFrame(rows).set_index("load")

    def draws(self, size: int | None = None) -> dict[str, Array]:
        """Return the posterior's scalar parameters, flattened over chains; `size` evenly spaced ones."""
        scalars = {str(n): v.values for n, v in self.posterior.items() if v.dims == ("chain", "draw")}
        total = next(iter(scalars.values())).size
        pick = np.arange(total) if size is None or size >= total else np.linspace(0, total - 1, size).astype(int)
        # draws of all chains side by side in time, so that evenly spaced ones cover the whole run
        return {name: values.T.reshape(-1)[pick] for name, values in scalars.items()}

    def save(self, directory: str | Path) -> None:
        """Write `posterior.nc` and `summary.csv` into a directory; each appears whole or not at all."""
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        partial = directory / f".{POSTERIOR}.partial"
        partial.unlink(missing_ok=True)
        import xarray as xr

        root = xr.Dataset(attrs={name: _attribute(value) for name, value in self.attributes.items()})
        root.to_netcdf(partial, mode="w", engine="h5netcdf")
        for name in GROUPS:
            if name in self.groups:
                self.groups[name].to_netcdf(partial, mode="a", group=name, engine="h5netcdf")
        os.replace(partial, directory / POSTERIOR)
        partial = directory / f".{SUMMARY}.partial"
        self.table.to_csv(partial)
        os.replace(partial, directory / SUMMARY)

    @classmethod
    def load(cls, directory: str | Path) -> Result:
        """Read a result from its directory, or from its `posterior.nc`.

        Raises
        ------
        InputError
            If there is no result, it cannot be read, or its schema is newer than this version knows.
        """
        import pandas as pd
        import xarray as xr

        path = Path(directory)
        path = path / POSTERIOR if path.is_dir() else path
        if not path.is_file():
            raise InputError(f"{path}: no such file; expected the {POSTERIOR} of a run")
        try:
            with xr.open_datatree(path, engine="h5netcdf") as tree:
                attributes = dict(tree.attrs)
                groups = {name: node.to_dataset().load() for name, node in tree.children.items()}
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: not a readable result ({error})") from None
        if "posterior" not in groups or "schema_version" not in attributes:
            raise InputError(f"{path}: not a result of softness-bayes: it has no posterior or no schema version")
        if int(attributes["schema_version"]) > SCHEMA:
            raise InputError(
                f"{path}: schema {attributes['schema_version']} is newer than {SCHEMA}, the newest this version reads"
            )
        table = path.with_name(SUMMARY)
        summary = pd.read_csv(table, index_col="parameter") if table.is_file() else pd.DataFrame()
        return cls(groups, summary, attributes)


def _attribute(value: Any) -> Any:
    """Return a value as netCDF attributes hold it: numbers and text as they are, the rest as JSON."""
    return value if isinstance(value, str | int | float) else json.dumps(value)


def prepare_directory(directory: Path, replace: bool) -> None:
    """Make an empty directory for a run.

    Raises
    ------
    InputError
        If it is a file, or holds something and `replace` is not asked for.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file, expected a directory for the results")
    if directory.is_dir() and any(directory.iterdir()):
        if not replace:
            raise InputError(f"{directory}: is not empty; choose another --out, or --force to replace what it holds")
        if not (directory / POSTERIOR).exists():
            raise InputError(f"{directory}: holds no {POSTERIOR}, so --force does not touch it")
        shutil.rmtree(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made ({error.strerror})") from None
