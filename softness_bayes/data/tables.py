"""Tables as named columns of text: titles, units, decimal marks, and errors that name the place."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.data.columns import MISSING, RATING, Column, Unit, unit_named
from softness_bayes.data.faults import Faults, Hint, TableError, listing
from softness_bayes.data.sheets import SheetNumber
from softness_bayes.errors import InputError, quoted

MARKS = (",", ".")
"""The possible decimal marks."""

MARKED = ("ratings", "fabrics", "compression")
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
    every = [cell for cells in columns for cell in cells]
    for mark in (".",) if between_commas else MARKS:
        other = _PATTERNS[MARKS[mark == ","]]
        shows = _first(every, _PATTERNS[mark].thousands)
        if shows and not _first(every, other.thousands) and not _first(every, other.decimals):
            return Reading(
                mark, _assumed(_first(every, other.either), mark, shows, "thousands separators"), grouped=True
            )
    if between_commas:
        return Reading(".")
    unclear, shows = _first(every, _PATTERNS[","].either), _first(every, _PATTERNS[","].decimals)
    if shows:
        return Reading(",", _assumed(unclear, ",", shows, "a decimal comma"))
    if unclear:
        return Reading(",", unclear=unclear)
    marked = [[cell for cell in cells if "." in cell.text] for cells in columns]
    if all(_PATTERNS["."].either.fullmatch(cell.text) for cells in marked for cell in cells):
        mixed = (some[0] for some, cells in zip(marked, columns, strict=True) if 0 < len(some) < len(cells))
        return Reading(".", unclear=next(mixed, None))
    return Reading(".")


class _Patterns(NamedTuple):
    """Patterns of numbers with a decimal mark."""

    decimals: re.Pattern[str]
    """Numbers that can only have decimals behind the mark."""
    either: re.Pattern[str]
    """Numbers that have decimals behind the mark, or thousands grouped by it."""
    thousands: re.Pattern[str]
    """Numbers that can only have decimals behind the mark and thousands grouped by the other one."""


def _patterns(mark: str, other: str) -> _Patterns:
    either = rf"[+-]?[1-9][0-9]{{0,2}}\{mark}[0-9]{{3}}"
    groups = rf"[+-]?[1-9][0-9]{{0,2}}(?:\{other}[0-9]{{3}})"
    return _Patterns(
        re.compile(rf"(?!{either}\Z)[+-]?[0-9]*\{mark}[0-9]+(?:[eE][+-]?[0-9]+)?"),
        re.compile(either),
        re.compile(rf"{groups}+\{mark}[0-9]+|{groups}{{2,}}"),
    )


_PATTERNS = {",": _patterns(",", "."), ".": _patterns(".", ",")}


def _first(cells: Iterable[Cell], pattern: re.Pattern[str]) -> Cell | None:
    return next((cell for cell in cells if pattern.fullmatch(cell.text)), None)


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


def _numbered(titles: Sequence[str]) -> list[str]:
    """Return titles that differ in a number at their end alone."""
    stems = {title: match[1] for title in titles if (match := re.fullmatch(r"(.*?)[\s_.#-]*[0-9]{1,3}", title))}
    count = Counter(stems.values())
    return [title for title, stem in stems.items() if count[stem] > 1]


FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_DATE = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}|[0-9]{1,2}[./-](?:[0-9]{1,2}[./-][0-9]{2,4}|[A-Za-z]{3})")


@dataclass(frozen=True)
class Table:
    """The known columns of a file, as stripped text under their standard names."""

    place: str
    """The file, and its sheet if it has several."""
    label: str
    """Name of the file, for notes."""
    digest: str
    """SHA-256 of the file's bytes."""
    cells: Mapping[str, Sequence[str]]
    titles: Mapping[str, str]
    """Standard name of a column -> its name in the file's header."""
    units: Mapping[str, Unit]
    """Standard name of a column -> its unit, where that is not the one in the standard name."""
    rows: IntArray
    """Line of each row in the file; the header is line 1."""
    decimal: str
    grouped: bool
    """True if the other mark may group thousands: the user named the decimal mark, or a number shows it."""
    notes: tuple[str, ...]
    columns: Sequence[str] = ()
    """Title of the column that each row is from, if the file has one for each fabric."""
    made: tuple[str, ...] = ()
    """Standard names of the columns that such a file does not have."""
    others: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Title of a column that is not used -> its cells."""
    perhaps: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Title of a column that is not used -> the standard name that it may have, and a remark."""
    faults: Faults = field(default_factory=Faults)
    """Problems found in the table so far."""

    def __len__(self) -> int:
        return len(self.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def fault(self, i: int, name: str, problem: str) -> None:
        """Add the problem of a cell; `check` raises it."""
        self.faults.add(int(self.rows[i]), self._title(i, name), problem)

    def is_faulty(self, i: int, name: str) -> bool:
        """Return whether a problem of the cell has been found."""
        return (int(self.rows[i]), self._title(i, name)) in self.faults

    def _title(self, i: int, name: str) -> str:
        return self.columns[i] if name in self.made else self.titles[name]

    def check(self) -> None:
        """Raise the error that lists all problems found, if there are any."""
        if self.faults:
            raise TableError(self.place, self.faults.listed, self.faults.hints)

    def take(self, index: IntArray) -> Table:
        """Return the rows at `index`."""
        cells, others = (
            {name: [texts[i] for i in index] for name, texts in columns.items()}
            for columns in (self.cells, self.others)
        )
        columns = [self.columns[i] for i in index] if self.columns else ()
        return replace(self, cells=cells, others=others, rows=self.rows[index], columns=columns)

    def lack(self, problem: str, *names: str, wide: bool = False) -> None:
        """Add that some columns are missing, with the titles that there are and what may mend it."""
        hints: list[Hint] = [{}]
        for name in names:
            may_be = [title for title, (own, _) in self.perhaps.items() if own == name][:3]
            hints = [{**hint, name: title} for title in may_be for hint in hints if title not in hint.values()] or hints
        titles = [quoted(title) for title in (*self.titles.values(), *self.others)]
        remarks = dict.fromkeys(remark for name, remark in self.perhaps.values() if name in names and remark)
        told = [problem, *(f"its columns are {listing(titles)}" for _ in titles[:1]), *[*remarks][:1]]
        ways = [hint for hint in hints if hint] + ([{"wide": ""}] if wide else [])
        self.faults.add_general("; ".join(told), ways)

    def require(self, *names: str) -> None:
        """Raise an error for a table without one of the columns `names`, with all other problems found."""
        if absent := [name for name in names if name not in self]:
            series = _numbered([*self.others]) if RATING.name in absent else []
            if series:
                self.faults.add_general(
                    f"columns {listing([quoted(title) for title in series])} look like repeated ratings: put each "
                    "rating in a separate row, in a column 'rating'"
                )
            else:
                what = " and ".join(map(repr, absent))
                self.lack(f"no column{'s' * (len(absent) > 1)} {what}", *absent, wide=RATING.name in absent)
            self.check()

    def labels(self, name: str) -> Sequence[str]:
        """Return a column of names; an empty one is a fault."""
        self.require(name)
        for i, text in enumerate(self.cells[name]):
            if not text:
                self.fault(i, name, "expected a name, got ''")
        return self.cells[name]

    def plainly(self, name: str) -> FloatArray:
        """Return the numbers of a column in its own unit, NaN for all other cells, whatever is wrong with them."""
        values = np.full(len(self), np.nan)
        for i, text in enumerate(self.cells.get(name, ())):
            try:
                values[i] = float(text if isinstance(text, SheetNumber) else plain(text, self.decimal, self.grouped))
            except ValueError:
                continue
        return np.where(np.isfinite(values), values, np.nan)

    def numbers(self, column: Column) -> FloatArray:
        """Return a column of numbers [SI], NaN for a missing cell or column, and for a fault."""
        values = np.full(len(self), np.nan)
        for i, text in enumerate(self.cells.get(column.name, ())):
            if text.casefold() in MISSING:
                continue
            try:
                number = text if isinstance(text, SheetNumber) else plain(text, self.decimal, self.grouped)
            except ValueError as error:
                self.fault(i, column.name, f"{error}, got {quoted(text)}")
                continue
            unit = self.units.get(column.name)
            if number.endswith("%") and column.name.endswith("_cv"):
                number, unit = number[:-1].rstrip(), unit_named("%", "ratio")
            try:
                values[i] = column.parse(number, text, unit)
            except ValueError as error:
                remedy = ""
                if "," in text and not self.grouped:
                    remedy = "; if commas are decimal marks, add --decimal , and if they group thousands, --decimal ."
                elif _DATE.match(text):
                    remedy = "; did a spreadsheet program turn a number into a date?"
                elif text.startswith("#") and text.endswith(("!", "?")):
                    remedy = "; its formula failed: mend it, or clear the cell of a missing value"
                self.fault(i, column.name, f"{error}{remedy}")
        return values


def unused_note(titles: Sequence[str]) -> list[str]:
    """Return the note on columns that are not used, nothing if there are none."""
    return [f"unused columns: {listing(titles)}"] if titles else []


def freeze(owner: Any, source: str, kinds: Mapping[str, type]) -> None:
    """Replace arrays of a frozen dataclass by copies of these kinds that cannot be written to.

    Raises
    ------
    InputError
        If they differ in length.
    """
    for name, kind in kinds.items():
        object.__setattr__(owner, name, read_only(getattr(owner, name), kind))
    if len({getattr(owner, name).shape for name in kinds}) > 1:
        raise InputError(f"{source}: {', '.join(kinds)} differ in length")


def read_only(values: ArrayLike, kind: type) -> NDArray:
    """Return a copy of `values` that cannot be written to."""
    array: NDArray = np.array(values, dtype=kind)
    array.setflags(write=False)
    return array
