"""Tables as named columns of text, and errors that name the place."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.data.columns import MISSING, RATING, Column, is_reversed
from softness_bayes.data.decimals import plain
from softness_bayes.data.faults import Fault, Faults, Hint, TableError, listing
from softness_bayes.data.sheets import SheetNumber
from softness_bayes.data.titles import Unit, unit_named
from softness_bayes.errors import InputError, quoted

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

    def fault(self, i: int, name: str, expected: str, remedy: str = "") -> None:
        """Add that the value of a cell is not what was expected; `check` raises it."""
        got = quoted(self.cells[name][i])
        self.faults.add(Fault(int(self.rows[i]), self._title(i, name), expected, got, remedy))

    def problem(self, i: int, name: str, problem: str) -> None:
        """Add another problem of a cell; `check` raises it."""
        self.faults.add(Fault(int(self.rows[i]), self._title(i, name), problem))

    def is_faulty(self, i: int, name: str) -> bool:
        """Return whether a problem of the cell has been found."""
        return (int(self.rows[i]), self._title(i, name)) in self.faults

    def _title(self, i: int, name: str) -> str:
        return self.columns[i] if name in self.made else self.titles[name]

    def check(self) -> None:
        """Raise the error that lists all problems found, if there are any."""
        if self.faults:
            raise TableError(self.place, self.faults.listed, self.faults.hints)

    def noted(self, *notes: str, **changes: Any) -> Table:
        """Return the table with further notes, and other changes."""
        return replace(self, notes=(*self.notes, *notes), **changes)

    def with_cells(self, name: str, texts: Sequence[str], *notes: str) -> Table:
        """Return the table with other cells in a column, and further notes."""
        return self.noted(*notes, cells={**self.cells, name: texts})

    def without(self, left: Sequence[int], note: str) -> Table:
        """Return the table without some rows, by index; the note begins with the lines of these rows."""
        kept = np.setdiff1d(np.arange(len(self)), np.asarray(left, dtype=np.intp))
        return self.take(kept).noted(f"{self.lines(left)}: {note}")

    def lines(self, some: Sequence[int]) -> str:
        """Return the lines of some rows in words, such as `rows 3 to 9, 12`."""
        lines = np.unique(self.rows[[*some]])
        runs = np.split(lines, np.flatnonzero(np.diff(lines) > 1) + 1)
        told = [str(run[0]) if run.size == 1 else f"{run[0]} to {run[-1]}" for run in runs]
        return f"row{'s' * (lines.size > 1)} {listing(told, 4)}"

    def keys(self, *names: str) -> list[tuple[str, ...]]:
        """Return the cells of some columns by row, those without a column left out."""
        columns = [self.cells[name] for name in names if name in self]
        return [*zip(*columns, strict=True)] if columns else [()] * len(self)

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
            may_be = [title for title, (own, _) in self.perhaps.items() if own == name and not is_reversed(title)][:3]
            hints = [{**hint, name: title} for title in may_be for hint in hints if title not in hint.values()] or hints
        titles = [quoted(title) for title in (*self.titles.values(), *self.others)]
        remarks = dict.fromkeys(remark for name, remark in self.perhaps.values() if name in names and remark)
        told = [problem, *(f"its columns are {listing(titles)}" for _ in titles[:1]), *[*remarks][:1]]
        ways = [hint for hint in hints if hint] + ([{"wide": ""}] if wide else [])
        self.faults.add_general("; ".join(told), ways)

    def require(self, *names: str) -> None:
        """Raise an error for a table without one of the columns `names`, with all other problems found."""
        if absent := [name for name in names if name not in self]:
            stems = {title: re.sub(r"[\s_.#-]*[0-9]{1,3}$", "", title) for title in self.others}
            count = Counter(stem for title, stem in stems.items() if stem != title)
            series = [title for title, stem in stems.items() if count[stem] > 1 and stem != title]
            if series and RATING.name in absent:
                self.faults.add_general(
                    f"columns {listing([quoted(title) for title in series])} look like repeated ratings: put each "
                    "rating in a separate row, in a column 'rating'; if they are loads, write the unit, as in "
                    f"{quoted(series[0] + ' mm')}"
                )
            else:
                what = " and ".join(map(repr, absent))
                if absent == [RATING.name] and "participant" not in self and len(self.others) > 1:
                    what += "; if its columns are people, call them P1, P2, …"
                self.lack(f"no column{'s' * (len(absent) > 1)} {what}", *absent, wide=RATING.name in absent)
            self.check()

    def labels(self, name: str) -> Sequence[str]:
        """Return a column of names; an empty one is a fault."""
        self.require(name)
        blank = [i for i, text in enumerate(self.cells[name]) if not text]
        once = 2 * len(blank) > len(self) and self.cells[name][0]
        for i in blank:
            self.fault(i, name, "expected a name", "; write it in each row that it stands for" if once else "")
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
            unit = self.units.get(column.name)
            try:
                number = text if isinstance(text, SheetNumber) else plain(text, self.decimal, self.grouped)
            except ValueError as error:
                self.fault(i, column.name, str(error))
                continue
            if number.endswith("%") and column.name.endswith("_cv"):
                number, unit = number[:-1].rstrip(), unit_named("%", "ratio")
            try:
                values[i] = column.parse(number, unit)
            except ValueError:
                remedy = ""
                if "," in text and not self.grouped:
                    remedy = "; if commas are decimal marks, add --decimal , and if they group thousands, --decimal ."
                elif _DATE.match(text):
                    remedy = "; did a spreadsheet program turn a number into a date?"
                elif text.startswith("#") and text.endswith(("!", "?")):
                    remedy = "; its formula failed: mend it, or clear the cell of a missing value"
                self.fault(i, column.name, f"expected {column.expected(unit)}", remedy)
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
