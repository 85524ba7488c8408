"""Typed records as JSON and arrays, without loss of precision.

A record is a dataclass or a named tuple of numbers, texts, arrays, other records, and tuples of these. It is written by
its values and read by its annotations, so that a field is declared once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray


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
