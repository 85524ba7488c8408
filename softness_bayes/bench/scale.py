"""Time and memory of whole runs as tables grow, each measured in a process of its own.

Tables are simulated, with one rating of every fabric under every load by every rater. Each is sampled for a few steps
by ``softness-bayes sample``, with everything that follows the sampler: checks, tables, figures. Predictions are those
of ``softness-bayes predict`` from a small run.
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

from softness_bayes.data import Fabrics, write_fabrics

STEPS = 10
"""Steps of the sampler: what grows with the table is the same for every step."""

_ENDED = (0, 3)  # 3: so few steps do not converge


class Table(NamedTuple):
    """A simulated table, and the number of fabrics for which ratings are predicted (0: the table itself is sampled)."""

    what: str
    """Quantity that grows from one table to the next."""
    fabrics: int
    loads: int
    raters: int
    predicted: int = 0

    @property
    def size(self) -> int:
        """Number of the growing quantity."""
        conditions = self.fabrics * self.loads
        sizes = {
            "ratings": conditions * self.raters,
            "conditions": conditions,
            "loads": self.loads,
            "predictions": self.predicted * self.loads,
        }
        return sizes[self.what]


TABLES = (
    *(Table("ratings", 34, 3, raters) for raters in (10, 100, 1000)),
    *(Table("conditions", fabrics, 3, 3) for fabrics in (34, 334, 3334)),
    *(Table("loads", 4, loads, 3) for loads in (30, 300, 3000)),
    *(Table("predictions", 8, 4, 4, fabrics) for fabrics in (100, 1000, 10_000)),
)


class Grown(NamedTuple):
    """Time and memory of one command."""

    what: str
    size: int
    ratings: int
    """Number of ratings of the table that is sampled, or was."""
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
        seconds, megabytes = _measured(table)
        exponent = math.nan
        if before is not None and before.what == table.what:
            exponent = math.log(seconds / before.seconds) / math.log(table.size / before.size)
        ratings = table.fabrics * table.loads * table.raters
        before = Grown(table.what, table.size, ratings, seconds, megabytes, exponent)
        yield before


def _measured(table: Table) -> tuple[float, float]:
    """Return processor time [s] and peak memory [MB] of the command for one table."""
    loads = [f"--indentation-mm={depth:.6g}" for depth in np.linspace(1.0, 3.0, table.loads)]
    with TemporaryDirectory() as name:
        folder = Path(name)
        few, data, run = folder / "fabrics.csv", folder / "data", folder / "run"
        _write_fabrics(few, table.fabrics)
        made = ["--fabrics", str(few), *loads, "--participants", str(table.raters), "--out", str(data)]
        _run(["simulate", *made])
        sampled = ["sample", "--data", str(data / "ratings.csv"), "--out", str(run), "--modulus-cv", "0"]
        found = _run([*sampled, "--max-steps", str(STEPS), "--processes", "1"])
        if table.predicted:
            _write_fabrics(folder / "others.csv", table.predicted)
            asked = ["--fabrics", str(folder / "others.csv"), *loads, "--posterior", str(run)]
            found = _run(["predict", *asked, "--out", str(folder / "predicted.csv")])
    return found


def _write_fabrics(path: Path, count: int) -> None:
    names = tuple(f"F{k}" for k in range(1, count + 1))
    write_fabrics(path, Fabrics(names, effective_modulus=np.geomspace(3e3, 6e5, count)))


def _run(command: Sequence[str]) -> tuple[float, float]:
    """Run a command of the package; return its processor time [s] and its peak memory [MB].

    Raises
    ------
    RuntimeError
        If it fails.
    """
    with subprocess.Popen(
        [sys.executable, "-m", "softness_bayes", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    ) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in _ENDED:
        raise RuntimeError(f"softness-bayes {command[0]} ended with {process.returncode}: {said[-500:]}")
    unit = 2**20 if sys.platform == "darwin" else 2**10  # of ru_maxrss, per MB
    return used.ru_utime + used.ru_stime, used.ru_maxrss / unit
