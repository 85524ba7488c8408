"""Figures of a run, drawn by its workers after its result is written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.plotting.figures import FIGURES, drawn, figures_of
from softness_bayes.plotting.style import PLOT
from softness_bayes.results.result import Result
from softness_bayes.sampler.workers import Workers

RUN_FORMATS = ("png", "csv")
"""Formats of the figures of a run; no PDF by default, as embedding its fonts doubles the time."""

FIRST_FIGURES = ("response", "rating", "inflection", "compression", "recorded")
"""Figures of a first look."""

RUN_FIGURES = ("predictive_checks", *FIRST_FIGURES, "corner", "category_counts", "psychometric")
"""Figures of a run, those that take longest first; ``plot`` draws the others, which would delay the end of the run."""


def draw_run_figures(result: Result, home: Path, workers: Workers, requested: Sequence[str] = ()) -> list[Path]:
    """Draw the figures of a run in parallel, and write them to the folder of figures in its directory.

    Figures that were drawn there before would show an old result, and are drawn again in their formats.

    Parameters
    ----------
    result
        The result.
    home
        Directory of the run, in which the result is saved.
    workers
        Processes that draw.
    requested
        Names of further figures, built-in or custom.

    Raises
    ------
    InputError
        If a custom figure fails, or another file is in the way.
    """
    directory, usual = home / "figures", FIRST_FIGURES if result.is_first_look else RUN_FIGURES
    formats = (*RUN_FORMATS, *(suffix for suffix in ("pdf", "svg") if any(directory.glob(f"*.{suffix}"))))
    earlier = [name for name in FIGURES if any(directory.glob(f"{name}.*"))]
    known = [*figures_of(result, every=True), *(name for name in requested if name not in FIGURES)]
    names = [name for name in dict.fromkeys(known) if name not in FIGURES or name in (*usual, *earlier, *requested)]
    names.sort(key=lambda name: usual.index(name) if name in usual else len(usual))
    files = workers.map(_drawn, [(result, name, formats) for name in names])
    return write_outputs(directory, {name: content for each in files for name, content in each.items()}, PLOT)


def _drawn(_: Any, result: Result, name: str, formats: tuple[str, ...]) -> dict[str, bytes]:
    return drawn(result, name, formats)
