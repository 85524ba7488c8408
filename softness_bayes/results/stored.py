"""Groups and provenance that a finished run stored, from which data, model and answers are computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.layout import UNCERTAIN, loads_in
from softness_bayes.errors import InputError
from softness_bayes.likelihood.scales import Scale
from softness_bayes.parameters.declared import FABRIC_MODULUS, PARAMETERS
from softness_bayes.provenance import Provenance
from softness_bayes.touch.contact import Finger, Load
from softness_bayes.touch.readings import Readings

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from softness_bayes.data import Fabrics
    from softness_bayes.recordings.findings import RecordedFindings

Array = NDArray[np.float64]


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
    verified
        Whether it is unchanged since it was written; False if this was not verified.
    source
        The file that it was read from, for messages.
    """

    tree: xr.DataTree
    table: pd.DataFrame
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    verified: bool = True
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
    def recorded_findings(self) -> RecordedFindings:
        """Findings about the recorded afferents of the run."""
        from softness_bayes.recordings.findings import RecordedFindings

        return RecordedFindings.recorded(self.provenance.recorded.recorded_findings)

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
