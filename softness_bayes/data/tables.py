"""Tables: texts by title, with the known columns under their standard names, and errors that name the place."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.data.columns import NUMBERS, OWNERS, Column, is_reversed
from softness_bayes.data.sheets import Sheet
from softness_bayes.data.texts import POINT, Reading, is_missing, listing
from softness_bayes.data.titles import Unit, analysed, bag, unit_named

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

Key = TypeVar("Key")


def grouped(keys: Iterable[Key]) -> dict[Key, list[int]]:
    """Return the places of each distinct key, in their order."""
    found: dict[Key, list[int]] = {}
    for i, key in enumerate(keys):
        found.setdefault(key, []).append(i)
    return found


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
    lines: list[tuple[int, str]] = []
    said: set[str] = set()
    for (_, _, remedy), alike in grouped((one.title, one.problem, one.remedy) for one in problems).items():
        group = [problems[i] for i in alike]
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


@dataclass(frozen=True)
class Table:
    """The columns of a file, as stripped text under their titles."""

    place: str
    """The file, and its sheet if it has several."""
    label: str
    """Name of the file, for notes."""
    digest: str
    """SHA-256 of the file's bytes."""
    header: str
    """The row of the header in words, for errors."""
    cells: Mapping[str, Sequence[str]]
    """The texts of each column by its title; titles differ in more than case."""
    rows: IntArray
    """Line of each row in the file; the header is line 1."""
    notes: tuple[str, ...] = ()
    between_commas: bool = False
    """True if commas separate the cells."""
    titles: Mapping[str, str] = field(default_factory=dict)
    """Standard name of a known column -> its title."""
    units: Mapping[str, Unit] = field(default_factory=dict)
    """Standard name of a column -> its unit, where that is not the one in the standard name."""
    reading: Reading = POINT
    perhaps: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Title of a column that is not used -> the standard name that it may have, and a remark."""
    spread: Sequence[str] = ()
    """Title of the column that each row is from, if the rows of the file held several values."""
    made: tuple[str, ...] = ()
    """Titles that such a file does not have; errors name those of `spread`."""
    faults: dict[tuple[int, str], Fault] = field(default_factory=dict)
    """Problems found in the table so far, by row and title."""
    hints: list[Hint] = field(default_factory=list)
    """Ways that may mend them."""

    @classmethod
    def of(cls, sheet: Sheet) -> Self:
        """Return the table of a sheet whose first row is the header; only the first column may lack a title.

        Raises
        ------
        InputError
            If there is no row below the header, two columns have the same title, or a row is longer than the header.
        """
        if len(sheet.records) < 2:
            raise InputError(f"{sheet.place}: there is no row below the header")
        titles, *body = sheet.records
        header = f"{sheet.place}: header" if sheet.lines[0] < 0 else f"{sheet.place}: row {sheet.lines[0]}"
        for title, count in Counter(title.casefold() for title in titles if title).items():
            if count > 1:
                turned = sum(bag(record[0]) in OWNERS for record in sheet.records) > 1
                more = "; its titles stand below each other: transpose it in a spreadsheet" if turned else ""
                raise InputError(f"{header}: {count} columns are called {quoted(title)}, expected one{more}")
        used = max((j + 1 for j, title in enumerate(titles) if title), default=0)
        for record, row in zip(body, sheet.lines[1:], strict=True):
            if beyond := [cell for cell in record[used:] if cell]:
                more = "; remove it, or give its column a title"
                if used == 1:
                    more = f"; is {quoted(titles[0])} a title of the table? The header must be the first row"
                raise InputError(
                    f"{sheet.place}: row {row}: {quoted(beyond[-1])} is beyond the {used} columns of the header{more}"
                )
        cells = {
            str(title): [record[j] if j < len(record) else "" for record in body]
            for j, title in enumerate(titles[:used])
            if title or not j
        }
        lines = np.array(sheet.lines[1:], dtype=np.intp)
        return cls(sheet.place, sheet.label, sheet.digest, header, cells, lines, sheet.notes, sheet.between_commas)

    def __len__(self) -> int:
        return len(self.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.titles

    def texts(self, name: str) -> Sequence[str]:
        """Return the cells of a known column, blank ones for another."""
        return self.cells[self.titles[name]] if name in self.titles else [""] * len(self)

    def title(self, name: str) -> str:
        """Return the title of a known column, of several columns of the file the first and the last."""
        title = self.titles[name]
        return " … ".join(dict.fromkeys((self.spread[0], self.spread[-1]))) if title in self.made[-1:] else title

    @property
    def others(self) -> dict[str, Sequence[str]]:
        """The cells of the columns that are not known, by title."""
        known = {*self.titles.values(), ""}
        return {title: texts for title, texts in self.cells.items() if title not in known}

    def keys(self, *names: str) -> list[tuple[str, ...]]:
        """Return the cells of some columns by row, blank where there is no column."""
        return [*zip(*map(self.texts, names), strict=True)]

    def grouped(self, *names: str) -> dict[tuple[str, ...], list[int]]:
        """Return the rows, by index, of each combination of texts in some columns."""
        return grouped(self.keys(*names))

    # other tables made of it

    def noted(self, *notes: str, **changes: Any) -> Self:
        """Return the table with further notes, and other changes."""
        return replace(self, notes=(*self.notes, *notes), **changes)

    def with_column(self, title: str, texts: Sequence[str], *notes: str) -> Self:
        """Return the table with other cells in a column, which may be a new one, and further notes."""
        return self.noted(*notes, cells={**self.cells, title: texts})

    def with_texts(self, name: str, texts: Sequence[str], *notes: str) -> Self:
        """Return the table with other cells in a known column, and further notes."""
        title = self.titles.get(name, name)
        return replace(self.with_column(title, texts, *notes), titles={**self.titles, name: title})

    def retitled(self, titles: Mapping[str, str]) -> Self:
        """Return the table with other titles of some columns."""
        return replace(self, cells={titles.get(title, title): texts for title, texts in self.cells.items()})

    def called(self, names: Mapping[str, str]) -> Self:
        """Return the table with other standard names of known columns, without those that get an empty one."""
        gone = {title for name, title in self.titles.items() if names.get(name) == ""}
        titles = {names.get(name, name): title for name, title in self.titles.items() if title not in gone}
        cells = {title: texts for title, texts in self.cells.items() if title not in gone}
        return replace(self, cells=cells, titles=titles)

    def take(self, index: IntArray) -> Self:
        """Return the rows at `index`."""
        places = index.tolist()
        cells = {title: [texts[i] for i in places] for title, texts in self.cells.items()}
        spread = [self.spread[i] for i in places] if self.spread else ()
        return replace(self, cells=cells, rows=self.rows[index], spread=spread)

    def without(self, left: Sequence[int], note: str) -> Self:
        """Return the table without some rows, by index; the note begins with the lines of these rows."""
        return self.take(np.setdiff1d(np.arange(len(self)), np.asarray(left, int))).noted(f"{self.lines(left)}: {note}")

    def lines(self, some: Sequence[int]) -> str:
        """Return the lines of some rows in words, such as `rows 3 to 9, 12`."""
        lines = np.unique(self.rows[[*some]])
        runs = np.split(lines, np.flatnonzero(np.diff(lines) > 1) + 1)
        told = [str(run[0]) if run.size == 1 else f"{run[0]} to {run[-1]}" for run in runs]
        return f"row{'s' * (lines.size > 1)} {listing(told, 4)}"

    def melted(self, parts: Sequence[tuple[str, Mapping[str, str]]], value: str, note: str) -> Self:
        """Return one row for each value in some columns, in the order of the rows, then of the columns.

        Parameters
        ----------
        parts
            Titles of the columns, and the cells that their rows get, by title.
        value
            Title of the values.
        note
            What was understood.
        """
        columns = [title for title, _ in parts]
        cells: dict[str, Sequence[str]] = {
            title: [text for text in texts for _ in parts]
            for title, texts in self.cells.items()
            if title not in columns
        }
        made = dict.fromkeys(name for _, own in parts for name in own)
        if taken := cells.keys() & {*made, value}:
            raise InputError(f"{self.header}: {note}, but there is a column {quoted(min(taken))}, too; rename it")
        cells |= {name: [own.get(name, "") for _, own in parts] * len(self) for name in made}
        cells[value] = [self.cells[title][i] for i in range(len(self)) for title in columns]
        spread, rows = columns * len(self), np.repeat(self.rows, len(parts))
        return self.noted(f"{note}: {listing(columns)}", cells=cells, rows=rows, spread=spread, made=(*made, value))

    def origin(self, notes: Sequence[str]) -> dict[str, Any]:
        """Return file, checksum and notes of what is made of the table."""
        return {
            "source": self.place,
            "digest": self.digest,
            "notes": tuple(f"{self.label}: {note}" for note in notes),
        }

    # its problems

    def fault(self, i: int, name: str, expected: str, remedy: str = "") -> None:
        """Add that the value of a cell is not what was expected; `check` raises it."""
        self.problem(i, name, expected, quoted(self.texts(name)[i]), remedy)

    def problem(self, i: int, name: str, *problem: str) -> None:
        """Add another problem of a cell; `check` raises it."""
        row, title = self.spot(i, name)
        self.faults.setdefault((row, title), Fault(row, title, *problem))

    def refuse(self, problem: str, *hints: Hint) -> None:
        """Add a problem of the whole table, and what may mend it."""
        self.hints.extend(hints)
        self.faults.setdefault((-1, problem), Fault(-1, "", problem))

    def is_faulty(self, i: int, *names: str) -> bool:
        """Return whether a problem of a row in some columns has been found."""
        return any(self.spot(i, name) in self.faults for name in names if name in self)

    def spot(self, i: int, name: str) -> tuple[int, str]:
        """Return row and title of a cell in the file."""
        title = self.titles[name]
        return int(self.rows[i]), self.spread[i] if title in self.made else title

    def check(self) -> None:
        """Raise the error that lists all problems found, general ones first, if there are any."""
        if self.faults:
            raise TableError(self.place, sorted(self.faults.values(), key=lambda fault: fault.row), self.hints)

    def lack(self, problem: str, *names: str, wide: bool = False) -> None:
        """Add that some columns are missing, with the titles that there are and what may mend it."""
        own = [quoted(self.title(name)) for name, title in self.titles.items() if title not in self.made[:-1]]
        titles = [*own, *map(quoted, self.others)]
        said = any("its columns are" in fault.problem for fault in self.faults.values())
        told = [problem, *(f"its columns are {listing(titles)}" for _ in titles[:1] if not said)]
        told += ["if they are garbled, save it as CSV in UTF-8"] * any(n.startswith("not UTF-8") for n in self.notes)
        meant = [(*self.perhaps[title], title) for title in self.cells if title in self.perhaps]
        told += [remark for name, remark, _ in meant if name in names and remark][:2]
        # logarithms, times of responses, and numbers in a unit that is not known would be misread
        unclear = {
            title: is_reversed(title)
            or {"log", "log10", "ln", "time"} & {*bag(title).split()}
            or (remark and analysed(title).unit)
            for _, remark, title in meant
        }
        hints = [{own: title} for name in names for own, _, title in meant if own == name and not unclear[title]]
        self.refuse("; ".join(told), *hints, *([{"wide": ""}] if wide else []))

    def require(self, *names: str) -> None:
        """Raise an error for a table without one of the columns `names`, with all other problems found."""
        absent = [name for name in names if name not in self]
        if not absent:
            return
        stems = {title: re.sub(r"[\s_.#-]*[0-9]{1,3}$", "", title) for title in self.others}
        count = Counter(stem for title, stem in stems.items() if stem != title)
        series = [title for title, stem in stems.items() if count[stem] > 1 and stem != title]
        if series and "rating" in absent:
            self.refuse(
                f"columns {listing([quoted(title) for title in series])} look like repeated ratings: put each "
                "rating in a separate row, in a column 'rating'; if they are people, call them P1, P2, …; if they are "
                f"loads, write the unit, as in {quoted(series[0] + ' mm')}"
            )
        else:
            what = " and ".join(map(repr, absent))
            if absent == ["rating"] and "participant" not in self and len(stems) > 1:
                what += "; if its columns are people, call them P1, P2, …"
            self.lack(f"no column{'s' * (len(absent) > 1)} {what}", *absent, wide="rating" in absent)
        self.check()

    # its values

    def labels(self, name: str) -> Sequence[str]:
        """Return a column of names; an empty one is a fault."""
        self.require(name)
        texts = self.texts(name)
        blank = [i for i, text in enumerate(texts) if not text]
        once = 2 * len(blank) > len(self) and texts[0]
        for i in blank:
            self.fault(i, name, "expected a name", "; write it in each row that it stands for" if once else "")
        return texts

    def plainly(self, name: str) -> FloatArray:
        """Return the numbers of a column in its own unit, NaN for all other cells, whatever is wrong with them."""
        values = np.full(len(self), np.nan)
        for i, text in enumerate(self.texts(name)):
            try:
                values[i] = float(self.reading.plain(text))
            except ValueError:
                continue
        return np.where(np.isfinite(values), values, np.nan)

    def numbers(self, column: Column | str) -> FloatArray:
        """Return a column of numbers [SI], NaN for a missing cell or column, and for a fault."""
        column = NUMBERS[column] if isinstance(column, str) else column
        values = np.full(len(self), np.nan)
        for i, text in enumerate(self.texts(column.name)):
            if is_missing(text):
                continue
            unit = self.units.get(column.name)
            try:
                number = self.reading.plain(text)
            except ValueError as error:
                self.fault(i, column.name, str(error))
                continue
            if number.endswith("%") and column.name.endswith("_cv"):
                number, unit = number[:-1].rstrip(), unit_named("%", "ratio")
            try:
                values[i] = column.parse(number, unit)
            except ValueError:
                remedy = ""
                if "," in text and not self.reading.grouped:
                    remedy = "; if commas are decimal marks, add --decimal , and if they group thousands, --decimal ."
                elif re.match(r"[0-9]+[./-](?:[0-9]+[./-][0-9]+|[A-Za-z]{3})|#.*[!?]$", text):
                    remedy = "; did a spreadsheet program turn a number into a date, or its formula fail?"
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
