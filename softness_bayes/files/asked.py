"""Number of tasks that a calibration or a study was asked for, from which `status` tells how many are left."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from softness_bayes.errors import InputError
from softness_bayes.files.json_text import parse_json
from softness_bayes.files.whole import write_whole

ASKED = "asked.json"
"""Name of the file in the directory of the tasks."""


class Asked(NamedTuple):
    """Tasks of the latest call."""

    tasks: int
    """Their number; 0 without such a file."""
    begun: float
    """Time at which the call began [s since 1970]."""


def write_asked(directory: Path, tasks: int) -> None:
    """Record the number of tasks of a call that begins now."""
    write_whole(directory / ASKED, (json.dumps({"tasks": tasks}) + "\n").encode())


def read_asked(directory: Path) -> Asked:
    """Return the tasks of the latest call.

    Raises
    ------
    InputError
        If the file is not such a record.
    """
    path = directory / ASKED
    if not path.is_file():
        return Asked(0, 0.0)
    try:
        return Asked(int(parse_json(path.read_text(encoding="utf-8"))["tasks"]), path.stat().st_mtime)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise InputError(f"{path}: not the number of tasks ({error!r})") from None
