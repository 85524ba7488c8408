"""Common parts of the commands about runs: reading of results, their cautions, the command line of a record."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.errors import InputError
from softness_bayes.files.command_line import portable

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from softness_bayes.data import Fabrics
    from softness_bayes.results.result import Result


def command_line() -> str:
    """Return the command line, quoted for a shell, without absolute paths."""
    return shlex.join(["softness-bayes", *(portable(word, Path.cwd()) for word in sys.argv[1:])])


@contextmanager
def executor_of(dask: str | None, shared: Path | None = None) -> Iterator[Executor | None]:
    """Connect to the requested cluster, if any; tasks write to the shared directory, if all workers see it."""
    if dask is None:
        yield None
        return
    from softness_bayes.runs.cluster import cluster

    with cluster(dask, shared) as executor:
        if not executor.shares_files:
            click.echo(
                f"note: {dask}: not all workers can read {shared}; their tasks return their files at their end, so the "
                "work of a killed one is lost",
                err=True,
            )
        yield executor


@contextmanager
def reading(*directories: Path, trust_code: bool) -> Iterator[list[Result]]:
    """Read results for a command; missing data in them raise an input error.

    Raises
    ------
    InputError
        If a result cannot be read, or lacks data that the command needs.
    """
    from softness_bayes.results.result import Result

    results = [Result.load(directory, trust_code=trust_code) for directory in directories]
    try:
        yield results
    except KeyError as error:
        if isinstance(error, InputError):
            raise
        sources = " or ".join(result.source for result in results)
        raise InputError(f"{sources}: lacks {error}, which every run of this version has") from error


@contextmanager
def rated_run(directory: Path, trust_code: bool) -> Iterator[Result]:
    """Read the result of a run with ratings, and warn if its chains have not converged.

    Raises
    ------
    InputError
        If there is no such run, or it had no ratings.
    """
    with reading(directory, trust_code=trust_code) as (result,):
        warn_of_unconverged(result)
        if not result.has_ratings:
            raise InputError(f"{directory}: a run without ratings cannot predict ratings")
        yield result


def warn_of_cautions(result: Result, fabrics: Fabrics | None) -> None:
    """Warn before predictions of a run are carried to other cloth than was rated (`results.rating_table.cautions`)."""
    from softness_bayes.results.rating_table import cautions

    for said in cautions(result, fabrics):
        click.echo(f"CAUTION: {said}", err=True)


def warn_of_unconverged(result: Result) -> None:
    """Warn if the chains of a run have not converged, so that answers from its draws are preliminary."""
    if not result.provenance.ending.converged:
        kind = "a first look (--quick), whose chains have" if result.is_first_look else "the chains of this run have"
        click.echo(f"warning: {result.source}: {kind} not converged; all numbers below are preliminary", err=True)
