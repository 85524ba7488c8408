"""Measured responses of fingers: forces of a rigid flat plate, and firing recorded from afferents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.ranges import ANY, Range
from softness_bayes.base.readable import counted, some_of
from softness_bayes.data.columns import (
    AFFERENTS,
    COUNT,
    CURVATURE,
    DISTANCE,
    FORCE,
    FORCES_OF_A_PLATE,
    INDENTATION,
    NUMBERS,
    RATE,
    RATE_SD,
    RATERS,
    WINDOW,
    Column,
    Kind,
)
from softness_bayes.data.ratings import loads_by_column, loads_in
from softness_bayes.data.reading import OneTable
from softness_bayes.data.tables import FloatArray, IntArray, Table, freeze
from softness_bayes.data.texts import listing, natural
from softness_bayes.data.titles import key
from softness_bayes.touch.contact import Load

FLAT_PLATE = ("flat plate", "plate", "flat")
"""Names of a rigid flat plate in a column `indentor`, ignoring case and punctuation. Without the column, all rows refer
to a plate."""

FREE_TRAVEL = 5e-4
"""Largest indentation at which no force may be measurable [m]."""

SOLE_FINGER = "finger"
"""Name of the participant in a table without a column of participants."""


@dataclass(frozen=True, eq=False)
class Compression(OneTable):
    """Forces of a rigid flat plate on fingerpads at given indentations; rows without a force are left out.

    Columns of a table: `participant` (if missing, all rows are of one finger), `indentation_mm`, `force_n`. If there
    is a column `indentor`, rows for other indentors than a flat plate are left out with a note, as are rows without a
    force or with a force of 0.

    Parameters
    ----------
    participants
        Names of the participants.
    participant
        Index (n,) of each row's finger.
    indentation, force
        Indentation [m] and force [N], both (n,) and positive.
    rows
        Line (n,) of each row in its file.
    n_zero
        Number of rows dropped because a force of 0 has no logarithm.
    source, digest, notes
        File, SHA-256 of its bytes, and notes for the user.
    """

    kind: ClassVar[Kind] = FORCES_OF_A_PLATE

    participants: tuple[str, ...]
    participant: IntArray
    indentation: FloatArray
    force: FloatArray
    rows: IntArray
    n_zero: int = 0
    source: str = "compression"
    digest: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, self.source, {"participant": int, "indentation": float, "force": float, "rows": int})
        for column, values in ((INDENTATION, self.indentation), (FORCE, self.force)):
            for row, value in zip(self.rows, values, strict=True):
                column.range.require(f"{self.source}: row {row}: {column.label}", value)

    def __len__(self) -> int:
        return len(self.force)

    @classmethod
    def from_table(cls, table: Table) -> Compression:
        """Return the rows of a table."""
        table.require("indentation_mm", "force_n")
        notes = list(table.notes)
        if "participant" not in table:
            notes.append("no column 'participant': all forces are treated as those of one finger")
        if "indentor" in table:
            indentors = table.labels("indentor")
            if others := [name for name in indentors if key(name) not in FLAT_PLATE]:
                told = some_of(len(others), len(table), "row", "has", "have")
                named = listing([*map(quoted, natural(others))])
                notes.append(f"{told} another indentor than a flat plate ({named}); left out")
            table = table.take(np.flatnonzero([name not in others for name in indentors]))
        by = table.labels("participant") if "participant" in table else [SOLE_FINGER] * len(table)
        # here 0 means that the plate does not yet touch the finger
        depth, force = (table.numbers(replace(column, range=ANY, reason="")) for column in (INDENTATION, FORCE))
        for i in range(len(table)):
            if force[i] < 0:
                table.fault(i, "force_n", "expected 0 or a positive force")
            for column, value in ((FORCE, force[i]), (INDENTATION, depth[i])) if force[i] > 0 else ():
                if not column.holds(value):
                    expected = column.expected(table.units.get(column.name))
                    table.fault(i, column.name, f"expected {expected} where there is a force")
        table.check()
        zero, missing = int((force == 0).sum()), int(np.isnan(force).sum())
        if missing:
            notes.append(f"{counted(missing, 'force is', 'forces are')} missing")
        if zero:
            notes.append(f"{zero} rows with a force of 0 are left out, because forces are fitted on a log scale")
        kept = np.flatnonzero(force > 0).tolist()
        if not kept:
            raise InputError("; ".join([f"{table.place}: no row with a force above 0 on a flat plate", *notes]))
        if (free := np.max(np.nan_to_num(depth), initial=0.0, where=force == 0)) > FREE_TRAVEL:
            notes.append(
                f"looks wrong: the force is 0 up to {1e3 * free:g} mm: indentations begin where the plate touches"
            )
        if np.sum((depth[kept] - depth[kept].mean()) * force[kept]) < 0:
            notes.append("looks wrong: forces fall with indentation: is it the position of the plate above something?")
        names = natural(by[i] for i in kept)
        participant = np.array([names.index(by[i]) for i in kept])
        return cls(
            tuple(names), participant, depth[kept], force[kept], table.rows[kept], n_zero=zero, **table.origin(notes)
        )


AVERAGED = replace(RATERS, label="number of averaged responses", range=Range(1.0, 1e6))

RESPONSES: Mapping[str, Column] = MappingProxyType(
    {"curvature": CURVATURE, "distance": DISTANCE, "rate": RATE, "n": AVERAGED, "sd": RATE_SD, "window": WINDOW}
)
"""The arrays of `Afferents`, each with its column in files and results."""


@dataclass(frozen=True, eq=False)
class Afferents(OneTable):
    """Responses of afferents to a rigid probe pressed on the fingerpad, one row each: a rate, or a count of spikes.

    Columns of a table: `force_n` or `indentation_mm`, `probe_curvature_per_m`, `distance_mm`, and either `rate_hz`
    (with `n` and `sd_hz`, if it is a mean and its spread is known) or `count` with `window_s`. Optional: `recording`;
    `afferent`, blank for means of several; `species`.

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
        Firing rate [Hz], number of responses averaged, and their standard deviation [Hz] (NaN if not stated), all
        (rows,).
    window
        Duration [s] (rows,) in which spikes were counted, whose number is rate × window; NaN in rows with a rate.
    recording
        Name (rows,) of the recording, for tables and figures; empty where there is none.
    species
        The species named in the table.
    rows
        Line (rows,) of each row in its file.
    source, digest, notes
        File, SHA-256 of its bytes, and notes for the user.
    """

    kind: ClassVar[Kind] = AFFERENTS

    names: tuple[str, ...]
    afferent: IntArray
    loads: tuple[Load, ...]
    curvature: FloatArray
    distance: FloatArray
    rate: FloatArray
    n: FloatArray
    sd: FloatArray
    window: FloatArray
    rows: IntArray
    recording: tuple[str, ...] = ()
    species: tuple[str, ...] = ()
    source: str = "afferents"
    digest: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, self.source, {"afferent": int, "rows": int, **dict.fromkeys(RESPONSES, float)})

    def __len__(self) -> int:
        return len(self.curvature)

    def take(self, rows: IntArray) -> Afferents:
        """Return some rows of the same afferents."""
        arrays = {name: getattr(self, name)[rows] for name in ("afferent", "rows", *RESPONSES)}
        named = tuple(self.recording[k] for k in rows) if self.recording else ()
        return replace(self, **arrays, loads=tuple(self.loads[k] for k in rows), recording=named)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """True (rows,) for rows with a count of spikes instead of a rate."""
        return ~np.isnan(self.window)

    @property
    def columns(self) -> dict[Column, FloatArray]:
        """Values of loads, probes and responses by their column [SI], each (rows,), NaN where there is none."""
        return {**loads_by_column(self.loads), **{column: getattr(self, name) for name, column in RESPONSES.items()}}

    @property
    def count(self) -> FloatArray:
        """Number of spikes (rows,), NaN in rows with a rate."""
        return np.round(self.rate * self.window)

    @classmethod
    def from_table(cls, table: Table) -> Afferents:
        """Return the rows of a table."""
        table.require("probe_curvature_per_m", "distance_mm")
        for pair in (("force_n", "indentation_mm"), ("rate_hz", "count")):
            if not {*pair} & table.titles.keys():
                table.lack(f"no column {pair[0]!r} or {pair[1]!r}", *pair)
        if "count" in table and not {"rate_hz", "window_s"} & table.titles.keys():
            table.lack("expected a count with its duration in column 'window_s'", "window_s")
        table.check()
        values = {column.name: table.numbers(column) for column in (COUNT, *RESPONSES.values())}
        kept = np.flatnonzero(["".join(texts).strip() for texts in table.keys("rate_hz", "count")])
        loads = loads_in(table, None)
        for i in kept.tolist():
            _check_row(table, i, values)
        table.check()
        if not kept.size:
            raise InputError(f"{table.place}: no row with a rate or a count")
        notes = list(table.notes)
        if kept.size < len(table):
            notes.append(f"{counted(len(table) - kept.size, 'response is', 'responses are')} missing")
        counts, window = values["count"], values["window_s"]
        values["rate_hz"] = np.where(np.isnan(counts), values["rate_hz"], counts / window)
        values["window_s"] = np.where(np.isnan(counts), np.nan, window)
        values["n"] = np.nan_to_num(values["n"], nan=1.0)
        arrays: dict[str, Any] = {name: values[column.name][kept] for name, column in RESPONSES.items()}
        table = table.take(kept)
        afferents = table.texts("afferent")
        names = natural(filter(None, afferents))
        return cls(
            tuple(names),
            np.array([names.index(name) if name else -1 for name in afferents]),
            tuple(load for i in kept if (load := loads[i]) is not None),
            **arrays,
            rows=table.rows,
            recording=tuple(table.texts("recording")) if "recording" in table else (),
            species=tuple(sorted({text for text in table.texts("species") if text})),
            **table.origin(notes),
        )


def _check_row(table: Table, i: int, values: Mapping[str, FloatArray]) -> None:
    """Add the faults of a row: missing places, two responses, a count without its window."""

    def states(name: str) -> bool:
        return not np.isnan(values[name][i]) or table.is_faulty(i, name)

    for name in ("probe_curvature_per_m", "distance_mm"):
        if not states(name):
            table.problem(i, name, f"expected {NUMBERS[name].expected()} where there is a response, got ''")
    if not states("count"):
        return
    text = table.texts("count")[i]
    if states("rate_hz"):
        table.problem(i, "count", f"expected a rate or a count, got both: {text!r}")
    elif values["count"][i] % 1 > 0:
        table.fault(i, "count", "expected a whole number of spikes")
    elif not states("window_s"):
        table.problem(i, "count", f"expected a count with its duration in column 'window_s', got {text!r} alone")
