"""Atomic writing of files, even if the process is killed or the disk is full, and checksums at their ends."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from softness_bayes.base.errors import InputError

SEAL = b"\nsoftness-bayes: SHA-256 of all before this line: "
"""Text before the checksum of a file; 64 hexadecimal digits and a line break follow it."""

_PART = re.compile(r"\.softness-bayes-[0-9a-f]{32}\.part")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically: under another name, synced to the disk, then renamed.

    Raises
    ------
    InputError
        If the path is a symbolic link.
    OSError
        If there is no room or no permission; the earlier file is then unchanged, or the new one is whole.
    """
    if path.is_symlink():
        raise InputError(f"{path}: is a symbolic link, and files are not written through links; move it away")
    put({path: staged(path, content)})


def staged(path: Path, content: bytes) -> Path:
    """Write content to the disk next to a path, under a random name, and return that name.

    Raises
    ------
    OSError
        If it cannot be written; no part of it is left.
    """
    part = path.with_name(f".softness-bayes-{secrets.token_hex(16)}.part")
    try:
        with open(part, "xb") as file:  # a new file: nothing is written through a link
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):
            error.filename = str(path)
        raise
    return part


def put(parts: Mapping[Path, Path]) -> None:
    """Rename staged files to their own names, replacing earlier files.

    Parameters
    ----------
    parts
        Paths of the staged files by final path, all in one directory.

    Raises
    ------
    OSError
        If that fails; files that are not yet renamed are removed.
    """
    waiting = dict(parts)
    try:
        for path, part in parts.items():
            os.replace(part, path)
            del waiting[path]
        # the names too, or a whole file could lack its own after a crash; on Windows directories cannot be opened
        for directory in {path.parent for path in parts} if os.name != "nt" else ():
            handle = os.open(directory, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise
    finally:
        discard(waiting.values())


def seal_of(content: bytes | memoryview) -> bytes:
    """Return what is written after the content of a file that ends with its checksum."""
    return SEAL + hashlib.sha256(content).hexdigest().encode() + b"\n"


def unsealed(whole: bytes) -> memoryview | None:
    """Return the content of a file before its checksum; None if the file does not end with the right one."""
    content = memoryview(whole)[: max(0, len(whole) - len(seal_of(b"")))]
    return content if whole[len(content) :] == seal_of(content) else None


def discard(parts: Iterable[Path]) -> None:
    """Remove staged files."""
    for part in parts:
        with suppress(OSError):
            part.unlink()


def is_part(path: Path) -> bool:
    """Return whether a file has the name of a staged file."""
    return _PART.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink()
