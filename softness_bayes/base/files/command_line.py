"""Command lines as text that can be stored and shared."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

_QUOTED = re.compile(r"\"[^\"]*\"|'[^']*'")
_PLAIN = re.compile(rb"[ !\"#-&(-\[\]-~]")


def storable(command: str) -> str:
    r"""Return a command line with bytes that are not UTF-8 written as escapes, ``$'caf\xe9.csv'``.

    Parameters
    ----------
    command
        As `shlex.join` writes it; Python keeps such bytes as surrogates, which a UTF-8 file cannot store.
    """

    def written(found: re.Match[str]) -> str:
        if found[0].encode(errors="ignore").decode() == found[0]:
            return found[0]
        single = (bytes([byte]) for byte in os.fsencode(found[0][1:-1]))
        return "$'" + "".join(b.decode() if _PLAIN.match(b) else f"\\x{b[0]:02x}" for b in single) + "'"

    return _QUOTED.sub(written, command)


def portable(word: str, here: Path) -> str:
    """Return a word of a command line without an absolute path, which would reveal the machine and its owner.

    Parameters
    ----------
    word
        A word, or an option and a value tied by ``=``.
    here
        Directory to which paths below it become relative; of other paths only the last name is kept.
    """
    flag, tied, value = word.partition("=") if word.startswith("--") else ("", "", word)
    if not os.path.isabs(value):
        return word
    below = os.path.relpath(value, here)
    return f"{flag}{tied}{Path(value).name or '.' if below.split(os.sep)[0] == os.pardir else below}"


def endings(paths: Sequence[Path]) -> list[str]:
    """Return short distinct names of paths: relative ones unchanged, of absolute ones the fewest last parts."""
    names = [str(path) for path in paths]  # of "" and "." there are no parts
    for size in range(1, max(len(path.parts) for path in paths) + 1):
        names = [str(Path(*path.parts[-size:]) if path.is_absolute() else path) for path in paths]
        if len({*names}) == len({*paths}):
            break
    return names
