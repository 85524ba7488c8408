"""Reading of tables: their known columns as text, by all rules, and what may mend one that is refused."""

from __future__ import annotations

import shlex
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np

from softness_bayes.data.columns import LABELS, MISSING, NUMBERS, plain_text
from softness_bayes.data.faults import Guesses, Hint, TableError, listing, natural
from softness_bayes.data.formats import TableSource, read_sheet
from softness_bayes.data.headers import Sought, understood
from softness_bayes.data.rules import as_understood, checked
from softness_bayes.data.shapes import Form, Request
from softness_bayes.data.sheets import Sheet, SheetNumber, shown
from softness_bayes.data.tables import Cell, Marks, Reading, Table, decimal_mark, mark_of, unused_note
from softness_bayes.errors import InputError
from softness_bayes.files.spreadsheet import unescaped


class Noted(Protocol):
    """Anything read from a table, with its notes."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user."""


Read = TypeVar("Read", bound=Noted)


def read_table(
    source: TableSource,
    sought: Sought,
    renames: Mapping[str, str],
    decimal: Marks = None,
    form: Form | None = None,
) -> Table:
    """Read the known columns of a table, as the rules of `rules` understand it.

    Other columns are left out, with a note.

    Parameters
    ----------
    source
        A file, or a pandas DataFrame.
    sought
        The columns that may have other names and units than the standard ones; notes say which do.
    renames
        Name of a column here -> its name in the file; those that the file lacks are ignored
        (`check_renames` refuses those that no file has).
    decimal
        What stands before the decimals of a number, "," or "."; the other one groups thousands. Table -> mark if
        tables differ. Left out, the numbers tell, or the table is refused.
    form
        Form of a table of ratings, which may be wide; notes say if it is.

    Raises
    ------
    InputError
        If the file is not a table with at least one row, or it can be understood in several ways; the message names
        file and row.
    """
    mark = mark_of(decimal, sought.sheet)
    request = Request(sought, renames, form or Form())
    sheet = as_understood(read_sheet(source, sought, renames), request)
    return checked(_table(sheet, request, mark), sought.sheet)


def _table(sheet: Sheet, request: Request, decimal: str | None) -> Table:
    """Return the known columns of a sheet."""
    header, padded = sheet.header, sheet.padded
    at, units, found, perhaps = understood(sheet, request.renames, request.sought)
    notes = [*sheet.notes, *found]
    columns = {name: [record[j] for record in sheet.body] for name, j in at.items()}
    cells = {name: [_number(text) for text in texts] for name, texts in columns.items()}
    for name in (name for name in LABELS if name in at):
        cells[name] = [shown(text) for text in columns[name]]
        total = Counter(cells[name])
        if both := [f"'{label}'" for label in natural(total) if 0 < padded[at[name], label] < total[label]]:
            notes.append(
                f"column {name!r}: {listing(both)} with and without spaces at the ends are treated as the same"
            )
        cells[name] = [str(unescaped(text)) for text in cells[name]]
    unused = {title: j for j, title in enumerate(header) if title and j not in at.values()}
    notes += unused_note([*unused])
    notes += [remark for j, (_, remark) in sorted(perhaps.items()) if remark and j in unused.values()]
    titles = {name: header[j] for name, j in at.items()}
    made = tuple(name for name, title in titles.items() if title in sheet.made)
    if sheet.columns and (name := next((name for name in made if titles[name] == sheet.made[-1]), "")):
        titles[name] = " … ".join(dict.fromkeys((sheet.columns[0], sheet.columns[-1])))
    reading = Reading(decimal or ".")
    if decimal is None:
        reading = _found_mark(sheet, cells, titles, made)
    if reading.note:
        notes.append(reading.note)
    return Table(
        place=sheet.place,
        label=sheet.label,
        digest=sheet.digest,
        cells=cells,
        titles=titles,
        units=units,
        rows=np.array(sheet.rows, dtype=np.intp),
        decimal=reading.mark,
        grouped=decimal is not None or reading.grouped,
        notes=tuple(notes),
        columns=sheet.columns,
        made=made,
        others={title: [str(unescaped(shown(record[j]))) for record in sheet.body] for title, j in unused.items()},
        perhaps={header[j]: told for j, told in perhaps.items()},
    )


def _number(text: str) -> str:
    """Return a number in full-width digits or with a sign of its own for minus in plain characters."""
    if text.isascii() or isinstance(text, SheetNumber):
        return text
    wide = all(unicodedata.east_asian_width(c) in "FWNaA" or c.isascii() for c in text)
    plain = plain_text(text) if wide or "\u2212" in text else text
    return plain if any(c in "0123456789" for c in plain) and all(c in "0123456789+-.,eE%" for c in plain) else text


def check_renames(renames: Mapping[str, str], *tables: Table) -> None:
    """Raise an error for renames of unknown columns, or to names that no table has."""
    for name, actual in renames.items():
        if name not in (*LABELS, *NUMBERS):
            known = (*LABELS, *NUMBERS)
            raise InputError(
                f"--column {name}={actual}: no column is called {name!r} here{Guesses(known).of(name)}; "
                f"expected one of {', '.join(known)}"
            )
        if all(table.titles.get(name, "").casefold() != actual.casefold() for table in tables):
            files = " or ".join(dict.fromkeys(table.place for table in tables))
            raise InputError(f"--column {name}={actual}: there is no column {actual!r} in {files}")


def with_hints(read: Callable[[Mapping[str, str], bool], Read], renames: Mapping[str, str], wide: bool) -> Read:
    """Return what is read; if it is refused, name what mends it, after trying.

    Parameters
    ----------
    read
        Reads with names of columns, and as a wide table or not.
    renames, wide
        Those of the user.
    """
    try:
        return read(renames, wide)
    except TableError as error:
        mending = next((hint for hint in error.candidates if _mends(read, renames, wide, hint)), {})
        error.remedy = shlex.join(words_of(mending))
        raise


def words_of(hint: Hint) -> list[str]:
    """Return the options of the command line that read a table in another way."""
    columns = [word for name, title in hint.items() if name != "wide" for word in ("--column", f"{name}={title}")]
    return [*columns, *(["--wide"] if "wide" in hint else [])]


def _mends(read: Callable[[Mapping[str, str], bool], Read], renames: Mapping[str, str], wide: bool, hint: Hint) -> bool:
    """Return whether a table is read in another way, and nothing looks wrong, or is refused for single cells only."""
    columns = {name: title for name, title in hint.items() if name != "wide"}
    try:
        found = read({**renames, **columns}, wide or "wide" in hint)
    except TableError as error:
        return bool(error.problems) and all(problem.row > 0 for problem in error.problems)
    except InputError:
        return False
    return not any("looks wrong" in note for note in found.notes)


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
            Cell(text, sheet.columns[i] if name in made else titles[name], sheet.rows[i])
            for i, text in enumerate(cells[name])
            if not (isinstance(text, SheetNumber) or (sheet.between_commas and "," not in text))
        ]
        for name in NUMBERS
        if name in cells
    ]
    filled = [[c for c in column if c.text.casefold() not in MISSING] for column in numbers]
    reading = decimal_mark(filled, sheet.between_commas)
    if reading.unclear is not None:
        raise InputError(_unclear(sheet.place, reading.unclear))
    return reading


def _unclear(place: str, cell: Cell) -> str:
    """Return the message for a number that can be read in two ways."""
    other = cell.text.replace(",", "").replace(".", "")
    return (
        f"{place}: {cell.place}: {cell.text!r} may be {cell.text.replace(',', '.')} or {other}, and no other "
        "number of this table decides which; give the decimal mark with --decimal . or --decimal ,"
    )
