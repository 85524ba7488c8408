"""`softness-bayes status`: progress of a run, a study or a calibration."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import command
from softness_bayes.cli.terminal import in_numbers, needed
from softness_bayes.readable import counted, some_of

if TYPE_CHECKING:
    from softness_bayes.checkpoints.saved import Status


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
    from softness_bayes.files.run_files import CHECKPOINT, RUNS
    from softness_bayes.runs.rank_table import is_calibration

    if is_calibration(directory):
        lines = _of_a_calibration(directory)
    elif (directory / RUNS).is_dir() and not (directory / CHECKPOINT).exists():
        lines = _of_a_study(directory)
    else:
        lines = _of_a_run(directory)
    click.echo("\n".join(lines))


def _of_a_run(directory: Path) -> list[str]:
    """Return the steps, the state and the last check of a run, in lines."""
    from softness_bayes.checkpoints.saved import read_status

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
    from softness_bayes.runs.rank_table import progress_of

    now = progress_of(directory)
    asked = max(now.asked, now.finished)
    size, left = some_of(now.finished, asked, "replicate"), asked - now.finished
    state = "no process is running it"
    if now.running:
        state = "a process is running it" + ("" if math.isnan(now.seconds) else f", about {now.seconds:.0f} s to go")
    elif left:
        state = f"interrupted, {state}; the same 'softness-bayes calibrate' runs the other {left}"
    return [f"{directory}: {size} finished, {now.unconverged} did not converge", state]


def _of_a_study(directory: Path) -> list[str]:
    """Return the numbers of tables of a study by their state, and the progress of each run, in lines."""
    from softness_bayes.checkpoints.saved import read_status, saved_states
    from softness_bayes.files.run_files import POSTERIOR, RUNS
    from softness_bayes.runs.batch import read_asked
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
