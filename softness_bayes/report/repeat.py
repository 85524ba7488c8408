"""Commands to repeat a run, derived from the provenance of its result."""

from __future__ import annotations

import math
import shlex
from itertools import zip_longest
from typing import NamedTuple

from softness_bayes.files.command_line import storable
from softness_bayes.likelihood.scales import name_of_scale
from softness_bayes.model.fingers import values_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.fabric_moduli import UNKNOWN_MODULUS
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.touch.readings import MENDED

PROGRAM = "softness-bayes"

DATA_FLAGS = (
    "--data",
    "--fabrics",
    "--compression",
    "--column",
    "--indentation-mm",
    "--force-n",
    "--decimal",
    "--round-load",
)
"""Options of `sample` about the files of the data, which only the recorded command line knows."""

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
    found, (options, run) = result.attributes, Request.of(result)
    begun, *continued = _split(run.command)
    data, notes = _data(result, begun)
    words = [PROGRAM, "sample", *data, *_model(options)]
    words += _rating(options, run.exact_reweight) if result.has_ratings else []
    steps = run.max_steps
    if not found["converged"] and math.isfinite(run.max_seconds):
        steps = int(found["steps"])
        notes.append(f"The run ended at its time limit; --max-steps {steps} ends it at the same step.")
    if options.kept_accuracy is not None:
        words += ["--accuracy", f"{options.kept_accuracy:g}"]
    elif result.has_ratings:
        notes.append(f"The run was made in Python, with a given resolution: {options.discretisation}.")
    words += ["--quick"] if run.quick else []
    words += ["--seed", str(run.seed), "--max-steps", str(steps), "--out", AGAIN]
    more = [shlex.join([PROGRAM, "resume", AGAIN, "--more-steps", count]) for count in map(_more_steps, continued)]
    notes.append(
        "The draws are the same only with the same files (compare their digests) and versions; both are listed above."
    )
    return Repetition((storable(shlex.join(words)), *more), tuple(notes))


def _split(command: str) -> list[list[str]]:
    """Return the words of the command that began a run and of those that walked further than asked at first."""
    begun, *later = command.split(f"; {PROGRAM} ")
    return [shlex.split(begun), *(words for words in map(shlex.split, later) if _more_steps(words))]


def _more_steps(words: list[str]) -> str:
    return next((value for flag, value in _pairs(words) if flag == "--more-steps"), "")


def _pairs(words: list[str]) -> list[tuple[str, str]]:
    """Return every option of a command with the word that follows it or is tied to it."""
    found = []
    for word, after in zip_longest(words, words[1:], fillvalue=""):
        flag, tied, value = word.partition("=")
        if word.startswith("--"):
            found.append((flag, value) if tied else (word, after))
    return found


def _data(result: Result, begun: list[str]) -> tuple[list[str], list[str]]:
    """Return the options that name the data, and notes on them."""
    typed = [word for flag, value in _pairs(begun) if flag in DATA_FLAGS for word in (flag, value)]
    typed += [flag for flag in ("--drop-zeros", "--wide") if flag in begun]
    if typed:
        return typed, [PATHS]
    names = [("--data", "RATINGS.csv"), ("--fabrics", "FABRICS.csv")] if result.has_ratings else []
    names += [("--compression", "FORCES.csv")] if result.has_compression else []
    note = "The run was started in Python, where file names are not recorded: replace the names in capitals by yours."
    return [word for pair in names for word in pair], [note]


def _model(options: ModelOptions) -> list[str]:
    """Return the options of every run's model: readings, finger, priors, held parameters."""
    words = ["--readings", "mended"]
    for place, name in options.readings.names.items():
        if name != MENDED.names[place]:
            words += ["--reading", f"{place}={name}"]
    for name, number in values_of(options.finger).items():
        words += ["--finger", f"{name}={number!r}"]
    words += ["--individual", ",".join(options.individual)] if options.individual else []
    words += [] if options.modulus_cv is None else ["--modulus-cv", repr(float(options.modulus_cv))]
    words += [] if options.unknown_modulus == UNKNOWN_MODULUS else ["--unknown-modulus", str(options.unknown_modulus)]
    words += [] if options.load_cv is None else ["--load-cv", repr(float(options.load_cv))]
    shared = options.shared_load_cv
    words += [] if shared is None else ["--shared-load-cv", repr(float(shared))]
    words += ["--priors", options.prior_set]
    for name, prior in options.priors.items():
        words += ["--prior", f"{name}={prior}"]
    for name, value in options.fix.items():
        words += ["--fix", f"{name}={float(value)!r}"]
    return words


def _rating(options: ModelOptions, exact_reweight: bool) -> list[str]:
    """Return the options that only a run on ratings has."""
    direction = options.direction.name if options.direction else "auto"
    words = ["--ratings", name_of_scale(options.scale), "--direction", direction]
    words += ["--errors", options.errors.name] if options.errors else []
    words += [] if options.resolution is None else ["--resolution", repr(float(options.resolution))]
    words += [] if options.n_categories is None else ["--categories", str(options.n_categories)]
    words += [] if options.slider_ends == (0.0, 1.0) else ["--slider", ",".join(map(repr, options.slider_ends))]
    words += ["--noise", repr(float(options.noise))] if options.noise else []
    return [*words, *(["--exact-reweight"] if exact_reweight else [])]
