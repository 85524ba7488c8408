"""Fit of one table of a study, as an ordinary run in its directory."""

from __future__ import annotations

import time
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.identity import identity
from softness_bayes.checkpoints.status import Status
from softness_bayes.data import Compression, Experiment
from softness_bayes.errors import LockedError, ResourceError, SoftnessError
from softness_bayes.files.run_files import CHECKPOINT, MANIFEST, POSTERIOR
from softness_bayes.provenance import versions
from softness_bayes.results.request import Request
from softness_bayes.runs.kept import model_of, sample_kept
from softness_bayes.sampler.diagnostics import Verdict

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


class Kept(NamedTuple):
    """Record of a run by the command line, from which `resume` continues it."""

    files: dict[str, Any]
    figures: bool


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
