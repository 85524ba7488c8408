"""Names of people and fabrics: sorting, suggestions for misspelt ones, and detection of similar names."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence

_LONGEST_GUESSED = 100

MOST_GUESSED, MOST_ASKED = 500, 100
"""Largest numbers of names among which, and for which, similar ones are sought in a table."""


def natural(names: Iterable[str]) -> list[str]:
    """Return distinct names, sorted with numbers in numerical order: P2 before P10."""

    def key(name: str) -> tuple[str, str]:
        return re.sub("[0-9]+", lambda digits: digits[0].zfill(20), name), name

    return sorted(set(names), key=key)


def listing(names: Sequence[str], most: int = 8) -> str:
    """Return names for a message, limited to the first few."""
    shown = [name if len(name) <= _LONGEST_GUESSED else f"{name[:_LONGEST_GUESSED]}…" for name in names[:most]]
    return ", ".join(shown) + (f", … ({len(names)} in all)" if len(names) > most else "")


class Guesses:
    """Suggestions for misspelt names: a known name that looks identical, or is similar.

    Similar names are sought among the first `MOST_GUESSED` known ones, and for the first `MOST_ASKED` misspelt ones.

    Parameters
    ----------
    known
        The known names.
    """

    def __init__(self, known: Iterable[str]) -> None:
        names = list(known)
        self._looks = {_look(name): name for name in reversed(names)}
        self._known = names[:MOST_GUESSED]
        self._left = MOST_ASKED

    def of(self, name: str) -> str:
        """Return ' (did you mean ...?)' if there is such a name, otherwise an empty text."""
        if alike := self._looks.get(_look(name)):
            return f" (which has {_shown(alike)} for {_shown(name)}: they differ in {_DIFFERENCE} only)"
        self._left -= 1
        if len(name) > _LONGEST_GUESSED or self._left < 0:
            return ""
        near = difflib.get_close_matches(name, self._known, 1)
        return f" (did you mean {near[0]!r}?)" if near else ""


def alike_notes(kind: str, names: Iterable[str]) -> list[str]:
    """Return notes on names so similar that they may be the same; names are kept as written.

    Parameters
    ----------
    kind
        Column of the names, such as 'participant'.
    names
        All of them.
    """
    groups: dict[str, list[str]] = {}
    for name in natural(names):
        groups.setdefault(_look(name), []).append(name)
    pairs = [" and ".join(map(_shown, group)) for group in groups.values() if len(group) > 1]
    if not pairs:
        return []
    return [f"column {kind!r}: {listing(pairs)} differ only in {_DIFFERENCE}; they are kept apart"]


_DIFFERENCE = "case, Unicode form or invisible characters"


def _look(name: str) -> str:
    """Return a key that is equal for names that look alike."""
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return " ".join("".join(c for c in folded if c.isspace() or unicodedata.category(c) not in ("Cf", "Cc")).split())


def _shown(name: str) -> str:
    """Return a name in quotes, with escapes for non-ASCII characters, which make differences visible."""
    return ascii(name if len(name) <= _LONGEST_GUESSED else f"{name[:_LONGEST_GUESSED]}…")
