"""`softness-bayes study`: many tables fitted separately, and parameters pooled over them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options.model import ModelChoice, model_choice, spreads
from softness_bayes.cli.options.ratings import rating_scale
from softness_bayes.cli.options.run import dask, max_time, seed
from softness_bayes.cli.options.tables import DataFiles, reading_options
from softness_bayes.cli.options.values import FILE, whole
from softness_bayes.cli.running import command_line, executor_of, record_of
from softness_bayes.defaults import MAX_STEPS
from softness_bayes.errors import InputError, NotConvergedError, NumericalError
from softness_bayes.ranges import PROCESSES, STEPS
from softness_bayes.readable import some_of

if TYPE_CHECKING:
    from tqdm import tqdm

    from softness_bayes.data import Compression, Experiment
    from softness_bayes.data.lists import Listed
    from softness_bayes.parameters.priors import Prior
    from softness_bayes.runs.study import Study
    from softness_bayes.runs.table_fit import TableOutcome


@click.command()
@click.argument("source", metavar="TABLES", type=FILE)
@reading_options
@model_choice
@rating_scale
@click.option(
    "--pool",
    "pooled",
    metavar="NAMES",
    default="",
    help="Parameters to pool, such as b,m; by default b, m and sigma_0, if they are sampled.",
)
@spreads
@click.option(
    "--max-steps",
    type=whole(STEPS),
    default=MAX_STEPS,
    show_default=True,
    help="Largest number of steps of each ensemble; a fit then ends even if it has not converged. The same "
    "command with more steps continues it.",
)
@max_time
@click.option(
    "--processes",
    type=whole(PROCESSES),
    metavar="N",
    help="Number of fits run in parallel; by default one for each core. Draws do not depend on it.",
)
@dask
@click.option("--figures", is_flag=True, help="Also draw the figures of every fit ('plot' can draw them later).")
@seed
@click.option(
    "--out",
    type=FILE,
    metavar="DIR",
    default=Path("study"),
    show_default=True,
    help="Directory to write to; a study there is continued.",
)
def command(
    source: Path,
    files: DataFiles,
    model: ModelChoice,
    scale: str,
    pooled: str,
    spreads: dict[str, Prior],
    max_steps: int,
    max_time: float,
    processes: int | None,
    dask: str | None,
    figures: bool,
    seed: int,
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
    from softness_bayes.likelihood.scales import scale_named
    from softness_bayes.results.request import RunOptions
    from softness_bayes.runs.study import study
    from softness_bayes.runs.table_fit import Kept

    listed = list_tables(source)
    if len(listed) < 2:
        raise InputError(f"{source}: one table only, {listed[0].name}; a study has at least two, 'sample' fits one")
    tables, refused = _read(listed, files)
    kept = {
        one.name: Kept(record_of(_files_of(one, files), out / RUNS / one.name), figures)
        for one in listed
        if one.name in tables
    }
    run = RunOptions(max_steps=max_steps, max_seconds=max_time, processes=processes, seed=seed, command=command_line())
    bar = _Bar(len(listed))
    hint = f"finished fits, and all steps of the others, are saved in {out}: the same command continues"
    with keeping(lambda: hint), executor_of(dask, out) as executor:
        try:
            found = study(
                tables,
                out,
                model.options(scale=scale_named(scale)),
                run,
                [name.strip() for name in pooled.split(",") if name.strip()],
                spreads,
                bar.show,
                refused,
                kept,
                executor,
            )
        finally:
            bar.close()
    found.save()
    for sentence in found.sentences():
        click.echo(sentence)
    click.echo(f"written to {out}")
    _end(found)


def _files_of(one: Listed, files: DataFiles) -> DataFiles:
    """Return the files of one table, with the same reading options as for all tables."""
    return replace(files, data=one.data, fabrics=one.fabrics or files.fabrics, compression=one.compression)


def _read(listed: list[Listed], files: DataFiles) -> tuple[dict[str, Experiment | Compression], dict[str, str]]:
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


def _end(found: Study) -> None:
    """Raise an error if tables were refused, have not converged or were not pooled."""
    from softness_bayes.runs.table_fit import REFUSED, UNCONVERGED

    total = len(found.outcomes)
    if bad := found.named(REFUSED):
        raise InputError(f"{some_of(len(bad), total, 'table', 'was', 'were')} refused ({', '.join(bad)}); see above")
    if short := found.named(UNCONVERGED):
        raise NotConvergedError(
            f"{some_of(len(short), total, 'table', 'has', 'have')} not converged ({', '.join(short)}); only "
            "converged tables are pooled; the same command with a larger --max-steps continues the others"
        )
    if found.failed:
        raise NumericalError(f"not pooled: {', '.join(found.failed)}; see above")


class _Bar:
    """Progress over tables on the terminal."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._bar: tqdm[NoReturn] | None = None

    def show(self, finished: int, one: TableOutcome) -> None:
        """Move the bar to the number of finished tables."""
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(total=self._total, unit="table", desc="fitting", leave=False, dynamic_ncols=True)
        self._bar.update(finished - self._bar.n)
        self._bar.set_postfix_str(f"{one.table} {one.outcome}")

    def close(self) -> None:
        """Clear the line."""
        if self._bar is not None:
            self._bar.close()
