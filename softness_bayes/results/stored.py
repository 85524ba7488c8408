"""Members of a finished run that are needed to restore its data and model and to compute answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.scales import Scale
from softness_bayes.provenance import Provenance
from softness_bayes.touch.contact import Finger, Load
from softness_bayes.touch.readings import Readings

if TYPE_CHECKING:
    import xarray as xr

    from softness_bayes.data import Fabrics


class Stored(Protocol):
    """A finished run from which the model can be rebuilt; implemented by `Result`."""

    @property
    def source(self) -> str:
        """The file that it was read from."""

    @property
    def provenance(self) -> Provenance:
        """Options, verdict and findings of the run."""

    @property
    def has_compression(self) -> bool:
        """True if the run was on compression data."""

    @property
    def finger(self) -> Finger:
        """The finger of the run."""

    @property
    def readings(self) -> Readings:
        """The readings of the run."""

    @property
    def scale(self) -> Scale:
        """The scale of the ratings."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads of the data."""

    @property
    def fabrics(self) -> Fabrics:
        """The fabrics of the data."""

    def group(self, name: str) -> xr.Dataset:
        """Return one group."""

    def values(self, size: int | None = None) -> dict[str, NDArray[np.float64]]:
        """Return evenly spaced draws of every parameter by name."""
