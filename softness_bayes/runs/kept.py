"""A run in its directory: sampling from the state of its checkpoint, then files and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.data import Compression, Experiment
from softness_bayes.model.build import ExperimentModel, SkinModel, build, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.assembly import Listener, Stage, no_listener
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs.plate import sample_skin_model
from softness_bayes.runs.run import sample_model
from softness_bayes.sampler.sampling import Progress
from softness_bayes.sampler.workers import Workers

if TYPE_CHECKING:
    from softness_bayes.runs.drawing import FiguresUnderWay


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
    listener: Listener = no_listener,
) -> Result:
    """Sample a model until convergence or a limit, from the state of a checkpoint, and write its files next to it.

    Parameters
    ----------
    checkpoint
        The checkpoint of the run, whose lock is held.
    model, run
        The model, and how long to run.
    own_figures
        Figures to draw in addition to those of every run, custom or built-in; None to draw no figures at all.
    progress
        Function called at least every few seconds.
    listener
        Function called at the start of each stage after sampling.

    Raises
    ------
    InputError, NumericalError
        As for `runs.run.sample`.
    """
    with run.settings.workers(model.posterior) as workers:
        figures = None if own_figures is None else _figures(workers, checkpoint, own_figures)
        if isinstance(model, ExperimentModel):
            result = sample_model(model, run, progress, checkpoint, listener, workers, figures)
        else:
            result = sample_skin_model(model, run, progress, checkpoint, listener, workers)
        listener(Stage.FILES)
        result.save(checkpoint.directory)
        if figures is not None:
            listener(Stage.FIGURES)
            figures.write(result)
    checkpoint.finish()
    return result


def _figures(workers: Workers, checkpoint: Checkpoint, requested: Sequence[str]) -> FiguresUnderWay:
    from softness_bayes.runs.drawing import FiguresUnderWay  # imports the plotting libraries

    return FiguresUnderWay(workers, checkpoint.directory / "figures", requested)
