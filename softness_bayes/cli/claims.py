"""`softness-bayes claims`: the paper's claims under each reading of its equations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from softness_bayes.base.defaults import SEED
from softness_bayes.base.errors import InputError
from softness_bayes.base.options import ByName, Number
from softness_bayes.base.ranges import PRIOR_DRAWS
from softness_bayes.cli.options import Dask, Force, Given, Out, Seed, Several, Touches, Words, command
from softness_bayes.cli.running import executor_of
from softness_bayes.model.options import ModelOptions

if TYPE_CHECKING:
    from softness_bayes.data import Fabrics, Ratings
    from softness_bayes.touch.contact import Load

MADE = ("claims.csv", "claims.md", "claims_loads.csv")


@command
def claims(
    *,
    readings: Annotated[tuple[str, ...], Several(Words(metavar="SET"))] = (),
    reading: Annotated[dict[str, str] | None, ByName("PLACE=NAME")] = None,
    priors_: Annotated[tuple[str, ...], Several(Words(metavar="SET"))] = (),
    model: Annotated[ModelOptions, Given("fix", "priors")],
    data: Path | None = None,
    touches: Touches,
    draws: Annotated[int, Number(PRIOR_DRAWS, "N")] = 200,
    dask: Dask = None,
    seed: Seed = SEED,
    out: Out = Path("results"),
    force: Force = False,
) -> None:
    """Test which of the paper's claims hold under which readings of its equations.

    Every claim has a numerical criterion. For each set of readings, set of priors and kind of load, the verdict is
    that the claim holds, that it fails, or that no receptor fires. Prints the verdicts with their numbers and the
    prior probability that the claim holds, and writes claims.csv, claims.md and claims_loads.csv.

    Parameters
    ----------
    readings
        Named set of readings: mended, printed or hertz; by default all three.
    reading
        Another reading of one equation of the model, in every set, such as pressure=hertz.
    priors_
        Named set of priors: default or in-vivo; by default both.
    data
        Table of ratings that the claims are tested against.
    fabrics
        Fabric table (CSV, Excel or Parquet); by default those of --data, or twelve moduli over the range of real cloth.
    indentation_mm
        Indentation [mm] of the touch; by default 1, 1.5, 2 and 3 mm and 0.5, 1, 2 and 4 N, or those of --data.
    force_n
        Contact force [N] of the touch; by default as for --indentation-mm.
    draws
        Number of draws of each prior for the probabilities; 0 for the medians only.
    """
    from softness_bayes.base.files.outputs import require_outputs, write_outputs
    from softness_bayes.base.files.spreadsheet import csv_of
    from softness_bayes.claims import PRIORS, TOUCHES, evaluate_claims
    from softness_bayes.claims.report import claims_table, loads_table, markdown, plain
    from softness_bayes.touch.contact import Force as OfForce
    from softness_bayes.touch.contact import Indentation
    from softness_bayes.touch.readings import NAMED_READINGS, readings_named

    require_outputs(out, MADE, "claims", force, [*touches.inputs, *([] if data is None else [data])])
    fabrics, ratings, loads = _materials(data, touches)
    chosen = [readings_named(name, reading or {}) for name in (readings or NAMED_READINGS)]
    kinds = {"indentation": Indentation, "force": OfForce}  # claims compare loads of one kind
    by_kind = {name: tuple(sorted({one for one in loads if isinstance(one, kind)})) for name, kind in kinds.items()}
    with executor_of(dask) as executor:
        trials = evaluate_claims(
            {one.label: one for one in chosen},
            priors_ or PRIORS,
            {name: some for name, some in by_kind.items() if some} or TOUCHES,
            fabrics,
            ratings,
            draws,
            seed,
            model.fix,
            model.priors,
            executor,
        )
    findings, by_load = (csv_of(table, index=False) for table in (claims_table(trials), loads_table(trials)))
    write_outputs(out, dict(zip(MADE, (findings, markdown(trials), by_load), strict=True)), "claims")
    click.echo(plain(trials))
    click.echo(f"written to {out}: {', '.join(MADE)}", err=True)


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
