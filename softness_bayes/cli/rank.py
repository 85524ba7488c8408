"""`softness-bayes rank` and `softness-bayes target`: fabrics by predicted softness, and those of a wished rating."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from softness_bayes.base.defaults import ANSWER_DRAWS, SEED
from softness_bayes.base.files.run_files import FABRIC_RATINGS
from softness_bayes.base.options import Number
from softness_bayes.base.ranges import ANY
from softness_bayes.base.readable import chance, interval, number, percent, some_of
from softness_bayes.cli.options import Directory, Force, Loads, Seed, TableFile, Touches, TrustCode, Words, command
from softness_bayes.cli.running import rated_run, warn_of_cautions

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.results.ranking import Ranking
    from softness_bayes.results.result import Result

FIGURE = "ranking"
AGREEMENT = "agreement.csv"


@command
def rank(
    directory: Path,
    *,
    touches: Touches,
    against: Path | None = None,
    format_: Annotated[str, Words("png", "pdf", "svg")] = "png",
    seed: Seed = SEED,
    out: Annotated[Path | None, Directory()] = None,
    force: Force = False,
    trust_code: TrustCode = False,
) -> None:
    """Rank fabrics by predicted softness: the typical rater rates softer fabrics higher.

    For each load the tables give the probability of each rank of every fabric, and of the order of every pair. Fabrics
    with the same rating in a draw are tied and share their ranks equally; this includes all fabrics for which no
    receptor fires. DIR is a run of 'sample'.

    Parameters
    ----------
    directory : DIR
    fabrics
        Fabric table (CSV, Excel or Parquet); by default the fabrics of the run.
    indentation_mm
        Indentation [mm] of the touch; by default as rated.
    force_n
        Contact force [N] of the touch; by default as rated.
    against
        Observed order to compare with (a table): fabric, and rank (1: softest) or rating (higher: softer).
    format_
        Format of the figure.
    out
        Directory to write to; by default DIR/ranking.
    """
    from softness_bayes.base.files.outputs import require_outputs, write_outputs
    from softness_bayes.base.files.spreadsheet import csv_of
    from softness_bayes.data.lists import read_order
    from softness_bayes.plotting.style import files_of

    target = out or (directory if directory.is_dir() else directory.parent) / FIGURE
    figure = f"{FIGURE}.{format_}"
    names, inputs = ["ranking.csv", "places.csv", "pairs.csv", figure], touches.inputs
    if against is not None:
        names, inputs = [*names, AGREEMENT], [*inputs, against]
    require_outputs(target, names, "rank", force, inputs)
    observed = None if against is None else read_order(against, touches.decimal)
    with rated_run(directory, trust_code) as result:
        ranking = result.rank(*touches.among(result.fabrics, result.loads), ANSWER_DRAWS, seed)
    tables = dict(zip(names, (ranking.table, ranking.place_table, ranking.pair_table), strict=False))
    if observed is not None:
        tables[AGREEMENT] = ranking.against(observed)
    contents: dict[str, bytes | str] = {
        name: csv_of(result.labelled(table), index=False) for name, table in tables.items()
    }
    write_outputs(target, contents | files_of(ranking.figure(), FIGURE, (format_,)), "rank")
    click.echo(f"{ranking.sentence}\n")
    _show(ranking)
    if observed is not None:
        agreement = tables[AGREEMENT]
        left = len(observed) - int(agreement["fabrics"].iloc[0])
        click.echo(
            "agreement with the observed order (median and 5-95 % limits over the draws; se from "
            "differences between fabrics):"
        )
        click.echo(agreement.to_string(index=False, float_format="{:.3f}".format, na_rep="–"))
        if left:
            click.echo(f"note: {against}: {some_of(left, len(observed), 'fabric', 'was', 'were')} not ranked", err=True)
    click.echo(f"written to {target}: {', '.join((*tables, figure))}", err=True)


def _show(ranking: Ranking, most: int = 20) -> None:
    """Print the order of the fabrics under each load, without the middle of tables with most rows, and the ties."""
    columns = ["order", "fabric", "e_fab_kpa", "people", "people_low", "people_high", "typical_rating"]
    columns += ["place_low", "place", "place_high", "tie", "p_silent"]
    first = "the softest first (the highest predicted rating)" if ranking.word == "softest" else "the highest first"
    for load, rows in ranking.table.groupby("load", sort=False):
        click.echo(f"{load}, {first}; people: their own mean, typical_rating: what the chain predicts")
        parts = [rows] if len(rows) <= most else [rows.head(most // 2), rows.tail(most // 2)]
        lines = [part[columns].to_string(index=False, float_format="{:.4g}".format, na_rep="–") for part in parts]
        click.echo("\n...\n".join(lines))
        tied, silent = int((rows["tie"] != "").sum()), int((rows["p_silent"] >= 0.5).sum())
        if tied:
            click.echo(
                f"{some_of(tied, len(rows), 'fabric')} tied with others and share the mean of their places; "
                f"no receptor fires for {silent} in most draws"
            )
        click.echo()


@command
def target(
    directory: Path,
    *,
    rating: Annotated[float, Number(ANY)],
    touches: Loads,
    tensile_modulus_mpa: Annotated[float | None, Number(ANY)] = None,
    thickness_mm: Annotated[float | None, Number(ANY)] = None,
    poisson_ratio: Annotated[float | None, Number(ANY)] = None,
    seed: Seed = SEED,
    file: TableFile,
    trust_code: TrustCode = False,
) -> None:
    """Find the effective moduli that give a desired rating, and the probability that one exists.

    The table has one row for each load and solution: if the response turns over, a softer and a stiffer fabric can have
    the same rating. Medians and limits are over the draws in which the solution exists. Moduli are searched from a
    tenth of the smallest rated modulus to ten times the largest. DIR is a run of 'sample'.

    Parameters
    ----------
    directory : DIR
    rating
        Rating of the typical rater, on the scale of the data.
    indentation_mm
        Indentation [mm] of the touch; by default as rated.
    force_n
        Contact force [N] of the touch; by default as rated.
    tensile_modulus_mpa : MPA
        Tensile modulus of the fabric; the command then finds its thickness.
    thickness_mm : MM
        Thickness of the fabric; the command then finds its tensile modulus.
    poisson_ratio : NU
        Poisson ratio of the fabric; by default the median of the rated fabrics.
    """
    from softness_bayes.data.columns import TENSILE_MODULUS, THICKNESS
    from softness_bayes.results.target import Cloth

    file.require()
    measured = ((TENSILE_MODULUS, tensile_modulus_mpa), (THICKNESS, thickness_mm))
    tensile, thick = (None if value is None else value * column.factor for column, value in measured)
    cloth = Cloth(tensile, thick, poisson_ratio)
    cloth.require()
    with rated_run(directory, trust_code) as result:
        warn_of_cautions(result, None)
        table = result.target(rating, touches.loads or None, *cloth, draws=ANSWER_DRAWS, seed=seed).table
    table = result.labelled(table)
    file.write(table)
    for load, rows in table.groupby("load", sort=False):
        click.echo(f"{load}: {_reach(rows)}{_nearest(result, str(load), rating)}", err=True)
    if result.fit.follows.rejected:
        click.echo(
            "the chain does not follow the ratings of this run: trust people's own means, not its moduli", err=True
        )


def _nearest(result: Result, load: str, rating: float) -> str:
    """Return in words the rated fabrics whose mean by people's own answers is nearest to a rating, from either side."""
    table = result.tables[FABRIC_RATINGS].reset_index()
    if "people" not in table or load not in set(table["load"]):
        return ""
    own = table[table["load"] == load].sort_values("people")
    around = [*own[own["people"] <= rating].tail(1).iterrows(), *own[own["people"] > rating].head(1).iterrows()]
    each = [f"{row['fabric']} {interval(row, 'people')}" for _, row in around]
    return f"; people themselves rated {' and '.join(each)}"


def _reach(rows: pd.DataFrame) -> str:
    """Return in words whether the rating can be reached under one load, and at which moduli."""
    one = rows.iloc[0]
    reach = f"a rating of {one['rating']:g} is reachable with probability {chance(one['p_reachable'])}"
    if not one["p_solution"]:
        least, largest = number(one["least_rating"]), number(one["largest_rating"])
        return f"{reach}: the ratings of the typical rater range from {least} to {largest}"
    sought = {
        "e_fab_kpa": ("E_fab", "kPa"),
        "thickness_mm": ("thickness", "mm"),
        "tensile_modulus_mpa": ("tensile modulus", "MPa"),
    }
    ways = []
    for _, row in rows.iterrows():
        values = [f"{noun} {interval(row, name)} {unit}" for name, (noun, unit) in sought.items() if name in rows]
        share, change = percent(row["p_solution"]), row["with_modulus"]
        ways.append(f"{', '.join(values)}, where the rating {change} with the modulus, in {share} of the draws")
    return f"{reach}: {'; or '.join(ways)}"
