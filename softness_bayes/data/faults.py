"""Names of people and fabrics in messages, and the problems of tables, collected in one message."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from itertools import islice
from typing import NamedTuple

from softness_bayes.base.errors import InputError

LONGEST = 100
"""Largest number of characters of a name that is compared with others, and that is shown."""

MOST_GUESSED, MOST_ASKED = 500, 100
"""Largest numbers of names among which, and for which, similar ones are sought in a table."""


def natural(names: Iterable[str]) -> list[str]:
    """Return distinct names, sorted with numbers in numerical order: P2 before P10."""
    return sorted(set(names), key=lambda name: (re.sub("[0-9]+", lambda digits: digits[0].zfill(20), name), name))


def _short(name: str) -> str:
    return name if len(name) <= LONGEST else f"{name[:LONGEST]}…"


def listing(names: Sequence[str], most: int = 8) -> str:
    """Return names for a message, limited to the first few."""
    return ", ".join(map(_short, names[:most])) + (f", … ({len(names)} in all)" if len(names) > most else "")


def shown_names(names: Iterable[str]) -> str:
    """Return names that differ in little, in quotes, with escapes for non-ASCII characters, which show how."""
    return " and ".join(ascii(_short(name)) for name in names)


def guess(name: str, known: Iterable[str]) -> str:
    """Return ' (did you mean ...?)' if one of the first `MOST_GUESSED` known names is similar, otherwise nothing."""
    near = difflib.get_close_matches(name, [*islice(known, MOST_GUESSED)], 1) if len(name) <= LONGEST else []
    return f" (did you mean {near[0]!r}?)" if near else ""


def identity(name: str) -> tuple[str, ...]:
    """Return a key that is equal for names that differ in case, zeros in front, format of numbers or punctuation only.

    Examples
    --------
    >>> identity("P01") == identity("p-1"), identity("1.0") == identity("01"), identity("A 12") == identity("A 1/2")
    (True, True, False)
    """
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    seen = "".join(c for c in folded if c.isspace() or unicodedata.category(c) not in ("Cf", "Cc"))
    text = " ".join(seen.split())
    if re.fullmatch(r"[+-]?[0-9]{1,30}(?:[.,][0-9]{1,30})?", text):
        return (f"{Decimal(text.replace(',', '.')).normalize():f}",)
    text = re.sub(r"(?<=[0-9])[.,]0+$", "", text)
    apart = "".join(" " if c in _BETWEEN or unicodedata.category(c) in ("Pd", "Zs") else c for c in text)
    # a space counts between two numbers only
    joined = re.sub(r"(?<!\d) | (?!\d)", "", " ".join(apart.split()))
    parts = re.findall(r"\d+|[^\d\s]+", joined)
    return tuple(part.lstrip("0") or "0" if part.isdigit() else part for part in parts) or (text,)


_BETWEEN = frozenset('_.,;:/\\()[]{}"#')
DIFFERENCE = "case, zeros in front, the format of numbers, punctuation or invisible characters"
"""Differences of names of one identity."""


Hint = Mapping[str, str]
"""Titles of columns, by standard name, with which a table may be read; `wide` stands for one column per fabric."""

SHOWN = 20
"""Largest number of problem lines per table in a message."""

SHARED, NAMED = 4, 3
"""Number of rows from which a common problem is summarised in one line, and of those that are listed in it."""


class Fault(NamedTuple):
    """A problem of a cell, or of a table."""

    row: int
    """Row of the cell; -1 for problems of the whole table."""
    title: str
    """Column of the cell."""
    problem: str
    """The fault, or the value that was expected."""
    got: str = ""
    """The value of the cell as quoted, if it is what is wrong."""
    remedy: str = ""
    """Advice, said once of equal problems."""


class TableError(InputError):
    """Problems of a table; the message gives its location and lists them.

    Parameters
    ----------
    place
        The file, and its sheet if it has several.
    problems
        Descriptions of the problems, with row and column if applicable.
    hints
        Ways that may mend it.
    """

    def __init__(self, place: str, problems: Sequence[Fault], hints: Sequence[Hint] = ()) -> None:
        self.problems, self.hints = tuple(problems), tuple(hints)
        super().__init__(_message(place, self.problems))

    @property
    def candidates(self) -> list[Hint]:
        """Return the ways to mend it, all at once first, then each of the first few."""
        every: dict[str, str] = {}
        for hint in self.hints:
            if "wide" not in hint and not hint.keys() & every.keys() and not {*hint.values()} & {*every.values()}:
                every |= hint
        return [*([every] if len(every) > 1 else []), *self.hints[:4]]


def _message(place: str, problems: Sequence[Fault]) -> str:
    """Return the problems of a table; those of many rows of a column that differ only in value share a line."""
    groups: dict[tuple[str, str, str], list[Fault]] = {}
    for one in problems:
        groups.setdefault((one.title, one.problem, one.remedy), []).append(one)
    lines: list[tuple[int, str]] = []
    said: set[str] = set()
    for (_, _, remedy), group in groups.items():
        shared = group[0].row != -1 and len(group) >= SHARED
        for some in [group] if shared else [[one] for one in group]:
            lines.append((some[0].row, _line(some) + ("" if remedy in said else remedy)))
            said.add(remedy)
    texts = [text for _, text in sorted(lines, key=lambda line: line[0])]
    if len(problems) == 1:
        return f"{place}: {texts[0]}"
    more = [f"… and {len(texts) - SHOWN} more lines"] if len(texts) > SHOWN else []
    return "\n  ".join([f"{place}: {len(problems)} problems:", *texts[:SHOWN], *more])


def _line(faults: Sequence[Fault]) -> str:
    """Return a problem in words, with the rows and values that have it."""

    def few(texts: Sequence[str]) -> str:
        return ", ".join(texts[:NAMED]) + (f", … and {len(texts) - NAMED} more" if len(texts) > NAMED else "")

    one = faults[0]
    rows = few([str(fault.row) for fault in faults])
    place = "" if one.row == -1 else f"row{'s' * (len(faults) > 1)} {rows}, column {one.title!r}: "
    got = f", got {few([*dict.fromkeys(fault.got for fault in faults)])}" if one.got else ""
    return f"{place}{one.problem}{got}"
