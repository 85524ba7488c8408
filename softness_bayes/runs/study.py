"""Studies: many tables fitted separately, each in an ordinary run directory, with parameters pooled over tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import require_outputs, write_outputs
from softness_bayes.base.files.run_files import POSTERIOR, RUNS
from softness_bayes.base.files.spreadsheet import csv_of, table_of
from softness_bayes.base.laws import Prior
from softness_bayes.base.readable import some_of
from softness_bayes.checking.pooling import LEAST_TABLES
from softness_bayes.data import Afferents, Compression, Experiment, Measurements
from softness_bayes.model.options import ModelOptions
from softness_bayes.plotting.studies import Forest, forest_figure
from softness_bayes.plotting.style import USUAL as USUAL_STYLE
from softness_bayes.plotting.style import Style, files_of
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.runs import population
from softness_bayes.runs.batch import batch, write_asked
from softness_bayes.runs.table_fits import CONVERGED, REFUSED, TableOutcome, fit_tables
from softness_bayes.sampler.workers import Workers, available_processors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STUDY = "study"
"""Command under which the files are listed."""

TABLES = "tables.csv"
"""Table of the outcomes of a study, written when it ends."""

INDIVIDUAL, POPULATION, REPORT, FIGURE = "individual.csv", "population.csv", "study.md", "forest"
MADE = (TABLES, INDIVIDUAL, POPULATION, REPORT, f"{FIGURE}.png", f"{FIGURE}.pdf")
"""Files of a study in addition to its runs."""


@dataclass(frozen=True, eq=False)
class Study:
    """A study: the outcome of every table, and populations of the converged ones.

    Parameters
    ----------
    outcomes
        Of all tables, in order.
    populations
        By parameter; empty if fewer than two tables have converged.
    directory
        Directory of the study.
    """

    outcomes: tuple[TableOutcome, ...]
    populations: Mapping[str, population.PooledParameter]
    directory: Path

    @property
    def tables(self) -> pd.DataFrame:
        """A row per table: table, outcome, run (its directory from here, if there is one), said."""
        rows = [
            {
                "table": one.table,
                "outcome": one.outcome,
                "run": f"{RUNS}/{one.table}" if (self.directory / RUNS / one.table).is_dir() else "",
                "said": one.said,
            }
            for one in self.outcomes
        ]
        return pd.DataFrame(rows)

    def named(self, outcome: str) -> list[str]:
        """Return the names of the tables with an outcome."""
        return [one.table for one in self.outcomes if one.outcome == outcome]

    @property
    def individual(self) -> pd.DataFrame:
        """A row per parameter and table: its interval separately and in the population, and its weights."""
        rows = [
            {
                "parameter": name,
                "table": table,
                **_named("separate", one.natural(found.separate)),
                **_named("shrunken", one.natural(one.sound(found.shrunken))),
                "effective_draws": found.effective,
                "largest_weight": found.largest,
                "pareto_k": found.pareto_k,
            }
            for name, one in self.populations.items()
            for table, found in one.pooled.tables.items()
        ]
        return pd.DataFrame(rows)

    @property
    def population(self) -> pd.DataFrame:
        """A row per parameter: median, spread, a further table, Monte-Carlo errors, priors; or the fault."""
        rows = [
            {
                "parameter": name,
                "unit": one.parameter.unit,
                "tables": len(one.pooled.tables),
                **_named("median", one.natural(one.sound(one.pooled.mean))),
                **_named("spread", one.sound(one.pooled.spread)),
                **_named("further", one.natural(one.sound(one.pooled.new))),
                "median_mcse": float(one.sound(one.pooled.mean_mcse)),
                "spread_mcse": float(one.sound(one.pooled.spread_mcse)),
                "scale": one.scale,
                "prior_median": str(one.prior.mean),
                "prior_spread": str(one.prior.spread),
                "fault": one.pooled.fault,
            }
            for name, one in self.populations.items()
        ]
        return pd.DataFrame(rows)

    @property
    def failed(self) -> list[str]:
        """Names of the parameters with rejected populations."""
        return [name for name, one in self.populations.items() if one.pooled.fault]

    def sentences(self) -> list[str]:
        """Describe the outcomes of the tables, then the populations, one sentence each."""
        good = self.named(CONVERGED)
        said = [f"{some_of(len(good), len(self.outcomes), 'table')} fitted and converged."]
        said += [f"{one.table}: {one.outcome}: {one.said}" for one in self.outcomes if one.outcome != CONVERGED]
        if not self.populations:
            said.append(f"nothing is pooled: a population needs at least {LEAST_TABLES} tables that have converged")
        return [*said, *(one.sentence() for one in self.populations.values())]

    def report(self) -> str:
        """Return the report in Markdown."""
        parts, table = ["# Study", "", *(f"- {sentence}" for sentence in self.sentences())], self.individual
        for name, one in self.populations.items():
            unit = "" if one.parameter.unit == "–" else f" [{one.parameter.unit}]"
            parts += ["", f"## {name}{unit}: {one.parameter.meaning}", ""]
            parts += [
                "| table | separately | in the population | effective draws | Pareto k |",
                "|---|---|---|---|---|",
            ]
            for _, row in table[table["parameter"] == name].iterrows():
                both = (_interval(row, "separate"), _interval(row, "shrunken"))
                cells = (row["table"], *both, f"{row['effective_draws']:.0f}", f"{row['pareto_k']:.2f}")
                parts.append(f"| {' | '.join(map(str, cells))} |")
        parts += ["", "Medians with 90 % intervals. Each parameter is pooled separately: in the population of one the"]
        parts += ["others keep their separate priors."]
        return "\n".join(parts) + "\n"

    def figure(self, style: Style = USUAL_STYLE) -> Figure:
        """Return the forest of all populations.

        Raises
        ------
        InputError
            If nothing is pooled.
        """
        return forest_figure([_forest(name, one) for name, one in self.populations.items()], style=style)

    def save(self) -> list[Path]:
        """Write tables, report and figure to the directory, all or none; those of an earlier study are replaced."""
        contents: dict[str, bytes | str] = {TABLES: csv_of(self.tables, index=False)}
        if self.populations:
            contents |= {
                INDIVIDUAL: csv_of(self.individual, index=False),
                POPULATION: csv_of(self.population, index=False),
                **files_of(self.figure(), FIGURE),
            }
        return write_outputs(self.directory, {**contents, REPORT: self.report()}, STUDY)


def study(
    tables: Mapping[str, Experiment | Compression | Afferents | Measurements],
    directory: str | Path,
    model: ModelOptions = ModelOptions(),
    run: RunOptions = RunOptions(),
    pool: Sequence[str] = (),
    spreads: Mapping[str, Prior] | None = None,
    progress: Callable[[int, TableOutcome], None] | None = None,
    refused: Mapping[str, str] | None = None,
    kept: Mapping[str, Mapping[str, Any]] | None = None,
    executor: Executor | None = None,
    **options: Any,
) -> Study:
    """Fit many tables separately, and pool selected parameters over those that have converged.

    Each fit is an ordinary run in a separate directory, ``runs/NAME``, and depends only on its table, the options and
    the seed. An interrupted study continues where it stopped; rejected tables are reported, and the others continue.

    Parameters
    ----------
    tables
        Data by name.
    directory
        Directory of the runs and of the files of the study.
    model, run
        Choices of the model, and how long each table is run; `run.processes` is the number of parallel fits.
    pool
        Names of the parameters; by default those of the finger that are sampled.
    spreads
        Priors of the populations' spreads (see `pool_results`).
    progress
        Function called with the number of finished tables and the last of them.
    refused
        Names of tables that could not be read, with the reason.
    kept
        Files and figures of each run, as recorded for its continuation by the command line.
    executor
        Executor that runs the fits instead of local processes, with the same draws (see `runs.table_fits`).
    **options
        Single options that replace those of `model` and `run`, by name.

    Raises
    ------
    InputError
        If there is no table, or the directory contains something else.
    LockedError
        If another process runs the same study.
    ResourceError
        If memory ran out, or worker processes died repeatedly.
    """
    request, refused, directory = Request(model, run).with_options(**options), refused or {}, Path(directory)
    population.require_parameters((*pool, *(spreads or {})))
    if not tables and not refused:
        raise InputError("study: there is no table")
    require_outputs(directory, MADE, STUDY)
    runs = directory / RUNS
    runs.mkdir(parents=True, exist_ok=True)
    found = {name: TableOutcome(name, REFUSED, why) for name, why in refused.items()}
    processes = min(request.run.processes or available_processors(), max(len(tables), 1))
    with batch(directory), Workers(request, processes, executor) as workers:
        before = sum((runs / name / POSTERIOR).is_file() for name in tables)
        write_asked(directory, len(tables) + len(refused), before)
        for one in fit_tables(workers, request, tables, runs, kept or {}, executor):
            found[one.table] = one
            if progress is not None:
                progress(len(found), one)
    good, populations = [name for name in sorted(found) if found[name].outcome == CONVERGED], {}
    if len(good) >= LEAST_TABLES:
        populations = population.pool_results({name: runs / name for name in good}, pool, spreads)
    return Study(tuple(found[name] for name in sorted(found)), populations, directory)


def refused_tables(directory: Path) -> list[str]:
    """Return the names of the tables that the last call of a study refused; empty before its end."""
    path = directory / TABLES
    if not path.is_file():
        return []
    table = table_of(path)
    return [str(name) for name in table["table"][table["outcome"] == REFUSED]]


def _forest(name: str, one: population.PooledParameter) -> Forest:
    """Return the data of the figure for one parameter."""
    found = one.pooled
    separate, shrunken = (
        one.natural(np.column_stack([getattr(table, kind) for table in found.tables.values()]))
        for kind in ("separate", "shrunken")
    )
    forest = Forest(name, one.parameter.label, tuple(found.tables), separate)
    if found.fault:
        return forest
    return forest._replace(shrunken=shrunken, population=one.natural(found.mean), new=one.natural(found.new))


def _named(name: str, ends: NDArray[np.float64]) -> dict[str, float]:
    low, middle, high = map(float, ends)
    return {name: middle, f"{name}_low": low, f"{name}_high": high}


def _interval(row: Any, name: str) -> str:
    if np.isnan(row[name]):
        return "–"
    return f"{row[name]:.4g} ({row[f'{name}_low']:.4g} to {row[f'{name}_high']:.4g})"
