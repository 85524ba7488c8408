"""`softness-bayes compare`: fitted models ranked by their predictions of left-out ratings."""

from __future__ import annotations

from pathlib import Path

import click

from softness_bayes.cli.options import FILE, dask, number, out, trust_code
from softness_bayes.cli.running import executor_of, reading
from softness_bayes.defaults import LEFT_OUT
from softness_bayes.ranges import STEPS
from softness_bayes.readable import chance

COMPARE, COMPARISON = "compare", "compare.csv"


@click.command()
@click.argument("directories", metavar="RESULT_DIR...", nargs=-1, required=True, type=FILE)
@click.option(
    "--leave",
    "left_out",
    type=click.Choice(LEFT_OUT),
    default=LEFT_OUT[0],
    show_default=True,
    help="What is held out and predicted from the rest: single ratings, participants, fabrics, or fabrics "
    "under single loads.",
)
@number(
    "--max-steps",
    STEPS,
    "Largest number of steps of each ensemble in a refit without a fabric; it then ends even if it has not converged.",
)
@dask
@out(".", f"Directory to write {COMPARISON} to.")
@click.option("--force", is_flag=True, help=f"Replace an existing {COMPARISON}.")
@trust_code
def command(
    directories: tuple[Path, ...], left_out: str, max_steps: int | None, dask: str | None, out: Path, force: bool
) -> None:
    """Rank finished runs by how well they predict held-out data.

    The runs must have the same ratings; readings, directions, priors or effects may differ. The log predictive
    densities of the ratings (in the units of the table) are summed (elpd) and compared unit by unit. Ratings (lists
    and pairs as a whole) and participants are held out by importance weights (PSIS). Fabrics are held out by sampling
    each model again without them, which takes about as long as the runs times the number of fabrics. Single
    conditions are held out by weights, and sampled again where these fail. The difference is compared with the
    largest of its standard errors: over single units, and over clusters of ratings by fabric, condition and
    participant. Weights are those of the mixture of runs that predicts best (stacking).
    """
    from dataclasses import replace

    from softness_bayes.errors import InputError
    from softness_bayes.files.command_line import endings
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.files.spreadsheet import csv_of
    from softness_bayes.runs.comparison import REFIT, compare
    from softness_bayes.runs.left_out import LEAVE

    require_outputs(out, [COMPARISON], COMPARE, force)
    labels = endings(directories)
    if len({*directories}) < len(directories):
        raise InputError("compare: a result is given twice")
    settings = REFIT if max_steps is None else replace(REFIT, max_steps=max_steps)
    with reading(*directories) as loaded, executor_of(dask) as executor:
        results = dict(zip(labels, loaded, strict=True))
        comparison = compare(
            results, LEAVE[left_out], settings, lambda what: click.echo(f"sampled {what}", err=True), executor
        )
    (path,) = write_outputs(out, {COMPARISON: csv_of(comparison.table)}, COMPARE)
    shown = comparison.table.drop(columns=["model", "unfinished", "converged"])
    click.echo(shown.to_string(float_format=lambda x: f"{x:.4g}", na_rep="–"))
    click.echo()
    for label, model in comparison.table["model"].items():
        click.echo(f"{label}: {model or 'the same model'}")
    for warning in comparison.warnings:
        click.echo(f"warning: {warning}")
    shares = ", ".join(f"{load} {chance(share)}" for load, share in comparison.interior.items())
    click.echo(f"probability of an interior maximum, averaged over the runs with their weights: {shares}")
    click.echo(f"written to {path}")
    click.echo(comparison.sentence)
