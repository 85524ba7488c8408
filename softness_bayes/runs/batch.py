"""Batches of fits in one directory: one process at a time runs them, and `status` tells how far it is."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.lock import Lock
from softness_bayes.base.files.records import parse_json
from softness_bayes.base.files.whole import write_whole

LOCK, ASKED = "lock", "asked.json"
"""Lock of a batch under way, and the record of the last call."""


class Asked(NamedTuple):
    """Fits of the last call."""

    fits: int
    """Their number; 0 without any call."""
    before: int
    """Number of them that were finished when it began."""
    begun: float
    """Time at which it began [s since 1970]."""

    def seconds_left(self, finished: int, last: float) -> float:
        """Return the estimated time [s] that the remaining fits take; nan if none has ended since the call began.

        Parameters
        ----------
        finished
            Number of finished fits.
        last
            Time at which the last of them ended [s since 1970].
        """
        since = finished - self.before
        return (last - self.begun) / since * (self.fits - finished) if since > 0 else math.nan


@contextmanager
def batch(directory: Path) -> Iterator[None]:
    """Hold a directory while fits are run in it.

    Raises
    ------
    LockedError
        If another process runs a batch there.
    """
    with Lock(directory / LOCK) as lock:
        yield
        lock.vanish()


def write_asked(directory: Path, fits: int, before: int) -> None:
    """Record the number of fits of a call that begins now, and how many of them are finished."""
    write_whole(directory / ASKED, (json.dumps({"fits": fits, "before": before}) + "\n").encode())


def read_asked(directory: Path) -> Asked:
    """Return the fits of the last call.

    Raises
    ------
    InputError
        If the file is not such a record.
    """
    path = directory / ASKED
    if not path.is_file():
        return Asked(0, 0, 0.0)
    try:
        values = parse_json(path.read_text(encoding="utf-8"))
        return Asked(int(values["fits"]), int(values["before"]), path.stat().st_mtime)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise InputError(f"{path}: not the number of fits ({error!r})") from None
