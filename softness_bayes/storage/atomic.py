"""Files that appear whole or not at all, whatever kills the process or fills the disk."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

PART = ".part"
"""Ending of a file that is being written."""


def write_whole(path: Path, content: bytes) -> None:
    """Write a file: under another name first, then to the disk itself, then under its own name.

    Raises
    ------
    OSError
        If there is no room or no permission; an earlier file of that name is still there, or the new one, whole.
    """
    part = path.with_name(path.name + PART)
    try:
        with open(part, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
        _sync_directory(path.parent)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        error.filename = str(path)
        raise


def _sync_directory(directory: Path) -> None:
    """Put the names in a directory on the disk; without it a file may be whole and yet nameless."""
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
