"""`softness-bayes claims`: the paper's claims under each reading of its equations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import Touches, dask, flag, force, number, out, path, repeated, seed, touches
from softness_bayes.cli.running import executor_of
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.options import ByName
from softness_bayes.ranges import PRIOR_DRAWS

if TYPE_CHECKING:
    from softness_bayes.data import Fabrics, Ratings
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
@repeated(
    ByName("PLACE=NAME"),
    ["--reading"],
    "overrides",
    "Another reading of one equation of the model, in every set, such as pressure=hertz.",
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
@path("--data", "FILE", "Table of ratings that the claims are tested against.")
@touches(
    "those of --data, or twelve moduli over the range of real cloth",
    "1, 1.5, 2 and 3 mm and 0.5, 1, 2 and 4 N, or those of --data",
)
@number("--draws", PRIOR_DRAWS, "Number of draws of each prior for the probabilities; 0 for the medians only.", 200)
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
    touches: Touches,
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

    require_outputs(out, MADE, CLAIMS, force, [*touches.inputs, *([] if data is None else [data])])
    fabrics, ratings, loads = _materials(data, touches)
    with executor_of(dask) as executor:
        trials = evaluate_claims(
            _readings(reading_sets, overrides),
            prior_sets or PRIORS,
            _by_kind(loads) or TOUCHES,
            fabrics,
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


def _materials(data: Path | None, touches: Touches) -> tuple[Fabrics, Ratings | None, tuple[Load, ...]]:
    """Return the fabric set, its ratings if there are any, and the requested loads."""
    from softness_bayes.claims import CLOTH
    from softness_bayes.data import read_experiment

    if data is None:
        fabrics, loads = touches.among(CLOTH, ())
        return fabrics, None, loads
    depths, forces = touches.indentation_mm, touches.force_n
    if len(depths) > 1 or len(forces) > 1:
        raise InputError(
            "--data has its own loads: give --indentation-mm or --force-n at most once, as the load of all ratings"
        )
    experiment = read_experiment(
        data,
        touches.fabrics,
        columns=touches.columns,
        indentation_mm=depths[0] if depths else None,
        force_n=forces[0] if forces else None,
        decimal=touches.decimal,
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
