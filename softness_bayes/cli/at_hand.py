"""Files of the working directory that advised commands may name: tables that can be read, and finished runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType

from softness_bayes.errors import SoftnessError
from softness_bayes.files.run_files import POSTERIOR

MOST = 30
"""Files, or directories, that are looked at."""

LARGEST = 1_000_000
"""Bytes of the largest table that is tried."""

_TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".parquet")


def ratings_at_hand(fabrics: str | None = None) -> str | None:
    """Return the name of a table of ratings that can be sampled without another option, None if there is none.

    Parameters
    ----------
    fabrics
        A table of fabrics for it, if it is to be given one.
    """
    from softness_bayes.data import read_experiment

    return _first(_tables("ratings.csv"), lambda path: len(read_experiment(path, fabrics).ratings) > 0)


def fabrics_at_hand(rated: str = "", columns: Mapping[str, str] = MappingProxyType({})) -> str | None:
    """Return the name of a table of fabrics, which has those of a table of ratings if one is named; else None.

    Parameters
    ----------
    rated
        The table of ratings.
    columns
        Names of its columns, as `Ratings.read` takes them.
    """
    from softness_bayes.data import Fabrics, Ratings

    names: set[str] = set()
    for depth in (2.0, None) if rated else ():  # with a load for all, or loads of its own
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
    """Return whether a directory of this name holds a finished run."""
    return os.path.isfile(os.path.join(path, POSTERIOR))


def vacant(name: str) -> str:
    """Return a name that nothing has yet, this one if it is free."""
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
