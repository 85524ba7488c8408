"""Decimal marks: which one the numbers of a table are written with, and numbers without it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

MARKS = (",", ".")
"""What may stand before the decimals."""


class Cell(NamedTuple):
    """A number as it stands in a file, and where."""

    text: str
    column: str
    row: int

    @property
    def place(self) -> str:
        """Row and column in words."""
        return f"row {self.row}, column {self.column!r}"


class Reading(NamedTuple):
    """What the numbers of a table say of their decimal mark."""

    mark: str
    note: str = ""
    """What was assumed of a number that could have been another."""
    unclear: Cell | None = None
    """A number that may have decimals or grouped thousands, where no other number decides."""


def decimal_mark(columns: Iterable[Sequence[Cell]]) -> Reading:
    """Find the decimal mark of a table whose cells are not separated by commas.

    Three digits behind a comma may be decimals or thousands, as in 1,234. Any number of the table that can
    have decimals only, as 0,82, decides for all. So does a column in which every number has a point and
    three digits, as programs write them; one that mixes these with whole numbers does not.

    Parameters
    ----------
    columns
        The columns of numbers, without the cells that are none.
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
            f"{unclear.place}: {unclear.text} is read as {assumed}, for {deciding.text} in {deciding.place} has a "
            "decimal comma; --decimal . says otherwise",
        )
    points = [cell for cell in every if "." in cell.text]
    if all(_grouped(".").fullmatch(cell.text) for cell in points):
        for cells in columns:
            marked = [cell for cell in cells if "." in cell.text]
            if 0 < len(marked) < len(cells):
                return Reading(".", unclear=marked[0])
    return Reading(".")


def plain(text: str, mark: str, declared: bool) -> str:
    """Return a number with a decimal point and no grouped thousands, which may stand where the mark was declared.

    Raises
    ------
    ValueError
        If it is not written with this mark; the message says what was expected.
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
