"""Files in the working directory for suggested commands: readable tables and finished runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType

from softness_bayes.errors import SoftnessError
from softness_bayes.files.run_files import POSTERIOR

MOST = 30
"""Largest number of files or directories that are examined."""

LARGEST = 1_000_000
"""Size of the largest table that is read [bytes]."""

_TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".parquet")


def ratings_at_hand(fabrics: str | None = None) -> str | None:
    """Return the name of a table of ratings that can be sampled without further options, None if there is none.

    Parameters
    ----------
    fabrics
        A table of fabrics to use with it, if any.
    """
    from softness_bayes.data import read_experiment

    return _first(_tables("ratings.csv"), lambda path: len(read_experiment(path, fabrics).ratings) > 0)


def fabrics_at_hand(rated: str = "", columns: Mapping[str, str] = MappingProxyType({})) -> str | None:
    """Return the name of a table of fabrics, or None if there is none.

    If a table of ratings is given, the table must contain all rated fabrics.

    Parameters
    ----------
    rated
        The table of ratings.
    columns
        Names of its columns, in the form accepted by `Ratings.read`.
    """
    from softness_bayes.data import Fabrics, Ratings

    names: set[str] = set()
    for depth in (2.0, None) if rated else ():  # a common load for all ratings, or loads from the table
        with suppress(SoftnessError, OSError):
            names |= {*Ratings.read(rated, columns=columns, indentation_mm=depth).fabrics}
    return _first(_tables("fabrics.csv"), lambda path: names <= {*Fabrics.read(path).names})


def kind_of(path: str) -> str:
    """Return `--compression` or `--fabrics` for a table of forces or of fabrics, an empty text for any other."""
    from softness_bayes.data import Compression, Fabrics

    for option, table in (("--compression", Compression), ("--fabrics", Fabrics)):
        with suppress(SoftnessError, OSError):
            table.read(path)
            return option
    return ""


def runs_at_hand() -> list[str]:
    """Return the names of directories with a finished run, `results` first."""
    found = [entry.name for entry in _entries() if is_run(entry.path)]
    return sorted(found, key=lambda name: (name != "results", name))


def is_run(path: str) -> bool:
    """Return True if a directory of this name contains a finished run."""
    return os.path.isfile(os.path.join(path, POSTERIOR))


def vacant(name: str) -> str:
    """Return the given name if it is unused, else the first unused name of the form NAME-2, NAME-3 and so on."""
    return next(one for one in (name, *(f"{name}-{k}" for k in range(2, 10_000))) if not os.path.lexists(one))


def _tables(usual: str) -> list[str]:
    found = [
        entry.name
        for entry in _entries()
        if entry.name.lower().endswith(_TABLES) and entry.is_file() and entry.stat().st_size <= LARGEST
    ]
    return sorted(found, key=lambda name: (name != usual, name))


def _entries() -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(".") as entries:
            yield from sorted((one for one in entries if one.name[0] not in "-."), key=lambda one: one.name)[:MOST]
    except OSError:
        return


def _first(names: Sequence[str], holds: Callable[[str], bool]) -> str | None:
    for name in names:
        try:
            if holds(name):
                return name
        except (SoftnessError, OSError, ArithmeticError, ValueError):
            continue
    return None
