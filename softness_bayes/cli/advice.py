"""Suggestions of working commands, printed as the last line of common errors.

They use the files in the working directory: readable tables and finished runs.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

import click

from softness_bayes.errors import SoftnessError
from softness_bayes.files.run_files import CHECKPOINT, POSTERIOR

PROGRAM = "softness-bayes"
TRY = "try: "
"""Beginning of the line with the suggested command."""

RATINGS, FABRICS, RUN, OTHER, NEW, OUT = "{ratings}", "{fabrics}", "{run}", "{other}", "{new}", "{out}"
"""Placeholders in suggested commands, for existing files and runs and for new directories."""

WORKS: Mapping[str, tuple[str, ...]] = {
    "check": ("--data", RATINGS),
    "sample": ("--data", RATINGS, "--out", OUT),
    "status": (RUN,),
    "resume": (RUN,),
    "plot": (RUN, "--figures", "rating"),
    "simulate": ("--fabrics", FABRICS, "--indentation-mm", "2", "--out", "{simulated}"),
    "report": (RUN,),
    "compare": (RUN, OTHER),
    "predict": ("--posterior", RUN, "--fabrics", FABRICS, "--force-n", "1"),
    "rank": (RUN, "--force-n", "1"),
    "target": (RUN, "--rating", "20", "--force-n", "1"),
    "explore": (RUN,),
    "new": (NEW,),
    "list": ("readings",),
}
"""Command -> arguments with which it works."""

LISTS: Mapping[str, str] = {
    "--reading": "list readings",
    "--readings": "list readings",
    "--prior": "list priors",
    "--priors": "list priors",
}
"""Option -> command that lists its possible values."""


def of_usage(error: click.UsageError, typed: Sequence[str]) -> str:
    """Return the advice for a usage error of the command line; empty if there is none."""
    verb = error.ctx.info_name if error.ctx is not None else None
    if isinstance(error, click.BadParameter) and not isinstance(error, click.MissingParameter):
        option = next(iter(error.param.opts), "") if error.param is not None else ""
        listing = LISTS.get(option) or (f"{verb} --help" if verb in WORKS else "")
        return f"{TRY}{PROGRAM} {listing}" if listing else ""
    extra = re.search(r"unexpected extra arguments? \(([^ ]+)\)", error.format_message())
    if extra and verb is not None and verb in ("check", "sample") and os.path.isfile(extra[1]):
        return f"{TRY}{shlex.join([PROGRAM, verb, '--data', extra[1]])}"
    return f"{TRY}{shlex.join([PROGRAM, *_working(verb, typed)])}" if verb is not None and verb in WORKS else ""


def of_input(message: str, typed: Sequence[str]) -> str:
    """Return the advice for an error in files or values: a suggested command, or else the help of the command."""
    found = [(match, advise) for pattern, advise in ADVICE if (match := re.search(pattern, message))]
    each = [words for match, advise in found if (words := advise(match, typed))]
    if not each:
        verb = next((word for word in typed if word in WORKS), None)
        return "" if verb is None else f"{TRY}{PROGRAM} {verb} --help"
    # the advice is either a complete command, or words to add to the typed command
    own = next((words for words in each if words[0] == PROGRAM), None)
    return TRY + shlex.join(own or [PROGRAM, *typed, *(word for words in each for word in words)])


def _working(verb: str, typed: Sequence[str] = ()) -> list[str]:
    """Return a command with arguments that work in this directory, or a command that creates the missing file.

    Runs that were named on the command line are preferred to others.
    """
    words = WORKS[verb]
    runs = [*dict.fromkeys([*filter(is_run, typed), *finished_runs()])] if RUN in words else []
    if RUN in words and len(runs) < 1 + (OTHER in words):
        return _working("sample") if readable_ratings() is not None else ["demo"]
    names: dict[str, str | None] = {
        RATINGS: readable_ratings() if RATINGS in words else None,
        FABRICS: readable_fabrics() if FABRICS in words else None,
        RUN: next(iter(runs), None),
        OTHER: next(iter(runs[1:]), None),
        NEW: vacant("my-study"),
        OUT: vacant("results"),
        "{simulated}": vacant("simulated"),
    }
    found = [names.get(word, word) for word in words]
    return ["new", vacant("my-study")] if None in found else [verb, *(word for word in found if word is not None)]


def _added(*words: str) -> Callable[[re.Match[str], Sequence[str]], list[str]]:
    def advise(match: re.Match[str], typed: Sequence[str]) -> list[str]:
        return [] if words[0] in typed else list(words)

    return advise


def _load(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the option for a column of the table that may contain the load, else an option for the load itself."""
    if named := re.search(r"--column ((?:indentation_mm|force_n)=(?:'[^']*'|\S+)) takes", match.string):
        return ["--column", named[1].replace("'", "")]
    return [] if "--indentation-mm" in typed else ["--indentation-mm", "2"]


def _fabrics(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the option for an existing table of fabrics, else the command that writes such a table."""
    if "--fabrics" in typed:
        return []
    data = typed[typed.index("--data") + 1] if "--data" in typed[:-1] else ""
    named = re.search(r"--column rating=('[^']*'|\S+) takes", match.string)
    found = readable_fabrics(data, {"rating": named[1].strip("'")} if named else {})
    return [PROGRAM, "new", vacant("my-study")] if found is None else ["--fabrics", found]


def _named(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the options for the columns that are named in a message."""
    found = re.findall(r"--column (\w+=(?:'[^']*'|[^\s;]+)) takes", match.string)
    if "no load column" in match.string:  # this option has separate advice
        found = [one for one in found if not one.startswith(("indentation_mm=", "force_n="))]
    return [word for one in found[:4] for word in ("--column", one.replace("'", ""))]


def _other_kind(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the command for a table of fabrics or of forces that was passed as a table of ratings."""
    if "--data" not in typed[:-1] or "--column rating=" in match.string.replace("--column rating=...", ""):
        return []
    at = typed.index("--data")
    option, others = option_of_table(typed[at + 1]), [*typed[:at], *typed[at + 2 :]]
    if option == "--compression" and option not in typed:
        return [PROGRAM, *others, option, typed[at + 1]]
    if option != "--fabrics" or option in typed:
        return []
    rated = readable_ratings(typed[at + 1])
    return (
        [PROGRAM, "new", vacant("my-study")]
        if rated is None
        else [PROGRAM, *others, "--data", rated, option, typed[at + 1]]
    )


def _scale(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    return [] if "--ratings" in typed else ["--ratings", match[1]]


def _instead(*words: str) -> Callable[[re.Match[str], Sequence[str]], list[str]]:
    def advise(match: re.Match[str], typed: Sequence[str]) -> list[str]:
        return [PROGRAM, *words]

    return advise


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


def _started(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    return [PROGRAM, *_working("check")]


def _compared(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    return [PROGRAM, *_working("compare")]


ADVICE: Sequence[tuple[str, Callable[[re.Match[str], Sequence[str]], list[str]]]] = (
    (r"no columns? .*'rating'", _other_kind),
    (r"the fabrics have no properties", _fabrics),
    (r"no load column|no load: give at least one", _load),
    (r"--column \w+=(?:'[^']*'|\S+) takes", _named),
    (r"add --ratings (\w+)", _scale),
    (r"with --decimal \. or --decimal ,|if commas are decimal marks", _added("--decimal", ",")),
    (r"leave these out with --drop-zeros", _added("--drop-zeros")),
    (r"^(.+): is not empty", _elsewhere),
    (r"^(.+): no such file; expected the posterior.nc of a run", _sampled),
    (r"^(.+): no run to continue or to report on", _sampled),
    (r"\.(csv|tsv|txt|xlsx|parquet): No such file or directory", _started),
    (r"^compare: 1 result", _compared),
    (r"^figures: there is no ", _instead("list", "figures")),
)
"""Patterns of messages, with words to add to the typed command or with a command that replaces it."""

MOST_EXAMINED = 30
"""Largest number of files or directories that are examined."""

LARGEST = 1_000_000
"""Size of the largest table that is read [bytes]."""

_TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".parquet")


def readable_ratings(fabrics: str | None = None) -> str | None:
    """Return the name of a table of ratings that can be sampled without further options, None if there is none.

    Parameters
    ----------
    fabrics
        A table of fabrics to use with it, if any.
    """
    from softness_bayes.data import read_experiment

    return _first(_tables("ratings.csv"), lambda path: len(read_experiment(path, fabrics).ratings) > 0)


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
        with suppress(SoftnessError, OSError):
            names |= {*Ratings.read(rated, columns=columns, indentation_mm=depth).fabrics}
    return _first(_tables("fabrics.csv"), lambda path: names <= {*Fabrics.read(path).names})


def option_of_table(path: str) -> str:
    """Return `--compression` or `--fabrics` for a table of forces or of fabrics, an empty text for any other."""
    from softness_bayes.data import Compression, Fabrics

    for option, table in (("--compression", Compression), ("--fabrics", Fabrics)):
        with suppress(SoftnessError, OSError):
            table.read(path)
            return option
    return ""


def finished_runs() -> list[str]:
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
            yield from sorted((one for one in entries if one.name[0] not in "-."), key=lambda one: one.name)[
                :MOST_EXAMINED
            ]
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
