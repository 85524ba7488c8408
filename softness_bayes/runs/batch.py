"""Batches of fits in one directory: one process at a time runs them, and `status` tells how far it is."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from softness_bayes.errors import InputError
from softness_bayes.files.json_text import parse_json
from softness_bayes.files.lock import Lock
from softness_bayes.files.whole import write_whole

LOCK, ASKED = "lock", "asked.json"
"""Lock of a batch under way, and the number of fits that the last call was asked for."""


class Asked(NamedTuple):
    """Fits of the last call."""

    fits: int
    """Their number; 0 without any call."""
    begun: float
    """Time at which the call began [s since 1970]."""

    def seconds_left(self, ended: Iterable[float], left: int) -> float:
        """Return the estimated time [s] that the remaining fits take; nan if none has ended since the call began.

        Parameters
        ----------
        ended
            Times at which fits ended [s since 1970].
        left
            Number of remaining fits.
        """
        since = [when for when in ended if when > self.begun]
        return (max(since) - self.begun) / len(since) * left if since else math.nan


@contextmanager
def batch(directory: Path, fits: int) -> Iterator[None]:
    """Hold a directory while a number of fits are run in it.

    Raises
    ------
    LockedError
        If another process runs a batch there.
    """
    with Lock(directory / LOCK) as lock:
        write_asked(directory, fits)
        yield
        lock.vanish()


def write_asked(directory: Path, fits: int) -> None:
    """Record the number of fits of a call that begins now."""
    write_whole(directory / ASKED, (json.dumps({"fits": fits}) + "\n").encode())


def read_asked(directory: Path) -> Asked:
    """Return the fits of the last call.

    Raises
    ------
    InputError
        If the file is not such a record.
    """
    path = directory / ASKED
    if not path.is_file():
        return Asked(0, 0.0)
    try:
        return Asked(int(parse_json(path.read_text(encoding="utf-8"))["fits"]), path.stat().st_mtime)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise InputError(f"{path}: not the number of fits ({error!r})") from None
