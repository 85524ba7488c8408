"""Content of a table's file, of limited size, with a time limit for pipes."""

from __future__ import annotations

import io
import os
import stat
import time
from pathlib import Path

from softness_bayes.errors import InputError, quoted

LARGEST = 2**28
"""Largest size of a table's file [bytes]: about ten million ratings."""

PATIENCE = 2.0
"""Time [s] to wait for the first data in a pipe."""

_OPENED = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def content_of(path: Path) -> bytes:
    """Return the bytes of a file, or of a pipe or device up to its end.

    Raises
    ------
    InputError
        If it cannot be read, is larger than `LARGEST`, or is a pipe without a writer.
    """
    try:
        with os.fdopen(os.open(path, _OPENED), "rb", 0) as file:
            return _all_of(file, path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except ValueError as error:  # a path with a NUL character
        raise InputError(f"{quoted(str(path))}: {error}") from None


def _all_of(file: io.FileIO, path: Path) -> bytes:
    about = os.fstat(file.fileno())
    content = io.BytesIO()
    if not stat.S_ISREG(about.st_mode):
        content.write(_beginning(file, path) if stat.S_ISFIFO(about.st_mode) else b"")
        os.set_blocking(file.fileno(), True)
    if about.st_size <= LARGEST:
        while content.tell() <= LARGEST and (part := file.read(2**20)):
            content.write(part)
    if max(about.st_size, content.tell()) > LARGEST:
        raise InputError(f"{path}: is larger than {LARGEST >> 20} MB, expected a table of ratings or fabrics")
    return content.getvalue()


def _beginning(pipe: io.FileIO, path: Path) -> bytes:
    """Return the available content of a pipe, empty if its writer has not started."""
    end = time.monotonic() + PATIENCE
    while (found := pipe.read(2**16)) == b"":
        if time.monotonic() > end:
            raise InputError(f"{path}: is a pipe without data, expected a table")
        time.sleep(0.02)
    return found or b""
