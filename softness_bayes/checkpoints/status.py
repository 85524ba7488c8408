"""Status of a run, read from the manifest of its checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from softness_bayes.checkpoints.manifest import read_manifest
from softness_bayes.files.lock import is_held
from softness_bayes.files.records import from_json
from softness_bayes.files.run_files import CHECKPOINT, LOCK, MANIFEST
from softness_bayes.sampler.chains import RunState
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.schedule import Schedule


class Status(NamedTuple):
    """Status of a run, read without interfering with it."""

    running: bool
    """True if a process is using the directory."""
    piloting: bool
    """True if the run is still in its pilot stage."""
    steps: int
    """Number of steps in the present phase."""
    missing: int
    """Estimated number of remaining steps."""
    seconds: float
    """Time spent."""
    failures: int
    """Points at which the density could not be computed."""
    ended: bool
    """True if the run has converged or reached a limit."""
    written: bool
    """True if the results next to the checkpoint are those of these steps."""
    max_steps: int
    """Largest number of steps, in whole strides."""
    verdict: Verdict | None
    """The last convergence check."""
    quick: bool = False
    """True if it is a first look started from the command line."""
    phase: int = 0
    """Number of completed stages of the pilot run, including runs that were too slow."""


def read_status(directory: str | Path) -> Status:
    """Return the status of a run, without any effect on the process that runs it.

    Raises
    ------
    InputError
        If the directory contains no checkpoint, or one of another version.
    """
    home = Path(directory) / CHECKPOINT
    running = is_held(home / LOCK)
    if running and not (home / MANIFEST).exists():  # it is still searching for starting points
        return Status(True, True, 0, 0, 0.0, 0, False, False, 0, None)
    return status_of(read_manifest(Path(directory)), running)


def status_of(manifest: Mapping[str, Any], running: bool) -> Status:
    """Return the status of a run from its manifest."""
    status: Status = from_json(Status, manifest["status"])
    written = not status.piloting and manifest["written"] == status.steps
    return status._replace(running=running, written=written)


def present_status(state: RunState, schedule: Schedule, request: Any) -> Status:
    """Return the status of a run that has reached a state, before its results are written.

    Parameters
    ----------
    state, schedule
        The state, and the schedule of the run.
    request
        The settings requested for the run, from the command line or Python.
    """
    piloting = schedule.in_pilot(state)
    options = request.get("options") if isinstance(request, dict) else None
    return Status(
        running=True,
        piloting=piloting,
        steps=0 if piloting else state.steps,
        missing=schedule.missing(state),
        seconds=state.seconds,
        failures=state.nonfinite.count,
        ended=state.ended,
        written=False,
        max_steps=schedule.max_steps // state.stride * state.stride,
        verdict=state.verdict,
        quick=isinstance(options, dict) and bool(options.get("quick")),
        phase=state.phase,
    )
