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
    """Interface of a finished run that the figures use; `Result` implements it."""

    @property
    def tree(self) -> xr.DataTree:
        """The groups of the result."""

    @property
    def is_first_look(self) -> bool:
        """True if the run ended on purpose before convergence."""

    @property
    def scale(self) -> Scale:
        """The scale of the ratings."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads of the data."""

    def group(self, name: str) -> xr.Dataset:
        """Return one group."""

    def curves(self) -> Curves:
        """Return the response against E_fab for each draw, under each load or group of loads."""

    def typical_ratings(self) -> NDArray[np.float64]:
        """Return the rating that a typical participant gives along these curves, shape (draws, loads, points)."""

    def inflections(self) -> Inflection:
        """Return the turning points of the response for each draw, under the same loads."""
