"""Status of a run, read from the manifest of its checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from softness_bayes.checkpoints.manifest import read_manifest
from softness_bayes.files.lock import is_held
from softness_bayes.files.run_files import CHECKPOINT, LOCK, MANIFEST
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.serial import verdict_of


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


def _quick(request: Any) -> bool:
    """Return whether the settings of a run, from the command line or Python, are those of a first look."""
    options = request.get("options") if isinstance(request, dict) else None
    return isinstance(options, dict) and bool(options.get("quick"))


def status_of(manifest: Mapping[str, Any], running: bool) -> Status:
    """Return the status of a run from its manifest."""
    state, piloting = manifest["state"], manifest["piloting"]
    return Status(
        running=running,
        piloting=piloting,
        steps=0 if piloting else state["steps"],
        missing=manifest["missing"],
        seconds=state["seconds"],
        failures=state["failures"],
        ended=state["ended"],
        written=not piloting and manifest["written"] == state["steps"],
        max_steps=manifest["max_steps"],
        verdict=verdict_of(state["verdict"]),
        quick=_quick(manifest.get("request")),
    )
