"""Measured properties of fabrics, and the modulus that follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from softness_bayes.data.columns import (
    BENDING_RIGIDITY,
    EFFECTIVE_MODULUS,
    MODULUS_SOURCES,
    POISSON_RATIO,
    TENSILE_MODULUS,
    THICKNESS,
    Column,
)
from softness_bayes.data.names import alike_notes, natural
from softness_bayes.data.tables import FloatArray, Table, check_renames, read_only, read_table
from softness_bayes.errors import InputError, quoted
from softness_bayes.touch.contact import PLATE_LENGTH, PRINTED_RIGIDITY, FabricModulus

USUAL_POISSON_RATIO = 0.3
"""Poisson ratio [-] of a fabric for which none is given (model.md 10)."""

PROPERTIES: Mapping[str, Column] = {
    "tensile_modulus": TENSILE_MODULUS,
    "thickness": THICKNESS,
    "poisson_ratio": POISSON_RATIO,
    "bending_rigidity": BENDING_RIGIDITY,
    "effective_modulus": EFFECTIVE_MODULUS,
}
"""Field of `Fabrics` -> its column."""


def _unmeasured() -> FloatArray:
    return np.array(np.nan)


@dataclass(frozen=True, eq=False)
class Fabrics:
    """Measured properties of some fabrics: arrays (n,) over the fabrics, NaN for a property that was not measured.

    Parameters
    ----------
    names
        Distinct names.
    tensile_modulus, thickness
        E_ten [Pa] and h [m].
    poisson_ratio
        nu_fab [-] in (-1, 0.5]; NaN becomes 0.3.
    bending_rigidity
        D [N m]; takes precedence over E_ten and h.
    effective_modulus
        E_fab [Pa]; takes precedence over all others.
    source, rows, digest, notes
        File, line of each fabric in it, SHA-256 of its bytes, and notes for the user.

    Raises
    ------
    InputError
        If names repeat, a value is out of range, or a fabric lacks the properties for a modulus.
    """

    names: tuple[str, ...]
    tensile_modulus: FloatArray = field(default_factory=_unmeasured)
    thickness: FloatArray = field(default_factory=_unmeasured)
    poisson_ratio: FloatArray = field(default_factory=_unmeasured)
    bending_rigidity: FloatArray = field(default_factory=_unmeasured)
    effective_modulus: FloatArray = field(default_factory=_unmeasured)
    source: str = "fabrics"
    rows: tuple[int, ...] = ()
    digest: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        if len(set(self.names)) < len(self.names):
            raise InputError(f"{self.source}: two fabrics have the same name")
        for name, column in PROPERTIES.items():
            values = np.broadcast_to(getattr(self, name), len(self.names))
            if column is POISSON_RATIO:
                values = np.where(np.isnan(values), USUAL_POISSON_RATIO, values)
            for i, value in enumerate(values):
                if not (np.isnan(value) or column.holds(value)):
                    raise InputError(f"{self._place(i)}: {name} is {value}, expected {column.expected}")
            object.__setattr__(self, name, read_only(values, float))
        for i, source in enumerate(self.basis):
            if not source:
                raise InputError(
                    f"{self._place(i)}: expected {EFFECTIVE_MODULUS.name}, or {BENDING_RIGIDITY.name}, "
                    f"or both {TENSILE_MODULUS.name} and {THICKNESS.name}"
                )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def basis(self) -> tuple[str, ...]:
        """The column that each fabric's modulus comes from, empty if there is none."""
        measured = (
            ~np.isnan(self.effective_modulus),
            ~np.isnan(self.bending_rigidity),
            ~np.isnan(self.tensile_modulus) & ~np.isnan(self.thickness),
        )
        return tuple(np.select(measured, [column.name for column in MODULUS_SOURCES], "").tolist())

    def modulus(self, reading: FabricModulus = PRINTED_RIGIDITY, length: float = PLATE_LENGTH) -> FloatArray:
        """Return the effective modulus E_fab = D / l³ (n,) [Pa], or as measured (model.md 1).

        Parameters
        ----------
        reading
            Formula for D [N m] from E_ten, h and nu_fab, if it was not measured.
        length
            l [m].

        Raises
        ------
        InputError
            If a modulus overflows or vanishes.
        """
        with np.errstate(over="ignore", under="ignore"):
            computed = reading.rigidity(self.tensile_modulus, self.thickness, self.poisson_ratio)
            rigidity = np.where(np.isnan(self.bending_rigidity), computed, self.bending_rigidity)
            modulus = np.where(np.isnan(self.effective_modulus), rigidity / length**3, self.effective_modulus)
        for i, value in enumerate(modulus):
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"{self._place(i)}: E_fab is {value} Pa, expected a positive modulus")
        return modulus

    def take(self, names: tuple[str, ...]) -> Fabrics:
        """Return the fabrics of these names, in their order."""
        place = {name: i for i, name in enumerate(self.names)}
        index = [place[name] for name in names]
        properties = {name: getattr(self, name)[index] for name in PROPERTIES}
        rows = tuple(self.rows[i] for i in index) if self.rows else ()
        return replace(self, names=names, rows=rows, **properties)

    def cells(self) -> dict[str, list[str]]:
        """Return the columns that are not empty, as text for a file."""
        columns = {
            column.name: [column.write(value) for value in getattr(self, name)] for name, column in PROPERTIES.items()
        }
        return {name: texts for name, texts in columns.items() if any(texts)}

    def _place(self, i: int) -> str:
        row = f"row {self.rows[i]}, " if self.rows else ""
        return f"{self.source}: {row}fabric {quoted(self.names[i])}"

    @classmethod
    def read(cls, path: str | Path, *, columns: Mapping[str, str] | None = None, decimal: str | None = None) -> Fabrics:
        """Read a fabric table, one row per fabric.

        Columns: `fabric`; in each row `effective_modulus_kpa`, or `bending_rigidity_n_m`, or
        `tensile_modulus_mpa` and `thickness_mm`; `poisson_ratio` where known.

        Parameters
        ----------
        path
            CSV file.
        columns
            Name above -> name in the file, where they differ.
        decimal
            What stands before the decimals, "," or "."; left out, the file tells or is refused.

        Raises
        ------
        InputError
            Naming file, row, column and value.
        """
        table = read_table(path, columns or {}, decimal)
        check_renames(columns or {}, table)
        return cls.from_table(table)

    @classmethod
    def from_table(cls, table: Table, repeated: bool = False) -> Fabrics:
        """Return the fabrics of a table; in a table of ratings (`repeated`) the rows of a fabric must agree."""
        labels = table.labels("fabric")
        rows: dict[str, list[int]] = {name: [] for name in (natural(labels) if repeated else labels)}
        for i, name in enumerate(labels):
            if rows[name] and not repeated:
                raise table.error(i, "fabric", f"{quoted(name)} stands in row {table.rows[rows[name][0]]} already")
            rows[name].append(i)
        properties = {}
        for name, column in PROPERTIES.items():
            filed = table.numbers(column)
            properties[name] = np.array([_agreed(table, column, filed, own) for own in rows.values()])
        notes = [f"{table.path.name}: {note}" for note in (*table.notes, *alike_notes("fabric", rows))]
        usual = np.isnan(properties["poisson_ratio"]).sum()
        if usual:
            notes.append(
                f"{table.path.name}: poisson_ratio {USUAL_POISSON_RATIO} is taken for {usual} of "
                f"{len(rows)} fabrics, which have none"
            )
        first = tuple(int(table.rows[own[0]]) for own in rows.values())
        return cls(
            tuple(rows),
            **properties,
            source=str(table.path),
            rows=first,
            digest=table.digest,
            notes=tuple(notes),
        )


def _agreed(table: Table, column: Column, filed: FloatArray, own: list[int]) -> float:
    """Return a fabric's value of a property, the same in all its rows; NaN if no row has one."""
    given = [i for i in own if not np.isnan(filed[i])]
    for i in given:
        if filed[i] != filed[given[0]]:
            value, first = (table.cells[column.name][j] for j in (i, given[0]))
            fabric, row = table.cells["fabric"][i], table.rows[given[0]]
            raise table.error(
                i, column.name, f"{quoted(fabric)} has {quoted(value)} here and {quoted(first)} in row {row}"
            )
    return float(filed[given[0]]) if given else np.nan
