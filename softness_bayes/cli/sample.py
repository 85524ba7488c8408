"""`softness-bayes sample`: ratings in, posterior and credible bands out."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options import collected, data_files, force, no_figures, out, own_figures, typed, verbose
from softness_bayes.cli.progress import Bar, telling
from softness_bayes.cli.running import command_line
from softness_bayes.cli.summary import print_result
from softness_bayes.errors import NotConvergedError
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import DataFiles, RunOptions, require_no_ratings_needed

if TYPE_CHECKING:
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.data import Experiment, Measurements
    from softness_bayes.model.build import ExperimentModel, SkinModel
    from softness_bayes.results.request import Request


@click.command
@data_files
@collected("model", ModelOptions)
@collected("how", RunOptions)
@no_figures
@own_figures
@out()
@force
@verbose
def command(
    files: DataFiles,
    model: ModelOptions,
    how: RunOptions,
    no_figures: bool,
    own_figures: tuple[str, ...],
    out: Path,
    force: bool,
    verbose: bool,
) -> None:
    """Sample the posterior of skin, transduction and rating parameters given ratings.

    Runs four independent ensembles until they have converged, or until --max-steps or --max-time. Writes to --out:
    posterior.nc (draws, predictions, provenance), summary.csv, directions.csv, predictive_checks.csv and figures/.
    Prints what people said, whether the model can be trusted, what was learnt and what to do next; with --verbose also
    the summary, the turning points and all checks. Exit code 3: not converged.

    --compression adds the forces of a rigid flat plate on fingerpads, which inform b and m directly, and --afferents
    the firing of nerve fibres under rigid probes. Without --data only these are fitted: the run then has no response
    curves and no turning point, but predicts how forces grow with indentation, and rates with the probe.

    With all parameters fixed there is nothing to sample: the log-likelihood and the turning points at that point are
    printed, and nothing is written.

    The run is saved in --out while it goes on. 'status' shows its progress, and 'resume' continues it after an
    interruption or after its end; the draws are those of a run that was never interrupted. --quick takes a first
    look, from which 'resume' continues to the same draws as well.
    """
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.data import Measurements
    from softness_bayes.results.request import Request

    with telling("reading the tables"):
        data = files.read()
    if isinstance(data, Measurements):
        model = _without_ratings(data, model, how)
    if _evaluated(data, model):
        return
    drawn = None if no_figures else own_figures
    require_drawn(drawn)
    request = Request(model, replace(how, command=command_line()))
    run(Checkpoint.create(out, force, inputs=files.paths), files, data, request, drawn, verbose)


def require_drawn(names: Sequence[str] | None) -> None:
    """Raise an error for custom figures that cannot be drawn; the argument is None if no figures are requested.

    Raises
    ------
    InputError
        If one cannot be imported, or is not a figure.
    """
    if names is None:
        return
    from softness_bayes.plotting.figures import OWN_FIGURES, require_figures
    from softness_bayes.supplied import installed

    if names or installed(OWN_FIGURES):
        require_figures([*names, *installed(OWN_FIGURES)])


def _without_ratings(data: Measurements, model: ModelOptions, how: RunOptions) -> ModelOptions:
    """Return the model of data without ratings: with plate forces it has wide priors unless others were requested.

    Raises
    ------
    InputError
        If an option for ratings was given.
    """
    require_no_ratings_needed(model, how)
    if typed("prior_set") or data.compression is None:
        return model
    click.echo(
        "note: without ratings the default is --priors wide, which is weakly informative about the skin", err=True
    )
    return replace(model, prior_set="wide")


def _evaluated(data: Experiment | Measurements, options: ModelOptions) -> bool:
    """Evaluate and print a model without sampled parameters; return False for any other model."""
    from softness_bayes.data import Measurements
    from softness_bayes.model.build import Parts, build, build_skin
    from softness_bayes.runs.evaluation import evaluate

    lines = [f"note: {note}" for note in data.notes]
    if isinstance(data, Measurements):
        skin = build_skin(data, options).posterior
        if skin.space.sampled:
            return False
        lines += evaluate(skin).sentences()
    else:
        parts = Parts(data, options)
        if parts.space.sampled or not parts.moduli.known:
            return False
        model = build(data, options)
        assert model.resolution is not None, "the command line sets an accuracy"
        lines += [_about_direction(model)]
        lines += evaluate(model.posterior, float(model.resolution.errors.peak)).sentences()
    lines.append("nothing is written; 'softness-bayes predict' shows contact, stress and firing at these values")
    click.echo("\n".join(lines))
    return True


def _about_direction(model: ExperimentModel) -> str:
    """Return the sentence on the direction of the ratings, marked as a note or a warning."""
    return f"{'warning' if model.direction.against_data else 'note'}: {model.direction.sentence}"


def run(
    checkpoint: Checkpoint,
    files: DataFiles,
    data: Experiment | Measurements,
    request: Request,
    own_figures: Sequence[str] | None,
    verbose: bool,
    moved: Sequence[str] = (),
) -> None:
    """Build the model, sample it from the start or from the checkpoint, and write and print the results.

    Custom figures are drawn in addition to the standard ones. If `own_figures` is None, no figures are drawn. `moved`
    holds the options with new paths of tables, which the advice on how to continue repeats. With `verbose`, all
    numbers and checks are printed, not only the closing lines.

    Raises
    ------
    NotConvergedError
        If a limit was reached before convergence; all results are written nevertheless.
    """
    from softness_bayes.provenance import versions
    from softness_bayes.runs.run import model_of, sample_kept

    out = checkpoint.directory
    with telling("compiling the model"):
        model = model_of(data, request.model)
    for line in _about(model, data):
        click.echo(line, err=True)
    bar = Bar()
    with keeping(lambda: _kept(checkpoint, bar.drawing, moved)), checkpoint, bar:
        checkpoint.request = {
            "files": files.record_in(out),
            "options": request._replace(model=model.options).record(),
            "figures": own_figures is not None,
            "own_figures": list(own_figures or ()),
            "versions": versions(),
        }
        bar.begin(0.0 if checkpoint.status is None else checkpoint.status.seconds)
        result = sample_kept(checkpoint, model, request.run, own_figures, bar.show)
    print_result(result, out, bar.times(), verbose)
    ending = result.provenance.ending
    if not ending.converged and not ending.quick:
        raise NotConvergedError(
            f"not converged after {ending.steps} steps; the draws so far are in {out}, for inspection only; "
            f"{_again(out, moved)} the run"
        )


def _about(model: ExperimentModel | SkinModel, data: Experiment | Measurements) -> Iterator[str]:
    """Yield notes and warnings on the data and on how the model reads them."""
    from softness_bayes.model.build import ExperimentModel, people_notes, sharing_note
    from softness_bayes.model.reach import reach_of

    yield from (f"note: {note}" for note in data.notes)
    if data.afferents is not None:
        yield f"note: {sharing_note(data.afferents, model.options.shared)}"
    if isinstance(model, ExperimentModel):
        if note := reach_of(model.experiment, model.options):
            yield f"warning: {note}"
        yield _about_direction(model)
        notes = model.interpretation.note, model.interpretation.errors_note
        yield from (f"note: {note}" for note in (*notes, *people_notes(model.experiment, model.options)))


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
