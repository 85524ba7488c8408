"""Names of people and fabrics: sorting, suggestions for misspelt ones, and detection of similar names."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence

_LONGEST_GUESSED = 100


def natural(names: Iterable[str]) -> list[str]:
    """Return distinct names, sorted with numbers in numerical order: P2 before P10."""

    def key(name: str) -> tuple[str, str]:
        return re.sub("[0-9]+", lambda digits: digits[0].zfill(20), name), name

    return sorted(set(names), key=key)


def listing(names: Sequence[str], most: int = 8) -> str:
    """Return names for a message, limited to the first few."""
    shown = [name if len(name) <= _LONGEST_GUESSED else f"{name[:_LONGEST_GUESSED]}…" for name in names[:most]]
    return ", ".join(shown) + (f", … ({len(names)} in all)" if len(names) > most else "")


def guess(name: str, known: Iterable[str]) -> str:
    """Return ' (did you mean ...?)' if a known name is similar or looks identical, otherwise an empty text."""
    known = list(known)
    if alike := [other for other in known if _look(other) == _look(name)]:
        return f" (which has {_shown(alike[0])} for {_shown(name)}: they differ in {_DIFFERENCE} only)"
    if len(name) > _LONGEST_GUESSED:
        return ""
    near = difflib.get_close_matches(name, known, 1)
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
