"""`softness-bayes sample`, `resume` and `status`: ratings in, posterior and credible bands out."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from softness_bayes.base.errors import InputError, NotConvergedError
from softness_bayes.base.options import Number
from softness_bayes.base.ranges import STEPS
from softness_bayes.base.readable import counted, some_of
from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options import Force, Given, NoFigures, Out, OwnFigures, TrustCode, Verbose, command, typed
from softness_bayes.cli.running import command_line
from softness_bayes.cli.terminal import Bar, in_numbers, needed, telling
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import DataFiles, Request, RunOptions, require_no_ratings_needed

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements
    from softness_bayes.model.build import ExperimentModel, SkinModel
    from softness_bayes.runs.checkpoint import Checkpoint
    from softness_bayes.runs.saved import Status

MOVABLE = ("data", "fabrics", "compression", "afferents")
"""Tables of a run, which may have been moved since."""


@command
def sample(
    *,
    files: DataFiles,
    model: ModelOptions,
    how: RunOptions,
    no_figures: NoFigures = False,
    figure: OwnFigures = (),
    out: Out = Path("results"),
    force: Force = False,
    verbose: Verbose = False,
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
    with telling("reading the tables"):
        from softness_bayes.data import Measurements  # inside, because the imports take longer than the tables
        from softness_bayes.runs.checkpoint import Checkpoint

        data = files.read()
    if isinstance(data, Measurements):
        require_no_ratings_needed(model, how)
        if data.compression is not None and not typed("prior_set"):
            model = replace(model, prior_set="wide")
            _note("without ratings the default is --priors wide, which is weakly informative about the skin")
    drawn = None if no_figures else figure
    _require_drawn(drawn)
    built = _compiled(data, model)
    if built.posterior.space.sampled:
        run = replace(how, command=command_line())
        _run(Checkpoint.create(out, force, inputs=files.paths), files, built, run, drawn, verbose)
    else:
        _evaluate(built)


@command
def resume(
    directory: Path,
    *,
    more_steps: Annotated[int | None, Number(STEPS, "N")] = None,
    limits: Annotated[RunOptions, Given("max_seconds", "processes")],
    moved: Annotated[DataFiles, Given(*MOVABLE)],
    no_figures: NoFigures = False,
    verbose: Verbose = False,
    trust_code: TrustCode = False,
) -> None:
    """Continue a run that was interrupted or has ended.

    The run continues in DIR with its original options, and gives the same draws as a run with the same seed that was
    never interrupted. A run that ended at its --max-steps gets the same number of steps again. A run that has
    converged continues only with --more-steps. A first look (sample --quick) continues to the full run. If the data,
    the priors, the readings or anything else that determines the draws has changed, the run is refused and the
    change is named. If files of the checkpoint are damaged, the run continues from the last intact state; the damaged
    files and the number of lost steps are reported.

    Parameters
    ----------
    directory : DIR
    more_steps
        Run at least this many further steps, even if the run has converged.
    data
        New path of the ratings, if they were moved.
    fabrics
        New path of the fabrics, if they were moved.
    compression
        New path of the forces, if they were moved.
    afferents
        New path of the recorded afferents, if they were moved.
    """
    from softness_bayes.base.files.records import require_trusted
    from softness_bayes.checking.provenance import VERSION, versions
    from softness_bayes.runs.checkpoint import Checkpoint
    from softness_bayes.runs.identity import differences

    checkpoint = Checkpoint.open(directory, salvage=True)
    status, request = checkpoint.status, checkpoint.request
    assert status is not None, "a run to continue has a state"
    if checkpoint.damage:
        _note(checkpoint.damage)
    if request is None:
        raise InputError(
            f"{directory}: the run was started in Python; continue it there, with sample(..., checkpoint=...) "
            f"inside 'with Checkpoint.open({str(directory)!r}) as checkpoint'"
        )
    require_trusted(f"{directory}: its checkpoint", request, trust_code)
    verdict = status.verdict if status.written and status.ended else None
    if verdict is not None and verdict.converged and more_steps is None and _is_whole(directory, trust_code):
        click.echo(f"{directory}: {verdict.sentence()} Its results are complete; use --more-steps to continue it.")
        return
    model, how = Request.from_record(request["options"])
    how = replace(
        continued(how, status, more_steps),
        max_seconds=limits.max_seconds,
        processes=limits.processes or how.processes,
    )
    then, now = (
        {name.removeprefix(VERSION): value for name, value in every.items()}
        for every in (request["versions"], versions())
    )
    if changed := differences(then, now):
        _note(f"the run was started with {changed}: draws may differ from those of an uninterrupted run")
    files = DataFiles.recorded_in(directory, request["files"])
    files = replace(files, **{name: getattr(moved, name) or getattr(files, name) for name in MOVABLE})
    for name in MOVABLE:
        path = getattr(files, name)
        if path is not None and not path.exists():
            raise InputError(
                f"{path}: no such file, and the run was started with it; if it was moved, give its new path "
                f"with --{name}"
            )
    figures = request.get("own_figures", []) if request["figures"] and not no_figures else None
    _require_drawn(figures)
    _run(checkpoint, files, _compiled(files.read(), model), how, figures, verbose, moved.words())


def _note(text: str) -> None:
    click.echo(f"note: {text}", err=True)


def _require_drawn(names: Sequence[str] | None) -> None:
    """Raise InputError for custom figures that cannot be drawn; the argument is None if no figures are requested."""
    from softness_bayes.base.supplied import installed
    from softness_bayes.plotting.figures import OWN_FIGURES, require_figures

    if names is not None and (names or installed(OWN_FIGURES)):
        require_figures([*names, *installed(OWN_FIGURES)])


def _compiled(data: Experiment | Measurements, options: ModelOptions) -> ExperimentModel | SkinModel:
    with telling("compiling the model"):
        from softness_bayes.model.build import model_of

        return model_of(data, options)


def _evaluate(model: ExperimentModel | SkinModel) -> None:
    """Evaluate and print a model without sampled parameters."""
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.runs.evaluation import Evaluation

    lines, error = [f"note: {note}" for note in model.data.notes], 0.0
    if isinstance(model, ExperimentModel):
        assert model.resolution is not None, "the command line sets an accuracy"
        lines, error = [*lines, _about_direction(model)], float(model.resolution.errors.peak)
    lines += Evaluation(model.posterior, error).sentences()
    lines.append("nothing is written; 'softness-bayes predict' shows contact, stress and firing at these values")
    click.echo("\n".join(lines))


def _about_direction(model: ExperimentModel) -> str:
    """Return the sentence on the direction of the ratings, marked as a note or a warning."""
    return f"{'warning' if model.direction.against_data else 'note'}: {model.direction.sentence}"


def _run(
    checkpoint: Checkpoint,
    files: DataFiles,
    model: ExperimentModel | SkinModel,
    run: RunOptions,
    own_figures: Sequence[str] | None,
    verbose: bool,
    moved: Sequence[str] = (),
) -> None:
    """Sample a model from the start or from the checkpoint, and write and print the results.

    Custom figures are drawn in addition to the standard ones; None draws no figures at all. `moved` holds the options
    with new paths of tables, which the advice on how to continue repeats.

    Raises
    ------
    NotConvergedError
        If a limit was reached before convergence; all results are written nevertheless.
    """
    from softness_bayes.checking.provenance import versions
    from softness_bayes.cli.running import print_result
    from softness_bayes.runs.run import sample_kept

    out = checkpoint.directory
    again = f"'{' '.join(['softness-bayes resume', str(out), *map(shlex.quote, moved)])}' continues"
    for line in _about(model):
        click.echo(line, err=True)
    bar = Bar()

    def kept() -> str:
        if bar.drawing:
            return f"the results are written to {out}: 'softness-bayes plot {out}' draws the figures; {again} it"
        status = checkpoint.status
        if status is None:
            checkpoint.leave()  # the process may end before its main thread does so
            return "nothing was saved, because sampling had not begun: start the run again"
        until = "in its pilot phase" if status.piloting else f"up to step {status.steps}"
        return f"the run is saved {until}: {again} it"

    with keeping(kept), checkpoint, bar:
        checkpoint.request = {
            "files": files.record_in(out),
            "options": Request(model.options, run).record(),
            "figures": own_figures is not None,
            "own_figures": list(own_figures or ()),
            "versions": versions(),
        }
        bar.begin(0.0 if checkpoint.status is None else checkpoint.status.seconds)
        result = sample_kept(checkpoint, model, run, own_figures, bar.show)
    print_result(result, out, bar.times(), verbose)
    ending = result.provenance.ending
    if not ending.converged and not ending.quick:
        raise NotConvergedError(
            f"not converged after {ending.steps} steps; the draws so far are in {out}, for inspection only; "
            f"{again} the run"
        )


def _about(model: ExperimentModel | SkinModel) -> Iterator[str]:
    """Yield notes and warnings on the data and on how the model reads them."""
    from softness_bayes.model.build import ExperimentModel, people_notes, sharing_note
    from softness_bayes.model.reach import reach_of

    data = model.data
    yield from (f"note: {note}" for note in data.notes)
    if data.afferents is not None and (isinstance(model, ExperimentModel) or data.compression is not None):
        yield f"note: {sharing_note(data.afferents, model.options.shared)}"
    if isinstance(model, ExperimentModel):
        if note := reach_of(model):
            yield f"warning: {note}"
        yield _about_direction(model)
        notes = model.interpretation.note, model.interpretation.errors_note
        yield from (f"note: {note}" for note in (*notes, *people_notes(model.data, model.options)))


def _is_whole(directory: Path, trust_code: bool) -> bool:
    """Return whether the results of a run can be read; if not, print why they are written again."""
    from softness_bayes.results.result import Result

    try:
        Result.load(directory, trust_code=trust_code)
    except InputError as error:
        _note(f"{error}; the results are written again")
        return False
    return True


def continued(options: RunOptions, status: Status, more_steps: int | None) -> RunOptions:
    """Return the options of a run with limits that let it go on."""
    options = replace(options, command=f"{options.command}; {command_line()}")
    if options.quick or more_steps is not None:
        least = 0 if more_steps is None else status.steps + more_steps
        return replace(options, quick=False, min_steps=least, max_steps=max(options.max_steps, least))
    if status.written and status.steps >= status.max_steps:
        return replace(options, max_steps=status.steps + options.max_steps)
    return options


@command
def status(directory: Path) -> None:
    """Show the progress of a run without disturbing it.

    Prints the number of steps, the result of the last check of the chains, the verdict, and whether a process is
    running it. For a study it prints one line for each run that has begun; for a calibration the numbers of finished
    replicates and of those that are left.

    Parameters
    ----------
    directory : DIR
    """
    from softness_bayes.base.files.run_files import CHECKPOINT, RUNS
    from softness_bayes.runs.batch import ASKED
    from softness_bayes.runs.rank_table import MANIFEST

    if (directory / MANIFEST).is_file() and (directory / ASKED).is_file():
        lines = _of_a_calibration(directory)
    elif (directory / RUNS).is_dir() and not (directory / CHECKPOINT).exists():
        lines = _of_a_study(directory)
    else:
        lines = _of_a_run(directory)
    click.echo("\n".join(lines))


def _of_a_run(directory: Path) -> list[str]:
    """Return the steps, the state and the last check of a run, in lines."""
    from softness_bayes.runs.saved import read_status

    status = read_status(directory)
    verdict, togo = status.verdict, f", about {status.missing} to go" if status.missing else ""
    lines = [f"{directory}: {_state(status)}", f"steps: {status.steps} in {status.seconds:.0f} s{togo}"]
    if status.failures:
        points = counted(status.failures, "point")
        lines.append(f"the density could not be computed at {points}, listed in nonfinite.csv")
    if verdict is None:
        return [*lines, "convergence has not been checked yet"]
    lines.append(f"at step {verdict.steps}: {in_numbers(verdict, status.seconds)}")
    lines += [needed(verdict, status.seconds / status.steps)] if status.steps and not verdict.converged else []
    return [*lines, verdict.sentence()]


def _of_a_calibration(directory: Path) -> list[str]:
    """Return the numbers of finished replicates and of those that are left, in lines."""
    from softness_bayes.base.files.lock import is_held
    from softness_bayes.runs.batch import LOCK, read_asked
    from softness_bayes.runs.rank_table import RANKS, read_replicates

    asked = read_asked(directory)
    done = [one for index, one in read_replicates(directory).items() if index < asked.fits]
    fits, unconverged = max(asked.fits, len(done)), sum(not one.converged for one in done)
    seconds = asked.seconds_left(len(done), (directory / RANKS).stat().st_mtime if done else 0.0)
    size, left, state = some_of(len(done), fits, "replicate"), fits - len(done), "no process is running it"
    if is_held(directory / LOCK):
        state = "a process is running it" + ("" if math.isnan(seconds) else f", about {seconds:.0f} s to go")
    elif left:
        state = f"interrupted, {state}; the same 'softness-bayes calibrate' runs the other {left}"
    return [f"{directory}: {size} finished, {unconverged} did not converge", state]


def _of_a_study(directory: Path) -> list[str]:
    """Return the numbers of tables of a study by their state, and the progress of each run, in lines."""
    from softness_bayes.base.files.run_files import POSTERIOR, RUNS
    from softness_bayes.runs.batch import read_asked
    from softness_bayes.runs.saved import read_status, saved_states
    from softness_bayes.runs.study import refused_tables

    begun = sorted(path for path in (directory / RUNS).iterdir() if saved_states(path))
    runs = {path.name: read_status(path) for path in begun}
    done = [name for name, one in runs.items() if one.ended and one.written and not one.running]
    good = sum((verdict := runs[name].verdict) is not None and verdict.converged for name in done)
    under_way = sum(one.running for one in runs.values())
    refused, asked = [name for name in refused_tables(directory) if name not in runs], read_asked(directory)
    asked = asked._replace(fits=max(asked.fits - len(refused), len(runs)))
    last = max(((directory / RUNS / name / POSTERIOR).stat().st_mtime for name in done), default=0.0)
    left = asked.seconds_left(len(done), last)
    whole = f"{directory}: {counted(len(done), 'run')} ended ({good} converged), {under_way} running, "
    whole += f"{len(runs) - len(done) - under_way} interrupted, {asked.fits - len(runs)} not begun"
    if refused:
        whole += f"; {counted(len(refused), 'table was', 'tables were')} refused ({', '.join(refused)})"
    lines = [whole if math.isnan(left) or not under_way else f"{whole}; about {left:.0f} s to go"]
    for name, one in runs.items():
        togo = f", about {one.missing * one.seconds / one.steps:.0f} s to go" if one.missing and one.steps else ""
        lines.append(f"{name}: {_state(one)}; {counted(one.steps, 'step')} in {one.seconds:.0f} s{togo}")
    return lines


def _state(status: Status) -> str:
    """Return the state of a run: under way, ended or interrupted."""
    if status.running:
        return "a process is running it" + (", in its pilot phase" if status.piloting else "")
    if status.ended and status.written and status.quick:
        return "a first look (--quick); 'softness-bayes resume' continues it to the full run"
    if status.ended and status.written:
        return "it has ended and its results are written"
    pilot = " its pilot phase" * status.piloting
    return f"interrupted, no process is running it; 'softness-bayes resume' continues{pilot}"
