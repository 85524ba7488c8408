"""Whole runs on growing tables: ``python -m softness_bayes.tools.benchmark_scale notebooks/results/scale.csv``.

Measures what ``softness-bayes bench --scale`` measures, and writes each number as soon as it is known. With ``--kinds``
only some kinds of table grow, and the other rows of the file are kept; with ``--missing`` only tables are measured that
the file lacks. The machine is named in each row.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from pathlib import Path

from softness_bayes.bench.scale import TABLES, Grown, grown
from softness_bayes.bench.subject import machine, machine_name

COLUMNS = ("kind", "size", "ratings", "processor_s", "peak_mb", "exponent", "machine")

Key = tuple[str, str]
"""Kind and size of a table."""


def row(one: Grown, name: str) -> tuple[str, ...]:
    """Return a row of the file, without the exponent."""
    return (one.what, str(one.size), str(one.ratings), f"{one.seconds:.1f}", f"{one.megabytes:.0f}", "", name)


def with_exponents(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return the rows, each with the exponent from the one before, which is empty for the smallest of a kind."""
    found, before = [], None
    for one in rows:
        power = ""
        if before is not None and before[0] == one[0]:
            time, size = (math.log(float(one[k]) / float(before[k])) for k in (3, 1))
            power = f"{time / size:.2f}"
        found.append((*one[:5], power, one[6]))
        before = one
    return found


def kept_rows(path: Path) -> dict[Key, tuple[str, ...]]:
    """Return the rows of an earlier file, by kind and size."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {(one[0], one[1]): tuple(one) for one in list(csv.reader(file))[1:]}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each table, and write them; rows of other tables are kept."""
    kinds = list(dict.fromkeys(table.what for table in TABLES))
    parser = argparse.ArgumentParser(description="Measure time and memory of whole runs as tables grow.")
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="file to write")
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds, help="what grows")
    parser.add_argument("--missing", action="store_true", help="measure only tables that the file lacks")
    given = parser.parse_args(arguments)
    rows, name = kept_rows(given.file), machine_name(machine())
    places = [(table.what, str(table.size)) for table in TABLES]
    asked = [table for table in TABLES if table.what in given.kinds]
    print(" | ".join(COLUMNS))
    for one in grown([t for t in asked if not (given.missing and (t.what, str(t.size)) in rows)]):
        rows[one.what, str(one.size)] = row(one, name)
        ordered = with_exponents([rows[key] for key in places if key in rows])
        print(" | ".join(next(each for each in ordered if each[:2] == (one.what, str(one.size)))), flush=True)
        with given.file.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *ordered])


if __name__ == "__main__":
    main()
