"""Checkpoint of a run: files of its states, and a manifest that names those of the last one.

The file of a state is written once and never changed; it holds the steps since the file before. The manifest is
replaced last, atomically. Whenever the process is killed, the manifest on disk therefore lists complete files, and
readers need only the manifest. It contains the checksums of these files and of itself, so that damaged, exchanged or
reordered files raise an error.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from softness_bayes.checkpoints.identity import differences
from softness_bayes.checkpoints.manifest import Whole, last_whole, name_of, read_manifest, sealed
from softness_bayes.checkpoints.state_file import digest_of, read_state_file, state_file, state_of
from softness_bayes.checkpoints.status import Status, present_status, status_of
from softness_bayes.checkpoints.vacancy import is_state_file, remove_run, require_vacant
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json
from softness_bayes.files.lock import Lock, require_free
from softness_bayes.files.outputs import require_outputs, write_outputs
from softness_bayes.files.records import to_json
from softness_bayes.files.run_files import CHECKPOINT, FILES, LOCK, MANIFEST, NONFINITE, RUN
from softness_bayes.files.whole import write_whole
from softness_bayes.sampler.chains import RunState
from softness_bayes.sampler.schedule import Schedule
from softness_bayes.sampler.target import TargetDensity

INTERVAL = 2.0
"""Time [s] between two writes."""

MOST_FILES = 64
"""Number of files of a state at which the next one holds all steps.

The files before that one are kept until the next such file: if it is damaged, the run continues from the state before.
"""


class Checkpoint:
    """The checkpoint of one run in its results' directory; a context manager that holds the directory's lock.

    Use `create` for a new run and `open` to continue one. If nothing was saved, leaving the context removes the files
    that it created.

    Parameters
    ----------
    directory
        Directory of the results.
    request
        The settings requested for the run, as JSON values, needed for its continuation.
    manifest
        Manifest of the run to continue; None for a new one.
    salvage
        Whether to use the last intact state if a later one is damaged.
    replace
        Whether a new run may replace an earlier one.
    inputs
        Files that the run reads, which are never replaced.
    """

    def __init__(
        self,
        directory: Path,
        request: Any,
        manifest: dict[str, Any] | None,
        salvage: bool = False,
        replace: bool = False,
        inputs: Iterable[Path] = (),
    ) -> None:
        self.directory, self.request, self._replace, self._inputs = directory, request, replace, tuple(inputs)
        self._home = directory / CHECKPOINT
        self._manifest, self._held = manifest, ExitStack()
        self._description: dict[str, str] = {}
        self._saved: tuple[int, int, int] = (-1, 0, 0)  # phase, stride and number of the stored steps in the files
        self._salvage, self.damage = salvage, ""  # damaged files and the resulting loss, as a sentence
        self._told, self._last = 0, -np.inf
        self._pending: Callable[[], None] | None = None

    @classmethod
    def create(
        cls, directory: str | Path, replace: bool = False, request: Any = None, inputs: Iterable[Path] = ()
    ) -> Checkpoint:
        """Return the checkpoint of a new run; an earlier result is removed when the first state is saved.

        Parameters
        ----------
        directory
            An empty directory or a new one.
        replace
            Whether it may contain an earlier run; only the files of that run are then removed.
        request
            The settings requested for the run, needed for its continuation.
        inputs
            Files that the run reads, which are never removed.

        Raises
        ------
        InputError
            If the directory cannot be written to, or contains something that may not be replaced.
        LockedError
            If another process is running there.
        """
        if Path(directory).is_dir():  # other contents are rejected below
            require_free(Path(directory) / CHECKPOINT / LOCK)
        checkpoint = cls(Path(directory), request, None, False, replace, inputs)
        require_vacant(checkpoint.directory, replace, checkpoint._inputs)
        return checkpoint

    @classmethod
    def open(cls, directory: str | Path, salvage: bool = False) -> Checkpoint:
        """Return the checkpoint of a run to continue.

        Parameters
        ----------
        directory
            Directory of its results.
        salvage
            Whether to go back to the last intact state if a file is damaged, which is then reported in `damage`.
            Damaged files are kept until the next state is written.

        Raises
        ------
        InputError
            If the directory contains no checkpoint, or one of another version; or if the manifest is damaged or, with
            `salvage`, no state is intact.
        LockedError
            With `salvage`, if another process is running there.
        """
        if salvage:
            require_free(Path(directory) / CHECKPOINT / LOCK)  # files that change during reading would look damaged
        manifest, damage = _read(Path(directory), salvage)
        checkpoint = cls(Path(directory), manifest["request"], manifest, salvage)
        checkpoint.damage = damage
        return checkpoint

    def __enter__(self) -> Self:
        made = [place for place in (self._home, *self._home.parents) if not place.exists()]
        with ExitStack() as stack:
            try:
                self._home.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{self.directory}: cannot be created ({error.strerror})") from None
            for place in reversed(made):
                stack.callback(self._remove_unused, place)
            lock = stack.enter_context(Lock(self._home / LOCK))
            stack.callback(self._vanish_unused, lock)
            if self._manifest is None:
                # another run may have started and ended in the meantime
                require_vacant(self.directory, self._replace, self._inputs)
            else:
                self._manifest, self.damage = _read(self.directory, self._salvage)  # as the last holder left it
                require_outputs(self.directory, FILES, RUN)
                if not self.damage:
                    self._tidy()
            self._held = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.leave()

    def leave(self) -> None:
        """Release the directory, and remove files created there if nothing was saved; a second call does nothing."""
        self._held.close()

    def begin(self, description: Mapping[str, str]) -> RunState | None:
        """Return the state from which to continue, or None for a new run.

        Parameters
        ----------
        description
            Settings that affect the draws, by name.

        Raises
        ------
        InputError
            If the settings differ from those at the start of the run, with the differences; if a file is damaged; or if
            JSON cannot store the request of a new run.
        """
        if self._manifest is None:
            self._description = dict(description)
            as_json(self.request, "request")
            return None
        self._description = self._manifest["description"]
        self.require_same(description)
        state = state_of([read_state_file(self._home / name, digest) for name, digest in self._manifest["files"]])
        self._saved = (state.phase, state.stride, state.steps // state.stride)
        self._told = state.nonfinite.count
        return state

    def require_same(self, description: Mapping[str, str]) -> None:
        """Raise an error if settings that affect the draws differ from those of the saved run.

        Raises
        ------
        InputError
            Naming the differences.
        """
        if said := differences(self.description, description):
            raise InputError(
                f"{self.directory}: cannot be continued, because the run was begun with {said}; continue it "
                "with its original options and data, or start a new run in another directory"
            )

    def keep(self, state: RunState, schedule: Schedule, target: TargetDensity) -> None:
        """Write a state, or hold it in memory if the last one was written very recently.

        Parameters
        ----------
        state
            State of the run.
        schedule, target
            Schedule of the run, and the sampled density.

        Raises
        ------
        OSError
            If it cannot be written; the earlier state remains valid.
        """
        self._pending = lambda: self._write(state, schedule, target)
        now = time.monotonic()
        if state.ended or state.phase != self._saved[0] or now - self._last >= INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Write the state held in memory, if not yet written.

        Raises
        ------
        OSError
            As for `keep`.
        """
        if self._pending is not None:
            write, self._pending = self._pending, None
            write()
            self._last = time.monotonic()

    def finish(self) -> None:
        """Record that the results of the saved steps are written."""
        if self._manifest is not None:
            self._replace_manifest({**self._manifest, "written": self._manifest["status"]["steps"]})

    @property
    def description(self) -> Mapping[str, str]:
        """Settings that affect the draws of the saved run, by name; empty before the first state."""
        return {} if self._manifest is None else self._manifest["description"]

    @property
    def status(self) -> Status | None:
        """Status of the saved run; None before the first state."""
        return None if self._manifest is None else status_of(self._manifest, True)

    def _write(self, state: RunState, schedule: Schedule, target: TargetDensity) -> None:
        if self._manifest is None:
            require_vacant(self.directory, self._replace, self._inputs)
            remove_run(self.directory, self._inputs)
        before = self._manifest or {"serial": 0, "files": [], "earlier": [], "written": None}
        files, earlier, stored = before["files"], before["earlier"], self._saved[2]
        if self._saved[:2] != (state.phase, state.stride) or len(files) >= MOST_FILES:
            files, earlier, stored = [], files, 0
        manifest = {
            "serial": before["serial"] + 1,
            "files": files,
            "earlier": earlier,
            "status": to_json(present_status(state, schedule, self.request)),
            "written": before["written"],
            "description": self._description,
            "request": self.request,
        }
        name, content = name_of(manifest["serial"]), state_file(state, stored, manifest)
        try:
            write_whole(self._home / name, content)
            self._replace_manifest({**manifest, "files": [*files, [name, digest_of(content)]]})
            self._saved = (state.phase, state.stride, state.steps // state.stride)
        finally:
            self._tidy()
        if state.nonfinite.count > self._told:
            self._told = state.nonfinite.count
            write_outputs(self.directory, {NONFINITE: _failure_table(state, target)}, RUN)

    def _replace_manifest(self, manifest: dict[str, Any]) -> None:
        path, content = self._home / MANIFEST, sealed(manifest)
        try:
            write_whole(path, content)
        finally:  # an interrupt may come after the file is replaced, when this state is saved
            if path.is_file() and path.read_bytes() == content:
                self._manifest = manifest

    def _tidy(self) -> None:
        """Remove files that are not in the manifest: leftovers of interrupted writes, and replaced files.

        The manifest on disk is used, because after an error it may be newer than the one in memory.
        """
        named: set[str] = set()
        if (self._home / MANIFEST).exists():
            manifest = read_manifest(self.directory)
            named = {name for name, _ in (*manifest["files"], *manifest["earlier"])}
        for path in self._home.glob("*"):
            if is_state_file(path) and path.name not in named:
                with suppress(OSError):
                    path.unlink()

    def _remove_unused(self, place: Path) -> None:
        if self._manifest is None:
            with suppress(OSError):
                place.rmdir()

    def _vanish_unused(self, lock: Lock) -> None:
        if self._manifest is None and not (self._home / MANIFEST).exists():
            self._tidy()  # of a first state whose manifest was not written any more
            lock.vanish()


def _read(directory: Path, salvage: bool) -> Whole:
    """Return the data from which to continue: the files in the manifest, or the last intact state."""
    return last_whole(directory) if salvage else Whole(read_manifest(directory), "")


def _failure_table(state: RunState, target: TargetDensity) -> str:
    """Return the points at which the density could not be computed, in natural units, with the stage that failed."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["stage", *target.names])
    for failure in state.nonfinite.failures:
        writer.writerow([failure.stage, *map(repr, target.natural(np.array(failure.point)).tolist())])
    return buffer.getvalue()
