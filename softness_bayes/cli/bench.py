"""`softness-bayes bench`: time and error of the likelihood on this machine, beside programs of other kinds."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import force, out

if TYPE_CHECKING:
    from softness_bayes.bench.peers import Peer
    from softness_bayes.bench.precision import Effort, Point

TABLE, WORDS, FIGURE, FORMATS = "work_precision.csv", "summary.md", "work_precision", ("png", "pdf")
BENCH, MADE = "bench", (TABLE, WORDS, *(f"{FIGURE}.{name}" for name in FORMATS))
GROWTH = ("whole_runs.csv", "whole_runs.md")
PEERS = {"solvers": "scipy", "brian": "brian2", "jax_cells": "diffrax"}
"""Modules of peers, and the package that each needs."""


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
    from softness_bayes.files.outputs import require_outputs

    made = GROWTH if scale else MADE
    require_outputs(out, made, BENCH, force)
    click.echo(f"this takes minutes; it then writes {', '.join(made)} to {out.resolve()}", err=True)
    if scale:
        _whole_runs(quick, out)
    else:
        with threadpool_limits(1):
            _measure(QUICK if quick else FULL, out)
    click.echo(f"written to {out}")


def _whole_runs(quick: bool, out: Path) -> None:
    """Measure, print and write whole runs on growing tables; a trial run measures the smallest of each kind."""
    import pandas as pd

    from softness_bayes.bench.growth import TABLES, grown
    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.files.spreadsheet import csv_of

    found, smallest = [], {table.what: table for table in reversed(TABLES)}
    for one in grown([*reversed(smallest.values())] if quick else TABLES):
        click.echo(f"{one.what:12} {one.size:8} {one.seconds:9.1f} s {one.megabytes:7.0f} MB  power {one.exponent:.2f}")
        found.append(one)
    head = ("what grows", "size", "processor time [s]", "peak memory [MB]", "time as size to the power")
    rows = [
        (
            one.what,
            str(one.size),
            f"{one.seconds:.1f}",
            f"{one.megabytes:.0f}",
            f"{one.exponent:.2f}".replace("nan", ""),
        )
        for one in found
    ]
    made = (csv_of(pd.DataFrame(found), index=False), markdown(head, rows))
    write_outputs(out, dict(zip(GROWTH, made, strict=True)), BENCH)


def _measure(effort: Effort, out: Path) -> None:
    """Measure, print and write everything."""
    import pandas as pd

    from softness_bayes.bench.peers import measure, ratio, receptors
    from softness_bayes.bench.precision import CHANNELS, USUAL, work_precision
    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.files.spreadsheet import csv_of
    from softness_bayes.plotting.benchmark import work_precision_figure
    from softness_bayes.plotting.style import files_of

    ours = []
    for point in work_precision(effort):
        click.echo(f"{point.way}, {point.setting}: {1e6 * point.seconds:.1f} µs, error {point.error_peak:.0e}")
        ours.append(point)
    others, count = [], receptors()
    for peer in _peers():
        point = measure(peer, count, effort)
        click.echo(f"{point.way}, {point.setting}: {point.seconds:.3g} s, error {point.error_peak:.0e}")
        others.append(point)
    points, name = [*ours, *others], machine()
    ratios = [*(math.nan for _ in ours), *(ratio(point, ours) for point in others)]
    figure = work_precision_figure(
        {way: [(p.seconds, p.error_peak) for p in ours if p.way == way] for way in CHANNELS},
        {f"{p.way}, {p.setting}": (p.seconds, p.error_peak) for p in others},
        [(p.seconds, p.error_peak) for p in ours if p.accuracy == USUAL],
        name,
    )
    contents: dict[str, bytes | str] = {
        TABLE: csv_of(pd.DataFrame(points).assign(ratio=ratios), index=False),
        WORDS: summary(points, ratios, name),
        **files_of(figure, FIGURE, FORMATS),
    }
    write_outputs(out, contents, BENCH)


def _peers() -> Iterator[Peer]:
    """Yield the peers that can be imported."""
    for module, package in PEERS.items():
        try:
            import_module(package)
        except Exception:  # the error depends on the versions of NumPy and of the package
            click.echo(
                f"left out: {package} is not installed, or not for this NumPy: pip install softness-bayes[peers]"
            )
        else:
            yield from import_module(f"softness_bayes.bench.{module}").PEERS


def summary(points: Sequence[Point], ratios: Sequence[float], machine: str) -> str:
    """Return the table of measurements in Markdown."""
    head = ("way", "time for a parameter vector", "error / peak", "error of log(N/N_ref + eps)", "time / likelihood's")
    rows = []
    for point, ratio in zip(points, ratios, strict=True):
        log, over = ("" if math.isnan(x) else f"{x:.0e}" for x in (point.error_log, ratio))
        time = f"{1e6 * point.seconds:.3g} µs" if point.seconds < 1e-3 else f"{point.seconds:.3g} s"
        rows.append((f"{point.way}, {point.setting}", time, f"{point.error_peak:.0e}", log, over))
    return f"{markdown(head, rows)}\nMeasured on: {machine}.\n"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rows))


def machine(info: Path = Path("/proc/cpuinfo")) -> str:
    """Return a description of the machine: processor, number of cores and versions.

    Parameters
    ----------
    info
        The system's description of its processors.
    """
    import numpy as np

    text = info.read_text(encoding="utf-8", errors="replace") if info.is_file() else ""
    named = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    processor = next(iter(named), platform.processor() or platform.machine())
    return f"{processor}, {os.cpu_count()} cores, Python {platform.python_version()}, NumPy {np.__version__}"
