"""The members of a finished run that its figures read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import xarray as xr

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
        """Return the response against E_fab, draw by draw."""

    def inflections(self) -> Inflection:
        """Return where the response turns over, draw by draw."""
