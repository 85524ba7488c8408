"""`softness-bayes status`: progress of a run, read without disturbing it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.running import in_numbers

if TYPE_CHECKING:
    from softness_bayes.checkpoints.checkpoint import Status


@click.command()
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
def command(directory: Path) -> None:
    """Say how a run is getting on, without disturbing it.

    Prints steps, what the last look at the chains found, the verdict, and whether a process is at it. Reads one
    small file of DIR, which the run replaces whole every few seconds.
    """
    from softness_bayes.checkpoints.checkpoint import read_status

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
    click.echo(status.verdict.sentence())


def _what(status: Status) -> str:
    """Say whether a run is under way, has ended or was interrupted."""
    if status.running:
        return "a process is running it" + (", in its pilot walk" if status.piloting else "")
    if status.ended and status.written:
        return "it has ended, its results are written"
    return (
        f"interrupted, no process is running it; 'softness-bayes resume' continues{' its pilot walk' * status.piloting}"
    )
