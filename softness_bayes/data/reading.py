"""Reading of tables in four steps.

Bytes become cells (`formats`); rows of cells become a table with one header and one row for each value (`shapes`);
titles become known columns (`headers`); rows that are no data are left out (`contents`). At each step a list of rules
says in which ways a table can be odd.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

import softness_bayes.data.contents as contents
import softness_bayes.data.shapes as shapes
from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.files.spreadsheet import unescaped
from softness_bayes.data.columns import NAMES, NUMBERS, Kind, Request, summarises
from softness_bayes.data.headers import Header
from softness_bayes.data.sheets import Sheet, TableSource, is_workbook, sheets_of
from softness_bayes.data.tables import Table, unused_note
from softness_bayes.data.texts import (
    Cell,
    Marks,
    Reading,
    SheetNumber,
    guess,
    is_missing,
    listing,
    mark_of,
    plain_digits,
    reading_of,
)
from softness_bayes.data.titles import key

ALL = ("ratings", "fabrics", "compression")


class Rule(NamedTuple):
    """One way in which a table can be odd.

    A rule returns the table as a person would understand it, with a note that says so; a table that can be understood
    in several ways is refused, with a message that says which; any other table is returned unchanged.
    """

    name: str
    tables: Sequence[str]
    """The kinds of tables in which it is looked for."""
    apply: Callable[..., Any]


ROWS = (
    Rule("lines above the header", ALL, shapes.with_header_first),
    Rule("rows of a survey", ("ratings",), shapes.without_survey_rows),
    Rule("several rows of titles", ALL, shapes.with_one_row_of_titles),
    Rule("repeated headers", ALL, shapes.without_repeated_headers),
    Rule("remarks below", ("ratings", "compression"), shapes.without_remarks),
)
"""Rules for the rows of a sheet, before its header is known."""

COLUMNS = (
    Rule("JSON in cells", ALL, shapes.with_json_cells),
    Rule("units in cells", ALL, shapes.with_units_of_cells),
    Rule("plus-minus", ("fabrics", "compression"), shapes.with_values_alone),
    Rule("no title of names", ("fabrics", "ratings"), shapes.with_a_title_of_names),
    Rule("directions side by side", ("fabrics",), shapes.with_directions_in_rows),
    Rule("choices", ("ratings",), shapes.with_choices_as_pairs),
    Rule("people in columns", ("ratings",), shapes.with_people_in_rows),
    Rule("fabrics in columns", ("ratings",), shapes.with_fabrics_in_rows),
)
"""Rules for the columns of a table, given the `Request`."""

CONTENTS = (
    Rule("percentages", ("ratings",), contents.with_percentages),
    Rule("practice", ("ratings",), contents.without_practice),
    Rule("marked rows", ("ratings",), contents.with_marked_rows_named),
    Rule("rows of statistics", (*ALL, "afferents"), contents.without_statistics),
    Rule("names of one identity", ALL, contents.with_one_spelling),
    Rule("copied rows", ("ratings",), contents.without_copies),
    Rule("copied people", ("ratings",), contents.with_equal_people_named),
    Rule("copied measurements", ("compression", "afferents"), contents.with_copied_measurements_named),
    Rule("codes for missing numbers", (*ALL, "afferents"), contents.with_codes_named),
    Rule("several attributes or groups", ("ratings",), contents.of_one_attribute_and_person),
    Rule("unknown people", ("ratings", "compression"), contents.with_people_known),
    Rule("steps of other numbers", ALL, contents.with_errors_and_steps_named),
    Rule("reversed signs", ("compression",), contents.with_signs_of_pressing),
    Rule("noise about zero", ("compression",), contents.without_noise),
    Rule("way back", ("compression",), contents.without_unloading),
)
"""Rules for the cells of the known columns."""


def read_table(source: TableSource, request: Request) -> Table:
    """Read the known columns of a table; other columns are left out, with a note.

    Raises
    ------
    InputError
        If the file is not a table with at least one row, or it can be understood in several ways; the message names
        file and row.
    """
    mark, kind = mark_of(request.decimal, request.kind.sheet), request.kind
    table, notes = _recognised(read_titled(source, kind, request.renames), kind, request.renames)
    for rule in COLUMNS:
        if kind.sheet in rule.tables and (found := rule.apply(table, request)) is not table:
            table, notes = _recognised(found, kind, request.renames)
    table = _with_numbers(table, notes, mark)
    for rule in CONTENTS:
        if kind.sheet in rule.tables:
            table = rule.apply(table)
    return table


def _recognised(table: Table, kind: Kind, renames: Mapping[str, str]) -> tuple[Table, list[str]]:
    """Return a table of which the columns are known, and what was understood of them."""
    header = Header(table, kind, renames)
    return replace(table, titles=header.at, units=header.units, perhaps=header.perhaps), header.notes


# bytes to cells, and the sheet among several


def read_titled(source: TableSource, kind: Kind, renames: Mapping[str, str]) -> Table:
    """Return the sheet of a file or DataFrame that has the columns looked for.

    Raises
    ------
    InputError
        If the file cannot be read, or it is not clear which of its sheets is meant.
    """
    sheets = sheets_of(source, kind.sheet)
    if len(sheets) == 1:
        return _titled(next(iter(sheets.values())), kind)
    place, tables = str(source), _tables(sheets, kind)
    if not tables:
        raise InputError(f"{place}: the workbook is empty, expected a header and rows")
    meant = list(tables) if len(tables) == 1 else _meant(tables, kind, renames)
    if len(meant) == 1:
        return tables[meant[0]]
    titles = {frozenset(title.casefold() for title in tables[name].cells) for name in meant}
    if len(titles) == 1:
        return _stacked(place, {name: tables[name] for name in meant}, kind, renames)
    raise InputError(
        f"{place}: {len(meant) or 'none'} of the sheets {listing([quoted(name) for name in tables])} may "
        f"contain the {kind.sheet}; rename the right one to {kind.sheet!r}"
        f"{', or give them the same titles if they belong together' if meant else ''}"
    )


def has_sheet(source: str | Path, kind: Kind, renames: Mapping[str, str]) -> bool:
    """Return whether a workbook of several sheets has one for the columns looked for."""
    if not is_workbook(Path(source)):
        return False
    sheets = sheets_of(source, kind.sheet)
    return len(sheets) > 1 and len(_meant(_tables(sheets, kind), kind, renames)) == 1


def _titled(sheet: Sheet, kind: Kind) -> Table:
    """Return the table of a sheet after the rules for its rows."""
    for rule in ROWS:
        if kind.sheet in rule.tables:
            sheet = rule.apply(sheet)
    return Table.of(sheet)


def _tables(sheets: Mapping[str, Sheet], kind: Kind) -> dict[str, Table]:
    """Return the sheets of a workbook, each read as the table looked for, without those that are none."""
    found = {}
    for name, sheet in sheets.items():
        try:
            found[name] = _titled(sheet, kind)
        except InputError:
            if key(name) == kind.sheet:
                raise
    return found


def _meant(tables: Mapping[str, Table], kind: Kind, renames: Mapping[str, str]) -> list[str]:
    """Return the sheets with the name that is looked for, or with the columns that mark it."""
    named = [name for name in tables if key(name) == kind.sheet]
    known = {name: _known(table, kind, renames) for name, table in tables.items()}
    for mark in kind.marks:
        named = named or [name for name, there in known.items() if mark <= there]
    return named


def _known(table: Table, kind: Kind, renames: Mapping[str, str]) -> set[str]:
    """Return the columns of a table that are known."""
    try:
        return {*_recognised(table, kind, renames)[0].titles}
    except InputError:
        return set()


def _stacked(place: str, tables: Mapping[str, Table], kind: Kind, renames: Mapping[str, str]) -> Table:
    """Return the rows of several sheets with the same titles, whose names are the participants if no column is."""
    left = [name for name in tables if summarises(name)]
    kept = {name: table for name, table in tables.items() if name not in left}
    first = next(iter(kept.values()))
    people = "participant" in kind.columns and "participant" not in _known(first, kind, renames)
    title = "participant" if people else "sheet"
    folded = [{text.casefold(): texts for text, texts in table.cells.items()} for table in kept.values()]
    cells = {text: [cell for one in folded for cell in one[text.casefold()]] for text in first.cells}
    places = f"{place}, sheets {listing([quoted(name) for name in kept])}"
    notes = [
        *dict.fromkeys(note for table in kept.values() for note in table.notes),
        f"{len(kept)} sheets are read below each other; their names are the column {title!r}",
        *([f"sheets of statistics are left out: {listing(left)}"] if left else []),
    ]
    return replace(
        first,
        place=places,
        label=Path(place).name,
        header=f"{places}: header",
        cells={title: [name for name, table in kept.items() for _ in range(len(table))], **cells},
        rows=np.concatenate([table.rows for table in kept.values()]),
        notes=tuple(notes),
    )


# the known columns


def _with_numbers(table: Table, notes: Sequence[str], decimal: str | None) -> Table:
    """Return a table with its numbers in plain characters, their decimal mark, and the notes on its columns."""
    numbers = {title for name, title in table.titles.items() if name in NUMBERS}
    cells: dict[str, Sequence[str]] = {}
    for title, texts in table.cells.items():
        if title in numbers:
            cells[title] = [plain_digits(text) for text in texts]
        elif title:  # names and remarks are as their program shows them
            cells[title] = [unescaped(text.shown if isinstance(text, SheetNumber) else text) for text in texts]
    table = replace(table, cells=cells)
    remarks = [remark for title in cells if (remark := table.perhaps.get(title, ("", ""))[1])]
    reading = Reading(decimal, grouped=True) if decimal else _found_reading(table)
    said = [reading.note] if reading.note else []
    return table.noted(*notes, *unused_note([*table.others]), *remarks, *said, reading=reading)


def _found_reading(table: Table) -> Reading:
    """Return the decimal mark that the numbers of a table show."""

    def cells(name: str) -> list[Cell]:
        return [
            Cell(text, "row {}, column {!r}".format(*table.spot(i, name)))
            for i, text in enumerate(table.texts(name))
            if not (isinstance(text, SheetNumber) or (table.between_commas and "," not in text) or is_missing(text))
        ]

    return reading_of(table.place, [cells(name) for name in NUMBERS if name in table], table.between_commas)


Read = TypeVar("Read")
"""Data made of a table."""


def read_as(make: Callable[[Table], Read], source: TableSource, request: Request) -> Read:
    """Return what is made of a table."""
    table = read_table(source, request)
    check_renames(request.renames, table)
    return make(table)


class OneTable(ABC):
    """Data of one table, whose columns the class names."""

    kind: ClassVar[Kind]
    """Kind of the table."""

    @classmethod
    @abstractmethod
    def from_table(cls, table: Table) -> Self:
        """Return the data of a table."""

    @classmethod
    def read(cls, path: TableSource, *, columns: Mapping[str, str] | None = None, decimal: Marks = None) -> Self:
        """Read a table.

        Parameters
        ----------
        path
            Text file, Excel workbook, Parquet file, or DataFrame, with the columns that the class names.
        columns
            Names of columns in the file, by these names, where they differ.
        decimal
            Decimal mark, "," or "."; by default inferred from the file, which is rejected if ambiguous.

        Raises
        ------
        InputError
            Naming file, row, column and value.
        """
        return read_as(cls.from_table, path, Request(cls.kind, columns or {}, decimal))


def check_renames(renames: Mapping[str, str], *tables: Table) -> None:
    """Raise an error for renames of unknown columns, or to names that no table has."""
    for name, actual in renames.items():
        if name not in NAMES:
            raise InputError(
                f"--column {name}={actual}: no column is called {name!r} here{guess(name, NAMES)}; "
                f"expected one of {', '.join(NAMES)}"
            )
        if all(table.titles.get(name, "").casefold() != actual.casefold() for table in tables):
            files = " or ".join(dict.fromkeys(table.place for table in tables))
            raise InputError(f"--column {name}={actual}: there is no column {actual!r} in {files}")
