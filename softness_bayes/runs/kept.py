"""A run in its own directory: sampled from wherever its checkpoint is, then its files and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.data import Compression, Experiment
from softness_bayes.model.build import ExperimentModel, SkinModel, build, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.request import RunOptions
from softness_bayes.results.result import Result
from softness_bayes.results.stages import Listener, Stage, unheard
from softness_bayes.runs.plate import sample_skin_model
from softness_bayes.runs.run import sample_model
from softness_bayes.sampler.sampling import Progress
from softness_bayes.sampler.workers import available_processors

DRAWING = 4
"""Largest number of processes that draw figures; each takes a second to start."""

RUN_FORMATS = ("png", "csv")
"""Formats of the figures of a run; the fonts of a PDF take as long as all else about it."""


def model_of(data: Experiment | Compression, options: ModelOptions) -> ExperimentModel | SkinModel:
    """Return the model of some data: of ratings, or of compression data alone.

    Raises
    ------
    InputError
        If data and options do not make a model.
    """
    return build_skin(data, options) if isinstance(data, Compression) else build(data, options)


def sample_kept(
    checkpoint: Checkpoint,
    model: ExperimentModel | SkinModel,
    run: RunOptions,
    own_figures: Sequence[str] | None,
    progress: Callable[[Progress], None] | None = None,
    listener: Listener = unheard,
) -> Result:
    """Sample a model to the goal or to a limit, from wherever a checkpoint is, and leave its files beside that.

    Parameters
    ----------
    checkpoint
        The checkpoint of the run, whose lock is held.
    model, run
        The model, and how long to run.
    own_figures
        Figures of the user's own that are drawn beside the others; None draws none at all.
    progress
        Called every few seconds at the latest.
    listener
        Called when a stage after the walk begins.

    Raises
    ------
    InputError, NumericalError
        As `runs.run.sample`.
    """
    if isinstance(model, ExperimentModel):
        result = sample_model(model, run, progress, checkpoint, listener)
    else:
        result = sample_skin_model(model, run, progress, checkpoint, listener)
    listener(Stage.FILES)
    result.save(checkpoint.directory)
    if own_figures is not None:
        listener(Stage.FIGURES)
        from softness_bayes.plotting.figures import draw_figures, figures_of

        processes = min(run.processes or available_processors(), DRAWING)
        names = [*figures_of(result), *own_figures] if own_figures else None
        directory = checkpoint.directory / "figures"
        draw_figures(result, directory, names, _formats(directory), processes=processes)
    checkpoint.finish()
    return result


def _formats(directory: Path) -> tuple[str, ...]:
    """Return the formats of a run's figures, and those in which they were drawn there before, which would be old."""
    there = (suffix for suffix in ("pdf", "svg") if any(directory.glob(f"*.{suffix}")))
    return (*RUN_FORMATS, *there)
