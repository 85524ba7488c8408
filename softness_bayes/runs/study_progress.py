"""Progress of a study: tables that were refused, and the time that the others still take."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

from softness_bayes.files.asked import read_asked
from softness_bayes.files.run_files import POSTERIOR, RUNS
from softness_bayes.runs.table_fit import REFUSED

TABLES = "tables.csv"
"""Table of the outcomes of a study, written when it ends."""


def refused_tables(directory: Path) -> list[str]:
    """Return the names of the tables that the last call refused; empty before its end."""
    path = directory / TABLES
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [row["table"] for row in csv.DictReader(file) if row.get("outcome") == REFUSED]


def seconds_left(directory: Path, done: Iterable[str], tables: int) -> float:
    """Return the estimated remaining time [s], from the runs that ended since the last call; nan without any.

    Parameters
    ----------
    directory
        Directory of the study.
    done
        Names of the runs that have ended.
    tables
        Number of tables that are fitted.
    """
    begun, names = read_asked(directory).begun, [*done]
    times = [(directory / RUNS / name / POSTERIOR).stat().st_mtime for name in names]
    since = [when for when in times if when > begun]
    return (max(since) - begun) / len(since) * (tables - len(names)) if since else math.nan
