"""Fits of the tables of a study: ordinary runs, in their directories or on workers that do not share these.

A task on a worker that does not share the directory runs in a temporary one, and returns the files of its run.
"""

from __future__ import annotations

import io
import tempfile
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, NamedTuple

import numpy as np

from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.identity import identity
from softness_bayes.checkpoints.status import Status, read_status
from softness_bayes.data import Compression, Experiment
from softness_bayes.errors import InputError, LockedError, ResourceError, SoftnessError, quoted
from softness_bayes.files.lock import Lock
from softness_bayes.files.run_files import CHECKPOINT, LOCK, MANIFEST, MANIFEST_COPY, POSTERIOR
from softness_bayes.files.whole import is_part, write_whole
from softness_bayes.provenance import versions
from softness_bayes.results.request import Request
from softness_bayes.runs.run import model_of, sample_kept
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.workers import Workers, shares_files

CONVERGED, UNCONVERGED, REFUSED = "converged", "not converged", "refused"
"""Possible outcomes of a table."""

SLICE = 300.0
"""Longest time [s] that a task samples before it returns the state of its run, which another task continues.

A killed worker, or a killed client, loses at most the tasks that were running.
"""

WAIT = 1.0
"""Time [s] between two checks of a directory in use by another process."""


class TableOutcome(NamedTuple):
    """Outcome of one table."""

    table: str
    outcome: str
    said: str
    """The verdict on convergence, or the reason why the table was rejected."""


class Kept(NamedTuple):
    """Record of a run by the command line, from which `resume` continues it."""

    files: dict[str, Any]
    figures: bool


def fit_tables(
    workers: Workers,
    request: Request,
    tables: Mapping[str, Experiment | Compression],
    runs: Path,
    kept: Mapping[str, Kept],
    executor: Executor | None,
) -> Iterator[TableOutcome]:
    """Fit tables, and yield the outcome of each as it ends.

    Parameters
    ----------
    workers
        Workers with the request as their resident.
    request
        Choices of the model, and how long each table is run.
    tables
        Data by name.
    runs
        Directory of the runs.
    kept
        Record of the command line for each run.
    executor
        Executor of the workers, if there is one.
    """
    if shares_files(executor):
        home = runs if executor is None else runs.resolve()
        tasks = [(name, data, str(home / name), kept.get(name), executor is not None) for name, data in tables.items()]
        yield from workers.as_finished(fit_table, tasks)
        return
    waiting = []
    for name in tables:
        try:
            if _needs_steps(runs / name, request):
                waiting.append(name)
            else:
                yield fit_table(request, name, tables[name], str(runs / name), kept.get(name), False)
        except SoftnessError as error:
            yield TableOutcome(name, REFUSED, str(error))
    before = 0.0
    while waiting:
        sent = [(name, tables[name], str(runs / name), kept.get(name), packed(runs / name), before) for name in waiting]
        waiting, before = [], before + SLICE
        for outcome, files, ended in workers.as_finished(fit_slice, sent):
            unpack(files, runs / outcome.table)
            if ended:
                yield outcome
            else:
                waiting.append(outcome.table)


def fit_table(
    request: Request, name: str, data: Experiment | Compression, directory: str, kept: Kept | None, patient: bool
) -> TableOutcome:
    """Fit one table in its directory, continuing an existing run; errors of the table become its outcome.

    If `patient`, wait for another process in that directory to end: on a cluster it may be a task that is still running
    although its client was killed.
    """
    while True:
        try:
            return _fit(request, name, data, Path(directory), kept)
        except ResourceError:
            raise
        except LockedError as error:
            if not patient:
                return TableOutcome(name, REFUSED, str(error))
            time.sleep(WAIT)
        except SoftnessError as error:
            return TableOutcome(name, REFUSED, str(error))


def _fit(
    request: Request, name: str, data: Experiment | Compression, directory: Path, kept: Kept | None
) -> TableOutcome:
    model = model_of(data, request.model)
    run = replace(request.run, seed=seed_of(request.run.seed, name), processes=1)
    asked = Request(model.options, run)
    begun = (directory / CHECKPOINT / MANIFEST).exists()
    with Checkpoint.open(directory) if begun else Checkpoint.create(directory) as checkpoint:
        status = checkpoint.status
        if status is not None and status.written and (directory / POSTERIOR).is_file():
            checkpoint.require_same(identity(data, model.posterior, run.settings, asked.choices()))
            if (verdict := final_verdict(status, run.max_steps)) is not None:
                return TableOutcome(name, CONVERGED if verdict.converged else UNCONVERGED, verdict.sentence())
        if kept is not None:
            record = {"files": kept.files, "options": asked.record(), "figures": kept.figures}
            checkpoint.request = {**record, "versions": versions()}
        figures = () if kept is not None and kept.figures else None
        ending = sample_kept(checkpoint, model, run, figures).provenance.ending
    return TableOutcome(name, CONVERGED if ending.converged else UNCONVERGED, ending.verdict)


def final_verdict(status: Status, max_steps: int) -> Verdict | None:
    """Return the verdict on a run that needs no further steps; None for others."""
    verdict = status.verdict
    return verdict if verdict is not None and (verdict.converged or status.steps >= max_steps) else None


def seed_of(seed: int, table: str) -> int:
    """Return the seed of one table's run, which depends only on the study's seed and the table's name."""
    return int(np.random.SeedSequence((seed, zlib.crc32(table.encode()))).generate_state(1)[0])


def fit_slice(
    request: Request,
    name: str,
    data: Experiment | Compression,
    directory: str,
    kept: Kept | None,
    files: bytes,
    before: float,
) -> tuple[TableOutcome, bytes, bool]:
    """Fit one table for at most `SLICE` seconds in a temporary directory, from the files of its run.

    Parameters
    ----------
    request, name, data, kept
        As for `fit_table`.
    directory
        Directory of the run on the client, for messages.
    files
        Archive of the files of the run to continue (`packed`).
    before
        Time that earlier tasks have spent on it [s].

    Returns
    -------
    tuple
        The outcome, an archive of the files, and False if another task must continue the run.
    """
    left = request.run.max_seconds - before
    run = replace(request.run, max_seconds=min(left, SLICE))
    with tempfile.TemporaryDirectory() as place:
        home = Path(place) / name
        unpack(files, home)
        outcome = fit_table(request._replace(run=run), name, data, str(home), kept, False)
        outcome = outcome._replace(said=outcome.said.replace(str(home), directory))
        ended = outcome.outcome != UNCONVERGED or left <= SLICE
        if not ended:
            status = read_status(home)
            ended = not status.piloting and status.steps >= status.max_steps
        return outcome, packed(home), ended


def _needs_steps(home: Path, request: Request) -> bool:
    """Return whether a run needs further steps; raise an error if it cannot be written to its directory."""
    begun = (home / CHECKPOINT / MANIFEST).exists()
    with Checkpoint.open(home) if begun else Checkpoint.create(home):
        pass
    if not begun or not (home / POSTERIOR).is_file():
        return True
    status = read_status(home)
    return not status.written or final_verdict(status, request.run.max_steps) is None


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
        last = (f"{CHECKPOINT}/{MANIFEST}", f"{CHECKPOINT}/{MANIFEST_COPY}")  # they name the valid files
        names = sorted(archive.namelist(), key=lambda name: (name in last, name))
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
