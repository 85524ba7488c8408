"""Stages of a run after sampling, reported to a listener."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import xarray as xr


class Stage(Enum):
    """A stage after sampling, in order of execution; the value describes it."""

    REPLICATES = "replicated data"
    LEFT_OUT = "each rating given all others (leave-one-out)"
    PREDICTIONS = "predictions and turning points"
    EXACT = "accuracy of the fast model"
    CHECKS = "checks of residuals"
    TABLES = "tables"
    FILES = "files"
    FIGURES = "figures"

    @property
    def number(self) -> int:
        """Number of the stage, from 1."""
        return [*Stage].index(self) + 1

    def __str__(self) -> str:
        return f"after sampling, {self.number} of {len(Stage)}: {self.value}"


Listener = Callable[[Stage], None]
"""Function called at the start of each stage."""


def unheard(_: Stage) -> None:
    """Do nothing."""


class Beginning(Protocol):
    """Work that starts as soon as some groups of a result are available, such as drawing figures."""

    def begin_walk(self, tree: xr.DataTree) -> None:
        """Receive the posterior draws, before anything is computed from them."""

    def begin_usual(self, tree: xr.DataTree) -> None:
        """Receive all groups, before tables are computed from them."""
