"""JSON: the only place where the toolkit reads it, and where values and typed records become JSON that is stored.

A record is a dataclass or a named tuple of numbers, texts, arrays, JSON values, other records, and tuples of these. It
is written by its values and read by its annotations, so that a field is declared once. What a file names of code is not
imported before the user trusts it (`require_trusted`).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, get_args, get_origin, get_type_hints

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.supplied import GROUP, IMPORTABLE, imported

if TYPE_CHECKING:  # the help of a command needs no NumPy
    from numpy.typing import NDArray


def parse_json(text: str | bytes) -> Any:
    """Return the values of some JSON, which may come from a file that anyone wrote.

    Raises
    ------
    InputError
        If it is nested too deeply.
    ValueError
        If it is not JSON in UTF-8. `InputError` is one as well.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError("JSON that is nested too deeply") from None


def as_json(values: Any, what: str, indent: int | None = None) -> str:
    """Return values as JSON, with NumPy scalars converted to plain ones.

    Parameters
    ----------
    values
        Mappings, sequences, text and numbers.
    what
        Name of the values, for the message.
    indent
        As for `json.dumps`.

    Raises
    ------
    InputError
        If JSON cannot hold them; the message names the entry.
    """
    try:
        return json.dumps(values, indent=indent, default=_plain)
    except RecursionError:
        raise InputError(f"{what}: cannot be stored (nested too deeply)") from None
    except (TypeError, ValueError) as error:
        entries = values.items() if isinstance(values, Mapping) else ()
        said = next((f" {name!r}: {value!r:.80}" for name, value in entries if not _is_json(value)), "")
        raise InputError(f"{what}:{said} cannot be stored ({error})") from None


def _plain(value: Any) -> Any:
    import numpy as np

    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be stored as JSON")


def _is_json(value: Any) -> bool:
    try:
        json.dumps(value, default=_plain)
    except (TypeError, ValueError):
        return False
    return True


def to_json(value: Any, arrays: list[NDArray[Any]] | None = None) -> Any:
    """Return a record as JSON values.

    Parameters
    ----------
    value
        The record.
    arrays
        List to which arrays are appended; their place in it then stands for them. Without one, they become lists.
    """
    import numpy as np

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
    import numpy as np

    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any or origin in (dict, Mapping):
        return values
    # newer versions of NumPy declare NDArray as an alias with an origin of its own
    if origin in (np.ndarray, get_origin(np.typing.NDArray[np.float64])):
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


def require_trusted(source: str, record: Any, trust_code: bool) -> None:
    """Raise an error if a record that was read from a file names code that this program has not imported.

    Parameters
    ----------
    source
        The file, for the message.
    record
        Texts, in any nesting of mappings and sequences, also as JSON.
    trust_code
        Whether the user trusts the file. Its modules are then imported from Python's path, except from the working
        directory, where the file itself may have come from; PYTHONPATH can name that directory.

    Raises
    ------
    InputError
        Names the code; or the reason why it cannot be imported.
    """
    for name, target in _code_in(record):
        module = target.partition(":")[0]
        if module in sys.modules:
            continue
        if not trust_code:
            raise InputError(
                f"{source}: names code, {quoted(name)}, and reading it would run the module {module!r}; if you trust "
                "whoever made the file, use --trust-code (in Python trust_code=True, or import the module first)"
            )
        before, asked = list(sys.path), os.environ.get("PYTHONPATH", "").split(os.pathsep)
        named = {Path(folder).resolve() for folder in asked if folder}
        sys.path[:] = [p for p in before if p and (Path(p).resolve() in named or Path(p).resolve() != Path.cwd())]
        try:
            imported(source, name, target)
        finally:
            sys.path[:] = before


def _code_in(record: Any) -> Iterator[tuple[str, str]]:
    """Yield what a record names of importable names and entry points, each with its MODULE:NAME."""
    left = [record]  # no recursion, which a deeply nested record could end early
    while left:
        one = left.pop()
        if isinstance(one, str):
            if one.startswith(("{", "[")):
                try:
                    left.append(parse_json(one))
                except InputError:
                    raise
                except ValueError:  # no JSON, so nobody looks up names in it
                    continue
            # a prior has numbers after its name
            for name in dict.fromkeys([one, one.lstrip("± ").partition("(")[0].strip()]):
                if name in _every_entry_point():
                    yield name, _every_entry_point()[name]
                elif IMPORTABLE.fullmatch(name):
                    yield name, name
        elif isinstance(one, Mapping):
            left.extend(one.values())
        elif not isinstance(one, (bytes, int, float)) and hasattr(one, "__iter__"):
            left.extend(one)


@cache
def _every_entry_point() -> Mapping[str, str]:
    """Return MODULE:NAME of each entry point in the groups of this package, by its short name."""
    found = entry_points()
    groups = [group for group in found.groups if group.startswith(f"{GROUP}.")]
    return {point.name: point.value for group in groups for point in found.select(group=group)}
