"""Reading of tables in four steps, and what mends one that is refused.

Bytes become cells (`formats`); rows of cells become a sheet with one header and one row for each value (`shapes`);
titles become known columns (`headers`); their cells become a `Table` without rows that are no data (`contents`). At
each step a list of rules says in which ways a table can be odd.
"""

from __future__ import annotations

import shlex
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from softness_bayes.data import contents, shapes
from softness_bayes.data.columns import LABELS, MISSING, NAMES, NUMBERS, Kind, summarises
from softness_bayes.data.decimals import Cell, Reading, decimal_mark, mark_of
from softness_bayes.data.faults import Hint, TableError, guess, listing
from softness_bayes.data.formats import TableSource, is_workbook, sheets_of
from softness_bayes.data.headers import Header
from softness_bayes.data.shapes import Request
from softness_bayes.data.sheets import Sheet, SheetNumber, sheet_of, shown
from softness_bayes.data.tables import Table, unused_note
from softness_bayes.data.titles import key, plain_text
from softness_bayes.errors import InputError, quoted
from softness_bayes.files.spreadsheet import unescaped

ALL = ("ratings", "fabrics", "compression")


class Rule(NamedTuple):
    """One way in which a table can be odd.

    A rule returns the table as a person would understand it, with a note that says so; a table that can be understood
    in several ways is refused, with a message that says which; any other table is returned unchanged.
    """

    name: str
    tables: Sequence[str]
    """The kinds of tables in which it is looked for."""
    apply: Callable[..., object]


ROWS = (
    Rule("comments", ALL, shapes.without_comments),
    Rule("lines above the header", ALL, shapes.without_preamble),
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
    Rule("no title of names", ("fabrics",), shapes.with_a_title_of_names),
    Rule("directions side by side", ("fabrics",), shapes.with_directions_in_rows),
    Rule("choices", ("ratings",), shapes.with_choices_as_pairs),
    Rule("people in columns", ("ratings",), shapes.with_people_in_rows),
    Rule("fabrics in columns", ("ratings",), shapes.with_fabrics_in_rows),
)
"""Rules for the columns of a sheet, given its `Header` and the `Request`."""

CONTENTS = (
    Rule("other columns of the same name", ALL, contents.without_namesakes),
    Rule("percentages", ("ratings",), contents.with_percentages),
    Rule("practice", ("ratings",), contents.without_practice),
    Rule("reversed scales", ("ratings",), contents.with_reversed_scales_named),
    Rule("rows of statistics", ALL, contents.without_statistics),
    Rule("names of one identity", ALL, contents.with_one_spelling),
    Rule("dates as names", ALL, contents.with_dates_named),
    Rule("copied rows", ("ratings",), contents.without_copies),
    Rule("unknown people", ("ratings", "compression"), contents.with_people_known),
    Rule("steps of other numbers", ("ratings",), contents.with_true_steps),
    Rule("reversed signs", ("compression",), contents.with_signs_of_pressing),
    Rule("noise about zero", ("compression",), contents.without_noise),
    Rule("way back", ("compression",), contents.without_unloading),
)
"""Rules for the cells of a `Table`."""

Subject = TypeVar("Subject", Sheet, Table)


def _after(rules: Sequence[Rule], kind: Kind, subject: Subject) -> Subject:
    """Return a sheet or a table after the rules for its kind."""
    for rule in rules:
        if kind.sheet in rule.tables:
            subject = rule.apply(subject)  # type: ignore[assignment]
    return subject


def read_table(source: TableSource, request: Request) -> Table:
    """Read the known columns of a table; other columns are left out, with a note.

    Raises
    ------
    InputError
        If the file is not a table with at least one row, or it can be understood in several ways; the message names
        file and row.
    """
    mark = mark_of(request.decimal, request.kind.sheet)
    sheet = read_sheet(source, request.kind, request.renames)
    header = Header(sheet, request.renames, request.kind)
    for rule in COLUMNS:
        if request.kind.sheet in rule.tables and (found := rule.apply(sheet, header, request)) is not sheet:
            assert isinstance(found, Sheet)
            sheet, header = found, Header(found, request.renames, request.kind)
    return _after(CONTENTS, request.kind, _table(header, mark))


# bytes to cells, and the sheet among several


def read_sheet(source: TableSource, kind: Kind, renames: Mapping[str, str]) -> Sheet:
    """Return the sheet of a file or DataFrame that has the columns looked for.

    Raises
    ------
    InputError
        If the file cannot be read, or it is not clear which of its sheets is meant.
    """
    sheets = sheets_of(source, kind.sheet)
    if len(sheets) == 1:
        return _after(ROWS, kind, next(iter(sheets.values()))).headed()
    return _chosen(str(source), _headed(sheets, kind), kind, renames)


def has_sheet(source: str | Path, kind: Kind, renames: Mapping[str, str]) -> bool:
    """Return whether a workbook of several sheets has one for the columns looked for."""
    if not is_workbook(Path(source)):
        return False
    sheets = sheets_of(source, kind.sheet)
    return len(sheets) > 1 and len(_candidates(_headed(sheets, kind), kind, renames)) == 1


def _headed(sheets: Mapping[str, Sheet], kind: Kind) -> dict[str, Sheet]:
    """Return the sheets of a workbook, each read as the table looked for, without those that are none."""
    found = {}
    for name, sheet in sheets.items():
        try:
            found[name] = _after(ROWS, kind, sheet).headed()
        except InputError:
            if key(name) == kind.sheet:
                raise
    return found


def _candidates(sheets: Mapping[str, Sheet], kind: Kind, renames: Mapping[str, str]) -> list[str]:
    """Return the sheets with the name that is looked for, or with the columns that mark it."""
    named = [name for name in sheets if key(name) == kind.sheet]
    known = {name: _known(sheet, kind, renames) for name, sheet in sheets.items()}
    for marks in (kind.marks, kind.otherwise):
        named = named or [name for name, there in known.items() if any(names <= there for names in marks)]
    return named


def _known(sheet: Sheet, kind: Kind, renames: Mapping[str, str]) -> set[str]:
    """Return the columns of a sheet that are known."""
    try:
        return {*Header(sheet, renames, kind).at}
    except InputError:
        return set()


def _chosen(place: str, sheets: Mapping[str, Sheet], kind: Kind, renames: Mapping[str, str]) -> Sheet:
    """Return the one sheet of a workbook that is meant, or several of one form below each other."""
    if not sheets:
        raise InputError(f"{place}: the workbook is empty, expected a header and rows")
    chosen = list(sheets) if len(sheets) == 1 else _candidates(sheets, kind, renames)
    if len(chosen) == 1:
        return sheets[chosen[0]]
    headers = {frozenset(title.casefold() for title in sheets[name].header) for name in chosen}
    if len(chosen) > 1 and len(headers) == 1:
        return _stacked(place, {name: sheets[name] for name in chosen}, kind, renames)
    raise InputError(
        f"{place}: {len(chosen) or 'none'} of the sheets {listing([quoted(name) for name in sheets])} may "
        f"contain the {kind.sheet}; rename the right one to {kind.sheet!r}"
    )


def _stacked(place: str, sheets: Mapping[str, Sheet], kind: Kind, renames: Mapping[str, str]) -> Sheet:
    """Return the rows of several sheets with the same titles, whose names are the participants if no column is."""
    left = [name for name in sheets if summarises(name)]
    kept = {name: sheet for name, sheet in sheets.items() if name not in left}
    first = next(iter(kept.values()))
    people = "participant" in kind.columns and "participant" not in _known(first, kind, renames)
    title = "participant" if people else "sheet"
    titles = [text.casefold() for text in first.header]
    rows: list[tuple[list[str], int]] = [([title, *first.header], -1)]
    for name, sheet in kept.items():
        order = [[text.casefold() for text in sheet.header].index(text) for text in titles]
        body = ([name, *(row[j] for j in order)] for row in sheet.body)
        rows += zip(body, sheet.lines[1:], strict=True)
    notes = [
        *dict.fromkeys(note for sheet in kept.values() for note in sheet.notes),
        f"{len(kept)} sheets are read below each other; their names are the column {title!r}",
        *([f"sheets of statistics are left out: {listing(left)}"] if left else []),
    ]
    places = f"{place}, sheets {listing([quoted(name) for name in kept])}"
    return sheet_of(rows, places, Path(place).name, first.digest, notes=notes).headed()


# a sheet's known columns as a table


def _table(header: Header, decimal: str | None) -> Table:
    """Return the known columns of a sheet."""
    sheet, at = header.sheet, header.at
    cells = {name: [row[j] for row in sheet.body] for name, j in at.items()}
    for name, texts in cells.items():
        cells[name] = [str(unescaped(shown(text))) if name in LABELS else _number(text) for text in texts]
    unused = {header.titles[j].text: j for j in header.free}
    notes = [*sheet.notes, *header.notes, *unused_note([*unused])]
    notes += [remark for _, (_, remark) in sorted(header.perhaps.items()) if remark]
    titles = {name: sheet.header[j] for name, j in at.items()}
    made = tuple(name for name, title in titles.items() if title in sheet.made)
    if sheet.columns and (name := next((name for name in made if titles[name] == sheet.made[-1]), "")):
        titles[name] = " … ".join(dict.fromkeys((sheet.columns[0], sheet.columns[-1])))
    rows = np.array(sheet.lines[1:], dtype=np.intp)
    reading = Reading(decimal, grouped=True) if decimal else _found_mark(sheet, cells, titles, made)
    return Table(
        place=sheet.place,
        label=sheet.label,
        digest=sheet.digest,
        cells=cells,
        titles=titles,
        units=header.units,
        rows=rows,
        decimal=reading.mark,
        grouped=reading.grouped,
        notes=(*notes, *([reading.note] if reading.note else [])),
        columns=sheet.columns,
        made=made,
        others={title: [str(unescaped(shown(row[j]))) for row in sheet.body] for title, j in unused.items()},
        perhaps={sheet.header[j]: told for j, told in header.perhaps.items()},
    )


def _number(text: str) -> str:
    """Return a number in full-width digits or with a sign of its own for minus in plain characters."""
    if text.isascii() or isinstance(text, SheetNumber):
        return text
    wide = all(unicodedata.east_asian_width(c) in "FWNaA" or c.isascii() for c in text)
    plain = plain_text(text) if wide or "\u2212" in text else text
    return plain if any(c in "0123456789" for c in plain) and all(c in "0123456789+-.,eE%" for c in plain) else text


def _found_mark(
    sheet: Sheet, cells: Mapping[str, Sequence[str]], titles: Mapping[str, str], made: Sequence[str]
) -> Reading:
    """Return the decimal mark that the numbers of a table show.

    Raises
    ------
    InputError
        If they do not decide between two.
    """
    numbers = [
        [
            Cell(text, sheet.columns[i] if name in made else titles[name], sheet.lines[1 + i])
            for i, text in enumerate(cells[name])
            if not (isinstance(text, SheetNumber) or (sheet.between_commas and "," not in text))
            and text.casefold() not in MISSING
        ]
        for name in NUMBERS
        if name in cells
    ]
    reading = decimal_mark(numbers, sheet.between_commas)
    if (cell := reading.unclear) is not None:
        other = cell.text.replace(",", "").replace(".", "")
        raise InputError(
            f"{sheet.place}: {cell.place}: {cell.text!r} may be {cell.text.replace(',', '.')} or {other}, and no other "
            "number of this table decides which; give the decimal mark with --decimal . or --decimal ,"
        )
    return reading


# what mends a table


Read = TypeVar("Read")
"""Data made of tables, with their notes."""


def read_as(make: Callable[[Table], Read], source: TableSource, request: Request) -> Read:
    """Return what is made of a table; if it is refused, name what mends it, after trying."""

    def read(request: Request) -> Read:
        table = read_table(source, request)
        check_renames(request.renames, table)
        return make(table)

    return with_hints(read, request)


def with_hints(read: Callable[[Request], Read], request: Request) -> Read:
    """Return what is read; if it is refused, name what mends it, after trying."""
    try:
        return read(request)
    except TableError as error:
        mending = next((hint for hint in error.candidates if _mends(read, request, hint)), {})
        error.remedy = shlex.join(words_of(mending))
        raise


MOST_FAULTS = 3
"""Largest number of faulty cells of a column that may be another one by its title."""


def words_of(hint: Hint) -> list[str]:
    """Return the options of the command line that read a table in another way."""
    columns = [word for name, title in hint.items() if name != "wide" for word in ("--column", f"{name}={title}")]
    return [*columns, *(["--wide"] if "wide" in hint else [])]


def _mends(read: Callable[[Request], Any], request: Request, hint: Hint) -> bool:
    """Return whether a table is read in another way, and nothing looks wrong, or is refused for single cells only."""
    columns = {name: title for name, title in hint.items() if name != "wide"}
    request = request._replace(renames={**request.renames, **columns}, wide=request.wide or "wide" in hint)
    try:
        found = read(request)
    except TableError as error:
        in_hinted = sum(problem.title in columns.values() for problem in error.problems)
        return in_hinted <= MOST_FAULTS and all(problem.row > 0 for problem in error.problems)
    except InputError:
        return False
    return not any("looks wrong" in note for note in found.notes)


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
