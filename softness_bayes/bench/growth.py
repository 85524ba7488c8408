"""Time and memory of whole runs as tables grow, each measured in a process of its own.

Tables are simulated, with one rating of every fabric under every load by every rater. Each is sampled for ten steps by
``softness-bayes sample``, with everything that follows the sampler: checks, tables, figures. Predictions are those of
``softness-bayes predict`` from a small run.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from softness_bayes.base.files.whole import write_whole
from softness_bayes.data import Fabrics, fabrics_csv


class Table(NamedTuple):
    """A simulated table."""

    what: str
    """The quantity that grows from one table to the next."""
    size: int
    fabrics: int
    loads: int
    raters: int
    predicted: int = 0
    """Number of fabrics for which ratings are predicted; 0: the table itself is sampled."""


TABLES = (
    *(Table("ratings", 102 * raters, 34, 3, raters) for raters in (10, 100, 1000)),
    *(Table("conditions", 3 * fabrics, fabrics, 3, 3) for fabrics in (34, 334, 3334)),
    *(Table("loads", loads, 4, loads, 3) for loads in (30, 300, 3000)),
    *(Table("predictions", 4 * fabrics, 8, 4, 4, fabrics) for fabrics in (100, 1000, 10_000)),
)


class Grown(NamedTuple):
    """Time and memory of one command."""

    what: str
    size: int
    seconds: float
    """Processor time, of all processes."""
    megabytes: float
    """Peak memory of the largest process."""
    exponent: float
    """p if the time grows in proportion to size^p from the next smaller size; NaN for the smallest."""


def grown(tables: Sequence[Table] = TABLES) -> Iterator[Grown]:
    """Measure the commands for some tables, those of one kind in rising order of size."""
    before: Grown | None = None
    for table in tables:
        seconds, megabytes = measured(table)
        exponent = math.nan
        if before is not None and before.what == table.what:
            exponent = math.log(seconds / before.seconds) / math.log(table.size / before.size)
        before = Grown(table.what, table.size, seconds, megabytes, exponent)
        yield before


def measured(table: Table) -> tuple[float, float]:
    """Return processor time [s] and peak memory [MB] of the command for one table."""
    loads = [f"--indentation-mm={depth:.6g}" for depth in np.linspace(1.0, 3.0, table.loads)]
    with TemporaryDirectory() as name:
        few, data, run, others = (Path(name) / each for each in ("fabrics.csv", "data", "run", "others.csv"))
        for path, count in ((few, table.fabrics), (others, table.predicted or 1)):
            moduli = np.geomspace(3e3, 6e5, count)
            cloth = Fabrics(tuple(f"F{k}" for k in range(1, count + 1)), effective_modulus=moduli)
            write_whole(path, fabrics_csv(cloth).encode())
        timed("simulate", "--fabrics", few, *loads, "--participants", table.raters, "--out", data)
        steps = ("--max-steps", 10, "--processes", 1)
        used = timed("sample", "--data", data / "ratings.csv", "--out", run, "--modulus-cv", 0, *steps)
        if table.predicted:
            out = Path(name) / "predicted.csv"
            used = timed("predict", "--fabrics", others, *loads, "--posterior", run, "--out", out)
    return used


def timed(*command: object) -> tuple[float, float]:
    """Run a command of the package; return its processor time [s] and its peak memory [MB].

    Raises
    ------
    RuntimeError
        If it fails.
    """
    words = [sys.executable, "-m", "softness_bayes", *map(str, command)]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        words, text=True, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        errors = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 3):  # 3: so few steps do not converge
        raise RuntimeError(f"softness-bayes {command[0]} ended with {process.returncode}: {errors[-500:]}")
    unit = 2**20 if sys.platform == "darwin" else 2**10  # of ru_maxrss, per MB
    return used.ru_utime + used.ru_stime, used.ru_maxrss / unit
