"""Typed records as JSON and arrays, without loss of precision.

A record is a dataclass or a named tuple of numbers, texts, arrays, other records, and tuples of these. It is written by
its values and read by its annotations, so that a field is declared once.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError


def to_json(value: Any, arrays: list[NDArray[Any]] | None = None) -> Any:
    """Return a record as JSON values.

    Parameters
    ----------
    value
        The record.
    arrays
        List to which arrays are appended; their place in it then stands for them. Without one, they become lists.
    """
    if isinstance(value, np.ndarray):
        if arrays is None:
            return value.tolist()
        arrays.append(value)
        return len(arrays) - 1
    if is_dataclass(value):
        return {each.name: to_json(getattr(value, each.name), arrays) for each in fields(value)}
    if isinstance(value, tuple):
        named = getattr(value, "_fields", ())
        made = [to_json(one, arrays) for one in value]
        return dict(zip(named, made, strict=True)) if named else made
    return value


_ARRAYS = np.ndarray, get_origin(NDArray[np.float64])
"""Origins of an array's type: newer versions of NumPy declare `NDArray` as an alias with an origin of its own."""


def from_json(kind: Any, values: Any, arrays: Sequence[NDArray[Any]] = ()) -> Any:
    """Return the record of JSON values from `to_json`.

    Parameters
    ----------
    kind
        Its type.
    values
        The JSON values.
    arrays
        The arrays that `to_json` appended.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in _ARRAYS:
        return np.array(values, dtype=float) if isinstance(values, list) else arrays[values]
    if origin is tuple:
        kinds = [arguments[0]] * len(values) if arguments[-1] is Ellipsis else arguments
        return tuple(from_json(each, value, arrays) for each, value in zip(kinds, values, strict=True))
    if NoneType in arguments:
        return None if values is None else from_json(arguments[0], values, arrays)
    if is_dataclass(kind) or issubclass(kind, tuple):
        types = get_type_hints(kind)
        return kind(**{name: from_json(types[name], value, arrays) for name, value in values.items()})
    return kind(values)


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
