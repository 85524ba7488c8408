"""Standard streams of the command line: closed or full ones are tolerated, and invisible characters are escaped.

`| head` prints no error, and a finished run still succeeds. Names of files cannot control the terminal.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import re
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

# keeps line ends, tabs and the carriage returns of progress bars; escapes direction marks and zero-width characters
_UNSEEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200b-\u200f\u202a-\u202e\u2060-\u2069\ufeff]")


_PLAIN = str.maketrans(
    {"–": "-", "—": "-", "−": "-", "…": "...", "·": ".", "×": "x", "≥": ">=", "≤": "<=", "→": "->", "µ": "u", "μ": "u"}
    | {"√": "sqrt ", "±": "+-", "‘": "'", "’": "'", "“": '"', "”": '"', "²": "2", "³": "3", "⁻": "-", "≈": "~"}
)


def _in_fewer_characters(error: UnicodeError) -> tuple[str | bytes, int]:
    """Return what stands for characters that an encoding does not have: similar ones, or their escapes.

    Bytes of file names that are not UTF-8 stay as they are.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    made = bytearray()
    for character in error.object[error.start : error.end]:
        if 0xDC80 <= ord(character) <= 0xDCFF:
            made.append(ord(character) - 0xDC00)
            continue
        plain = unicodedata.normalize("NFKD", character.translate(_PLAIN)).encode("ascii", "ignore")
        made += plain or character.encode("ascii", "backslashreplace")
    return bytes(made), error.end


codecs.register_error("softness_bayes.fewer", _in_fewer_characters)


def visible(text: str) -> str:
    """Return a text with an escape for each character that controls a terminal or is invisible."""
    return _UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class Tolerant:
    """A text stream that escapes invisible characters, and discards text after its first write error.

    Parameters
    ----------
    stream
        The stream that it writes to.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, or discard."""
        try:
            self._stream.write(visible(text))
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
    """Make standard output and error tolerant and their text visible inside the ``with`` block; yield the output."""
    before = sys.stdout, sys.stderr
    for stream in before:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="softness_bayes.fewer")
    out, err = (None if stream is None else Tolerant(stream) for stream in before)
    sys.stdout, sys.stderr = out, err
    try:
        yield out or Tolerant(None)
    finally:
        for stream in (out, err):
            if stream is not None:
                stream.flush()
        sys.stdout, sys.stderr = before
