"""Checksum of a whole file at its end, verified before any library reads the file.

HDF5 trusts what it reads. A single damaged byte can send it into an endless loop
(https://github.com/HDFGroup/hdf5/issues/1707) or end the process, before the checksums of the content are reached.
HDF5 does not read beyond the end that it has noted itself, so that every program opens a sealed file. A program that
changes the file overwrites the seal or leaves it out; the checksums of the content then tell what was changed.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

SEAL = b"\nsoftness-bayes: SHA-256 of all before this line: "
"""Text before the checksum; 64 hexadecimal digits and a line break follow it."""

_LENGTH = len(SEAL) + 65
_CHUNK = 1 << 20


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
    left = path.stat().st_size - _LENGTH
    if left < 0:
        return False
    digest = hashlib.sha256()
    with path.open("rb") as file:
        file.seek(left)
        seal = re.fullmatch(re.escape(SEAL) + rb"(.{64})\n", file.read(), re.DOTALL)
        if seal is None:
            return False
        file.seek(0)
        while left and (chunk := file.read(min(left, _CHUNK))):
            digest.update(chunk)
            left -= len(chunk)
    return digest.hexdigest().encode() != seal[1]
