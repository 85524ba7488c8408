"""Checksums of the content of a result, part by part.

Checksums are computed from values as they are read, not from the bytes of a file, so that each changed part can be
identified by name.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.files.json_text import parse_json

if TYPE_CHECKING:
    import xarray as xr

CHECKSUMS = "checksums"
"""Name of the attribute with the SHA-256 of every variable and attribute, as JSON."""


def checksums(tree: xr.DataTree) -> str:
    """Return the checksums of a tree, in the form of its attribute `CHECKSUMS`."""
    return json.dumps(dict(_checksums(tree)))


class Changes(NamedTuple):
    """Parts of a tree that differ from its checksums, in words."""

    missing: list[str]
    """Parts that are missing."""
    other: list[str]
    """Parts that were changed or added."""


def changes(tree: xr.DataTree) -> Changes:
    """Compare a tree with its checksums."""
    try:
        written = dict(parse_json(tree.attrs[CHECKSUMS]))
    except (KeyError, TypeError, ValueError):
        return Changes([], [f"attribute {CHECKSUMS!r}"])
    found = dict(_checksums(tree))
    return Changes(
        [name for name in written if name not in found],
        [name for name in found if written.get(name) != found[name]],
    )


def _checksums(tree: xr.DataTree) -> Iterator[tuple[str, str]]:
    """Yield a description and the checksum of every part of a tree."""
    for key, value in tree.attrs.items():
        if key != CHECKSUMS:
            yield f"attribute {key!r}", _digest(_bytes_of(value))
    for group, child in tree.children.items():
        yield f"group {group!r}", _digest(*(part for key in child.attrs for part in _item(key, child.attrs[key])))
        dataset = child.to_dataset()
        for name, variable in dataset.variables.items():
            described = [part for key in sorted(variable.attrs) for part in _item(key, variable.attrs[key])]
            dims = repr((variable.dims, variable.shape, name in dataset.coords)).encode()
            yield f"variable {name!r} of group {group!r}", _digest(dims, _bytes_of(variable.values), *described)


def _item(key: Any, value: Any) -> tuple[bytes, bytes]:
    return str(key).encode(), _bytes_of(value)


def _digest(*parts: bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def _bytes_of(value: Any) -> bytes:
    """Return numbers with their type, or text, as bytes that do not depend on the machine."""
    array: NDArray[Any] = np.asarray(value)
    if array.dtype.kind not in "biufc":
        return json.dumps([str(text) for text in array.ravel()]).encode()
    if array.dtype.kind == "f":
        # NaN has many bit patterns, which are replaced by one
        array = np.where(np.isnan(array), np.array(np.nan, array.dtype), array)
    array = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return array.dtype.str.encode() + array.tobytes()
