"""The members of a finished run that its figures read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray

    from softness_bayes.checking.inflection import Curves, Inflection
    from softness_bayes.likelihood.scales import Scale
    from softness_bayes.touch.contact import Load


class Drawable(Protocol):
    """A finished run as its figures know it; `Result` is one."""

    @property
    def tree(self) -> xr.DataTree:
        """Its groups."""

    @property
    def scale(self) -> Scale:
        """The scale of the ratings."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads of the data."""

    def group(self, name: str) -> xr.Dataset:
        """Return one group."""

    def curves(self) -> Curves:
        """Return the response against E_fab, draw by draw, under each load, or group of many loads."""

    def typical_ratings(self) -> NDArray[np.float64]:
        """Return the rating that a typical participant gives along these curves, shape (draws, loads, points)."""

    def inflections(self) -> Inflection:
        """Return where the response turns over, draw by draw, under the same loads."""
