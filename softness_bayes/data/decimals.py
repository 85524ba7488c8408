"""Decimal marks: what the numbers of a table say about them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from softness_bayes.errors import InputError

MARKS = (",", ".")
"""The possible decimal marks."""

MARKED = ("ratings", "fabrics", "compression", "afferents")
"""Tables that may have different marks."""

Marks: TypeAlias = str | Mapping[str, str] | None
"""The mark of all tables, or marks by table; None, or a missing table, to infer it from the numbers."""


def mark_of(marks: Marks, table: str) -> str | None:
    """Return the mark given for a table; None if there is none.

    Raises
    ------
    InputError
        If there is no such mark or table.
    """
    given = dict.fromkeys(MARKED, marks) if isinstance(marks, str) else marks or {}
    for name, mark in given.items():
        if name not in MARKED or mark not in MARKS:
            raise InputError(
                f"decimal is {marks!r}, expected one of {', '.join(map(repr, MARKS))}, or a mark for each of "
                f"some of the tables {', '.join(MARKED)}"
            )
    return given.get(table)


_SPACES = re.compile("[\u00a0\u2009\u202f'\u2019]")
_SPACED = re.compile(rf"[+-]?[0-9]{{1,3}}(?:{_SPACES.pattern}[0-9]{{3}})+(?:[.,][0-9]+)?")


class Cell(NamedTuple):
    """A number as written in a file, and its place."""

    text: str
    column: str
    row: int

    @property
    def place(self) -> str:
        """Row and column in words."""
        return f"row {self.row}, column {self.column!r}"


class Reading(NamedTuple):
    """Evidence in a table's numbers about its decimal mark."""

    mark: str
    note: str = ""
    """Assumption about an ambiguous number."""
    unclear: Cell | None = None
    """An ambiguous number, with decimals or grouped thousands, if no other number decides."""
    grouped: bool = False
    """True if the other mark groups thousands, as shown by an unambiguous number."""


def decimal_mark(columns: Iterable[Sequence[Cell]], between_commas: bool = False) -> Reading:
    """Find the decimal mark of a table, and whether the other mark groups thousands.

    Three digits after a comma may be decimals or thousands, as in 1,234. A number that can only have decimals, such as
    0,82, determines the mark of the whole table, as does one that can only have grouped thousands, such as 1,234.5 or
    1,234,567. The same holds for a column in which every number has a point and three digits, as written by programs; a
    column that mixes these with whole numbers is ambiguous.

    Parameters
    ----------
    columns
        The columns of numbers, without their missing cells.
    between_commas
        Whether commas separate the cells, so that the decimal mark is a point.
    """
    columns = [[cell._replace(text=_unspaced(cell.text)) for cell in cells] for cells in columns]

    def first(mark: str, what: str) -> Cell | None:
        pattern = _PATTERNS[mark][what]
        return next((cell for cells in columns for cell in cells if pattern.fullmatch(cell.text)), None)

    for mark in (".",) if between_commas else MARKS:
        other = MARKS[mark == ","]
        shows = first(mark, "thousands")
        if shows and not first(other, "thousands") and not first(other, "decimals"):
            return Reading(mark, _assumed(first(other, "either"), mark, shows, "thousands separators"), grouped=True)
    if between_commas:
        return Reading(".")
    unclear, shows = first(",", "either"), first(",", "decimals")
    if shows:
        return Reading(",", _assumed(unclear, ",", shows, "a decimal comma"))
    if unclear:
        return Reading(",", unclear=unclear)
    marked = [[cell for cell in cells if "." in cell.text] for cells in columns]
    if all(_PATTERNS["."]["either"].fullmatch(cell.text) for cells in marked for cell in cells):
        mixed = (some[0] for some, cells in zip(marked, columns, strict=True) if 0 < len(some) < len(cells))
        return Reading(".", unclear=next(mixed, None))
    return Reading(".")


def _patterns(mark: str, other: str) -> dict[str, re.Pattern[str]]:
    """Return patterns of numbers that can only have decimals behind a mark, decimals or thousands, only thousands."""
    either = rf"[+-]?[1-9][0-9]{{0,2}}\{mark}[0-9]{{3}}"
    groups = rf"[+-]?[1-9][0-9]{{0,2}}(?:\{other}[0-9]{{3}})"
    return {
        "decimals": re.compile(rf"(?!{either}\Z)[+-]?[0-9]*\{mark}[0-9]+(?:[eE][+-]?[0-9]+)?"),
        "either": re.compile(either),
        "thousands": re.compile(rf"{groups}+\{mark}[0-9]+|{groups}{{2,}}"),
    }


_PATTERNS = {",": _patterns(",", "."), ".": _patterns(".", ",")}


def _assumed(unclear: Cell | None, mark: str, shows: Cell, what: str) -> str:
    """Return the note on a number of two meanings that another number decides, empty if there is none."""
    if unclear is None:
        return ""
    other = MARKS[mark == ","]
    read = unclear.text.replace(other, "").replace(mark, ".")
    return (
        f"{unclear.place}: {unclear.text} is read as {read}, because {shows.text} in {shows.place} has {what}; "
        f"--decimal {other} reads it otherwise"
    )


def plain(text: str, mark: str, declared: bool) -> str:
    """Return a number with a decimal point and no grouped thousands.

    Parameters
    ----------
    text
        The number as written.
    mark
        Its decimal mark.
    declared
        Whether the other mark is known to group thousands. No-break or thin spaces and apostrophes always do.

    Raises
    ------
    ValueError
        If the number is not written with this mark; the message says what was expected.
    """
    other, text = MARKS[mark == ","], _unspaced(text)
    if other in text and mark != other:
        groups = re.compile(rf"([+-]?[0-9]{{1,3}}(?:\{other}[0-9]{{3}})+)(\{mark}[0-9]*)?")
        if declared and groups.fullmatch(text):
            text = text.replace(other, "")
        elif mark == "," and text.strip("+-0123456789.,eE") == "":
            raise ValueError("expected a decimal comma, as elsewhere in this file")
    return text.replace(mark, ".")


def _unspaced(text: str) -> str:
    """Return a number without the spaces (other than plain ones) or apostrophes that group its thousands."""
    return _SPACES.sub("", text) if _SPACED.fullmatch(text) else text
