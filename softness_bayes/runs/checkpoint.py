"""Checkpoint of a run: its states are saved while it goes on, and a killed or ended run continues from the last one."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pandas as pd

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.lock import Lock, require_free
from softness_bayes.base.files.outputs import (
    Survey,
    make,
    remove,
    require_outputs,
    survey,
    told,
    unmake,
    write_outputs,
)
from softness_bayes.base.files.records import as_json
from softness_bayes.base.files.run_files import CHECKPOINT, FILES, LOCK, NONFINITE, RUN
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.files.whole import is_part, write_whole
from softness_bayes.runs import saved
from softness_bayes.runs.identity import differences
from softness_bayes.sampler.chains import RunState
from softness_bayes.sampler.sampling import Settings
from softness_bayes.sampler.target import TargetDensity


class Checkpoint:
    """The checkpoint of one run in its results' directory; a context manager that holds the directory's lock.

    Use `create` for a new run and `open` to continue one. If nothing was saved, leaving the context removes the files
    that it created.

    Parameters
    ----------
    directory
        Directory of the results.
    salvage
        Whether to use the last intact state if a later one is damaged.
    replace
        Whether a new run may replace an earlier one.
    inputs
        Files that the run reads, which are never replaced.

    Attributes
    ----------
    request
        The settings requested for the run, as JSON values, needed for its continuation; None until they are set.
    """

    def __init__(
        self,
        directory: Path,
        salvage: bool = False,
        replace: bool = False,
        inputs: Iterable[Path] = (),
    ) -> None:
        self.directory, self._replace, self._inputs = directory, replace, tuple(inputs)
        self.request: Any = None
        self._home, self._held = directory / CHECKPOINT, ExitStack()
        self._record: saved.Record | None = None
        self._state: RunState | None = None
        self._salvage, self.damage = salvage, ""  # damaged files and the resulting loss, as a sentence
        self._description: dict[str, str] = {}
        self._kept: tuple[int, ...] = ()  # numbers of the last two files that are whole

    @classmethod
    def create(cls, directory: str | Path, replace: bool = False, inputs: Iterable[Path] = ()) -> Checkpoint:
        """Return the checkpoint of a new run; an earlier result is removed when the first state is saved.

        Parameters
        ----------
        directory
            An empty directory or a new one.
        replace
            Whether it may contain an earlier run; only the files of that run are then removed.
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
        checkpoint = cls(Path(directory), False, replace, inputs)
        checkpoint._require_vacant()
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
            If the directory contains no checkpoint, or one of another version; or if a file is damaged or, with
            `salvage`, no state is intact.
        LockedError
            With `salvage`, if another process is running there.
        """
        if salvage:
            require_free(Path(directory) / CHECKPOINT / LOCK)  # files that change during reading would look damaged
        checkpoint = cls(Path(directory), salvage=salvage)
        record = checkpoint._read()
        checkpoint.request = record.request
        return checkpoint

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            try:
                made = make(self._home)
            except OSError as error:
                raise InputError(f"{self.directory}: cannot be created ({error.strerror})") from None
            stack.callback(lambda: unmake(made if self._record is None else ()))
            lock = stack.enter_context(Lock(self._home / LOCK))
            stack.callback(self._vanish_unused, lock)
            if self._record is None:
                # another run may have started and ended in the meantime
                self._require_vacant()
            else:
                self._read()  # as the last holder left it
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
            If the settings differ from those at the start of the run, with the differences; or if JSON cannot store
            the request of a new run.
        """
        if self._record is None:
            as_json(self.request, "request")
        else:
            self.require_same(description)
        self._description = dict(description)
        return self._state

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

    def keep(self, state: RunState, schedule: Settings, target: TargetDensity) -> None:
        """Write a state.

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
        before = self._state
        if before is None:
            self._require_vacant()
            remove(_earlier_run(self.directory, self._inputs))
        self._store(state, saved.Status.of(state, schedule, self.request))
        if state.nonfinite.count > (0 if before is None else before.nonfinite.count):
            # the points in natural units, with the stage that failed
            failures = state.nonfinite.failures
            points = target.natural(np.array([one.point for one in failures]))
            table = pd.DataFrame(points, pd.Index([one.stage for one in failures], name="stage"), target.names)
            write_outputs(self.directory, {NONFINITE: csv_of(table)}, RUN)

    def finish(self) -> None:
        """Record that the results of the saved steps are written."""
        if self._state is not None and self._record is not None:
            self._store(self._state, self._record.status._replace(written=True))

    @property
    def description(self) -> Mapping[str, str]:
        """Settings that affect the draws of the saved run, by name; empty before the first state."""
        return {} if self._record is None else self._record.description

    @property
    def status(self) -> saved.Status | None:
        """Status of the saved run; None before the first state."""
        return None if self._record is None else self._record.status

    def _read(self) -> saved.Record:
        self._record, self._state, self.damage = saved.read_last(self.directory, self._salvage)
        self._kept = (self._record.number,)
        return self._record

    def _store(self, state: RunState, status: saved.Status) -> None:
        """Write the file of a state."""
        number = max(saved.saved_states(self.directory), default=0) + 1
        record = saved.Record(number, status, self._description, self.request)
        path = saved.state_path(self.directory, number)
        try:
            write_whole(path, saved.content_of(state, record))
        finally:  # an interrupt may come after the file is there, when this state is saved
            if path.is_file():
                self._record, self._state, self._kept = record, state, (*self._kept[-1:], number)
            self._tidy()

    def _tidy(self) -> None:
        """Remove leftovers of interrupted writes, and all states of this run but the last two."""
        every = [] if self._record is None else saved.saved_states(self.directory)
        old = [saved.state_path(self.directory, number) for number in every if number not in self._kept]
        for path in (*filter(is_part, self._home.glob("*")), *old):
            with suppress(OSError):
                path.unlink()

    def _require_vacant(self) -> None:
        """Raise an error for a directory to which a new run may not write; nothing is changed.

        Raises
        ------
        InputError
            If it is a file or is below one; or if it is not empty and may not be replaced, or not all of its files
            belong to an earlier run.
        """
        for place in (self.directory, *self.directory.parents):
            if place.exists() and not place.is_dir():
                raise InputError(f"{place}: is a file, expected a directory for the results")
        there, begun = _earlier_run(self.directory, self._inputs), bool(saved.saved_states(self.directory))
        if self._replace and there.others:
            raise InputError(
                f"{self.directory}: --force replaces only an earlier run, but {told(there.others)}; move it away, or "
                "choose another --out"
            )
        # a run killed before its first state leaves no more than a part of a file
        if not self._replace and not all(map(is_part, (*there.ours, *there.others))):
            instead = "'softness-bayes resume' to continue its run" if begun else "--force to replace an earlier run"
            also = ", --force to replace it" if begun else ""
            raise InputError(f"{self.directory}: is not empty; choose another --out, or {instead}{also}")

    def _vanish_unused(self, lock: Lock) -> None:
        if self._record is None and not saved.saved_states(self.directory):
            self._tidy()
            lock.vanish()


def _earlier_run(directory: Path, inputs: Iterable[Path]) -> Survey:
    """Return the files of a run in a directory, those of its checkpoint from the newest on, and all other files.

    Files that `plot`, `report` and `rank` made there belong to the run; files that a new run reads do not.
    """
    home, beside = directory / CHECKPOINT, survey(directory, (RUN, "plot", "report", "rank"), inputs, but=(CHECKPOINT,))
    if home.is_symlink() or not home.is_dir():
        other = {home: "is not the directory of a checkpoint"} if os.path.lexists(home) else {}
        return Survey(beside.ours, {**other, **beside.others})
    paths = sorted(home.iterdir(), reverse=True)
    states = [path for path in paths if is_part(path) or saved.number_of(path) is not None]
    held = [path for path in paths if path.name == LOCK and path.is_file() and not path.is_symlink()]
    others = {path: "was not written by this command" for path in paths if path not in (*states, *held)}
    return Survey((*states, *beside.ours), {**others, **beside.others})
