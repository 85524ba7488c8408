"""Commands to repeat a run, derived from the provenance of its result."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from itertools import zip_longest
from typing import NamedTuple

from softness_bayes.files.command_line import storable
from softness_bayes.model.options import ModelOptions
from softness_bayes.options import Flag
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import DataFiles, RunOptions

PROGRAM = "softness-bayes"

PATHS = (
    "Paths are relative to the directory in which the run was started. For a file elsewhere that was given by "
    "its absolute path, only the name is stored."
)
"""Note on the paths in a command."""

AGAIN = "again/"
"""Directory that the repeated run is written to."""


class Repetition(NamedTuple):
    """Commands that draw the same posterior again."""

    commands: tuple[str, ...]
    """Commands in order of execution."""
    notes: tuple[str, ...]
    """Conditions for identical draws."""


def repetition(result: Result) -> Repetition:
    """Return commands with every option that the draws depend on, the seed included.

    Parameters
    ----------
    result
        A finished run, begun at the command line or in Python.
    """
    attributes, (model, run) = result.attributes, Request.of(result)
    begun, *continued = _split(run.command)
    data, notes = _data(result, begun)
    if not attributes["converged"] and math.isfinite(run.max_seconds):
        run = replace(run, max_steps=int(attributes["steps"]))
        notes.append(f"The run ended at its time limit; --max-steps {run.max_steps} ends it at the same step.")
    left_out = {"processes", "max_seconds"}
    if result.has_ratings and model.kept_accuracy is None:
        left_out.add("accuracy")
        notes.append(f"The run was made in Python, with a given resolution: {model.discretisation}.")
    words = [PROGRAM, "sample", *data]
    for options in (model, run):
        words += options.words(*_stated(type(options), left_out, result.has_ratings))
    more = [shlex.join([PROGRAM, "resume", AGAIN, "--more-steps", count]) for count in map(_more_steps, continued)]
    notes.append(
        "The draws are the same only with the same files (compare their digests) and versions; both are listed above."
    )
    return Repetition((storable(shlex.join([*words, "--out", AGAIN])), *more), tuple(notes))


def _stated(options: type[ModelOptions | RunOptions], left_out: set[str], rated: bool) -> list[str]:
    """Return the names of the options that a command states, for a run with or without ratings."""
    return [name for name, one in options.declared.items() if name not in left_out and (rated or not one.needs_ratings)]


def _split(command: str) -> list[list[str]]:
    """Return the words of the command that began a run and of those that walked further than asked at first."""
    begun, *later = command.split(f"; {PROGRAM} ")
    return [shlex.split(begun), *(words for words in map(shlex.split, later) if _more_steps(words))]


def _more_steps(words: list[str]) -> str:
    return next((value for flag, value in _pairs(words) if flag == "--more-steps"), "")


def _pairs(words: list[str]) -> list[tuple[str, str]]:
    """Return every option of a command with the word that follows it or is tied to it."""
    pairs = []
    for word, after in zip_longest(words, words[1:], fillvalue=""):
        flag, tied, value = word.partition("=")
        if word.startswith("--"):
            pairs.append((flag, value) if tied else (word, after))
    return pairs


def _data(result: Result, begun: list[str]) -> tuple[list[str], list[str]]:
    """Return the options of the files, which only the recorded command line knows, and notes on them."""
    files = {one.flag: isinstance(one.kind, Flag) for one in DataFiles.declared.values()}
    typed = [
        word for flag, value in _pairs(begun) if flag in files for word in ([flag] if files[flag] else [flag, value])
    ]
    if typed:
        return typed, [PATHS]
    names = [("--data", "RATINGS.csv"), ("--fabrics", "FABRICS.csv")] if result.has_ratings else []
    names += [("--compression", "FORCES.csv")] if result.has_compression else []
    names += [("--afferents", "AFFERENTS.csv")] if result.has_afferents else []
    note = "The run was started in Python, where file names are not recorded: replace the names in capitals by yours."
    return [word for pair in names for word in pair], [note]
