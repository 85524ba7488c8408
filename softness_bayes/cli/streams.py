"""Tolerance of closed or full standard streams: `| head` prints no error, and a finished run still succeeds."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any


class Tolerant:
    """A text stream that discards text after its first write error, and otherwise acts like the stream."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, or discard."""
        try:
            return int(self._stream.write(text))
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        """Flush, or do nothing."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.failure = self.failure or error
        with suppress(OSError, ValueError, AttributeError):  # a stream in memory has no file descriptor
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())  # remaining buffered text is discarded too
            os.close(nowhere)
            self._stream.flush()

    @property
    def lost(self) -> str:
        """The write error in words; empty for a closed pipe, which may be on purpose."""
        if self.failure is None or self.failure.errno == errno.EPIPE:
            return ""
        return self.failure.strerror or str(self.failure)


def open_closed_streams() -> None:
    """Open standard streams that were closed at program start; otherwise other files would get their descriptors."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # this takes the lowest free descriptor, which is the closed one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


@contextmanager
def tolerant_streams() -> Iterator[Tolerant]:
    """Make standard output and error tolerant inside the ``with`` block; yield the output stream."""
    before = sys.stdout, sys.stderr
    for stream in before:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="surrogateescape")  # names of files need not be UTF-8
    out, err = (None if stream is None else Tolerant(stream) for stream in before)
    sys.stdout, sys.stderr = out, err
    try:
        yield out or Tolerant(None)
    finally:
        for stream in (out, err):
            if stream is not None:
                stream.flush()
        sys.stdout, sys.stderr = before
