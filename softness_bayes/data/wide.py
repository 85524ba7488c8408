"""Wide tables of ratings, with one column for each fabric, or for each fabric under each load."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from softness_bayes.data.columns import FORCE, INDENTATION, RATING, Column
from softness_bayes.data.headers import Sought, understood
from softness_bayes.data.names import Guesses, listing
from softness_bayes.data.sheets import Sheet, SheetNumber
from softness_bayes.data.units import LONGEST_TITLE, unit_named
from softness_bayes.errors import InputError, quoted

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
