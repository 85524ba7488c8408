"""Fits of the tables of a study: ordinary runs, in their directories or on workers that do not share these.

A task on a worker that does not share the directory runs in a temporary one, and returns the files of its run.
"""

from __future__ import annotations

import io
import tempfile
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from softness_bayes.base.errors import LockedError, ResourceError, SoftnessError
from softness_bayes.base.files.lock import Lock
from softness_bayes.base.files.run_files import CHECKPOINT, LOCK, POSTERIOR
from softness_bayes.base.files.whole import is_part, write_whole
from softness_bayes.checking.provenance import versions
from softness_bayes.data import Afferents, Compression, Experiment, Measurements
from softness_bayes.results.run_options import Request
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.identity import identity
from softness_bayes.runs.run import model_of, sample_kept
from softness_bayes.runs.saved import Status, read_status, saved_states
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.workers import Workers, shares_files

CONVERGED, UNCONVERGED, REFUSED = "converged", "not converged", "refused"
"""Possible outcomes of a table."""

WAIT = 1.0
"""Time [s] between two checks of a directory in use by another process."""


class TableOutcome(NamedTuple):
    """Outcome of one table."""

    table: str
    outcome: str
    said: str
    """The verdict on convergence, or the reason why the table was rejected."""


class Fit(NamedTuple):
    """Task of one table."""

    table: str
    """Its name."""
    data: Experiment | Compression | Afferents | Measurements
    directory: str
    """Directory of the run on the client."""
    kept: Mapping[str, Any] | None
    """Its files, and whether it has figures, as `resume` reads them; None for a run from Python."""
    patient: bool = False
    """True to wait for another process in the directory to end: on a cluster it may be a task that is still running
    although its client was killed."""
    files: bytes | None = None
    """Archive of the files of the run (`packed`), for a worker that does not share the directory."""


def fit_tables(
    workers: Workers,
    request: Request,
    tables: Mapping[str, Experiment | Compression | Afferents | Measurements],
    runs: Path,
    kept: Mapping[str, Mapping[str, Any]],
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
        As for `study`.
    executor
        Executor of the workers, if there is one.
    """
    tasks = []
    home = runs if executor is None else runs.resolve()
    for name, data in tables.items():
        fit = Fit(name, data, str(home / name), kept.get(name), executor is not None and shares_files(executor))
        if not shares_files(executor):
            try:
                if not _needs_steps(home / name, request):
                    yield fit_table(request, fit)[0]
                    continue
                fit = fit._replace(files=packed(home / name))
            except SoftnessError as error:
                yield TableOutcome(name, REFUSED, str(error))
                continue
        tasks.append((fit,))
    for outcome, files in workers.as_finished(fit_table, tasks):
        unpack(files, runs / outcome.table)
        yield outcome


def fit_table(request: Request, fit: Fit) -> tuple[TableOutcome, bytes]:
    """Fit one table, continuing an existing run; errors of the table become its outcome.

    Returns
    -------
    tuple
        The outcome, and the archive of the files if the worker does not share the directory.
    """
    if fit.files is None:
        return _outcome(request, fit, Path(fit.directory)), b""
    with tempfile.TemporaryDirectory() as place:
        home = Path(place) / fit.table
        unpack(fit.files, home)
        outcome = _outcome(request, fit, home)
        return outcome._replace(said=outcome.said.replace(str(home), fit.directory)), packed(home)


def _outcome(request: Request, fit: Fit, directory: Path) -> TableOutcome:
    while True:
        try:
            return _fitted(request, fit, directory)
        except ResourceError:
            raise
        except SoftnessError as error:
            if not (fit.patient and isinstance(error, LockedError)):
                return TableOutcome(fit.table, REFUSED, str(error))
            time.sleep(WAIT)


def _fitted(request: Request, fit: Fit, directory: Path) -> TableOutcome:
    data = fit.data if isinstance(fit.data, Experiment) else Measurements.of(fit.data)
    model = model_of(data, request.model)
    run = replace(request.run, seed=seed_of(request.run.seed, fit.table), processes=1)
    asked = Request(model.options, run)
    with _checkpoint(directory) as checkpoint:
        status = checkpoint.status
        if status is not None and status.written and (directory / POSTERIOR).is_file():
            checkpoint.require_same(identity(data, model.posterior, run.settings, asked.choices()))
            if (verdict := final_verdict(status, run.max_steps)) is not None:
                return TableOutcome(fit.table, CONVERGED if verdict.converged else UNCONVERGED, verdict.sentence())
        if fit.kept is not None:
            checkpoint.request = {**fit.kept, "options": asked.record(), "versions": versions()}
        figures = () if fit.kept is not None and fit.kept["figures"] else None
        ending = sample_kept(checkpoint, model, run, figures).provenance.ending
    return TableOutcome(fit.table, CONVERGED if ending.converged else UNCONVERGED, ending.verdict)


def _checkpoint(directory: Path) -> Checkpoint:
    """Return the checkpoint of a run to continue, or of a new one."""
    return Checkpoint.open(directory) if saved_states(directory) else Checkpoint.create(directory)


def final_verdict(status: Status, max_steps: int) -> Verdict | None:
    """Return the verdict on a run that needs no further steps; None for others."""
    verdict = status.verdict
    return verdict if verdict is not None and (verdict.converged or status.steps >= max_steps) else None


def seed_of(seed: int, table: str) -> int:
    """Return the seed of one table's run, which depends only on the study's seed and the table's name."""
    return int(np.random.SeedSequence((seed, zlib.crc32(table.encode()))).generate_state(1)[0])


def _needs_steps(home: Path, request: Request) -> bool:
    """Return whether a run needs further steps; raise an error if it cannot be written to its directory."""
    with _checkpoint(home):
        pass
    if not saved_states(home) or not (home / POSTERIOR).is_file():
        return True
    status = read_status(home)
    return not status.written or final_verdict(status, request.run.max_steps) is None


def packed(directory: Path) -> bytes:
    """Return an archive of the files of a run, without its lock; empty if nothing was saved."""
    if not saved_states(directory):
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
        Directory of the run.
    """
    if not files:
        return
    (directory / CHECKPOINT).mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(io.BytesIO(files)) as archive, Lock(directory / CHECKPOINT / LOCK):
        # states come last, in order: the newest says that the results beside it are written
        for name in sorted(archive.namelist(), key=lambda name: (Path(name).parent.name == CHECKPOINT, name)):
            (directory / name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(directory / name, archive.read(name))
