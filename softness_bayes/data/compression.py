"""Forces on fingerpads pressed by a rigid flat plate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softness_bayes.data.columns import FORCE, INDENTATION, Column
from softness_bayes.data.faults import natural
from softness_bayes.data.formats import TableSource
from softness_bayes.data.headers import PRESSED
from softness_bayes.data.reading import check_renames, read_table, with_hints
from softness_bayes.data.tables import FloatArray, IntArray, Marks, Table, freeze
from softness_bayes.errors import InputError
from softness_bayes.readable import counted, some_of

FLAT_PLATE = ("flat_plate", "flat plate", "plate", "flat")
"""Names of a rigid flat plate in a column `indentor`, ignoring case; without the column, all rows refer to a plate."""

# here 0 means that the plate does not yet touch the finger
_INDENTATION = Column(INDENTATION.name, INDENTATION.label, INDENTATION.unit, power=INDENTATION.power)
_FORCE = Column(FORCE.name, FORCE.label, FORCE.unit)


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

        def read(renames: Mapping[str, str], _: bool) -> Compression:
            table = read_table(path, PRESSED, renames, decimal)
            check_renames(renames, table)
            return cls.from_table(table)

        return with_hints(read, columns or {}, False)

    @classmethod
    def from_table(cls, table: Table) -> Compression:
        """Return the rows of a table; its columns are those of `read`."""
        table.require(INDENTATION.name, FORCE.name)
        notes = [f"{table.label}: {note}" for note in table.notes]
        if "participant" not in table:
            notes.append(f"{table.label}: no column 'participant': all forces are treated as those of one finger")
            table = replace(table, cells={**table.cells, "participant": [SOLE_FINGER] * len(table)})
        if "indentor" in table:
            flat = np.array([name.casefold() in FLAT_PLATE for name in table.labels("indentor")])
            if not flat.all():
                others = some_of(int((~flat).sum()), len(table), "row", "has", "have")
                notes.append(f"{table.label}: {others} another indentor than a flat plate; left out")
            table = table.take(np.flatnonzero(flat))
        by, depth, force = table.labels("participant"), table.numbers(_INDENTATION), table.numbers(_FORCE)
        for i in range(len(table)):
            if force[i] < 0:
                table.fault(i, FORCE.name, f"expected 0 or a positive force, got {table.cells[FORCE.name][i]!r}")
            if not force[i] > 0:
                continue
            for column, value in ((FORCE, force[i]), (INDENTATION, depth[i])):
                if not column.holds(value):
                    found = table.cells[column.name][i]
                    expected = column.expected(table.units.get(column.name))
                    table.fault(i, column.name, f"expected {expected} where there is a force, got {found!r}")
        table.check()
        zero, missing = int((force == 0).sum()), int(np.isnan(force).sum())
        if missing:
            notes.append(f"{table.label}: {counted(missing, 'force is', 'forces are')} missing")
        if zero:
            notes.append(
                f"{table.label}: {zero} rows with a force of 0 are left out, because forces are fitted on a log scale"
            )
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
            notes=tuple(notes),
        )
