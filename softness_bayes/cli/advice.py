"""Suggestions of working commands, printed as the last line of common errors.

They use the files in the working directory: readable tables and finished runs.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click

from softness_bayes.base.errors import SoftnessError
from softness_bayes.base.files.run_files import CHECKPOINT, POSTERIOR

PROGRAM = "softness-bayes"
TRY = "try: "
"""Beginning of the line with the suggested command."""

WORKS: Mapping[str, Callable[[Sequence[str]], Sequence[str | None]]] = {
    "check": lambda runs: ("--data", readable_ratings()),
    "sample": lambda runs: ("--data", readable_ratings(), "--out", vacant("results")),
    "status": lambda runs: (runs[0],),
    "resume": lambda runs: (runs[0],),
    "plot": lambda runs: (runs[0], "--figures", "rating"),
    "simulate": lambda runs: ("--fabrics", readable_fabrics(), "--indentation-mm", "2", "--out", vacant("simulated")),
    "report": lambda runs: (runs[0],),
    "compare": lambda runs: (runs[0], runs[1]),
    "predict": lambda runs: ("--posterior", runs[0], "--fabrics", readable_fabrics(), "--force-n", "1"),
    "rank": lambda runs: (runs[0], "--force-n", "1"),
    "target": lambda runs: (runs[0], "--rating", "20", "--force-n", "1"),
    "design": lambda runs: ("--given", runs[0]),
    "explore": lambda runs: (runs[0],),
    "new": lambda runs: (vacant("my-study"),),
    "list": lambda runs: ("readings",),
}
"""Command -> function of the runs in this directory, which returns arguments with which it works; None for a missing
file."""

LISTS = {"--reading": "readings", "--readings": "readings", "--prior": "priors", "--priors": "priors"}
"""Option -> what `list` lists of its possible values."""


def of_usage(error: click.UsageError, typed: Sequence[str]) -> str:
    """Return the advice for a usage error of the command line; empty if there is none."""
    verb = "" if error.ctx is None else error.ctx.info_name or ""
    option = error.param.opts[0] if isinstance(error, click.BadParameter) and error.param is not None else ""
    extra = re.search(r"unexpected extra arguments? \(([^ ]+)\)", error.format_message())
    if option in LISTS:
        words = [PROGRAM, "list", LISTS[option]]
    elif verb not in WORKS or (option and not isinstance(error, click.MissingParameter)):
        return ""
    elif extra and verb in ("check", "sample") and os.path.isfile(extra[1]):
        words = [PROGRAM, verb, "--data", extra[1]]
    else:
        words = working(verb, typed)
    return TRY + shlex.join(words)


def of_input(
    message: str,
    typed: Sequence[str],
    hints: Sequence[Mapping[str, str]] = (),
    reads: Callable[[Sequence[str]], bool] = lambda words: True,
) -> str:
    """Return the advice for an error in files or values: a suggested command; empty where none is known to help.

    Parameters
    ----------
    message, typed
        The error, and the words of the command that met it.
    hints
        Columns of the table with which it may be read, each by itself.
    reads
        Whether a command reads its tables.
    """
    matches = [(match, advise) for pattern, advise in ADVICE if (match := re.search(pattern, message))]
    for hint in (*hints, {}):
        columns = [("--column", f"{name}={title}") for name, title in hint.items() if name != "wide"]
        added = [word for pair in [*columns, ("--wide",) * ("wide" in hint)] for word in pair]
        advice = [words for match, advise in matches if (words := advise(match, [*typed, *added]))]
        # the advice is either a complete command, or words to add to the typed command
        complete = next((words for words in advice if words[0] == PROGRAM), None)
        words = complete or [PROGRAM, *typed, *(word for words in advice for word in words), *added]
        if (advice or hint) and reads(words[1:]):
            return TRY + shlex.join(words)
    return ""


def working(verb: str, typed: Sequence[str] = ()) -> list[str]:
    """Return a command with arguments that work in this directory, or a command that creates the missing file.

    Runs that were named on the command line are preferred to others.
    """
    try:
        words = WORKS[verb]([*dict.fromkeys([*filter(is_run, typed), *_entries("results", is_run)])])
    except IndexError:  # too few runs
        return working("sample") if readable_ratings() is not None else [PROGRAM, "demo"]
    known = [word for word in words if word is not None]
    return [PROGRAM, verb, *known] if len(known) == len(words) else _new()


def _new() -> list[str]:
    """Return the command that writes tables to start from."""
    return [PROGRAM, "new", vacant("my-study")]


def _add(typed: Sequence[str], *words: str) -> list[str]:
    """Return an option to add to the typed command, unless it is there."""
    return [] if words[0] in typed else [*words]


def _load(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the option for the load of all ratings, which nobody but the user knows, unless a column is named."""
    if "no load column" not in match[0]:
        return _add(typed, "--indentation-mm", "2")
    named = any(word.startswith(("indentation_mm=", "force_n=")) for word in typed)
    return [] if named else _add(typed, "--load", "free")


def _fabrics(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the option for an existing table of fabrics, else the command that writes such a table."""
    data = typed[typed.index("--data") + 1] if "--data" in typed[:-1] else ""
    columns = dict(word.split("=", 1) for option, word in pairwise(typed) if option == "--column" and "=" in word)
    table = readable_fabrics(data, columns)
    return _new() if table is None else _add(typed, "--fabrics", table)


def _other_kind(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the command for a table of fabrics or of forces that was passed as a table of ratings."""
    from softness_bayes.data import Compression, Fabrics

    if "--data" not in typed[:-1] or any(word.startswith("rating=") for word in typed):
        return []
    at = typed.index("--data")
    table, others = typed[at + 1], [*typed[:at], *typed[at + 2 :]]
    if "--compression" not in typed and _reads(Compression.read, table):
        return [PROGRAM, *others, "--compression", table]
    if "--fabrics" in typed or not _reads(Fabrics.read, table):
        return []
    rated = readable_ratings(table)
    return _new() if rated is None else [PROGRAM, *others, "--data", rated, "--fabrics", table]


def _elsewhere(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    other = vacant(match[1].rstrip("/"))
    if "--out" not in typed:
        return ["--out", other]
    at = typed.index("--out") + 1
    return [PROGRAM, *typed[:at], other, *typed[at + 1 :]]


def _sampled(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    home = match[1].removesuffix("/posterior.nc")
    if Path(home, CHECKPOINT).is_dir():
        return [PROGRAM, "resume", home]
    ratings = readable_ratings()
    return [PROGRAM, "demo"] if ratings is None else [PROGRAM, "sample", "--data", ratings, "--out", vacant(home)]


# not for 1,234 between commas, which rather has thousands
_DECIMAL = r"with --decimal \. or --decimal ,|got '(?![0-9]{1,3},[0-9]{3}')[^;]*; if commas are decimal marks"

ADVICE: Sequence[tuple[str, Callable[[re.Match[str], Sequence[str]], list[str]]]] = (
    (r"no columns? .*'rating'", _other_kind),
    (r"the fabrics have no properties", _fabrics),
    (r"no load column(?!.*, as to ')|no load: give", _load),
    (r"add --ratings (\w+)", lambda match, typed: _add(typed, "--ratings", match[1])),
    (_DECIMAL, lambda _, typed: _add(typed, "--decimal", ",")),
    (r"leave these out with --drop-zeros", lambda _, typed: _add(typed, "--drop-zeros")),
    (r"^(.+): is not empty", _elsewhere),
    (r"^(.+): no such file; expected the posterior.nc of a run", _sampled),
    (r"^(.+): no run to continue or to report on", _sampled),
    (r"\.(csv|tsv|txt|xlsx|parquet): No such file or directory", lambda *_: working("check")),
    (r"^no data: ", lambda _, typed: working("sample" if "sample" in typed else "check")),
    (r"^compare: 1 result", lambda *_: working("compare")),
    (r"^figures: there is no ", lambda *_: [PROGRAM, "list", "figures"]),
)
"""Patterns of messages, with words to add to the typed command or with a command that replaces it."""


def readable_ratings(fabrics: str | None = None) -> str | None:
    """Return the name of a table of ratings that can be sampled without further options, None if there is none.

    Parameters
    ----------
    fabrics
        A table of fabrics to use with it, if any.
    """
    from softness_bayes.data import read_experiment

    return next((name for name in _tables("ratings.csv") if _reads(read_experiment, name, fabrics)), None)


def readable_fabrics(rated: str = "", columns: Mapping[str, str] = MappingProxyType({})) -> str | None:
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
        ratings = _reads(Ratings.read, rated, columns=columns, indentation_mm=depth)
        names |= {*ratings.fabrics} if ratings else set()
    for name in _tables("fabrics.csv"):
        if (table := _reads(Fabrics.read, name)) and names <= {*table.names}:
            return name
    return None


def is_run(path: str) -> bool:
    """Return True if a directory of this name contains a finished run."""
    return os.path.isfile(os.path.join(path, POSTERIOR))


def vacant(name: str) -> str:
    """Return the given name if it is unused, else the first unused name of the form NAME-2, NAME-3 and so on."""
    return next(one for one in (name, *(f"{name}-{k}" for k in range(2, 10_000))) if not os.path.lexists(one))


def _tables(first: str) -> list[str]:
    """Return the names of the tables in this directory that are quick to read."""
    endings = (".csv", ".tsv", ".txt", ".xlsx", ".parquet")
    return _entries(
        first, lambda one: one.lower().endswith(endings) and os.path.isfile(one) and os.path.getsize(one) <= 1_000_000
    )


def _entries(first: str, wanted: Callable[[str], bool]) -> list[str]:
    """Return names in this directory, among the first thirty, of which one comes first if it is there."""
    try:
        shown = sorted(one for one in os.listdir(".") if one[0] not in "-.")[:30]
        return sorted(filter(wanted, shown), key=lambda name: (name != first, name))
    except OSError:
        return []


def _reads(read: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Return what a reader of tables returns; None if it refuses the table, or finds no row."""
    try:
        return read(*arguments, **options) or None
    except (SoftnessError, OSError, ArithmeticError, ValueError):
        return None
