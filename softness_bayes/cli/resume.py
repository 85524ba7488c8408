"""`softness-bayes status` and `softness-bayes resume`: progress of a run, and its continuation."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import FILE, collected, no_figures, number, trust_code, trusts_code, verbose
from softness_bayes.cli.running import command_line, in_numbers, needed
from softness_bayes.cli.sample import require_drawn, run
from softness_bayes.errors import InputError
from softness_bayes.ranges import STEPS
from softness_bayes.readable import counted, some_of
from softness_bayes.results.run_options import DataFiles, RunOptions

if TYPE_CHECKING:
    from softness_bayes.checkpoints.saved import Status
    from softness_bayes.runs.rank_table import CalibrationProgress


MOVABLE = ("data", "fabrics", "compression", "afferents")
"""Tables of a run, which may have been moved since."""


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
@number("--more-steps", STEPS, "Run at least this many further steps, even if the run has converged.")
@collected("limits", RunOptions, "max_seconds", "processes")
@collected(
    "moved",
    DataFiles,
    *MOVABLE,
    data={"help": "New path of the ratings, if they were moved."},
    fabrics={"help": "New path of the fabrics, if they were moved."},
    compression={"help": "New path of the forces, if they were moved."},
    afferents={"help": "New path of the recorded afferents, if they were moved."},
)
@no_figures
@verbose
@trust_code
def command(
    directory: Path,
    more_steps: int | None,
    limits: RunOptions,
    moved: DataFiles,
    no_figures: bool,
    verbose: bool,
) -> None:
    """Continue a run that was interrupted or has ended.

    The run continues in DIR with its original options, and gives the same draws as a run with the same seed that was
    never interrupted. A run that ended at its --max-steps gets the same number of steps again. A run that has
    converged continues only with --more-steps. A first look (sample --quick) continues to the full run. If the data,
    the priors, the readings or anything else that determines the draws has changed, the run is refused and the
    change is named. If files of the checkpoint are damaged, the run continues from the last intact state; the damaged
    files and the number of lost steps are reported.
    """
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.checkpoints.identity import differences
    from softness_bayes.provenance import VERSION, versions
    from softness_bayes.results.request import Request
    from softness_bayes.supplied import require_trusted

    checkpoint = Checkpoint.open(directory, salvage=True)
    status = checkpoint.status
    assert status is not None, "a run to continue has a state"
    if checkpoint.damage:
        click.echo(f"note: {checkpoint.damage}", err=True)
    if checkpoint.request is None:
        raise InputError(
            f"{directory}: the run was started in Python; continue it there, with sample(..., checkpoint=...) "
            f"inside 'with Checkpoint.open({str(directory)!r}) as checkpoint'"
        )
    require_trusted(f"{directory}: its checkpoint", checkpoint.request, trusts_code())
    verdict = status.verdict if status.written and status.ended else None
    if verdict is not None and verdict.converged and more_steps is None and _is_whole(directory):
        click.echo(f"{directory}: {verdict.sentence()} Its results are complete; use --more-steps to continue it.")
        return
    model, how = Request.from_record(checkpoint.request["options"])
    how = replace(
        _continued(how, status, more_steps),
        max_seconds=limits.max_seconds,
        processes=limits.processes or how.processes,
    )
    then, now = (
        {name.removeprefix(VERSION): value for name, value in every.items()}
        for every in (checkpoint.request["versions"], versions())
    )
    if changed := differences(then, now):
        click.echo(
            f"note: the run was started with {changed}: draws may differ from those of an uninterrupted run", err=True
        )
    files = DataFiles.recorded_in(directory, checkpoint.request["files"])
    files = replace(files, **{name: getattr(moved, name) or getattr(files, name) for name in MOVABLE})
    for name in MOVABLE:
        path = getattr(files, name)
        if path is not None and not path.exists():
            raise InputError(
                f"{path}: no such file, and the run was started with it; if it was moved, give its new path "
                f"with --{name}"
            )
    wanted = checkpoint.request["figures"] and not no_figures
    own_figures = checkpoint.request.get("own_figures", []) if wanted else None
    require_drawn(own_figures)
    run(checkpoint, files, files.read(), Request(model, how), own_figures, verbose, moved.words())


def _is_whole(directory: Path) -> bool:
    """Return whether the results of a run can be read; if not, print why they are written again."""
    from softness_bayes.results.result import Result

    try:
        Result.load(directory, trust_code=trusts_code())
    except InputError as error:
        click.echo(f"note: {error}; the results are written again", err=True)
        return False
    return True


def _continued(options: RunOptions, status: Status, more_steps: int | None) -> RunOptions:
    """Return the options of a run with limits that let it go on."""
    options = replace(options, command=f"{options.command}; {command_line()}")
    if options.quick or more_steps is not None:
        least = 0 if more_steps is None else status.steps + more_steps
        return replace(options, quick=False, min_steps=least, max_steps=max(options.max_steps, least))
    if status.written and status.steps >= status.max_steps:
        return replace(options, max_steps=status.steps + options.max_steps)
    return options


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
def status(directory: Path) -> None:
    """Show the progress of a run without disturbing it.

    Prints the number of steps, the result of the last check of the chains, the verdict, and whether a process is
    running it. For a study it prints one line for each run that has begun; for a calibration the numbers of finished
    replicates and of those that are left.
    """
    from softness_bayes.checkpoints.saved import read_status, saved_states
    from softness_bayes.files.run_files import CHECKPOINT, RUNS
    from softness_bayes.runs.rank_table import is_calibration, progress_of

    if is_calibration(directory):
        lines = _of_a_calibration(directory, progress_of(directory))
    elif (directory / RUNS).is_dir() and not (directory / CHECKPOINT).exists():
        begun = sorted(path for path in (directory / RUNS).iterdir() if saved_states(path))
        lines = _of_a_study(directory, {path.name: read_status(path) for path in begun})
    else:
        lines = _of_a_run(directory, read_status(directory))
    click.echo("\n".join(lines))


def _of_a_run(directory: Path, status: Status) -> list[str]:
    """Return the steps, the state and the last check of a run, in lines."""
    verdict, togo = status.verdict, f", about {status.missing} to go" if status.missing else ""
    lines = [f"{directory}: {_what(status)}", f"steps: {status.steps} in {status.seconds:.0f} s{togo}"]
    if status.failures:
        points = counted(status.failures, "point")
        lines.append(f"the density could not be computed at {points}, listed in nonfinite.csv")
    if verdict is None:
        return [*lines, "convergence has not been checked yet"]
    lines.append(f"at step {verdict.steps}: {in_numbers(verdict, status.seconds)}")
    lines += [needed(verdict, status.seconds / status.steps)] if status.steps and not verdict.converged else []
    return [*lines, verdict.sentence()]


def _of_a_calibration(directory: Path, now: CalibrationProgress) -> list[str]:
    """Return the numbers of finished replicates and of those that are left, in lines."""
    asked = max(now.asked, now.finished)
    size, left = some_of(now.finished, asked, "replicate"), asked - now.finished
    state = "no process is running it"
    if now.running:
        state = "a process is running it" + ("" if math.isnan(now.seconds) else f", about {now.seconds:.0f} s to go")
    elif left:
        state = f"interrupted, {state}; the same 'softness-bayes calibrate' runs the other {left}"
    return [f"{directory}: {size} finished, {now.unconverged} did not converge", state]


def _of_a_study(directory: Path, runs: dict[str, Status]) -> list[str]:
    """Return the numbers of tables of a study by their state, and the progress of each run, in lines."""
    from softness_bayes.files.run_files import POSTERIOR, RUNS
    from softness_bayes.runs.batch import read_asked
    from softness_bayes.runs.study import refused_tables

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
        rate = one.seconds / max(one.steps, 1)
        togo = f", about {one.missing * rate:.0f} s to go" if one.missing and one.steps else ""
        lines.append(f"{name}: {_what(one)}; {counted(one.steps, 'step')} in {one.seconds:.0f} s{togo}")
    return lines


def _what(status: Status) -> str:
    """Return the state of a run: under way, ended or interrupted."""
    if status.running:
        return "a process is running it" + (", in its pilot phase" if status.piloting else "")
    if status.ended and status.written and status.quick:
        return "a first look (--quick); 'softness-bayes resume' continues it to the full run"
    if status.ended and status.written:
        return "it has ended and its results are written"
    return (
        "interrupted, no process is running it; 'softness-bayes resume' "
        f"continues{' its pilot phase' * status.piloting}"
    )
