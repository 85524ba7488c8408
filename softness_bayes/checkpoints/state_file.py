"""Files of saved states: everything needed to continue, the steps since the file before, and a copy of the manifest."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.records import from_json, to_json
from softness_bayes.sampler.chains import RunState, Segment

Arrays = Mapping[str, NDArray[Any]]

_RECORD, _STEPS = "record", Segment._fields[:2]


def state_file(state: RunState, stored: int, manifest: Mapping[str, Any]) -> bytes:
    """Return the bytes of the file of a state.

    Parameters
    ----------
    state
        The state. Of its stored steps only new ones are copied: a long run is saved thousands of times.
    stored
        Number of stored steps in the files before.
    manifest
        Manifest of the checkpoint at this state, without this file.
    """
    none, arrays = np.empty(0), list[NDArray[Any]]()
    accepted = [np.array([one.accepted for one in part], dtype=np.int64).sum(axis=0) for part in state.parts]
    bare = [(Segment(none, none, number),) if part else () for number, part in zip(accepted, state.parts, strict=True)]
    record = {"state": to_json(replace(state, parts=tuple(bare)), arrays), "manifest": manifest}
    named = {str(k): array for k, array in enumerate(arrays)}
    if state.steps // state.stride > stored:
        new = [Segment.join(Segment.after(part, stored)) for part in state.parts]
        named |= {name: np.stack([getattr(one, name) for one in new]) for name in _STEPS}
    buffer = io.BytesIO()
    np.savez(
        buffer, allow_pickle=False, **{_RECORD: np.frombuffer(as_json(record, "state").encode(), np.uint8)}, **named
    )
    return buffer.getvalue()


def state_of(files: Sequence[Arrays]) -> RunState:
    """Return the state from its file and those before it, in order."""
    last = files[-1]
    arrays = [last[str(k)] for k in range(sum(name.isdigit() for name in last))]
    state: RunState = from_json(RunState, parse_json(last[_RECORD].tobytes())["state"], arrays)
    pieces = [one for one in files if _STEPS[0] in one]
    if not pieces:
        return state
    walks, heights = (np.concatenate([one[name] for one in pieces], axis=1) for name in _STEPS)
    joined = zip(walks, heights, state.parts, strict=True)
    return replace(state, parts=tuple((Segment(walk, height, part[0].accepted),) for walk, height, part in joined))


def manifest_in(file: Arrays) -> dict[str, Any]:
    """Return the manifest at a state from its file."""
    return dict(parse_json(file[_RECORD].tobytes())["manifest"])


def unpacked(content: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a state's file by name."""
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def digest_of(content: bytes) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(content).hexdigest()


def read_state_file(path: Path, digest: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of a state's file, by name.

    Raises
    ------
    InputError
        If the file is missing or has another SHA-256.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: a part of a checkpoint that cannot be read ({error.strerror})") from None
    if digest_of(content) != digest:
        raise changed(path)
    return unpacked(content)


def changed(path: Path) -> InputError:
    """Return the error for a checkpoint file with the wrong checksum."""
    return InputError(
        f"{path}: damaged, or changed since it was written: its checksum does not match; 'softness-bayes "
        "resume' goes back to the last intact state if there is one; otherwise restore the file from a copy, "
        "or start the run again in another directory"
    )
