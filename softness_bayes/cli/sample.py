"""`softness-bayes sample`: ratings in, posterior and credible bands out."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options.model import ModelChoice, model_choice
from softness_bayes.cli.options.ratings import rating_scale
from softness_bayes.cli.options.run import force, max_time, no_figures, out, own_figures, processes, seed
from softness_bayes.cli.options.tables import DataFiles, data_files
from softness_bayes.cli.options.values import Number, whole
from softness_bayes.cli.printed import print_result
from softness_bayes.cli.progress import Bar
from softness_bayes.cli.running import Sampling, command_line, record_of
from softness_bayes.defaults import MAX_STEPS, NOISE
from softness_bayes.errors import InputError, NotConvergedError
from softness_bayes.ranges import NOISES, STEPS

if TYPE_CHECKING:
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.data import Compression, Experiment
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.model.options import ModelOptions
    from softness_bayes.results.request import Request


@click.command(cls=Sampling)
@data_files
@model_choice
@rating_scale
@click.option(
    "--noise",
    type=Number(NOISES),
    default=NOISE,
    show_default=True,
    metavar="STRENGTH",
    help="White-noise current on every membrane [µA/cm² √ms]. Its mean effect is found by simulation, which "
    "takes minutes. Needs --fix for c_Na, c_K, c_L and c_A.",
)
@click.option(
    "--exact-reweight",
    is_flag=True,
    help="Weight the draws by the exact likelihood (Pareto-smoothed); summary and predictions use the weighted draws.",
)
@click.option(
    "--max-steps",
    type=whole(STEPS),
    default=MAX_STEPS,
    show_default=True,
    help="Largest number of steps of each ensemble; the run then ends even if it has not converged.",
)
@click.option(
    "--quick",
    is_flag=True,
    help="A first look: the run ends at the first check of the chains, before it has converged, with few "
    "figures and without the comparison with the exact model. 'resume' continues it to the full run.",
)
@max_time
@processes
@no_figures
@own_figures
@seed
@out
@force
def command(
    files: DataFiles,
    model: ModelChoice,
    scale: str,
    noise: float,
    exact_reweight: bool,
    max_steps: int,
    quick: bool,
    max_time: float,
    processes: int | None,
    no_figures: bool,
    own_figures: tuple[str, ...],
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Sample the posterior of skin, transduction and rating parameters given ratings.

    Runs four independent ensembles until they have converged, or until --max-steps or --max-time. Writes to --out:
    posterior.nc (draws, predictions, provenance), summary.csv, directions.csv, predictive_checks.csv and figures/.
    Prints the summary, the parameters that only the prior determines, the turning point of the response under each
    load, whether the model reproduces it, and a verdict. Exit code 3: not converged.

    --compression adds the forces of a rigid flat plate on fingerpads, which inform b and m directly. Without --data
    only these forces are fitted: the run then has no response curves and no turning point, but predicts how the
    force grows with indentation.

    With all parameters fixed there is nothing to sample: the log-likelihood and the turning points at that point are
    printed, and nothing is written.

    The run is saved in --out while it goes on. 'status' shows its progress, and 'resume' continues it after an
    interruption or after its end; the draws are those of a run that was never interrupted. --quick takes a first
    look, from which 'resume' continues to the same draws as well.
    """
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.data import Compression
    from softness_bayes.likelihood.scales import scale_named
    from softness_bayes.results.request import Request, RunOptions

    data = files.read()
    if isinstance(data, Compression):
        model = _model_of_forces(model)
    options = model.options(scale=scale_named(scale), noise=noise)
    if _evaluated(data, options):
        return
    how = RunOptions(
        exact_reweight=exact_reweight,
        max_steps=max_steps,
        max_seconds=max_time,
        processes=processes,
        seed=seed,
        command=command_line(),
        quick=quick,
    )
    drawn = None if no_figures else own_figures
    require_drawn(drawn)
    run(Checkpoint.create(out, force, inputs=files.paths), files, data, Request(options, how), drawn)


def require_drawn(own: Sequence[str] | None) -> None:
    """Raise an error for custom figures that cannot be drawn; the argument is None if no figures are requested.

    Raises
    ------
    InputError
        If one cannot be imported, or is not a figure.
    """
    if own is None:
        return
    from softness_bayes.plotting.figures import OWN_FIGURES, require_figures
    from softness_bayes.supplied import installed

    if own or installed(OWN_FIGURES):
        require_figures([*own, *installed(OWN_FIGURES)])


def _model_of_forces(model: ModelChoice) -> ModelChoice:
    """Return the model of compression data alone, with wide priors unless others were requested.

    Raises
    ------
    InputError
        If an option for ratings was given.
    """
    source = click.get_current_context().get_parameter_source
    of_ratings = ("scale", "direction", "accuracy", "noise", "exact_reweight", "errors", "resolution")
    if any(source(name) is not ParameterSource.DEFAULT for name in of_ratings):
        raise InputError(
            "--ratings, --direction, --accuracy, --noise, --exact-reweight, --errors and --resolution need "
            "ratings: give --data, or omit them"
        )
    if source("prior_set") is not ParameterSource.DEFAULT:
        return model
    click.echo(
        "note: without ratings the default is --priors wide, which is weakly informative about the skin", err=True
    )
    return replace(model, prior_set="wide")


def _evaluated(data: Experiment | Compression, options: ModelOptions) -> bool:
    """Evaluate and print a model without sampled parameters; return False for any other model."""
    from softness_bayes.data import Compression
    from softness_bayes.model.build import build, build_skin, moduli_of, space_of
    from softness_bayes.runs.evaluation import evaluate

    said = [f"note: {note}" for note in data.notes]
    if isinstance(data, Compression):
        skin = build_skin(data, options).posterior
        found = None if skin.space.sampled else evaluate(skin)
    elif space_of(data, options).sampled or not moduli_of(data, options).known:
        found = None
    else:
        model = build(data, options)
        said.append(_direction_note(model))
        assert model.resolution is not None, "the command line sets an accuracy"
        found = evaluate(model.posterior, float(model.resolution.errors.peak))
    if found is None:
        return False
    for line in (*said, *found.sentences()):
        click.echo(line)
    click.echo("nothing is written; 'softness-bayes predict' shows contact, stress and firing at these values")
    return True


def _direction_note(model: ExperimentModel) -> str:
    """Return the sentence on the direction of the ratings, marked as a note or a warning."""
    return f"{'warning' if model.direction.against_data else 'note'}: {model.direction.sentence}"


def run(
    checkpoint: Checkpoint,
    files: DataFiles,
    data: Experiment | Compression,
    request: Request,
    own_figures: Sequence[str] | None,
    moved: Sequence[str] = (),
) -> None:
    """Build the model, sample it from the start or from the checkpoint, and write and print the results.

    Custom figures are drawn in addition to the standard ones. If `own_figures` is None, no figures are drawn. `moved`
    holds the options with new paths of tables, which the advice on how to continue repeats.

    Raises
    ------
    NotConvergedError
        If a limit was reached before convergence; all results are written nevertheless.
    """
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.model.pressed import people_note
    from softness_bayes.model.reach import reach_of
    from softness_bayes.provenance import versions
    from softness_bayes.runs.kept import model_of, sample_kept

    out, (options, how) = checkpoint.directory, request
    model = model_of(data, options)
    for note in data.notes:
        click.echo(f"note: {note}", err=True)
    if isinstance(model, ExperimentModel):
        if said := reach_of(model.experiment, model.options):
            click.echo(f"warning: {said}", err=True)
        click.echo(_direction_note(model), err=True)
        people = people_note(model.experiment, model.options)
        for said in (model.given.note, model.given.errors_note, *([] if people is None else [people])):
            click.echo(f"note: {said}", err=True)
    bar = Bar()
    with keeping(lambda: _kept(checkpoint, bar.drawing, moved)), checkpoint:
        decided = request._replace(model=model.options)
        asked = {"files": record_of(files, out), "options": decided.record(), "figures": own_figures is not None}
        asked |= {"own_figures": list(own_figures)} if own_figures else {}
        checkpoint.request = {**asked, "versions": versions()}
        bar.begin(0.0 if checkpoint.status is None else checkpoint.status.seconds)
        try:
            result = sample_kept(checkpoint, model, how, own_figures, bar.show, bar.stage)
        finally:
            bar.close()
    print_result(result, out, bar.times())
    ending = result.provenance.ending
    if not ending.converged and not ending.quick:
        raise NotConvergedError(
            f"not converged after {ending.steps} steps; the draws so far are in {out}, for inspection only; "
            f"{_again(out, moved)} the run"
        )


def _kept(checkpoint: Checkpoint, drawing: bool = False, moved: Sequence[str] = ()) -> str:
    """Return the saved progress of a run and the command to continue it; release the directory if nothing was saved.

    `drawing` is True if only figures are missing.
    """
    status = checkpoint.status
    if drawing:
        out = checkpoint.directory
        return (
            f"the results are written to {out}: 'softness-bayes plot {out}' draws the figures; {_again(out, moved)} it"
        )
    if status is None:
        checkpoint.leave()  # the process may end before its main thread does so
        return "nothing was saved, because sampling had not begun: start the run again"
    until = "in its pilot phase" if status.piloting else f"up to step {status.steps}"
    return f"the run is saved {until}: {_again(checkpoint.directory, moved)} it"


def _again(directory: Path, moved: Sequence[str]) -> str:
    # an interrupt may come before the checkpoint has the new paths
    return f"'{' '.join(['softness-bayes resume', str(directory), *map(shlex.quote, moved)])}' continues"
