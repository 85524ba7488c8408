"""Fits of a study on workers that do not share its directory: each task returns the files of its run."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, NamedTuple

from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.status import read_status
from softness_bayes.data import Compression, Experiment
from softness_bayes.errors import InputError, SoftnessError, quoted
from softness_bayes.files.lock import Lock
from softness_bayes.files.run_files import CHECKPOINT, LOCK, MANIFEST, MANIFEST_COPY, POSTERIOR
from softness_bayes.files.whole import is_part, write_whole
from softness_bayes.results.request import Request
from softness_bayes.runs.table_fit import REFUSED, UNCONVERGED, Kept, TableOutcome, final_verdict, fit_table
from softness_bayes.sampler.workers import Workers

SLICE = 300.0
"""Longest time [s] that a task samples before it returns its state, which another task continues.

A killed worker, or a killed client, loses at most the tasks that were running.
"""

_LAST = (f"{CHECKPOINT}/{MANIFEST}", f"{CHECKPOINT}/{MANIFEST_COPY}")  # written last: it names the valid files


class SentFiles(NamedTuple):
    """Files of a run, as a task receives them."""

    content: bytes
    """Archive of `packed`."""


class RunFiles:
    """Files of a run, read only when a task is sent, so that those of waiting tasks take no memory.

    Parameters
    ----------
    directory
        Directory of the run.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    @property
    def content(self) -> bytes:
        """Archive of the directory (see `packed`)."""
        return packed(self._directory)

    def __reduce__(self) -> tuple[type[SentFiles], tuple[bytes]]:
        return SentFiles, (self.content,)


class Returned(NamedTuple):
    """Result of a task."""

    outcome: TableOutcome
    files: bytes
    """Archive of the run's directory; empty if nothing was saved."""
    seconds: float
    """Time spent by this task and those that it continued."""
    ended: bool
    """False if another task must continue the run."""


def fits_apart(
    workers: Workers,
    request: Request,
    tables: Mapping[str, Experiment | Compression],
    runs: Path,
    kept: Mapping[str, Kept],
) -> Iterator[TableOutcome]:
    """Fit tables on workers without a common directory; yield the outcome of each as it ends.

    Parameters
    ----------
    workers
        Workers with the request as their resident.
    request
        Choices of the model, and how long each table is run.
    tables
        Data by name.
    runs
        Directory of the runs, in which this process writes what the tasks return.
    kept
        Record of the command line for each run.
    """
    tasks = []
    for name, data in tables.items():
        home = runs / name
        try:
            _require_writable(home)
        except SoftnessError as error:
            yield TableOutcome(name, REFUSED, str(error))
            continue
        if _has_ended(home, request):
            yield fit_table(request, name, data, str(home), kept.get(name), False)
        else:
            tasks.append((name, data, str(home), kept.get(name), RunFiles(home), 0.0))
    follow = partial(_next_task, runs, tables, kept)
    for one in workers.as_finished(fit_slice, tasks, follow):
        if one.ended:
            yield one.outcome


def fit_slice(
    request: Request,
    name: str,
    data: Experiment | Compression,
    directory: str,
    kept: Kept | None,
    files: RunFiles | SentFiles,
    before: float,
) -> Returned:
    """Fit one table for at most `SLICE` seconds in a temporary directory, from the files of its run.

    Parameters
    ----------
    request, name, data, kept
        As for `table_fit.fit_table`.
    directory
        Directory of the run on the client, for messages.
    files
        Files of the run to continue, if it has begun.
    before
        Time that earlier tasks have spent on it [s].
    """
    left = request.run.max_seconds - before
    run = replace(request.run, max_seconds=min(left, SLICE))
    with tempfile.TemporaryDirectory() as place:
        home = Path(place) / name
        unpack(files.content, home)
        outcome = fit_table(request._replace(run=run), name, data, str(home), kept, False)
        outcome = outcome._replace(said=outcome.said.replace(str(home), directory))
        ended = outcome.outcome != UNCONVERGED or left <= SLICE or _at_the_limit(home)
        return Returned(outcome, packed(home), before + SLICE, ended)


def _has_ended(home: Path, request: Request) -> bool:
    """Return whether a run needs no further steps, so that its outcome can be read here."""
    if not (home / CHECKPOINT / MANIFEST).exists() or not (home / POSTERIOR).is_file():
        return False
    status = read_status(home)
    return status.written and final_verdict(status, request.run.max_steps) is not None


def _at_the_limit(home: Path) -> bool:
    """Return whether a run has reached its largest number of steps."""
    status = read_status(home)
    return not status.piloting and status.steps >= status.max_steps


def _next_task(
    runs: Path, tables: Mapping[str, Experiment | Compression], kept: Mapping[str, Kept], one: Returned
) -> tuple[Any, ...] | None:
    """Write the files that a task has returned; return the task that continues it, if any."""
    name = one.outcome.table
    if one.files:
        unpack(one.files, runs / name)
    if one.ended:
        return None
    return name, tables[name], str(runs / name), kept.get(name), RunFiles(runs / name), one.seconds


def _require_writable(directory: Path) -> None:
    """Raise an error if a run cannot be written to a directory, or another process is running there."""
    begun = (directory / CHECKPOINT / MANIFEST).exists()
    with Checkpoint.open(directory) if begun else Checkpoint.create(directory):
        pass


def packed(directory: Path) -> bytes:
    """Return an archive of the files of a run, without its lock; empty if nothing was saved."""
    if not (directory / CHECKPOINT / MANIFEST).exists():
        return b""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for path in sorted(directory.rglob("*")):
            if path.is_file() and not path.is_symlink() and path.name != LOCK and not is_part(path):
                archive.writestr(zipfile.ZipInfo(path.relative_to(directory).as_posix()), path.read_bytes())
    return content.getvalue()


def unpack(files: bytes, directory: Path) -> None:
    """Write the files of an archive; whenever the process is killed, the directory holds a run that can be continued.

    Parameters
    ----------
    files
        An archive of `packed`, or nothing.
    directory
        Directory of the run; files of its checkpoint that are not in the archive are removed.

    Raises
    ------
    InputError
        If a name in the archive is not that of a file below the directory; nothing is then written.
    """
    if not files:
        return
    home = directory / CHECKPOINT
    with zipfile.ZipFile(io.BytesIO(files)) as archive:
        names = sorted(archive.namelist(), key=lambda name: (name in _LAST, name))
        for name in names:
            if not _is_below(name):
                raise InputError(f"{directory}: a worker returned a file named {quoted(name)}, expected one below it")
        home.mkdir(parents=True, exist_ok=True)
        with Lock(home / LOCK):
            _write_all(archive, names, directory)


def _is_below(name: str) -> bool:
    """Return whether a name in an archive stays below the directory of the archive, on any system."""
    path, elsewhere = PurePosixPath(name), PureWindowsPath(name)
    return bool(path.parts) and ".." not in elsewhere.parts and not (path.is_absolute() or elsewhere.anchor)


def _write_all(archive: zipfile.ZipFile, names: Sequence[str], directory: Path) -> None:
    for name in names:
        (directory / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(directory / name, archive.read(name))
    for path in (directory / CHECKPOINT).iterdir():
        if path.is_file() and path.name != LOCK and f"{CHECKPOINT}/{path.name}" not in names:
            path.unlink()
