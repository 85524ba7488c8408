"""Firing recorded from afferents under rigid probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data.columns import (
    AFFERENTS,
    COUNT,
    CURVATURE,
    DISTANCE,
    FORCE,
    INDENTATION,
    RATE,
    RATE_SD,
    RATERS,
    WINDOW,
    Column,
)
from softness_bayes.data.decimals import Marks
from softness_bayes.data.faults import natural
from softness_bayes.data.formats import TableSource
from softness_bayes.data.ratings import loads_in
from softness_bayes.data.reading import read_as
from softness_bayes.data.shapes import Request
from softness_bayes.data.tables import FloatArray, IntArray, Table, freeze
from softness_bayes.errors import InputError
from softness_bayes.ranges import Range
from softness_bayes.readable import counted
from softness_bayes.touch.contact import Load

_AVERAGED = replace(RATERS, label="number of averaged responses", range=Range(1.0, 1e6))
_ARRAYS = ("curvature", "distance", "rate", "n", "sd", "count", "window")


@dataclass(frozen=True, eq=False)
class Afferents:
    """Responses of afferents to a rigid probe pressed on the fingerpad, one row each: a rate, or a count of spikes.

    Parameters
    ----------
    names
        Names of the afferents.
    afferent
        Index (rows,) of each row's afferent; -1 for means of several.
    loads
        Load of each row.
    curvature, distance
        Probe curvature [1/m] (0: flat), and distance of the receptive field from the contact's axis [m], both (rows,).
    rate, n, sd
        Firing rate [Hz] (NaN in rows with a count), number of responses averaged, and their standard deviation [Hz]
        (NaN if not stated), all (rows,).
    count, window
        Number of spikes and duration [s] in which they were counted (NaN in rows with a rate), both (rows,).
    recording
        Name (rows,) of the recording, for tables and figures; empty where there is none.
    species
        The species named in the table.
    rows
        Line (rows,) of each row in its file.
    source, digest, notes
        File, SHA-256 of its bytes, and notes for the user.
    """

    names: tuple[str, ...]
    afferent: IntArray
    loads: tuple[Load, ...]
    curvature: FloatArray
    distance: FloatArray
    rate: FloatArray
    n: FloatArray
    sd: FloatArray
    count: FloatArray
    window: FloatArray
    rows: IntArray
    recording: tuple[str, ...] = ()
    species: tuple[str, ...] = ()
    source: str = "afferents"
    digest: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, self.source, {"afferent": int, "rows": int, **dict.fromkeys(_ARRAYS, float)})

    def __len__(self) -> int:
        return len(self.curvature)

    def take(self, rows: IntArray) -> Afferents:
        """Return some rows of the same afferents."""
        arrays = {name: getattr(self, name)[rows] for name in ("afferent", "rows", *_ARRAYS)}
        named = tuple(self.recording[k] for k in rows) if self.recording else ()
        return replace(self, **arrays, loads=tuple(self.loads[k] for k in rows), recording=named)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """True (rows,) for rows with a count of spikes instead of a rate."""
        return ~np.isnan(self.count)

    @property
    def observed(self) -> FloatArray:
        """The response as a rate [Hz], shape (rows,): counts are divided by their window."""
        return np.where(self.counted, self.count / self.window, self.rate)

    @classmethod
    def read(cls, path: TableSource, *, columns: Mapping[str, str] | None = None, decimal: Marks = None) -> Afferents:
        """Read a table of recorded responses, one row each.

        Columns: `force_n` or `indentation_mm`, `probe_curvature_per_m`, `distance_mm`, and either `rate_hz` (with `n`
        and `sd_hz`, if it is a mean and its spread is known) or `count` with `window_s`. Optional: `recording`;
        `afferent`, blank for means of several; `species`.

        Parameters
        ----------
        path
            Text file, Excel workbook, Parquet file, or DataFrame.
        columns
            Names of columns in the file, by the names above, where they differ.
        decimal
            Decimal mark, "," or "."; by default inferred from the file.

        Raises
        ------
        InputError
            Naming file, row, column and value.
        """
        return read_as(cls.from_table, path, Request(AFFERENTS, columns or {}, decimal))

    @classmethod
    def from_table(cls, table: Table) -> Afferents:
        """Return the rows of a table; its columns are those of `read`."""
        table.require(CURVATURE.name, DISTANCE.name)
        if FORCE.name not in table and INDENTATION.name not in table:
            table.lack(f"no column {FORCE.name!r} or {INDENTATION.name!r}", FORCE.name, INDENTATION.name)
        if RATE.name not in table and COUNT.name not in table:
            table.lack(f"no column {RATE.name!r} or {COUNT.name!r}", RATE.name, COUNT.name)
        table.check()
        values = {column.name: table.numbers(column) for column in (*_NUMBERS, _AVERAGED)}
        rate, count = values[RATE.name], values[COUNT.name]
        kept = [i for i in range(len(table)) if not _is_missing(table, i)]
        loads = loads_in(table, None)
        for i in kept:
            _check_row(table, i, {name: float(column[i]) for name, column in values.items()})
        table.check()
        if not kept:
            raise InputError(f"{table.place}: no row with a rate or a count")
        filed = table.cells.get("afferent", [""] * len(table))
        names = natural(filed[i] for i in kept if filed[i])
        notes = list(table.notes)
        if len(kept) < len(table):
            notes.append(f"{counted(len(table) - len(kept), 'response is', 'responses are')} missing")
        place = {name: k for k, name in enumerate(names)}
        return cls(
            tuple(names),
            np.array([place.get(filed[i], -1) for i in kept]),
            tuple(load for i in kept if (load := loads[i]) is not None),
            values[CURVATURE.name][kept],
            values[DISTANCE.name][kept],
            rate[kept],
            np.where(np.isnan(values[_AVERAGED.name]), 1.0, values[_AVERAGED.name])[kept],
            values[RATE_SD.name][kept],
            count[kept],
            values[WINDOW.name][kept],
            table.rows[kept],
            recording=tuple(table.cells["recording"][i] for i in kept) if "recording" in table else (),
            species=tuple(sorted({text for text in table.cells.get("species", ()) if text})),
            source=table.place,
            digest=table.digest,
            notes=tuple(f"{table.label}: {note}" for note in notes),
        )


_NUMBERS = (CURVATURE, DISTANCE, RATE, RATE_SD, COUNT, WINDOW)


def _is_missing(table: Table, i: int) -> bool:
    """Return whether a row has neither a rate nor a count, nor a faulty one."""
    names = [column.name for column in (RATE, COUNT) if column.name in table]
    return all(not table.cells[name][i].strip() for name in names)


def _check_row(table: Table, i: int, values: Mapping[str, float]) -> None:
    """Add the faults of a row: missing places, two responses, a count without its window."""

    def states(column: Column) -> bool:
        return not np.isnan(values[column.name]) or (column.name in table and table.is_faulty(i, column.name))

    for column in (CURVATURE, DISTANCE):
        if not states(column):
            table.problem(i, column.name, f"expected {column.expected()} where there is a response, got ''")
    if not states(COUNT):
        return
    text = table.cells[COUNT.name][i]
    if states(RATE):
        table.problem(i, COUNT.name, f"expected a rate or a count, got both: {text!r}")
    elif values[COUNT.name] % 1 > 0:
        table.fault(i, COUNT.name, "expected a whole number of spikes")
    elif not states(WINDOW):
        table.problem(
            i, COUNT.name, f"expected a count with its duration in column {WINDOW.name!r}, got {text!r} alone"
        )
