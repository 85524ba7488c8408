"""`softness-bayes claims`: the paper's claims under each reading of its equations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import FILE, by_name, dask, flag, force, load_options, out, seed, whole
from softness_bayes.cli.running import executor_of
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.options import ByName
from softness_bayes.ranges import PRIOR_DRAWS
from softness_bayes.results.run_options import DataFiles

if TYPE_CHECKING:
    from softness_bayes.data import Fabrics, Ratings
    from softness_bayes.data.tables import Marks
    from softness_bayes.parameters.laws import Prior
    from softness_bayes.touch.contact import Load
    from softness_bayes.touch.readings import Readings

CLAIMS, MADE = "claims", ("claims.csv", "claims.md", "claims_loads.csv")


@click.command()
@click.option(
    "--readings",
    "reading_sets",
    multiple=True,
    metavar="SET",
    help="Named set of readings: mended, printed or hertz. Repeatable; by default all three.",
)
@by_name(
    ByName("PLACE=NAME"),
    "--reading",
    "overrides",
    "Another reading of one equation of the model, in every set, such as pressure=hertz. Repeatable.",
)
@click.option(
    "--priors",
    "prior_sets",
    multiple=True,
    metavar="SET",
    help="Named set of priors: default or in-vivo. Repeatable; by default both.",
)
@flag(ModelOptions, "fix")
@flag(ModelOptions, "priors")
@click.option(
    "--data",
    type=FILE,
    metavar="FILE",
    help="Table of ratings (CSV) that the claims are tested against.",
)
@click.option(
    "--fabrics",
    type=FILE,
    metavar="FILE",
    help="Fabric set (CSV); by default that of --data, or twelve moduli over the range of real cloth.",
)
@flag(DataFiles, "columns")
@flag(DataFiles, "decimal")
@load_options(". Repeatable; by default 1, 1.5, 2 and 3 mm and 0.5, 1, 2 and 4 N, or those of --data.")
@click.option(
    "--draws",
    type=whole(PRIOR_DRAWS),
    default=200,
    show_default=True,
    help="Number of draws of each prior for the probabilities; 0 for the medians only.",
)
@dask
@seed
@out()
@force
def command(
    reading_sets: tuple[str, ...],
    overrides: dict[str, str],
    prior_sets: tuple[str, ...],
    fix: dict[str, float],
    priors: dict[str, Prior],
    data: Path | None,
    fabrics: Path | None,
    columns: dict[str, str],
    decimal: Marks,
    indentation_mm: tuple[float, ...],
    force_n: tuple[float, ...],
    draws: int,
    dask: str | None,
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Test which of the paper's claims hold under which readings of its equations.

    Every claim has a numerical criterion. For each set of readings, set of priors and kind of load, the verdict is
    that the claim holds, that it fails, or that no receptor fires. Prints the verdicts with their numbers and the
    prior probability that the claim holds, and writes claims.csv, claims.md and claims_loads.csv.
    """
    from softness_bayes.claims import PRIORS, TOUCHES, evaluate_claims
    from softness_bayes.claims.report import claims_table, loads_table, markdown, plain
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.files.spreadsheet import csv_of

    require_outputs(out, MADE, CLAIMS, force, [path for path in (data, fabrics) if path is not None])
    touched, ratings, loads = _materials(data, fabrics, columns, decimal, indentation_mm, force_n)
    with executor_of(dask) as executor:
        trials = evaluate_claims(
            _readings(reading_sets, overrides),
            prior_sets or PRIORS,
            _by_kind(loads) or TOUCHES,
            touched,
            ratings,
            draws,
            seed,
            fix,
            priors,
            executor,
        )
    findings, by_load = (csv_of(table, index=False) for table in (claims_table(trials), loads_table(trials)))
    write_outputs(out, dict(zip(MADE, (findings, markdown(trials), by_load), strict=True)), CLAIMS)
    click.echo(plain(trials))
    click.echo(f"written to {out}: {', '.join(MADE)}", err=True)


def _readings(names: tuple[str, ...], overrides: Mapping[str, str]) -> dict[str, Readings]:
    """Return the requested sets of readings, with names that include individual changes."""
    from softness_bayes.touch.readings import NAMED_READINGS, readings_named

    chosen = [readings_named(name, overrides) for name in (names or NAMED_READINGS)]
    return {readings.label: readings for readings in chosen}


def _materials(
    data: Path | None,
    fabrics: Path | None,
    columns: Mapping[str, str],
    decimal: Marks,
    indentation_mm: tuple[float, ...],
    force_n: tuple[float, ...],
) -> tuple[Fabrics, Ratings | None, tuple[Load, ...]]:
    """Return the fabric set, its ratings if there are any, and the requested loads."""
    from softness_bayes.claims import CLOTH
    from softness_bayes.data import Fabrics, loads_of, read_experiment

    if data is None:
        if columns and fabrics is None:
            raise InputError("--column applies to --data or --fabrics: give one of them")
        chosen = CLOTH if fabrics is None else Fabrics.read(fabrics, columns=columns, decimal=decimal)
        return chosen, None, loads_of(indentation_mm, force_n)
    if len(indentation_mm) > 1 or len(force_n) > 1:
        raise InputError(
            "--data has its own loads: give --indentation-mm or --force-n at most once, as the load of all ratings"
        )
    indentation, held_force = (next(iter(values), None) for values in (indentation_mm, force_n))
    experiment = read_experiment(
        data, fabrics, columns=columns, indentation_mm=indentation, force_n=held_force, decimal=decimal
    )
    for note in experiment.notes:
        click.echo(f"note: {note}", err=True)
    return experiment.fabrics, experiment.ratings, experiment.ratings.loads


def _by_kind(loads: tuple[Load, ...]) -> dict[str, tuple[Load, ...]]:
    """Return the sorted loads of each kind, indentation or force; claims compare loads of one kind."""
    from softness_bayes.touch.contact import Force, Indentation

    kinds = {"indentation": Indentation, "force": Force}
    some = {name: tuple(sorted({load for load in loads if isinstance(load, kind)})) for name, kind in kinds.items()}
    return {name: held for name, held in some.items() if held}
