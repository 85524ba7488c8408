"""Conversion of the states of a run to arrays and plain values for a file, and back, without loss of precision."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import Segment
from softness_bayes.sampler.diagnostics import Goal, ModeShare, Verdict
from softness_bayes.sampler.nonfinite import Failure, Nonfinite
from softness_bayes.sampler.starts import Starts
from softness_bayes.sampler.state import EnsembleState, RunState

Arrays = Mapping[str, NDArray[Any]]

_MAP = "map"


def packed(arrays: Arrays) -> bytes:
    """Return arrays by name as the bytes of an npz file."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def changed(path: Path) -> InputError:
    """Return the error for a checkpoint file with the wrong checksum."""
    return InputError(
        f"{path}: damaged, or changed since it was written: its checksum does not match; 'softness-bayes "
        "resume' goes back to the last intact state if there is one; otherwise restore the file from a copy, "
        "or start the run again in another directory"
    )


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


def state_arrays(state: RunState) -> dict[str, NDArray[Any]]:
    """Return the arrays of a state, without its chains."""
    kinds, keys, *numbers = zip(*(one.random for one in state.ensembles), strict=True)
    accepted = [np.sum([segment.accepted for segment in part], axis=0) for part in state.parts]
    failures = state.nonfinite.failures
    return {
        "coordinates": np.stack([one.coordinates for one in state.ensembles]),
        "log_density": np.stack([one.log_density for one in state.ensembles]),
        "random_kind": np.array(kinds),
        "random_keys": np.stack(keys),
        "random_numbers": np.array(numbers, dtype=float),
        "accepted": np.array(accepted),
        **_map_arrays(_MAP, state.map),
        **{name: a for k, mode in enumerate(state.modes) for name, a in _map_arrays(_mode(k), mode).items()},
        "failure_points": np.array([f.point for f in failures], dtype=float),
        "failure_stages": np.array([f.stage for f in failures], dtype=str),
    }


def piece_arrays(state: RunState, stored: int) -> dict[str, NDArray[Any]]:
    """Return the stored steps of all ensembles after the first ``stored`` ones.

    Only these are copied: a long run is saved thousands of times.
    """
    new = [Segment.join(Segment.after(part, stored)) for part in state.parts]
    return {
        "coordinates": np.stack([one.coordinates for one in new]),
        "log_density": np.stack([one.log_density for one in new]),
    }


def state_values(state: RunState) -> dict[str, Any]:
    """Return the numbers of a state and its verdicts as JSON data."""
    plain = ("phase", "steps", "stride", "due", "seconds", "ended", "relearnt")
    return {
        **{name: getattr(state, name) for name in plain},
        "modes": len(state.modes),
        "starts": state.starts._asdict(),
        "evaluations": state.nonfinite.evaluations,
        "failures": state.nonfinite.count,
        "before": _verdict_values(state.before),
        "verdict": _verdict_values(state.verdict),
    }


def state_of(values: Mapping[str, Any], arrays: Arrays, segments: Sequence[Arrays]) -> RunState:
    """Return the state from its values, its arrays, and the pieces of its chains in order."""
    position, has_spare, spare = arrays["random_numbers"]
    ensembles = tuple(
        EnsembleState(
            arrays["coordinates"][e],
            arrays["log_density"][e],
            (
                str(arrays["random_kind"][e]),
                arrays["random_keys"][e],
                int(position[e]),
                int(has_spare[e]),
                float(spare[e]),
            ),
        )
        for e in range(len(arrays["coordinates"]))
    )
    parts: tuple[tuple[Segment, ...], ...] = tuple(() for _ in ensembles)
    if segments:
        coordinates, log_density = (
            np.concatenate([s[name] for s in segments], axis=1) for name in ("coordinates", "log_density")
        )
        walked = zip(coordinates, log_density, arrays["accepted"], strict=True)
        parts = tuple((Segment(*one),) for one in walked)
    stages = arrays["failure_stages"].tolist()
    points = arrays["failure_points"].tolist()
    failures = tuple(Failure(tuple(point), stage) for point, stage in zip(points, stages, strict=True))
    return RunState(
        ensembles=ensembles,
        map=_map_of(_MAP, arrays),
        parts=parts,
        before=verdict_of(values["before"]),
        verdict=verdict_of(values["verdict"]),
        modes=tuple(_map_of(_mode(k), arrays) for k in range(values["modes"])),
        starts=Starts(**values["starts"]),
        nonfinite=Nonfinite(values["evaluations"], values["failures"], failures),
        **{name: values[name] for name in ("phase", "steps", "stride", "due", "seconds", "ended")},
        relearnt=values.get("relearnt", 0),  # checkpoints of earlier versions do not have it
    )


def verdict_of(values: Mapping[str, Any] | None) -> Verdict | None:
    """Return the verdict from JSON data."""
    if values is None:
        return None
    arrays = {name: np.array(values[name], dtype=float) for name in ("tau", "r_hat", "ess_bulk", "ess_tail")}
    if arrays["tau"].ndim == 2:  # format of earlier versions: one time per ensemble
        values = {**values, "ensembles": len(arrays["tau"])}
        arrays["tau"] = arrays["tau"].max(axis=0)
    return Verdict(**{**values, **arrays, **_tuples(values), "goal": Goal(**values["goal"])})


def _tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "names": tuple(values["names"]),
        "shares": tuple(ModeShare(*share) for share in values["shares"]),
        "starts": Starts(*values["starts"]),
    }


def _map_arrays(prefix: str, map: TriangularMap) -> dict[str, NDArray[Any]]:
    plain = {f"{prefix}_{name}": getattr(map, name) for name in ("centre", "axes", "scale")}
    return plain | {f"{prefix}_bend_{k}": bend for k, bend in enumerate(map.bends)}


def _map_of(prefix: str, arrays: Arrays) -> TriangularMap:
    centre, axes, scale = (arrays[f"{prefix}_{name}"] for name in ("centre", "axes", "scale"))
    return TriangularMap(centre, axes, scale, tuple(arrays[f"{prefix}_bend_{k}"] for k in range(centre.size)))


def _mode(k: int) -> str:
    return f"mode_{k}"


def _verdict_values(verdict: Verdict | None) -> dict[str, Any] | None:
    if verdict is None:
        return None
    values = {field.name: getattr(verdict, field.name) for field in fields(verdict)}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
    return {**plain, "goal": asdict(verdict.goal)}
