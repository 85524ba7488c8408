"""Command lines as text that any file can hold and a shell takes again."""

from __future__ import annotations

import os
import re

_QUOTED = re.compile(r"\"[^\"]*\"|'[^']*'")
_PLAIN = re.compile(rb"[ !\"#-&(-\[\]-~]")


def storable(command: str) -> str:
    r"""Return a command line with bytes that are not UTF-8 written as escapes, ``$'caf\xe9.csv'``.

    Parameters
    ----------
    command
        As `shlex.join` writes it; Python keeps such bytes as surrogates, which no UTF-8 file can hold.
    """
    return _QUOTED.sub(lambda found: found[0] if _is_text(found[0]) else _escaped(found[0][1:-1]), command)


def _is_text(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _escaped(text: str) -> str:
    single = (bytes([byte]) for byte in os.fsencode(text))
    return "$'" + "".join(b.decode() if _PLAIN.match(b) else f"\\x{b[0]:02x}" for b in single) + "'"
