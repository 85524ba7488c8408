"""`softness-bayes rank`: fabrics in the order of their predicted softness."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options.run import seed, trust_code
from softness_bayes.cli.options.tables import RequestedTouches, touches_of_run
from softness_bayes.cli.options.values import FILE
from softness_bayes.cli.running import reading, warn_of_unconverged
from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.errors import InputError
from softness_bayes.readable import some_of

if TYPE_CHECKING:
    from softness_bayes.results.ranking import Ranking

RANK, FORMATS = "rank", ("png", "pdf")
ORDER, PLACES, PAIRS, AGREEMENT, FIGURE = "ranking.csv", "places.csv", "pairs.csv", "agreement.csv", "ranking"
MADE = (ORDER, PLACES, PAIRS, *(f"{FIGURE}.{suffix}" for suffix in FORMATS))

SHOWN = 20
"""Largest number of printed rows; of longer tables, the first and the last rows are printed."""


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
@touches_of_run
@click.option(
    "--against",
    type=FILE,
    metavar="FILE",
    help="Observed order to compare with (a table): fabric, and rank (1: softest) or rating (higher: softer).",
)
@seed
@click.option("--out", type=FILE, metavar="OUT", help=f"Directory to write to; by default DIR/{FIGURE}.")
@click.option("--force", is_flag=True, help="Replace the files that 'rank' wrote there.")
@trust_code
def command(
    directory: Path, touches: RequestedTouches, against: Path | None, seed: int, out: Path | None, force: bool
) -> None:
    """Rank fabrics by predicted softness: the typical rater rates softer fabrics higher.

    For each load the tables give the probability of each rank of every fabric, and of the order of every pair. Fabrics
    with the same rating in a draw are tied and share their ranks equally; this includes all fabrics for which no
    receptor fires. DIR is a run of 'sample'.
    """
    from softness_bayes.data.lists import read_order
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.files.spreadsheet import csv_of
    from softness_bayes.plotting.style import files_of

    target = (directory if directory.is_dir() else directory.parent) / FIGURE if out is None else out
    inputs = [*touches.inputs, *([] if against is None else [against])]
    require_outputs(target, (*MADE, *([] if against is None else [AGREEMENT])), RANK, force, inputs)
    observed = None if against is None else read_order(against, touches.decimal)
    with reading(directory) as (result,):
        warn_of_unconverged(result)
        if not result.has_ratings:
            raise InputError(f"{directory}: a run without ratings cannot predict ratings")
        fabrics, loads = touches.of_run(result)
        found = result.rank(fabrics, loads, ANSWER_DRAWS, seed)
    agreement = None if observed is None else found.against(observed)
    tables = {ORDER: found.table, PLACES: found.place_table, PAIRS: found.pair_table}
    tables |= {} if agreement is None else {AGREEMENT: agreement}
    contents: dict[str, bytes | str] = {
        name: csv_of(result.labelled(table), index=False) for name, table in tables.items()
    }
    write_outputs(target, contents | files_of(found.figure(), FIGURE, FORMATS), RANK)
    _show(found)
    if observed is not None and agreement is not None:
        left = len(observed) - int(agreement["fabrics"].iloc[0])
        click.echo(
            "agreement with the observed order (median and 5-95 % limits over the draws; se from "
            "differences between fabrics):"
        )
        click.echo(agreement.to_string(index=False, float_format="{:.3f}".format, na_rep="–"))
        if left:
            click.echo(f"note: {against}: {some_of(left, len(observed), 'fabric', 'was', 'were')} not ranked", err=True)
    click.echo(f"written to {target}: {', '.join((*tables, *MADE[3:]))}", err=True)


def _show(found: Ranking) -> None:
    """Print the order of the fabrics under each load, without the middle of long tables, and the ties."""
    columns = ["order", "fabric", "e_fab_kpa", "typical_rating", "place_low", "place", "place_high", "tie", "p_silent"]
    for one, (load, rows) in zip(found.loads, found.table.groupby("load", sort=False), strict=True):
        click.echo(f"{load}, the softest first (the highest predicted rating):")
        parts = [rows] if len(rows) <= SHOWN else [rows.head(SHOWN // 2), rows.tail(SHOWN // 2)]
        lines = [part[columns].to_string(index=False, float_format="{:.4g}".format) for part in parts]
        click.echo("\n...\n".join(lines))
        tied, silent = int((one.tie > 0).sum()), int((one.p_silent >= 0.5).sum())
        if tied:
            click.echo(
                f"{some_of(tied, len(rows), 'fabric')} tied with others and share the mean of their places; "
                f"no receptor fires for {silent} in most draws"
            )
        click.echo()
