"""`softness-bayes sample`: ratings in, posterior and credible bands out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import (
    DataFiles,
    ReadingChoice,
    data_files,
    fix,
    force,
    out,
    prior,
    prior_set,
    readings,
    seed,
)
from softness_bayes.cli.running import command_line, max_time, no_figures, processes, run

if TYPE_CHECKING:
    from softness_bayes.inference.priors import Prior


@click.command()
@data_files
@fix
@prior
@prior_set
@readings
@click.option(
    "--direction",
    type=click.Choice(["softness", "inverse"]),
    default="softness",
    show_default=True,
    help="Whether ratings rise (softness) or fall (inverse) with the response.",
)
@click.option(
    "--max-steps",
    type=click.IntRange(min=1),
    default=100_000,
    show_default=True,
    help="Steps of each ensemble after which the run ends, converged or not.",
)
@max_time
@processes
@no_figures
@seed
@out
@force
def command(
    files: DataFiles,
    fixed: dict[str, float],
    priors: dict[str, Prior],
    prior_set: str,
    choice: ReadingChoice,
    direction: str,
    max_steps: int,
    max_time: float,
    processes: int | None,
    no_figures: bool,
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Sample the posterior of skin, transduction and rating parameters given ratings.

    Runs four independent ensembles until they have converged, or to --max-steps or --max-time, and writes to
    --out: posterior.nc (draws, predictions, provenance), summary.csv and figures/. Prints the summary, where
    the response turns over under each load, and a verdict. Exit code 3: not converged.

    The run is kept in --out all along: 'status' says how far it is, and 'resume' continues it, interrupted or
    ended, to the draws of a run that was never interrupted.
    """
    from softness_bayes.inference.observation import RATING_DIRECTIONS
    from softness_bayes.run import RunOptions
    from softness_bayes.storage.checkpoint import Checkpoint

    experiment = files.read()
    options = RunOptions(
        fix=fixed,
        priors=priors,
        prior_set=prior_set,
        readings=choice.resolve(),
        direction=RATING_DIRECTIONS[direction],
        max_steps=max_steps,
        max_seconds=max_time,
        processes=processes,
        seed=seed,
        command=command_line(),
    )
    run(Checkpoint.create(out, force), files, experiment, options, not no_figures)
