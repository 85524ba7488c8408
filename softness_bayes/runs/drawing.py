"""Figures of a run, drawn by its workers in parallel with other work after sampling."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softness_bayes.files.outputs import write_outputs
from softness_bayes.parameters.declared import FABRIC_MODULUS
from softness_bayes.plotting.figures import FIGURES, drawn, figures_of
from softness_bayes.plotting.style import PLOT
from softness_bayes.results.result import Result
from softness_bayes.sampler.workers import Workers

if TYPE_CHECKING:
    import xarray as xr

RUN_FORMATS = ("png", "csv")
"""Formats of the figures of a run; no PDF by default, as embedding its fonts doubles the time."""

FIRST_FIGURES = ("response", "rating", "inflection", "compression")
"""Figures of a first look."""

RUN_FIGURES = ("predictive_checks", *FIRST_FIGURES, "corner", "category_counts", "psychometric")
"""Figures of a run, those that take longest first; ``plot`` draws the others, which would delay the end of the run."""

OF_THE_WALK = ("corner",)
"""Figures of a run that need only the posterior draws, available before anything is computed from them."""

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
declare none, and sampled moduli, which place the fabrics, for all."""


class FiguresUnderWay:
    """Figures drawn by workers, each as soon as its data are available.

    Parameters
    ----------
    workers
        Processes that draw; without other processes, figures are drawn when they are written.
    directory
        Directory to which they will be written.
    requested
        Names of further figures, built-in or custom.
    """

    def __init__(self, workers: Workers, directory: Path, requested: Sequence[str] = ()) -> None:
        self._workers, self._directory, self._requested = workers, directory, requested
        self._begun: dict[str, Callable[[], dict[str, bytes]]] = {}

    def begin_walk(self, tree: xr.DataTree) -> None:
        """Start the figures of the posterior draws; the tree contains only these."""
        self._begin(_result(tree), OF_THE_WALK)

    def begin_usual(self, tree: xr.DataTree) -> None:
        """Start the built-in figures of all groups of a result, before its tables are available."""
        result = _result(tree)
        self._begin(result, [name for name in figures_of(result, every=True) if name in FIGURES])

    def write(self, result: Result) -> list[Path]:
        """Draw figures not yet started, such as custom ones, wait for all figures and write them.

        Raises
        ------
        InputError
            If a custom figure fails, or another file is in the way.
        """
        custom = [name for name in (*figures_of(result), *self._requested) if name not in FIGURES]
        self._begin(result, [*figures_of(result, every=True), *custom])
        return write_outputs(self._directory, _finished(self._begun.values()), PLOT)

    @cached_property
    def _formats(self) -> tuple[str, ...]:
        """Formats, determined when the first figure is started, after files of a replaced run have been removed."""
        return formats_in(self._directory)

    @cached_property
    def _earlier(self) -> tuple[str, ...]:
        """Figures that were drawn there before, and would show an old result; determined like the formats."""
        return tuple(name for name in FIGURES if any(self._directory.glob(f"{name}.*")))

    def _begin(self, result: Result, names: Iterable[str]) -> None:
        usual = FIRST_FIGURES if result.is_first_look else RUN_FIGURES
        wanted = [name for name in names if name not in FIGURES or name in (*usual, *self._earlier, *self._requested)]
        for name in sorted(wanted, key=lambda name: usual.index(name) if name in usual else len(usual)):
            if name not in self._begun:
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

    named = {place.partition("/")[0] for place in FIGURES[name].needs} or {"posterior"}
    kept = {group: node for group, node in tree.children.items() if group not in LARGE or group in named}
    if "posterior" not in kept and FABRIC_MODULUS in tree["posterior"].data_vars:
        kept["posterior"] = xr.DataTree(tree["posterior"].to_dataset()[[FABRIC_MODULUS]])
    return xr.DataTree(tree.to_dataset(), children=kept)


def _finished(begun: Iterable[Callable[[], dict[str, bytes]]]) -> dict[str, bytes]:
    """Wait for figures, and return the contents of all files by their names."""
    return {name: content for finished in begun for name, content in finished().items()}


def _drawn_of(_: Any, result: Result, name: str, formats: tuple[str, ...]) -> dict[str, bytes]:
    return drawn(result, name, formats)
