"""Loads of a table of ratings: columns, and the load of each row."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from softness_bayes.data.columns import FORCE, INDENTATION, RATING, Column
from softness_bayes.data.tables import MISSING, Table
from softness_bayes.errors import InputError, quoted
from softness_bayes.touch.contact import Force, Indentation, Load


class LoadColumn(NamedTuple):
    """A kind of load: its column, its type, and the function that returns its value [SI]."""

    column: Column
    kind: type[Indentation] | type[Force]
    value: Callable[[Any], float]


LOAD_COLUMNS = (
    LoadColumn(INDENTATION, Indentation, attrgetter("depth")),
    LoadColumn(FORCE, Force, attrgetter("newton")),
)


def loads_of(indentation_mm: Iterable[float] = (), force_n: Iterable[float] = ()) -> tuple[Load, ...]:
    """Return the distinct loads of some indentations [mm] and forces [N]: indentations first, each in increasing order.

    Raises
    ------
    InputError
        If a value is not positive and finite.
    """
    distinct: set[Load] = set()
    for (column, kind, _), given in zip(LOAD_COLUMNS, (indentation_mm, force_n), strict=True):
        try:
            distinct |= {kind(column.parse(repr(float(value)))) for value in given}
        except ValueError as error:
            raise InputError(f"{column.name}: {error}") from None
    return tuple(sorted(distinct, key=rank))


def rank(load: Load) -> tuple[int, float]:
    """Return the sort key of a load: indentations first, each in increasing order."""
    return next((k, entry.value(load)) for k, entry in enumerate(LOAD_COLUMNS) if isinstance(load, entry.kind))


def given_load(table: Table, indentation_mm: float | None, force_n: float | None) -> Load | None:
    """Return the load given for all rows, or None if there is a column; having neither or both is a fault."""
    filed = [entry.column.name for entry in LOAD_COLUMNS if entry.column.name in table]
    given = loads_of(*([] if value is None else [value] for value in (indentation_mm, force_n)))
    if not filed and len(given) != 1:
        table.faults.add_general(
            f"no load column ({INDENTATION.name} or {FORCE.name}); give the load of all "
            "ratings by one of --indentation-mm and --force-n, or name its column with --column"
            + "".join(f"; {note}" for note in table.notes if "fabric" in table and RATING.name in table)
        )
    elif filed and given:
        table.faults.add_general(
            "--indentation-mm and --force-n apply only to tables without a load column; this one has "
            f"{' and '.join(repr(table.titles[name]) for name in filed)}"
        )
    elif len(filed) > 1:
        cells = zip(*(table.cells[name] for name in filed), strict=True)
        if all(all(text.casefold() not in MISSING for text in row) for row in cells):
            ways = " or ".join(f"--column {name}={quoted(table.titles[name])}" for name in filed)
            remedy = f"{ways} takes only one of them"
            if any(table.titles[name].casefold() == name for name in filed):
                remedy = f"remove the column that was measured rather than controlled ({' or '.join(filed)})"
            table.faults.add_general(f"every row has an indentation and a force, expected one load; {remedy}")
            table.check()
    return given[0] if given else None


def loads_in(table: Table, given: Load | None) -> list[Load | None]:
    """Return each row's load, from its columns or the given one; rows without a load are faults."""
    filed = {entry: table.numbers(entry.column) for entry in LOAD_COLUMNS if entry.column.name in table}
    if not filed:
        return [given] * len(table)
    touches: list[Load | None] = []
    present = {entry: ~np.isnan(values) for entry, values in filed.items()}
    for i in range(len(table)):
        values = {entry: float(values[i]) for entry, values in filed.items() if present[entry][i]}
        if len(values) != 1 and not any(table.is_faulty(i, entry.column.name) for entry in filed):
            last = next(reversed(filed)).column.name
            found = " and ".join(quoted(table.cells[entry.column.name][i]) for entry in filed)
            expected = "a load" if len(filed) == 1 else "one load: an indentation or a force"
            table.fault(i, last, f"expected {expected}, got {found}")
        touches.append(next((entry.kind(value) for entry, value in values.items()), None))
    return touches
