"""Forces on fingerpads pressed by a rigid flat plate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softness_bayes.data.columns import FORCE, FORCES_OF_A_PLATE, INDENTATION
from softness_bayes.data.decimals import Marks
from softness_bayes.data.faults import natural
from softness_bayes.data.formats import TableSource
from softness_bayes.data.reading import read_as
from softness_bayes.data.shapes import Request
from softness_bayes.data.tables import FloatArray, IntArray, Table, freeze
from softness_bayes.errors import InputError
from softness_bayes.ranges import ANY
from softness_bayes.readable import counted, some_of

FLAT_PLATE = ("flat_plate", "flat plate", "plate", "flat")
"""Names of a rigid flat plate in a column `indentor`, ignoring case; without the column, all rows refer to a plate."""

SOLE_FINGER = "finger"
"""Name of the participant in a table without a column of participants."""


@dataclass(frozen=True, eq=False)
class Compression:
    """Forces of a rigid flat plate on fingerpads at given indentations; rows without a force are left out.

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
    def read(cls, path: TableSource, *, columns: Mapping[str, str] | None = None, decimal: Marks = None) -> Compression:
        """Read a table of forces, one row each.

        Columns: `participant` (if missing, all rows are of one finger), `indentation_mm`, `force_n`. If there is a
        column `indentor`, rows for other indentors than a flat plate are left out with a note, as are rows without a
        force or with a force of 0.

        Parameters
        ----------
        path
            Text file, Excel workbook, Parquet file, or DataFrame.
        columns
            Names of columns in the file, by the names above, where they differ.
        decimal
            Decimal mark, "," or "."; by default inferred from the file, which is rejected if ambiguous.

        Raises
        ------
        InputError
            Naming file, row, column and value.
        """
        return read_as(cls.from_table, path, Request(FORCES_OF_A_PLATE, columns or {}, decimal))

    @classmethod
    def from_table(cls, table: Table) -> Compression:
        """Return the rows of a table; its columns are those of `read`."""
        table.require(INDENTATION.name, FORCE.name)
        notes = list(table.notes)
        if "participant" not in table:
            notes.append("no column 'participant': all forces are treated as those of one finger")
            table = table.with_cells("participant", [SOLE_FINGER] * len(table))
        if "indentor" in table:
            flat = np.array([name.casefold() in FLAT_PLATE for name in table.labels("indentor")])
            if not flat.all():
                others = some_of(int((~flat).sum()), len(table), "row", "has", "have")
                notes.append(f"{others} another indentor than a flat plate; left out")
            table = table.take(np.flatnonzero(flat))
        by = table.labels("participant")
        # here 0 means that the plate does not yet touch the finger
        depth, force = (table.numbers(replace(column, range=ANY, reason="")) for column in (INDENTATION, FORCE))
        for i in range(len(table)):
            if force[i] < 0:
                table.fault(i, FORCE.name, "expected 0 or a positive force")
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
            raise InputError(f"{table.place}: no row with a force above 0 on a flat plate")
        names = natural(by[i] for i in kept)
        place = {name: k for k, name in enumerate(names)}
        return cls(
            tuple(names),
            np.array([place[by[i]] for i in kept]),
            depth[kept],
            force[kept],
            table.rows[kept],
            n_zero=zero,
            source=table.place,
            digest=table.digest,
            notes=tuple(f"{table.label}: {note}" for note in notes),
        )
