"""Sheets: a header of one or two rows, and rows of cells; wide sheets with a row for each rating."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from softness_bayes.data.columns import (
    FORCE,
    INDENTATION,
    LONGEST_TITLE,
    RATING,
    UNITS,
    Column,
    is_unit,
    key,
    title_and_unit,
    unit_named,
)
from softness_bayes.data.faults import Guesses, listing
from softness_bayes.data.headers import Sought, keys_of, understood
from softness_bayes.errors import InputError, quoted

MOST_COLUMNS = 2**14
"""Largest number of columns of a table, that of spreadsheet programs."""

MOST_CELLS = 2**24
"""Largest number of cells of a table, with the empty ones between others."""


class SheetNumber(str):
    """A number that the file holds as one, not as text: its decimal mark is a point."""


@dataclass(frozen=True)
class Sheet:
    """A header and rows of stripped cells; blank rows are left out."""

    place: str
    """File, and sheet if there are several, for errors."""
    label: str
    """Name of the file, for notes."""
    digest: str
    """SHA-256 of the file's bytes."""
    header: Sequence[str]
    body: Sequence[Sequence[str]]
    """Cells of each row, as many as the header has."""
    rows: Sequence[int]
    """Line of each row in the file."""
    titled: str
    """Place of the header: `place` and its row."""
    padded: Counter[tuple[int, str]] = field(default_factory=Counter)
    """Number of cells with spaces at their ends, by column and by text without the spaces."""
    between_commas: bool = False
    """True if commas separate the cells."""
    notes: tuple[str, ...] = ()
    columns: Sequence[str] = ()
    """Title of the column that each row is from, if it was a wide table."""
    made: tuple[str, ...] = ()
    """Titles that a wide table did not have; errors name those of `columns`."""


def sheet_of(
    lines: Iterable[tuple[Sequence[str], int]],
    place: str,
    label: str,
    digest: str,
    *,
    between_commas: bool = False,
    notes: Sequence[str] = (),
) -> Sheet:
    """Return the sheet of some rows of cells.

    Parameters
    ----------
    lines
        Cells of each row, and its line; the first row that is not blank is the header, whose line is -1 if it has none.
    place, label, digest, between_commas, notes
        As of `Sheet`.

    Raises
    ------
    InputError
        If there is no row below the header, two columns have the same title, a row is longer than the header, or the
        table is too large.
    """
    records: list[list[str]] = []
    rows: list[int] = []
    padded: Counter[tuple[int, str]] = Counter()
    size = 0
    for record, line in lines:
        size += max(len(record), len(records[0]) if records else 0)
        if len(record) > MOST_COLUMNS or size > MOST_CELLS:
            what = f"{len(record)} columns, expected at most {MOST_COLUMNS}"
            if len(record) <= MOST_COLUMNS:
                what = f"more than {MOST_CELLS} cells, with the empty ones up to the last column"
            raise InputError(f"{place}: row {line}: {what}; is there a stray cell far from the table?")
        cells = [cell if isinstance(cell, SheetNumber) else cell.strip() for cell in record]
        padded.update((j, cell) for j, cell in enumerate(cells) if cell != record[j])
        if any(cells):
            records.append(cells)
            rows.append(line)
    header, body = records[0] if records else [], records[1:]
    if len(body) > 1 and (two := joined(header, body[0])):
        header, body, rows, notes = two[0], body[1:], [rows[0], *rows[2:]], [*notes, two[1]]
    if not body:
        raise InputError(f"{place}: there is no row below the header")
    titled = f"{place}: header" if rows[0] < 0 else f"{place}: row {rows[0]}"
    for title, count in Counter(title.casefold() for title in header if title).items():
        if count > 1:
            raise InputError(f"{titled}: {count} columns are called {quoted(title)}, expected one")
    used = max((j + 1 for j, title in enumerate(header) if title), default=0)
    for record, row in zip(body, rows[1:], strict=True):
        beyond = [cell for cell in record[used:] if cell]
        if beyond:
            title = (
                f"; is {quoted(header[0])} a title of the table? The header must be the first row" if used == 1 else ""
            )
            raise InputError(
                f"{place}: row {row}: {quoted(beyond[-1])} is beyond the {used} columns of the header{title}"
            )
    body = [[*record[:used], *[""] * (used - len(record))] for record in body]
    return Sheet(place, label, digest, header[:used], body, rows[1:], titled, padded, between_commas, tuple(notes))


_LABELS = keys_of("participant") | keys_of("fabric") | keys_of("list")
_NO_UNIT = frozenset({"-", "–", "1"})
_LOAD = re.compile(r"[0-9]+(?:[.,][0-9]+)?\s*(?P<unit>[^\s0-9].*)")


def joined(header: Sequence[str], below: Sequence[str]) -> tuple[list[str], str] | None:
    """Return the titles of a header of two rows, and a note on the second one; None if it holds data.

    Parameters
    ----------
    header, below
        Cells of the first two rows that are not blank, without spaces at their ends.
    """
    width = max(len(header), len(below))
    titles, second = ([*row, *[""] * (width - len(row))] for row in (header, below))
    # a title that is merged over both rows stands in each
    second = ["" if text and key(text) == key(title) else text for title, text in zip(titles, second, strict=True)]
    return _with_units(titles, second) or _with_loads(titles, second)


def _with_units(titles: Sequence[str], units: Sequence[str]) -> tuple[list[str], str] | None:
    """Return titles with the units below them; no column of names has one."""
    filled = [j for j, text in enumerate(units) if text]
    bare = {j: units[j].strip("[]() ") for j in filled}
    if not all(titles[j] and key(titles[j]) not in _LABELS and is_unit(bare[j]) for j in filled):
        return None
    named = [j for j in filled if bare[j] not in _NO_UNIT]
    if not named or len(filled) == len(titles):
        return None
    # a title that has a unit already keeps it; what is below must not be another one
    found = {j: f"{titles[j]} [{bare[j]}]" for j in named if not _has(titles[j], bare[j])}
    made = listing([quoted(text) for text in found.values()]) if found else "those of the headers"
    return ([found.get(j, title) for j, title in enumerate(titles)], f"the second row contains units: {made}")


def _has(title: str, unit: str) -> bool:
    """Return whether a title ends in a unit."""
    spelt = title_and_unit(title)[1]
    return spelt is not None and any(
        (one := unit_named(unit, quantity)) is not None and one == unit_named(spelt.text, quantity)
        for quantity in UNITS
    )


def _is_load(text: str) -> bool:
    match = _LOAD.fullmatch(text)
    return match is not None and any(unit_named(match["unit"], quantity) for quantity in ("length", "force"))


def _with_loads(titles: Sequence[str], second: Sequence[str]) -> tuple[list[str], str] | None:
    """Return titles of fabrics with the loads below them; a fabric stands once before several, as in merged cells."""
    loaded = [j for j, text in enumerate(second) if _is_load(text)]
    others = [j for j, text in enumerate(second) if text and j not in loaded]
    if len(loaded) < 2 or any(titles[j] for j in others):
        return None
    found, fabric = list(titles), ""
    for j in range(len(titles)):
        if j in loaded:
            fabric = titles[j] or fabric
            if not fabric:
                return None
            found[j] = f"{fabric} @ {second[j]}"
        else:
            found[j], fabric = titles[j] or second[j], ""
    return (found, f"the second row contains loads: {listing([quoted(found[j]) for j in loaded])}")


_LOADED = re.compile(
    r"(?P<fabric>.*?\S)[\s@_,;/|([-]+(?P<number>[0-9]+(?:\.[0-9]+|,[0-9]{1,2})?)[\s_]*"
    r"(?P<unit>mm|[uµμ]m|cm|N|mN|cN|gf)\s*[)\]]?",
    re.IGNORECASE,
)
_LOADS = {"length": INDENTATION, "force": FORCE}


class Form(NamedTuple):
    """The form of a table of ratings, as far as it is known."""

    wide: bool = False
    """True if the user called it wide."""
    fabrics: Callable[[], Collection[str] | None] = lambda: None
    """Returns the names of the fabrics, None where they are not known."""


class _Rated(NamedTuple):
    """A column of ratings: its index, fabric, and load in its title, if there is one."""

    j: int
    fabric: str
    load: tuple[Column, str] | None


def lengthened(sheet: Sheet, sought: Sought, renames: Mapping[str, str], form: Form) -> Sheet:
    """Return a wide sheet with one row for each rating, any other as it is.

    A table is wide if the user says so, or if it has no column of ratings or fabrics and at least two titles are
    fabrics, as in `cotton`, or fabrics under loads, as in `cotton @ 2 mm`, `cotton_2mm` or `cotton_1N`.

    Raises
    ------
    InputError
        If a table that is called wide is none, or a title may be a misspelt fabric.
    """
    at = understood(sheet.header, renames, sought, sheet.titled).at
    if long := [name for name in ("fabric", RATING.name) if name in at]:
        if form.wide:
            raise InputError(
                f"{sheet.titled}: --wide expects a table with one column per fabric; this one has a column "
                f"{quoted(sheet.header[at[long[0]]])} for the {long[0]} of each row"
            )
        return sheet
    others = {j: title for j, title in enumerate(sheet.header) if title and j not in at.values()}
    rated = _rated(sheet, others, form)
    if not rated:
        return sheet
    titles = [sheet.header[column.j] for column in rated]
    loaded = next((title for title, column in zip(titles, rated, strict=True) if column.load is not None), None)
    for column in _LOADS.values():
        if loaded is not None and column.name in at:
            filed = quoted(sheet.header[at[column.name]])
            raise InputError(
                f"{sheet.titled}: loads are in headers ({quoted(loaded)}) and in {filed}, expected only one of these"
            )
    return _melted(sheet, rated, titles, loaded is not None)


def _rated(sheet: Sheet, titles: Mapping[int, str], form: Form) -> list[_Rated]:
    """Return the columns of ratings, none if the table is not wide."""
    known = form.fabrics()
    found: list[_Rated] = []
    strange: list[tuple[str, str]] = []
    for j, title in titles.items():
        name, load = _fabric_and_load(title)
        if known is not None and title in known:
            found.append(_Rated(j, title, None))
        elif load is not None and (known is None or name in known):
            found.append(_Rated(j, name, load))
        elif known is None and form.wide:
            found.append(_Rated(j, title, None))
        elif known is not None:
            strange.append((title, name))
    if not form.wide and len(found) < 2:
        return []
    absent = set(known or ()) - {column.fabric for column in found}
    guesses = Guesses(sorted(absent))
    for title, name in strange:
        near = guesses.of(name)
        if near or name != title:
            raise InputError(f"{sheet.titled}, column {quoted(title)}: {quoted(name)} is not a known fabric{near}")
    if not found:
        raise InputError(f"{sheet.titled}: no column has the name of a fabric, such as {listing(sorted(absent), 3)}")
    return found


def _fabric_and_load(title: str) -> tuple[str, tuple[Column, str] | None]:
    """Return the fabric in a title, and the column and text of its load, if there is one."""
    match = _LOADED.fullmatch(title) if len(title) <= LONGEST_TITLE else None
    if match is None:
        return title, None
    for quantity, column in _LOADS.items():
        if unit := unit_named(match["unit"], quantity):
            try:
                value = column.parse(match["number"].replace(",", "."), match["number"], unit)
            except ValueError:
                return title, None
            return match["fabric"], (column, column.write(value))
    return title, None


def _melted(sheet: Sheet, rated: Sequence[_Rated], titles: Sequence[str], loaded: bool) -> Sheet:
    """Return one row for each rating, in the order of the rows, then of the columns."""
    melted = {column.j for column in rated}
    kept = [j for j in range(len(sheet.header)) if j not in melted]
    made = ("fabric", RATING.name, *((INDENTATION.name, FORCE.name) if loaded else ()))

    def cells(row: Sequence[str], column: _Rated) -> list[str]:
        load = dict([(column.load[0].name, SheetNumber(column.load[1]))] if column.load else ())
        return [*(row[j] for j in kept), column.fabric, row[column.j], *(load.get(name, "") for name in made[2:])]

    # of two load columns that are made, one without any load is not there
    body = [cells(row, column) for row in sheet.body for column in rated]
    filled = [k for k in range(len(kept) + len(made)) if k < len(kept) + 2 or any(row[k] for row in body)]
    header = [*(sheet.header[j] for j in kept), *made]
    places = {j: k for k, j in enumerate(kept)}
    padded = {(places[j], text): len(rated) * n for (j, text), n in sheet.padded.items() if j in places}
    return replace(
        sheet,
        header=[header[k] for k in filled],
        body=[[row[k] for k in filled] for row in body],
        rows=[line for line in sheet.rows for _ in rated],
        columns=[title for _ in sheet.rows for title in titles],
        made=made,
        padded=Counter(padded),
        notes=(*sheet.notes, f"one column per fabric{' and load' if loaded else ''}: {listing(titles)}"),
    )
