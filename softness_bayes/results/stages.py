"""Stages of a run after its walk, told to whoever waits for them."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import xarray as xr


class Stage(Enum):
    """A part of what follows the walk; the value says what is done, in the order in which it is done."""

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
        """Place among the stages, from 1."""
        return [*Stage].index(self) + 1

    def __str__(self) -> str:
        return f"after sampling, {self.number} of {len(Stage)}: {self.value}"


Listener = Callable[[Stage], None]
"""Called when a stage begins."""


def unheard(_: Stage) -> None:
    """Do nothing."""


class Beginning(Protocol):
    """Work that begins as soon as some groups of a result are known, such as drawing them."""

    def begin_walk(self, tree: xr.DataTree) -> None:
        """Take the posterior's draws, before anything is computed from them."""

    def begin_usual(self, tree: xr.DataTree) -> None:
        """Take all groups, before tables are made of them."""
