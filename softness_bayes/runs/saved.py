"""Files of a checkpoint: each holds a whole state of a run, its status and a checksum.

A file is written once and never changed, and the state of a run is that of its newest file. The file before is kept: if
the newest one is damaged, the run continues from there. A damaged or exchanged file raises an error.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.lock import is_held
from softness_bayes.base.files.records import as_json, from_json, parse_json, to_json
from softness_bayes.base.files.run_files import CHECKPOINT, LOCK
from softness_bayes.base.files.whole import seal_of, unsealed
from softness_bayes.sampler.chains import RunState, Segment
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.sampling import Settings

FORMAT = 8
"""Version of the layout; other versions are rejected."""

_NAME = re.compile(r"state-([0-9]{7,})\.npz")
_RECORD = "record"


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

    @classmethod
    def of(cls, state: RunState, schedule: Settings, request: Any) -> Status:
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
        return cls(
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
        )


class Record(NamedTuple):
    """Record of a state in its file."""

    number: int
    """Number of the file."""
    status: Status
    description: dict[str, str]
    """Settings that affect the draws, by name."""
    request: Any
    """Settings requested for the run, as JSON values."""


class DamagedError(InputError):
    """A file of a checkpoint is missing or changed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"{path}: damaged, or changed since it was written: its checksum does not match; 'softness-bayes "
            "resume' goes back to the last intact state if there is one; otherwise restore the file from a copy, "
            "or start the run again in another directory"
        )


def state_path(directory: Path, number: int) -> Path:
    """Return the file of a state of the run in a directory of results."""
    return directory / CHECKPOINT / f"state-{number:07d}.npz"


def number_of(path: Path) -> int | None:
    """Return the number of a state's file; None for any other path."""
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match and path.is_file() and not path.is_symlink() else None


def saved_states(directory: Path) -> list[int]:
    """Return the numbers of the files of states in a directory of results, in order; empty if no run has begun."""
    home = directory / CHECKPOINT
    paths = home.iterdir() if home.is_dir() else ()
    return sorted(number for path in paths if (number := number_of(path)) is not None)


def content_of(state: RunState, record: Record) -> bytes:
    """Return the content of the file of a state, with what the file says of it."""
    arrays: list[NDArray[Any]] = []
    joined = replace(state, parts=tuple((Segment.join(part),) if part else () for part in state.parts))
    values = {"format": FORMAT, **to_json(record), "state": to_json(joined, arrays)}
    text, buffer = np.frombuffer(as_json(values, "state").encode(), np.uint8), io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{_RECORD: text}, **{str(k): array for k, array in enumerate(arrays)})
    return buffer.getvalue() + seal_of(buffer.getbuffer())


def read_state(path: Path) -> tuple[Record, RunState]:
    """Return record and state of a file.

    Raises
    ------
    InputError
        If the file is missing or damaged, or of another format.
    """
    try:
        content = unsealed(path.read_bytes())
    except (FileNotFoundError, IsADirectoryError):
        content = None
    except OSError as error:
        raise InputError(f"{path}: a part of a checkpoint that cannot be read ({error.strerror})") from None
    if content is None:
        raise DamagedError(path)
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        values, arrays = _values(path, file), [file[str(k)] for k in range(len(file.files) - 1)]
    if values["number"] != number_of(path):  # another file has taken its place
        raise DamagedError(path)
    return _record(values), from_json(RunState, values["state"], arrays)


def read_last(directory: Path, salvage: bool = False) -> tuple[Record, RunState, str]:
    """Return record and state of the newest file of a run, and damaged files and the resulting loss as a sentence.

    Parameters
    ----------
    directory
        Directory of the results.
    salvage
        Whether to go back to the last intact state; otherwise a damaged file raises an error.

    Raises
    ------
    InputError
        If there is no run, or none of its states is intact.
    """
    damaged: dict[Path, None] = {}
    for number in reversed(_begun(directory)):
        try:
            record, state = read_state(state_path(directory, number))
        except DamagedError as error:
            if not salvage:
                raise
            damaged[error.path] = None
            continue
        where = "its pilot phase" if record.status.piloting else f"step {record.status.steps}"
        lost = f"the run continues from {where}, the last intact state: the steps after it are lost"
        return record, state, "; ".join([*(f"{path}: damaged or missing" for path in damaged), lost] if damaged else [])
    raise InputError(
        f"{'; '.join(f'{path}: damaged or missing' for path in damaged)}; no intact state is left; restore the files "
        "from a copy, or start the run again in another directory"
    )


def read_status(directory: str | Path) -> Status:
    """Return the status of a run, without any effect on the process that runs it.

    Raises
    ------
    InputError
        If the directory contains no checkpoint, or one of another version.
    """
    directory = Path(directory)
    running = is_held(directory / CHECKPOINT / LOCK)
    if running and not saved_states(directory):  # it is still searching for starting points
        return Status(True, True, 0, 0, 0.0, 0, False, False, 0, None)
    return read_record(directory).status._replace(running=running)


def read_record(directory: Path) -> Record:
    """Return the record of the newest file of a run, without reading its arrays.

    Raises
    ------
    InputError
        If there is no run, or the record is damaged or of another version.
    """
    while True:
        path = state_path(directory, _begun(directory)[-1])
        try:
            # NumPy leaves a file that it opened itself open if it is no archive
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                return _record(_values(path, file))
        except InputError:
            raise
        except FileNotFoundError:  # the run has just replaced it
            continue
        except Exception:  # the bytes may be anything
            raise DamagedError(path) from None


def _begun(directory: Path) -> list[int]:
    if not (numbers := saved_states(directory)):
        raise InputError(f"{directory}: no run to continue or to report on; expected {directory / CHECKPOINT}")
    return numbers


def _values(path: Path, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    values = parse_json(arrays[_RECORD].tobytes())
    if values.get("format") != FORMAT:
        raise InputError(
            f"{path}: not a checkpoint of format {FORMAT}, the only one that this version reads; continue the "
            "run with the version that began it, or start it again in another directory"
        )
    return dict(values)


def _record(values: Mapping[str, Any]) -> Record:
    record: Record = from_json(Record, {name: values[name] for name in Record._fields})
    return record
