"""`softness-bayes bench`: time and error of the likelihood on this machine, beside programs of other kinds."""

from __future__ import annotations

import math
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import force, out
from softness_bayes.defaults import ACCURACY

if TYPE_CHECKING:
    from softness_bayes.bench.peers import Peer
    from softness_bayes.bench.precision import Effort, Point

TABLE, WORDS, FIGURE, FORMATS = "work_precision.csv", "summary.md", "work_precision", ("png", "pdf")
BENCH, MADE = "bench", (TABLE, WORDS, *(f"{FIGURE}.{name}" for name in FORMATS))
GROWTH = ("whole_runs.csv", "whole_runs.md")


@click.command()
@click.option("--quick", is_flag=True, help="A trial run: few draws and small tables.")
@click.option("--scale", is_flag=True, help="Measure instead whole runs on growing tables: time and memory.")
@out("bench", "Directory to write to.")
@force
def command(quick: bool, scale: bool, out: Path, force: bool) -> None:
    """Measure time and error of the likelihood on this machine, and of other ways to compute the response.

    Measures the likelihood of 1080 ratings at each accuracy, on one core, for 12 fabrics under 3 indentations and draws
    of the prior. Then measures programs that simulate every receptor: SciPy, NumPy and, where installed, Brian2 and
    JAX. Each is given with its error, and with the ratio of its time to that of the likelihood at the same error or
    less. Writes work_precision.csv, summary.md (tables) and work_precision.png and .pdf.

    With --scale, runs the whole job with few steps on simulated tables of up to 102 000 ratings of 1000 raters, 10 002
    conditions and 3000 loads, and predicts 40 000 touches, each in a process of its own. Writes whole_runs.csv
    and whole_runs.md.
    """
    from threadpoolctl import threadpool_limits

    from softness_bayes.bench.precision import FULL, QUICK
    from softness_bayes.files.outputs import require_outputs, write_outputs

    names = GROWTH if scale else MADE
    require_outputs(out, names, BENCH, force)
    click.echo(f"this takes minutes; it then writes {', '.join(names)} to {out.resolve()}", err=True)
    with threadpool_limits(1):
        contents = _whole_runs(quick) if scale else _speed_and_error(QUICK if quick else FULL)
    write_outputs(out, contents, BENCH)
    click.echo(f"written to {out}")


def _whole_runs(quick: bool) -> dict[str, bytes | str]:
    """Measure and print whole runs on growing tables; a trial run measures the smallest of each kind."""
    import pandas as pd

    from softness_bayes.bench.growth import TABLES, grown
    from softness_bayes.files.spreadsheet import csv_of

    measured, smallest = [], {table.what: table for table in reversed(TABLES)}
    for one in grown([*reversed(smallest.values())] if quick else TABLES):
        click.echo(f"{one.what:12} {one.size:8} {one.seconds:9.1f} s {one.megabytes:7.0f} MB  power {one.exponent:.2f}")
        measured.append(one)
    table = pd.DataFrame(measured)
    shown = {
        "what grows": table["what"],
        "size": table["size"],
        "processor time [s]": table["seconds"].map("{:.1f}".format),
        "peak memory [MB]": table["megabytes"].map("{:.0f}".format),
        "time as size to the power": table["exponent"].map("{:.2f}".format).replace("nan", ""),
    }
    return dict(zip(GROWTH, (csv_of(table, index=False), markdown(shown)), strict=True))


def _speed_and_error(effort: Effort) -> dict[str, bytes | str]:
    """Measure and print the likelihood at each accuracy, and its peers."""
    import pandas as pd

    from softness_bayes.bench.peers import measure, ratio, receptors
    from softness_bayes.bench.precision import CHANNELS, work_precision
    from softness_bayes.files.spreadsheet import csv_of
    from softness_bayes.plotting.benchmark import work_precision_figure
    from softness_bayes.plotting.style import files_of

    def shown(points: Iterable[Point]) -> Iterator[Point]:
        for point in points:
            click.echo(f"{point.way}, {point.setting}: {_time(point.seconds)}, error {point.error_peak:.0e}")
            yield point

    ours, count = [*shown(work_precision(effort))], receptors()
    others = [*shown(measure(peer, count, effort) for peer in _peers())]
    ratios, name = [*(math.nan for _ in ours), *(ratio(point, ours) for point in others)], machine()
    table = pd.DataFrame([*ours, *others]).assign(ratio=ratios)
    figure = work_precision_figure(
        {way: [(p.seconds, p.error_peak) for p in ours if p.way == way] for way in CHANNELS},
        {f"{p.way}, {p.setting}": (p.seconds, p.error_peak) for p in others},
        [(p.seconds, p.error_peak) for p in ours if p.accuracy == ACCURACY],
        name,
    )
    words = {
        "way": table["way"] + ", " + table["setting"],
        "time for a parameter vector": table["seconds"].map(_time),
        "error / peak": table["error_peak"].map("{:.0e}".format),
        "error of log(N/N_ref + eps)": table["error_log"].map("{:.0e}".format).replace("nan", ""),
        "time / likelihood's": table["ratio"].map("{:.0e}".format).replace("nan", ""),
    }
    return {
        TABLE: csv_of(table, index=False),
        WORDS: f"{markdown(words)}\nMeasured on: {name}.\n",
        **files_of(figure, FIGURE, FORMATS),
    }


def _time(seconds: float) -> str:
    return f"{1e6 * seconds:.3g} µs" if seconds < 1e-3 else f"{seconds:.3g} s"


def _peers() -> Iterator[Peer]:
    """Yield the peers that can be imported."""
    for module, package in {"solvers": "scipy", "brian": "brian2", "jax_cells": "diffrax"}.items():
        try:
            import_module(package)
        except Exception:  # the error depends on the versions of NumPy and of the package
            click.echo(
                f"left out: {package} is not installed, or not for this NumPy: pip install softness-bayes[peers]"
            )
        else:
            yield from import_module(f"softness_bayes.bench.{module}").PEERS


def markdown(columns: Mapping[str, Iterable[object]]) -> str:
    """Return a table in Markdown."""
    rows = [columns, ["---"] * len(columns), *zip(*columns.values(), strict=True)]
    return "".join(f"| {' | '.join(map(str, row))} |\n" for row in rows)


def machine() -> str:
    """Return a description of the machine: processor, number of cores and versions."""
    import numpy as np

    info = Path("/proc/cpuinfo")
    named = re.search(r"^model name\s*: (.*)", info.read_text() if info.is_file() else "", re.MULTILINE)
    processor = named[1] if named else platform.processor() or platform.machine()
    return f"{processor}, {os.cpu_count()} cores, Python {platform.python_version()}, NumPy {np.__version__}"
