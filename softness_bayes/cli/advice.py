"""Commands that would work, for the errors of beginners: the last line of such an error."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import click

from softness_bayes.files.run_files import CHECKPOINT

PROGRAM = "softness-bayes"
TRY = "try: "
"""Beginning of the line that gives the command."""

WORKS: Mapping[str, str] = {
    "check": "--data ratings.csv",
    "plan": "--data ratings.csv",
    "sample": "--data ratings.csv --out results",
    "status": "results",
    "resume": "results",
    "plot": "results --figures rating",
    "simulate": "--fabrics fabrics.csv --indentation-mm 2 --out simulated",
    "report": "results",
    "compare": "results other-results",
    "predict": "--posterior results --fabrics fabrics.csv --force-n 1",
    "rank": "results --fabrics fabrics.csv --force-n 1",
    "target": "results --rating 20 --force-n 1",
    "explore": "results",
    "new": "my-study",
}
"""Words after a verb with which it works, if files of these names are there."""

LISTS: Mapping[str, str] = {
    "--reading": "readings",
    "--readings": "readings",
    "--prior": "priors",
    "--priors": "priors",
}
"""Verbs that list what may follow an option."""


def of_usage(error: click.UsageError, typed: Sequence[str]) -> str:
    """Return the advice on a command line that cannot be understood; empty if there is none."""
    verb = error.ctx.info_name if error.ctx is not None else None
    if isinstance(error, click.BadParameter) and not isinstance(error, click.MissingParameter):
        option = next(iter(error.param.opts), "") if error.param is not None else ""
        return f"{TRY}{PROGRAM} {LISTS[option]}" if option in LISTS else ""
    extra = re.search(r"unexpected extra arguments? \(([^ ]+)\)", error.format_message())
    if extra and verb is not None and verb in ("check", "plan", "sample") and os.path.isfile(extra[1]):
        return f"{TRY}{shlex.join([PROGRAM, verb, '--data', extra[1]])}"
    return f"{TRY}{PROGRAM} {verb} {WORKS[verb]}" if verb is not None and verb in WORKS else ""


def of_input(message: str, typed: Sequence[str]) -> str:
    """Return the advice on an error of files and values; empty if there is none."""
    found = [(match, advise) for pattern, advise in ADVICE if (match := re.search(pattern, message))]
    more = [words for match, advise in found for words in advise(match, typed)]
    if not more:
        return ""
    own = more[0] == PROGRAM  # a command of its own, not words to add to the one that was typed
    return TRY + shlex.join(more if own else [PROGRAM, *typed, *more])


def _added(*words: str) -> Callable[[re.Match[str], Sequence[str]], list[str]]:
    def advise(match: re.Match[str], typed: Sequence[str]) -> list[str]:
        return [] if words[0] in typed else list(words)

    return advise


def _load(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    """Return the option that names a column of the table, where one may hold the load, else one that gives it."""
    if named := re.search(r"--column ((?:indentation_mm|force_n)=(?:'[^']*'|\S+)) takes", match.string):
        return ["--column", named[1].replace("'", "")]
    return [] if "--indentation-mm" in typed else ["--indentation-mm", "2"]


def _instead(*words: str) -> Callable[[re.Match[str], Sequence[str]], list[str]]:
    def advise(match: re.Match[str], typed: Sequence[str]) -> list[str]:
        return [PROGRAM, *words]

    return advise


def _elsewhere(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    other = f"{match[1].rstrip('/')}-2"
    if "--out" not in typed:
        return ["--out", other]
    at = typed.index("--out") + 1
    return [PROGRAM, *typed[:at], other, *typed[at + 1 :]]


def _sampled(match: re.Match[str], typed: Sequence[str]) -> list[str]:
    home = match[1].removesuffix("/posterior.nc")
    if Path(home, CHECKPOINT).is_dir():
        return [PROGRAM, "resume", home]
    return [PROGRAM, "sample", "--data", "ratings.csv", "--out", home]


ADVICE: Sequence[tuple[str, Callable[[re.Match[str], Sequence[str]], list[str]]]] = (
    (r"the fabrics have no properties", _added("--fabrics", "fabrics.csv")),
    (r"no load column|no load: give at least one", _load),
    (r"^(.+): is not empty", _elsewhere),
    (r"^(.+): no such file; expected the posterior.nc of a run", _sampled),
    (r"^(.+): no run to continue or to report on", _sampled),
    (r"\.(csv|tsv|txt|xlsx|parquet): No such file or directory", _instead("new", "my-study")),
    (r"^compare: 1 result", _added("other-results")),
    (r"^figures: there is no ", _instead("figures")),
)
"""Patterns of messages, and the words to add to what was typed, or the command in its place."""
