"""`softness-bayes status`: progress of a run, read without disturbing it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.running import in_numbers, needed
from softness_bayes.files.asked import read_asked

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
        click.echo(f"the density could not be computed at {status.failures} points, listed in nonfinite.csv")
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
    asked = f" of {found.asked}" if found.asked else ""
    click.echo(f"{directory}: {found.finished}{asked} replicates are finished, {found.unconverged} did not converge")
    if found.running:
        seconds = "" if math.isnan(found.seconds) else f", about {found.seconds:.0f} s to go"
        click.echo(f"a process is running it{seconds}")
    elif left:
        click.echo(f"interrupted, no process is running it; the same 'softness-bayes calibrate' runs the other {left}")
    else:
        click.echo("no process is running it")


def _of_a_study(directory: Path, runs: dict[str, Status]) -> None:
    """Print the number of finished runs of a study, and the progress of each run."""
    done = [one for one in runs.values() if one.ended and one.written and not one.running]
    good = sum(one.verdict is not None and one.verdict.converged for one in done)
    under_way = sum(one.running for one in runs.values())
    waiting = read_asked(directory).tasks - len(runs)
    more = f"; {waiting} more have not begun" if waiting > 0 else ""
    click.echo(
        f"{directory}: of {len(runs)} runs that have begun, {len(done)} have ended ({good} converged), "
        f"{under_way} are running, and {len(runs) - len(done) - under_way} are interrupted{more}"
    )
    for name, one in runs.items():
        rate = one.seconds / max(one.steps, 1)
        left = f", about {one.missing * rate:.0f} s to go" if one.missing and one.steps else ""
        click.echo(f"{name}: {_what(one)}; {one.steps} steps in {one.seconds:.0f} s{left}")


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
