"""`softness-bayes compare`, `calibrate` and `bench`: how far runs, intervals and the fast model can be trusted."""

from __future__ import annotations

import math
import os
import platform
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeVar

import click

from softness_bayes.base.defaults import ACCURACY, LEFT_OUT
from softness_bayes.base.errors import InputError, NotConvergedError, NumericalError
from softness_bayes.base.options import Number
from softness_bayes.base.ranges import PARTICIPANTS, REPLICATES, STEPS
from softness_bayes.base.readable import chance, some_of
from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options import Dask, Directory, Force, Given, Out, Touches, TrustCode, Words, command, typed
from softness_bayes.cli.running import executor_of, reading, warn_of_unconverged
from softness_bayes.cli.terminal import counting
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import RunOptions

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.bench.precision import Effort
    from softness_bayes.checking.calibration import Replicate
    from softness_bayes.runs.rank_table import Calibrated

COMPARISON = "compare.csv"

Measured = TypeVar("Measured", bound=NamedTuple)


@command
def compare(
    directories: tuple[Path, ...],
    *,
    leave: Annotated[str, Words(*LEFT_OUT)] = LEFT_OUT[0],
    max_steps: Annotated[int | None, Number(STEPS, "N")] = None,
    dask: Dask = None,
    out: Out = Path("."),
    force: Force = False,
    trust_code: TrustCode = False,
) -> None:
    """Rank finished runs by how well they predict held-out data.

    The runs must have the same ratings; readings, directions, priors or effects may differ. The log predictive
    densities of the ratings (in the units of the table) are summed (elpd) and compared unit by unit. Ratings (lists
    and pairs as a whole) and participants are held out by importance weights (PSIS). Fabrics are held out by sampling
    each model again without them, which takes about as long as the runs times the number of fabrics. Single
    conditions are held out by weights, and sampled again where these fail. The difference is compared with the
    largest of its standard errors: over single units, and over clusters of ratings by fabric, condition and
    participant. Weights are those of the mixture of runs that predicts best (stacking).

    Parameters
    ----------
    directories : RESULT_DIR...
    leave
        What is held out and predicted from the rest: single ratings, participants, fabrics, fabrics under single
        loads, or responses of recorded afferents (always, in runs without ratings).
    max_steps
        Largest number of steps of each ensemble in a refit without a fabric; it then ends even if it has not converged.
    out
        Directory to write compare.csv to.
    """
    from softness_bayes.base.files.command_line import endings
    from softness_bayes.base.files.outputs import require_outputs, write_outputs
    from softness_bayes.base.files.spreadsheet import csv_of
    from softness_bayes.runs.comparison import REFIT
    from softness_bayes.runs.comparison import compare as compared
    from softness_bayes.runs.left_out import LEAVE

    require_outputs(out, [COMPARISON], "compare", force)
    labels = endings(directories)
    if len({*directories}) < len(directories):
        raise InputError("compare: a result is given twice")
    settings = REFIT if max_steps is None else replace(REFIT, max_steps=max_steps)
    with reading(*directories, trust_code=trust_code) as loaded, executor_of(dask) as executor:
        results = dict(zip(labels, loaded, strict=True))
        found = compared(
            results, LEAVE[leave], settings, lambda what: click.echo(f"sampled {what}", err=True), executor
        )
    (path,) = write_outputs(out, {COMPARISON: csv_of(found.table)}, "compare")
    shown = found.table.drop(columns=["model", "unfinished", "converged"])
    lines = [shown.to_string(float_format=lambda x: f"{x:.4g}", na_rep="–"), ""]
    lines += [f"{label}: {model or 'the same model'}" for label, model in found.table["model"].items()]
    lines += [f"warning: {warning}" for warning in found.warnings]
    shares = ", ".join(f"{load} {chance(share)}" for load, share in found.interior.items())
    if shares:
        lines.append(f"probability of an interior maximum, averaged over the runs with their weights: {shares}")
    click.echo("\n".join([*lines, f"written to {path}", found.sentence]))


@command
def calibrate(
    *,
    replicates: Annotated[int, Number(REPLICATES, "N")] = 200,
    like: Annotated[Path | None, Directory()] = None,
    touches: Touches,
    design: bool = False,
    participants: Annotated[int, Number(PARTICIPANTS, "N")] = 20,
    model: Annotated[ModelOptions, Given(without=("noise",))],
    run: Annotated[RunOptions, Given("max_steps", "processes", "seed", max_steps={"default": 10_000})],
    dask: Dask = None,
    from_: Annotated[Path | None, Directory()] = None,
    finished: bool = False,
    out: Out = Path("calibration"),
    trust_code: TrustCode = False,
) -> None:
    """Test the inference by simulation: whether credible intervals have their stated coverage.

    This is simulation-based calibration. Each replicate draws parameters from the prior, simulates ratings, samples
    the posterior until it has converged, and ranks the true values among its draws. The ranks must be uniform. They
    are tested for every parameter, mu, the log-likelihood, the participants' effects, and, under each load, the
    existence and the place of the turning point. The verdict states which faults this number of replicates can
    detect. Without fabrics and loads a small example is rated. Writes to --out: ranks.csv with a row for every finished
    replicate (an interrupted calibration continues), coverage.csv, ecdf.png and verdict.txt.

    --like DIR draws the parameters from the posterior of a finished run instead. It simulates ratings by new raters
    under the loads of the run, with its missing cells and observation model, and fits them together with the ratings
    of the run.

    --from DIR goes on from a stored result: --replicates 1000 then runs the rest. Design, model, priors and seed must
    be the same, and true values that are drawn again must agree. Where only settings of the fits differ, such as the
    largest number of steps, the verdict says so.

    --design predicts in some seconds, by linearisation, how much a fit would narrow every parameter and which other
    design would help most. Use it before a calibration, which takes hours.

    A replicate that has not converged within --max-steps is ranked by chains through the true values. Its ranks are
    valid, but detect less than others.

    Exit code 3: some replicates are missing; 4: not calibrated.

    Parameters
    ----------
    replicates
        Number of parameter draws that are simulated and fitted; a later call can ask for more.
    like
        Calibrate over the posterior of this run instead of the prior, with the design and the model of the run.
    fabrics
        Fabric table (CSV, Excel or Parquet); by default eight fabrics.
    indentation_mm
        Indentation [mm] of the touch; by default those of a small example.
    force_n
        Contact force [N] of the touch; by default those of a small example.
    design
        Predict the posterior widths for this design without simulating; nothing is written.
    participants
        Number of raters.
    max_steps
        Largest number of steps of each ensemble; a replicate that has not converged by then is ranked in another way
        (see above).
    processes
        Number of replicates run in parallel; by default one for each core. Ranks do not depend on it.
    from_
        Also take the replicates of an earlier calibration of the same problem from this directory, or from the
        ranks.csv and manifest.json kept of it; it is only read.
    finished
        Evaluate the finished replicates and run no more; the verdict stays open and names those that are missing.
    out
        Directory to write to; a calibration there that was begun with the same options is continued.
    """
    from softness_bayes.cli.check import design_lines
    from softness_bayes.experiments.understanding import foreseen
    from softness_bayes.runs import calibrate as running
    from softness_bayes.runs.rank_table import read_replicates

    if finished and from_ is not None:
        raise InputError("--from: cannot be combined with --finished, which writes no replicates")
    if like is not None:
        if flags := typed(*Touches.declared, *ModelOptions.declared, "design", "participants"):
            raise InputError(f"{flags[0]}: cannot be combined with --like, which takes design and model from the run")
        with reading(like, trust_code=trust_code) as (result,):
            warn_of_unconverged(result)
            problem = running.posterior_problem(result, run)
    else:
        planned = touches.among(running.USUAL_FABRICS, running.USUAL_LOADS)
        scene = running.CalibrationScene(*planned, participants)
        if design:
            click.echo("\n".join(design_lines(foreseen(*scene.planned(model)))))
            return
        problem = running.prior_problem(scene, model, run)

    def kept() -> str:
        saved = len(read_replicates(out))
        saved_of = f"{some_of(saved, replicates, 'replicate')} saved in {out}: the same command runs the others"
        return saved_of if saved else ""

    with (
        counting(replicates, "replicate", "calibrating") as show,
        keeping(kept),
        executor_of(None if finished else dask) as executor,
    ):

        def tell(done: int, one: Replicate) -> None:
            show(done, f"last one {one.steps} steps, autocorrelation time {one.tau:.0f}")

        if finished:
            calibrated = running.finished(problem, replicates, out)
        else:
            calibrated = running.calibrate(problem, None, run, replicates, out, tell, None, executor, from_)
    _report(calibrated, out)
    if calibrated.calibration.faults():
        raise NumericalError("not calibrated: see the verdict above")
    if calibrated.unfinished:
        raise NotConvergedError(f"{some_of(len(calibrated.unfinished), replicates, 'replicate')} not finished")


def _report(calibrated: Calibrated, out: Path) -> None:
    """Write tables, figure and verdict, and print coverage and verdict."""
    from softness_bayes.base.files.outputs import write_outputs
    from softness_bayes.checking.calibration import coverage_sentence
    from softness_bayes.plotting.checks import rank_ecdf_figure
    from softness_bayes.plotting.style import files_of
    from softness_bayes.runs.rank_table import CALIBRATE, FIGURE

    calibrated.save(out)
    calibration = calibrated.calibration
    figure = rank_ecdf_figure(calibration.rank, calibration.draws, calibration.names)
    write_outputs(out, files_of(figure, FIGURE, ("png",)), CALIBRATE)
    table = calibrated.coverage()
    click.echo(table[["expected", "share", "low", "high"]].to_string(float_format=lambda x: f"{x:.3g}"))
    click.echo(f"{coverage_sentence(calibration)}\n\nwritten to {out}")
    click.echo(calibrated.sentence())


FIGURE, FORMATS = "work_precision", ("png", "pdf")
PRECISION = (f"{FIGURE}.csv", "summary.md", *(f"{FIGURE}.{name}" for name in FORMATS))
GROWTH, TABLES = ("whole_runs.csv", "whole_runs.md"), ("tables.csv", "tables.md")


@command
def bench(
    *, quick: bool = False, scale: bool = False, tables: bool = False, out: Out = Path("bench"), force: Force = False
) -> None:
    """Measure time and error of the likelihood on this machine, and of other ways to compute the response.

    Measures the likelihood of 1080 ratings at each accuracy, on one core, for 12 fabrics under 3 indentations and draws
    of the prior. Then measures programs that simulate every receptor: SciPy, NumPy and, where installed, Brian2 and
    JAX. Each is given with its error, and with the ratio of its time to that of the likelihood at the same error or
    less. Writes work_precision.csv, summary.md (tables) and work_precision.png and .pdf.

    With --scale, runs the whole job with few steps on simulated tables of up to 102 000 ratings of 1000 raters, 10 002
    conditions and 3000 loads, and predicts 40 000 touches, each in a process of its own. Writes whole_runs.csv
    and whole_runs.md.

    With --tables, simulates a table of every kind of ratings, samples each until it has converged, and compares
    effective draws with those of emcee's default moves. Writes tables.csv and tables.md.

    Parameters
    ----------
    quick
        A trial run: few draws and small tables.
    scale
        Measure instead whole runs on growing tables: time and memory.
    tables
        Measure instead the time until tables of every kind of ratings have converged.
    out
        Directory to write to.
    """
    import pandas as pd
    from threadpoolctl import threadpool_limits

    from softness_bayes.base.files.outputs import require_outputs, write_outputs
    from softness_bayes.base.files.spreadsheet import csv_of
    from softness_bayes.bench import growth
    from softness_bayes.bench.precision import FULL, QUICK
    from softness_bayes.bench.tables import sampled

    if scale and tables:
        raise InputError("bench: --scale and --tables measure different things; give one of them")
    names = GROWTH if scale else TABLES if tables else PRECISION
    require_outputs(out, names, "bench", force)
    click.echo(f"this takes minutes; it then writes {', '.join(names)} to {out.resolve()}", err=True)
    with threadpool_limits(1):
        if scale:
            smallest = {table.what: table for table in reversed(growth.TABLES)}
            grown = growth.grown([*reversed(smallest.values())] if quick else growth.TABLES)
            table, figures = pd.DataFrame([*_told(grown)]), dict[str, bytes]()
        elif tables:
            table, figures = pd.DataFrame([*_told(sampled(quick))]), {}
        else:
            table, figures = _speed_and_error(QUICK if quick else FULL)
    shown: list[Iterable[object]] = [table.columns, ["---"] * len(table.columns), *table.itertuples(index=False)]
    lines = [f"| {' | '.join([_short(value) for value in row])} |\n" for row in shown]
    contents = (csv_of(table, index=False), f"{''.join(lines)}\nMeasured on: {_machine()}.\n")
    write_outputs(out, {**dict(zip(names, contents, strict=False)), **figures}, "bench")
    click.echo(f"written to {out}")


def _told(measured: Iterable[Measured]) -> Iterator[Measured]:
    """Yield measurements; each is printed when it is made."""
    for row in measured:
        click.echo(", ".join(f"{name} {_short(value)}" for name, value in row._asdict().items()))
        yield row


def _short(value: object) -> str:
    return str(value) if not isinstance(value, float) else "" if math.isnan(value) else f"{value:.3g}"


def _speed_and_error(effort: Effort) -> tuple[pd.DataFrame, dict[str, bytes]]:
    """Measure and print the likelihood at each accuracy, and its peers; return their table and its figures."""
    import pandas as pd

    from softness_bayes.bench.peers import Peer, measure, ratio, receptors
    from softness_bayes.bench.precision import CHANNELS, work_precision
    from softness_bayes.plotting.studies import work_precision_figure
    from softness_bayes.plotting.style import files_of

    ours, count, peers = [*_told(work_precision(effort))], receptors(), list[Peer]()
    for module, package in {"solvers": "scipy", "brian": "brian2", "jax_cells": "diffrax"}.items():
        try:
            import_module(package)
        except Exception:  # the error depends on the versions of NumPy and of the package
            click.echo(
                f"left out: {package} is not installed, or not for this NumPy: pip install softness-bayes[peers]"
            )
        else:
            peers += import_module(f"softness_bayes.bench.{module}").PEERS
    others = [*_told(measure(peer, count, effort) for peer in peers)]
    ratios = [*(math.nan for _ in ours), *(ratio(point, ours) for point in others)]
    figure = work_precision_figure(
        {way: [(p.seconds, p.error_peak) for p in ours if p.way == way] for way in CHANNELS},
        {f"{p.way}, {p.setting}": (p.seconds, p.error_peak) for p in others},
        [(p.seconds, p.error_peak) for p in ours if p.accuracy == ACCURACY],
        _machine(),
    )
    return pd.DataFrame([*ours, *others]).assign(ratio=ratios), files_of(figure, FIGURE, FORMATS)


def _machine() -> str:
    """Return a description of the machine: processor, number of cores and versions."""
    info = Path("/proc/cpuinfo")
    named = re.search(r"^model name\s*: (.*)", info.read_text() if info.is_file() else "", re.MULTILINE)
    processor = named[1] if named else platform.processor() or platform.machine()
    versions = f"Python {platform.python_version()}, NumPy {import_module('numpy').__version__}"
    return f"{processor}, {os.cpu_count()} cores, {versions}"
