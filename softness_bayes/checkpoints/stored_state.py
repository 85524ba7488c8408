"""Files of a state: one of everything except the stored steps, and pieces of these."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.records import from_json, to_json
from softness_bayes.sampler.chains import RunState, Segment

Arrays = Mapping[str, NDArray[Any]]

_RECORD = "record"


def state_file(state: RunState, status: NamedTuple) -> bytes:
    """Return the bytes of the file of a state, with its status but without its stored steps."""
    none = np.empty(0)
    accepted = [np.array([one.accepted for one in part], dtype=np.int64).sum(axis=0) for part in state.parts]
    bare = [(Segment(none, none, number),) if part else () for number, part in zip(accepted, state.parts, strict=True)]
    arrays: list[NDArray[Any]] = []
    record = as_json({"state": to_json(replace(state, parts=tuple(bare)), arrays), "status": to_json(status)}, "state")
    named = {str(k): array for k, array in enumerate(arrays)}
    return packed({**named, _RECORD: np.frombuffer(record.encode(), np.uint8)})


def status_in(file: Arrays) -> dict[str, Any]:
    """Return the status in the file of a state, as JSON values."""
    return dict(parse_json(file[_RECORD].tobytes())["status"])


def state_of(file: Arrays, pieces: Sequence[Arrays]) -> RunState:
    """Return the state from its file and the pieces of its chains, in order."""
    arrays = [file[str(k)] for k in range(len(file) - 1)]
    state: RunState = from_json(RunState, parse_json(file[_RECORD].tobytes())["state"], arrays)
    if not pieces:
        return state
    walks, heights = (np.concatenate([one[name] for one in pieces], axis=1) for name in Segment._fields[:2])
    joined = zip(walks, heights, state.parts, strict=True)
    return replace(state, parts=tuple((Segment(walk, height, part[0].accepted),) for walk, height, part in joined))


def piece_file(state: RunState, stored: int) -> bytes:
    """Return the bytes of the file of all stored steps after the first ``stored`` ones.

    Only these are copied: a long run is saved thousands of times.
    """
    new = [Segment.join(Segment.after(part, stored)) for part in state.parts]
    return packed({name: np.stack([getattr(one, name) for one in new]) for name in Segment._fields[:2]})


def packed(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return arrays by name as the bytes of an npz file."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def unpacked(path: Path, digest: str) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz file whose SHA-256 is known.

    Raises
    ------
    InputError
        If the file is missing or has another digest.
    """
    try:
        with open(path, "rb") as opened:
            if hashlib.file_digest(opened, "sha256").hexdigest() != digest:
                raise changed(path)
            opened.seek(0)
            with np.load(opened, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
    except OSError as error:
        raise InputError(f"{path}: a part of a checkpoint that cannot be read ({error.strerror})") from None


def changed(path: Path) -> InputError:
    """Return the error for a checkpoint file with the wrong checksum."""
    return InputError(
        f"{path}: damaged, or changed since it was written: its checksum does not match; 'softness-bayes "
        "resume' goes back to the last intact state if there is one; otherwise restore the file from a copy, "
        "or start the run again in another directory"
    )
