"""Figures of a run, drawn by its workers in parallel with other work after sampling."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softness_bayes.files.outputs import write_outputs
from softness_bayes.plotting.figures import FIGURES, drawn, every_figure, figures_of
from softness_bayes.plotting.style import PLOT
from softness_bayes.results.result import Result
from softness_bayes.sampler.workers import Workers

if TYPE_CHECKING:
    import xarray as xr

RUN_FORMATS = ("png", "csv")
"""Formats of the figures of a run; no PDF by default, as embedding its fonts doubles the time."""

FIRST_FIGURES = ("response", "rating", "inflection", "trace", "compression")
"""Figures of a first look; ``plot`` draws the others."""

OF_THE_WALK = ("corner", "trace", "rank")
"""Figures that need only the posterior draws, which are available before anything is computed from them."""

LARGE = (
    "posterior",
    "posterior_predictive",
    "prior_predictive",
    "sample_stats",
    "log_prior",
    "log_likelihood",
    "log_likelihood_loo",
)
"""Large groups, which are sent only for figures that declare them as needed; `posterior` is sent for figures that
declare none."""


class FiguresUnderWay:
    """Figures drawn by workers, each as soon as its data are available.

    Parameters
    ----------
    workers
        Processes that draw; without other processes, figures are drawn when they are written.
    directory
        Directory to which they will be written.
    """

    def __init__(self, workers: Workers, directory: Path) -> None:
        self._workers, self._directory = workers, directory
        self._begun: dict[str, Callable[[], dict[str, bytes]]] = {}

    def begin_walk(self, tree: xr.DataTree) -> None:
        """Start the figures of the posterior draws; the tree contains only these."""
        self._begin(_result(tree), [name for name in OF_THE_WALK if name in every_figure()])

    def begin_usual(self, tree: xr.DataTree) -> None:
        """Start the built-in figures of all groups of a result, before its tables are available."""
        result = _result(tree)
        self._begin(result, [name for name in figures_of(result) if name in FIGURES])

    def write(self, result: Result, own: Sequence[str]) -> list[Path]:
        """Draw figures not yet started, such as custom ones, wait for all figures and write them.

        Raises
        ------
        InputError
            If a custom figure fails, or another file is in the way.
        """
        self._begin(result, [*figures_of(result), *own])
        return write_outputs(self._directory, _finished(self._begun.values()), PLOT)

    @cached_property
    def _formats(self) -> tuple[str, ...]:
        """Formats, determined when the first figure is started, after files of a replaced run have been removed."""
        return formats_in(self._directory)

    def _begin(self, result: Result, names: Iterable[str]) -> None:
        first = result.is_first_look
        for name in names:
            if name not in self._begun and not (first and name in FIGURES and name not in FIRST_FIGURES):
                shown = replace(result, tree=_needed(result.tree, name)) if name in FIGURES else result
                self._begun[name] = self._workers.start(_drawn_of, shown, name, self._formats)


def formats_in(directory: Path) -> tuple[str, ...]:
    """Return the formats of a run's figures, and those in which they were drawn there before, which would be old."""
    there = (suffix for suffix in ("pdf", "svg") if any(directory.glob(f"*.{suffix}")))
    return (*RUN_FORMATS, *there)


def _result(tree: xr.DataTree) -> Result:
    """Return groups as a result without tables."""
    import pandas as pd

    return Result(tree, pd.DataFrame())


def _needed(tree: xr.DataTree, name: str) -> xr.DataTree:
    """Return the groups of a result without the large ones that a figure does not need."""
    import xarray as xr

    named = {source.place.partition("/")[0] for source in FIGURES[name].needs} or {"posterior"}
    kept = {group: node for group, node in tree.children.items() if group not in LARGE or group in named}
    return xr.DataTree(tree.to_dataset(), children=kept)


def _finished(begun: Iterable[Callable[[], dict[str, bytes]]]) -> dict[str, bytes]:
    """Wait for figures, and return the contents of all files by their names."""
    return {name: content for finished in begun for name, content in finished().items()}


def _drawn_of(_: Any, result: Result, name: str, formats: tuple[str, ...]) -> dict[str, bytes]:
    return drawn(result, name, formats)
