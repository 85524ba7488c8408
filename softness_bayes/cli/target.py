"""`softness-bayes target`: the fabrics that have a wished rating."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options.run import seed, trust_code
from softness_bayes.cli.options.tables import load_options
from softness_bayes.cli.options.values import FILE
from softness_bayes.cli.running import reading, warn_of_unconverged
from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.errors import InputError
from softness_bayes.readable import chance, counted, number, percent

if TYPE_CHECKING:
    import pandas as pd

TARGET = "target"

_SOUGHT = (("thickness_mm", "thickness", "mm"), ("tensile_modulus_mpa", "tensile modulus", "MPa"))


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
@click.option(
    "--rating", type=float, required=True, metavar="X", help="Rating of the typical rater, on the scale of the data."
)
@load_options(True, " of the touch. Repeatable; by default as rated.")
@click.option(
    "--tensile-modulus-mpa",
    type=float,
    metavar="MPA",
    help="Tensile modulus of the fabric; the command then finds its thickness.",
)
@click.option(
    "--thickness-mm",
    type=float,
    metavar="MM",
    help="Thickness of the fabric; the command then finds its tensile modulus.",
)
@click.option(
    "--poisson-ratio",
    type=float,
    metavar="NU",
    help="Poisson ratio of the fabric; by default the median of the rated fabrics.",
)
@seed
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="CSV file to write; by default the table is printed, to five digits.",
)
@click.option("--force", is_flag=True, help="Replace the file --out if 'target' wrote it.")
@trust_code
def command(
    directory: Path,
    rating: float,
    indentation_mm: tuple[float, ...],
    force_n: tuple[float, ...],
    tensile_modulus_mpa: float | None,
    thickness_mm: float | None,
    poisson_ratio: float | None,
    seed: int,
    out: Path | None,
    force: bool,
) -> None:
    """Find the effective moduli that give a desired rating, and the probability that one exists.

    The table has one row for each load and solution: if the response turns over, a softer and a stiffer fabric can have
    the same rating. Medians and limits are over the draws in which the solution exists. Moduli are searched from a
    tenth of the smallest rated modulus to ten times the largest. DIR is a run of 'sample'.
    """
    from softness_bayes.data import loads_of
    from softness_bayes.data.columns import TENSILE_MODULUS, THICKNESS
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.files.spreadsheet import PRINTED, csv_of
    from softness_bayes.results.target import Cloth

    if out is not None:
        require_outputs(out.parent, [out.name], TARGET, force)
    given = ((TENSILE_MODULUS, tensile_modulus_mpa), (THICKNESS, thickness_mm))
    tensile, thick = (None if value is None else value * column.factor for column, value in given)
    cloth = Cloth(tensile, thick, poisson_ratio)
    cloth.require()
    loads = loads_of(indentation_mm, force_n)
    with reading(directory) as (result,):
        warn_of_unconverged(result)
        if not result.has_ratings:
            raise InputError(f"{directory}: a run without ratings cannot predict ratings")
        found = result.target(rating, loads or None, *cloth, draws=ANSWER_DRAWS, seed=seed)
    table = result.labelled(found.table)
    if out is None:
        click.echo(csv_of(table, index=False, digits=PRINTED), nl=False)
    else:
        write_outputs(out.parent, {out.name: csv_of(table, index=False)}, TARGET)
        click.echo(f"{out}: {counted(len(table), 'row')}", err=True)
    for load, rows in table.groupby("load", sort=False):
        click.echo(f"{load}: {_said(rows)}", err=True)


def _said(rows: pd.DataFrame) -> str:
    """Return in words whether the rating can be reached under one load, and at which moduli."""
    one = rows.iloc[0]
    reach = f"a rating of {one['rating']:g} is reachable with probability {chance(one['p_reachable'])}"
    span = (
        f"the ratings of the typical rater range from {number(one['least_rating'])} to {number(one['largest_rating'])}"
    )
    if not one["p_solution"]:
        return f"{reach}: {span}"
    ways = []
    for _, row in rows.iterrows():
        found = [f"E_fab {_interval(row, 'e_fab_kpa')} kPa"]
        found += [f"{words} {_interval(row, name)} {unit}" for name, words, unit in _SOUGHT if name in rows]
        said = f"where the rating {row['with_modulus']} with the modulus, in {percent(row['p_solution'])} of the draws"
        ways.append(f"{', '.join(found)}, {said}")
    return f"{reach}: {'; or '.join(ways)}"


def _interval(row: pd.Series, name: str) -> str:
    return f"{number(row[name])} ({number(row[f'{name}_low'])} to {number(row[f'{name}_high'])})"
