"""JSON: the only place where the toolkit reads it, and where values become JSON that is stored."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from softness_bayes.base.errors import InputError


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
