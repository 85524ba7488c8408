"""`softness-bayes study`: many tables fitted separately, and parameters pooled over them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from softness_bayes.base.errors import InputError, NotConvergedError, NumericalError
from softness_bayes.base.options import Names
from softness_bayes.base.readable import some_of
from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options import Dask, Given, Out, command
from softness_bayes.cli.running import command_line, executor_of
from softness_bayes.cli.terminal import counting
from softness_bayes.model.options import LAWS, ModelOptions
from softness_bayes.results.run_options import DataFiles, RunOptions

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements
    from softness_bayes.runs.study import Study


@command
def study(
    source: Path,
    *,
    files: Annotated[DataFiles, Given(without=("data", "compression", "afferents"))],
    model: Annotated[ModelOptions, Given(without=("noise",))],
    pool: Annotated[tuple[str, ...], Names()] = (),
    spread: Annotated[dict[str, Any] | None, LAWS] = None,
    run: Annotated[RunOptions, Given("max_steps", "max_seconds", "processes", "seed")],
    dask: Dask = None,
    figures: bool = False,
    out: Out = Path("study"),
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

    Parameters
    ----------
    source : TABLES
    pool
        Parameters to pool, such as b,m; by default b, m and sigma_0, if they are sampled.
    spread
        Prior of the spread of a pooled parameter between tables, such as b='halfnormal(0.3)'; by default half-normal
        with the width of the prior of the parameter.
    max_steps
        Largest number of steps of each ensemble; a fit then ends even if it has not converged. The same command with
        more steps continues it.
    processes
        Number of fits run in parallel; by default one for each core. Draws do not depend on it.
    figures
        Also draw the figures of every fit ('plot' can draw them later).
    out
        Directory to write to; a study there is continued.
    """
    from softness_bayes.base.files.run_files import RUNS
    from softness_bayes.data.lists import list_tables
    from softness_bayes.runs.study import study as fit

    listed = list_tables(source)
    if len(listed) < 2:
        raise InputError(f"{source}: one table only, {listed[0].name}; a study has at least two, 'sample' fits one")
    files_of = {
        one.name: replace(files, data=one.data, fabrics=one.fabrics or files.fabrics, compression=one.compression)
        for one in listed
    }
    tables, refused = _read(files_of)
    kept = {name: {"files": files_of[name].record_in(out / RUNS / name), "figures": figures} for name in tables}
    hint = f"finished fits, and all steps of the others, are saved in {out}: the same command continues"
    with (
        counting(len(listed), "table", "fitting") as show,
        keeping(lambda: hint),
        executor_of(dask, out) as executor,
    ):
        fitted = fit(
            tables,
            out,
            model,
            replace(run, command=command_line()),
            pool,
            spread or {},
            lambda finished, one: show(finished, f"{one.table} {one.outcome}"),
            refused,
            kept,
            executor,
        )
    fitted.save()
    click.echo("\n".join([*fitted.sentences(), f"written to {out}"]))
    require_complete(fitted)


def _read(files: dict[str, DataFiles]) -> tuple[dict[str, Experiment | Measurements], dict[str, str]]:
    """Return the readable tables, and the error message for each unreadable one."""
    tables, refused = {}, {}
    for name, one in files.items():
        try:
            tables[name] = one.read()
        except InputError as error:
            refused[name] = " ".join(str(error).split())
            continue
        for note in tables[name].notes:
            click.echo(f"note: {name}: {note}", err=True)
    return tables, refused


def require_complete(fitted: Study) -> None:
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
