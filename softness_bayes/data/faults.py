"""Problems of tables, collected to be reported in one message, and suggestions for misspelt names."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from itertools import islice
from typing import NamedTuple

from softness_bayes.errors import InputError

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


def guess(name: str, known: Iterable[str]) -> str:
    """Return ' (did you mean ...?)' if one of the first `MOST_GUESSED` known names is similar, otherwise nothing."""
    if len(name) > _LONGEST_GUESSED:
        return ""
    near = difflib.get_close_matches(name, [*islice(known, MOST_GUESSED)], 1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def look(name: str) -> str:
    """Return a key that is equal for names that look alike."""
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return " ".join("".join(c for c in folded if c.isspace() or unicodedata.category(c) not in ("Cf", "Cc")).split())


def identity(name: str) -> tuple[str, ...]:
    """Return a key that is equal for names that differ in case, zeros in front, format of numbers or punctuation only.

    Examples
    --------
    >>> identity("P01") == identity("p-1"), identity("1.0") == identity("01"), identity("A 12") == identity("A 1/2")
    (True, True, False)
    """
    text = look(name)
    if re.fullmatch(r"[+-]?[0-9]{1,30}(?:[.,][0-9]{1,30})?", text):
        return (f"{Decimal(text.replace(',', '.')).normalize():f}",)
    text = re.sub(r"(?<=[0-9])[.,]0+$", "", text)
    apart = "".join(" " if c in _BETWEEN or unicodedata.category(c) in ("Pd", "Zs") else c for c in text)
    parts: list[str] = []
    for part in re.findall(r"\d+|[^\d\s]+", apart):
        if parts and not part.isdigit() and not parts[-1].isdigit():
            parts[-1] += part
        else:
            parts.append(part.lstrip("0") or "0" if part.isdigit() else part)
    return tuple(parts) or (text,)


_BETWEEN = frozenset('_.,;:/\\()[]{}"#')
DIFFERENCE = "case, zeros in front, the format of numbers, punctuation or invisible characters"
"""Differences of names of one identity."""


def shown_names(names: Iterable[str]) -> str:
    """Return names that differ in little, in quotes, with escapes for non-ASCII characters, which show how."""
    short = (name if len(name) <= _LONGEST_GUESSED else f"{name[:_LONGEST_GUESSED]}…" for name in names)
    return " and ".join(map(ascii, short))


Hint = Mapping[str, str]
"""Titles of columns, by standard name, with which a table may be read; `wide` stands for one column per fabric."""

MOST_HINTS = 4
"""Largest number of ways to mend a table that are tried."""

SHOWN = 20
"""Largest number of problem lines per table in a message."""

SHARED = 4
"""Number of rows from which a common problem is summarised in one line."""

NAMED = 3
"""Number of rows, and of different values, listed in such a line."""


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

    def line(self, rows: Sequence[int] = (), values: Sequence[str] = (), remedy: str = "") -> str:
        """Return the problem in words, by default of its own row and value."""
        own = [*map(str, rows)] or [str(self.row)]
        place = "" if self.row == -1 else f"row{'s' * (len(own) > 1)} {_named(own)}, column {self.title!r}: "
        got = f", got {_named(values or [self.got])}" if self.got else ""
        return f"{place}{self.problem}{got}{remedy}"


class TableError(InputError):
    """Problems of a table; the message gives its location and lists them.

    Parameters
    ----------
    place
        The file, and its sheet if it has several.
    problems
        Descriptions of the problems, with row and column if applicable.
    hints
        What may mend it.

    Attributes
    ----------
    remedy
        What mends it, as options of the command line, tried before.
    """

    def __init__(self, place: str, problems: Sequence[Fault | str], hints: Sequence[Hint] = ()) -> None:
        self.place = place
        self.hints = tuple(hints)
        self.remedy = ""
        self.problems = tuple(Fault(-1, "", one) if isinstance(one, str) else one for one in problems)
        super().__init__(_message(place, self.problems))

    @property
    def candidates(self) -> list[Hint]:
        """Return the ways to mend it, all at once first, then each."""
        every: dict[str, str] = {}
        for hint in self.hints:
            if not hint.keys() & every.keys() and not {*hint.values()} & {*every.values()}:
                every |= hint
        return [*([every] if len(every) > 1 else []), *self.hints[:MOST_HINTS]]

    def __str__(self) -> str:
        return str(self.args[0]) + (f"\n  try: {self.remedy}" if self.remedy else "")


def together(errors: Sequence[TableError]) -> TableError:
    """Combine the errors of several tables into one, with each problem of a table listed once."""
    by_place: dict[str, dict[Fault, None]] = {}
    for error in errors:
        # if a table was read twice, the later attempt found more problems, in order
        by_place[error.place] = dict.fromkeys(error.problems) | by_place.get(error.place, {})
    every = [problem for problems in by_place.values() for problem in problems]
    combined = TableError(errors[0].place, every, [hint for error in errors for hint in error.hints])
    combined.args = ("\n".join(_message(place, tuple(problems)) for place, problems in by_place.items()),)
    return combined


def _message(place: str, problems: Sequence[Fault]) -> str:
    lines = _lines(problems)
    if len(problems) == 1:
        return f"{place}: {lines[0]}"
    shown = f", of which the first {SHOWN} are" if len(lines) > SHOWN else ""
    if len(lines) == 1:
        return f"{place}: {len(problems)} equal problems in {lines[0]}"
    if shown and len(lines) < len(problems):
        shown = f" in {len(lines)} lines{shown}"
    return "\n  ".join([f"{place}: {len(problems)} problems{shown}:", *lines[:SHOWN]])


def _lines(problems: Sequence[Fault]) -> list[str]:
    """Return a line for each problem; problems of many rows of a column that differ only in value share a line."""
    shared: dict[tuple[str, str, str], list[Fault]] = {}
    for one in problems:
        shared.setdefault((one.title, one.problem, one.remedy), []).append(one)
    lines: list[tuple[int, str]] = []
    said: set[str] = set()
    for members in shared.values():
        together = members[0].row != -1 and len(members) >= SHARED
        for one in members[:1] if together else members:
            remedy = "" if one.remedy in said else one.remedy
            said.add(one.remedy)
            rows, values = [m.row for m in members], [*dict.fromkeys(m.got for m in members)]
            lines.append((one.row, one.line(rows, values, remedy) if together else one.line(remedy=remedy)))
    return [text for _, text in sorted(lines, key=lambda line: line[0])]


def _named(texts: Sequence[str]) -> str:
    """Return the first few texts, and the number of further ones."""
    more = f", … and {len(texts) - NAMED} more" if len(texts) > NAMED else ""
    return ", ".join(texts[:NAMED]) + more


class Faults:
    """The problems found in a table."""

    def __init__(self) -> None:
        self._found: dict[tuple[int, str], Fault] = {}
        self.hints: list[Hint] = []

    def add(self, fault: Fault) -> None:
        """Add the problem of a cell, unless the cell already has one."""
        self._found.setdefault((fault.row, fault.title), fault)

    def add_general(self, problem: str, hints: Sequence[Hint] = ()) -> None:
        """Add a problem of the whole table, and what may mend it."""
        self.hints += hints
        self._found.setdefault((-1, problem), Fault(-1, "", problem))

    def __bool__(self) -> bool:
        return bool(self._found)

    def __contains__(self, cell: tuple[int, str]) -> bool:
        return cell in self._found

    @property
    def rows(self) -> set[int]:
        """The rows that have a problem."""
        return {row for row, _ in self._found}

    @property
    def listed(self) -> list[Fault]:
        """The problems, general ones first, then by their rows."""
        return [self._found[cell] for cell in sorted(self._found, key=lambda cell: cell[0])]
