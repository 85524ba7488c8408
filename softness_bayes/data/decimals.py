"""Decimal marks: recognition of the mark of a table, and its conversion to a point."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

MARKS = (",", ".")
"""The possible decimal marks."""


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
    """Evidence of a table's numbers about its decimal mark."""

    mark: str
    note: str = ""
    """Assumption about an ambiguous number."""
    unclear: Cell | None = None
    """A number that may have decimals or grouped thousands, if no other number decides."""


def decimal_mark(columns: Iterable[Sequence[Cell]]) -> Reading:
    """Find the decimal mark of a table whose cells are not separated by commas.

    Three digits behind a comma may be decimals or thousands, as in 1,234. A number that can only have
    decimals, such as 0,82, decides for the whole table. So does a column in which every number has a point and
    three digits, as programs write them; a column that mixes these with whole numbers does not decide.

    Parameters
    ----------
    columns
        The columns of numbers, without their missing cells.
    """
    columns = [list(cells) for cells in columns]
    every = [cell for cells in columns for cell in cells]
    if commas := [cell for cell in every if _marked(",").fullmatch(cell.text)]:
        deciding = next((cell for cell in commas if not _grouped(",").fullmatch(cell.text)), None)
        unclear = next((cell for cell in commas if _grouped(",").fullmatch(cell.text)), None)
        if unclear is None:
            return Reading(",")
        if deciding is None:
            return Reading(",", unclear=unclear)
        assumed = unclear.text.replace(",", ".")
        return Reading(
            ",",
            f"{unclear.place}: {unclear.text} is read as {assumed}, because {deciding.text} in {deciding.place} has a "
            "decimal comma; --decimal . reads it otherwise",
        )
    points = [cell for cell in every if "." in cell.text]
    if all(_grouped(".").fullmatch(cell.text) for cell in points):
        for cells in columns:
            marked = [cell for cell in cells if "." in cell.text]
            if 0 < len(marked) < len(cells):
                return Reading(".", unclear=marked[0])
    return Reading(".")


def plain(text: str, mark: str, declared: bool) -> str:
    """Return a number with a decimal point and no grouped thousands, which are allowed only if the mark is declared.

    Raises
    ------
    ValueError
        If the number is not written with this mark; the message says what was expected.
    """
    other = MARKS[mark == ","]
    if other in text and mark != other:
        groups = re.compile(rf"([+-]?[0-9]{{1,3}}(?:\{other}[0-9]{{3}})+)(\{mark}[0-9]*)?")
        if declared and groups.fullmatch(text):
            text = text.replace(other, "")
        elif mark == ",":
            raise ValueError("expected a decimal comma, as elsewhere in this file")
    return text.replace(mark, ".")


def _marked(mark: str) -> re.Pattern[str]:
    return re.compile(rf"[+-]?[0-9]*\{mark}[0-9]+(?:[eE][+-]?[0-9]+)?")


def _grouped(mark: str) -> re.Pattern[str]:
    return re.compile(rf"[+-]?[1-9][0-9]{{0,2}}\{mark}[0-9]{{3}}")
