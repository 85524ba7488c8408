"""`softness-bayes study`: many tables fitted separately, and parameters pooled over them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options import FILE, collected, dask, model_options, out, spreads
from softness_bayes.cli.progress import counting
from softness_bayes.cli.running import command_line, executor_of
from softness_bayes.errors import InputError, NotConvergedError, NumericalError
from softness_bayes.model.options import ModelOptions
from softness_bayes.readable import some_of
from softness_bayes.results.run_options import DataFiles, RunOptions

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements
    from softness_bayes.data.lists import Listed
    from softness_bayes.parameters.laws import Prior
    from softness_bayes.runs.study import Study


@click.command()
@click.argument("source", metavar="TABLES", type=FILE)
@collected("files", DataFiles, without=("data", "compression", "afferents"))
@model_options
@click.option(
    "--pool",
    "pooled",
    metavar="NAMES",
    default="",
    help="Parameters to pool, such as b,m; by default b, m and sigma_0, if they are sampled.",
)
@spreads
@collected(
    "run",
    RunOptions,
    *("max_steps", "max_seconds", "processes", "seed"),
    max_steps={
        "help": "Largest number of steps of each ensemble; a fit then ends even if it has not converged. The same "
        "command with more steps continues it."
    },
    processes={"help": "Number of fits run in parallel; by default one for each core. Draws do not depend on it."},
)
@dask
@click.option("--figures", is_flag=True, help="Also draw the figures of every fit ('plot' can draw them later).")
@out("study", "Directory to write to; a study there is continued.")
def command(
    source: Path,
    files: DataFiles,
    model: ModelOptions,
    pooled: str,
    spreads: dict[str, Prior],
    run: RunOptions,
    dask: str | None,
    figures: bool,
    out: Path,
) -> None:
    """Fit many tables separately, then pool parameters across them.

    TABLES is a folder of tables of ratings (sites, participants, sessions), or a file that lists them in the columns
    table, data, fabrics and compression, with paths relative to its folder. Every table is fitted separately, in an
    ordinary run directory OUT/runs/NAME that 'status', 'resume' and 'report' accept.

    Then each chosen parameter is given a population. Its values are normally distributed across tables on the
    unconstrained scale (the logarithm of a positive parameter), and the mean has the prior of the parameter itself. The
    separate posteriors are reweighted, so nothing is sampled again. A population whose weights fail is refused, and
    the table at fault is named. Writes tables.csv, individual.csv, population.csv, forest.png and .pdf, and study.md.

    The same command continues a study that was interrupted. A table that cannot be read or fitted is named, and the
    others continue. Exit code 2: a table was refused; 3: one has not converged; 4: a population was refused.
    """
    from softness_bayes.data.lists import list_tables
    from softness_bayes.files.run_files import RUNS
    from softness_bayes.runs.study import study
    from softness_bayes.runs.table_fits import Kept

    listed = list_tables(source)
    if len(listed) < 2:
        raise InputError(f"{source}: one table only, {listed[0].name}; a study has at least two, 'sample' fits one")
    tables, refused = _read(listed, files)
    kept = {
        one.name: Kept(_files_of(one, files).record_in(out / RUNS / one.name), figures)
        for one in listed
        if one.name in tables
    }
    hint = f"finished fits, and all steps of the others, are saved in {out}: the same command continues"
    with (
        counting(len(listed), "table", "fitting") as show,
        keeping(lambda: hint),
        executor_of(dask, out) as executor,
    ):
        fitted = study(
            tables,
            out,
            model,
            replace(run, command=command_line()),
            [name.strip() for name in pooled.split(",") if name.strip()],
            spreads,
            lambda finished, one: show(finished, f"{one.table} {one.outcome}"),
            refused,
            kept,
            executor,
        )
    fitted.save()
    for sentence in fitted.sentences():
        click.echo(sentence)
    click.echo(f"written to {out}")
    _end(fitted)


def _files_of(one: Listed, files: DataFiles) -> DataFiles:
    """Return the files of one table, with the same reading options as for all tables."""
    return replace(files, data=one.data, fabrics=one.fabrics or files.fabrics, compression=one.compression)


def _read(listed: list[Listed], files: DataFiles) -> tuple[dict[str, Experiment | Measurements], dict[str, str]]:
    """Return the readable tables, and the error message for each unreadable one."""
    tables, refused = {}, {}
    for one in listed:
        try:
            tables[one.name] = _files_of(one, files).read()
        except InputError as error:
            refused[one.name] = " ".join(str(error).split())
            continue
        for note in tables[one.name].notes:
            click.echo(f"note: {one.name}: {note}", err=True)
    return tables, refused


def _end(fitted: Study) -> None:
    """Raise an error if tables were refused, have not converged or were not pooled."""
    from softness_bayes.runs.table_fits import REFUSED, UNCONVERGED

    total = len(fitted.outcomes)
    if bad := fitted.named(REFUSED):
        raise InputError(f"{some_of(len(bad), total, 'table', 'was', 'were')} refused ({', '.join(bad)}); see above")
    if short := fitted.named(UNCONVERGED):
        raise NotConvergedError(
            f"{some_of(len(short), total, 'table', 'has', 'have')} not converged ({', '.join(short)}); only "
            "converged tables are pooled; the same command with a larger --max-steps continues the others"
        )
    if fitted.failed:
        raise NumericalError(f"not pooled: {', '.join(fitted.failed)}; see above")
