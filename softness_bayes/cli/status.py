"""`softness-bayes status`: progress of a run, read without disturbing it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.running import in_numbers, needed
from softness_bayes.files.asked import read_asked
from softness_bayes.readable import counted, some_of

if TYPE_CHECKING:
    from softness_bayes.checkpoints.status import Status
    from softness_bayes.runs.calibration_files import CalibrationProgress


@click.command()
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
def command(directory: Path) -> None:
    """Show the progress of a run without disturbing it.

    Prints the number of steps, the result of the last check of the chains, the verdict, and whether a process is
    running it. Reads one small file of DIR, which the run replaces every few seconds. For a study it prints one line
    for each run that has begun; for a calibration the numbers of finished replicates and of those that are left.
    """
    from softness_bayes.checkpoints.status import read_status
    from softness_bayes.files.run_files import CHECKPOINT, MANIFEST, RUNS
    from softness_bayes.runs.calibration_files import is_calibration, progress_of

    if is_calibration(directory):
        _of_a_calibration(directory, progress_of(directory))
        return

    if (directory / RUNS).is_dir() and not (directory / CHECKPOINT).exists():
        begun = sorted(path.parent.parent for path in (directory / RUNS).glob(f"*/{CHECKPOINT}/{MANIFEST}"))
        _of_a_study(directory, {path.name: read_status(path) for path in begun})
        return
    status = read_status(directory)
    click.echo(f"{directory}: {_what(status)}")
    togo = f", about {status.missing} to go" if status.missing else ""
    click.echo(f"steps: {status.steps} in {status.seconds:.0f} s{togo}")
    if status.failures:
        click.echo(f"the density could not be computed at {counted(status.failures, 'point')}, listed in nonfinite.csv")
    if status.verdict is None:
        click.echo("convergence has not been checked yet")
        return
    click.echo(f"at step {status.verdict.steps}: {in_numbers(status.verdict, status.seconds)}")
    if not status.verdict.converged and status.steps:
        click.echo(needed(status.verdict, status.seconds / status.steps))
    click.echo(status.verdict.sentence())


def _of_a_calibration(directory: Path, found: CalibrationProgress) -> None:
    """Print the numbers of finished replicates and of those that are left."""
    left = found.asked - found.finished
    size = counted(found.finished, "replicate is", "replicates are")
    if found.asked:
        size = some_of(found.finished, found.asked, "replicate")
    click.echo(f"{directory}: {size} finished, {found.unconverged} did not converge")
    if found.running:
        seconds = "" if math.isnan(found.seconds) else f", about {found.seconds:.0f} s to go"
        click.echo(f"a process is running it{seconds}")
    elif left:
        click.echo(f"interrupted, no process is running it; the same 'softness-bayes calibrate' runs the other {left}")
    else:
        click.echo("no process is running it")


def _of_a_study(directory: Path, runs: dict[str, Status]) -> None:
    """Print the numbers of tables of a study by their state, and the progress of each run."""
    from softness_bayes.runs.study_progress import refused_tables, seconds_left

    done = [name for name, one in runs.items() if one.ended and one.written and not one.running]
    good = sum((verdict := runs[name].verdict) is not None and verdict.converged for name in done)
    under_way = sum(one.running for one in runs.values())
    refused = [name for name in refused_tables(directory) if name not in runs]
    asked = max(read_asked(directory).tasks, len(runs))
    waiting = max(asked - len(runs) - len(refused), 0)
    left = seconds_left(directory, done, asked - len(refused))
    click.echo(
        f"{directory}: {counted(len(done), 'run')} ended ({good} converged), {under_way} running, "
        f"{len(runs) - len(done) - under_way} interrupted, {waiting} not begun"
        + (f"; {counted(len(refused), 'table was', 'tables were')} refused ({', '.join(refused)})" if refused else "")
        + ("" if math.isnan(left) or not under_way else f"; about {left:.0f} s to go")
    )
    for name, one in runs.items():
        rate = one.seconds / max(one.steps, 1)
        togo = f", about {one.missing * rate:.0f} s to go" if one.missing and one.steps else ""
        click.echo(f"{name}: {_what(one)}; {counted(one.steps, 'step')} in {one.seconds:.0f} s{togo}")


def _what(status: Status) -> str:
    """Return the state of a run: under way, ended or interrupted."""
    if status.running:
        return "a process is running it" + (", in its pilot phase" if status.piloting else "")
    if status.ended and status.written and status.quick:
        return (
            "a first look (--quick), before the chains have converged; 'softness-bayes resume' continues it "
            "to the full run"
        )
    if status.ended and status.written:
        return "it has ended and its results are written"
    return (
        "interrupted, no process is running it; 'softness-bayes resume' "
        f"continues{' its pilot phase' * status.piloting}"
    )
