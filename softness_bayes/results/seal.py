"""Checksum of a whole file at its end, verified before any library reads the file.

HDF5 trusts what it reads. A single damaged byte can send it into an endless loop
(https://github.com/HDFGroup/hdf5/issues/1707) or end the process, before the checksums of the content are reached.
HDF5 does not read beyond the end that it has noted itself, so that every program opens a sealed file. A program that
changes the file overwrites the seal or leaves it out; the checksums of the content then tell what was changed.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

SEAL = b"\nsoftness-bayes: SHA-256 of all before this line: "
"""Text before the checksum; 64 hexadecimal digits and a line break follow it."""

_LENGTH = len(SEAL) + 65


def seal_of(content: bytes | memoryview) -> bytes:
    """Return what is written after the content of a file."""
    return SEAL + hashlib.sha256(content).hexdigest().encode() + b"\n"


def is_broken(path: Path) -> bool:
    """Return whether a file has a seal that its content does not match; False for a file without a seal.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    whole = path.read_bytes()
    start = len(whole) - _LENGTH
    if not (whole.startswith(SEAL, start) and whole.endswith(b"\n")):
        return False
    return whole[start:] != seal_of(memoryview(whole)[:start])
