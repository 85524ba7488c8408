"""Measured properties of fabrics, the modulus derived from them, and whether they are plausible for cloth."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.ranges import RELATIVE_ERRORS, Range, numbers, refuse
from softness_bayes.data.columns import (
    EFFECTIVE_MODULUS,
    FABRICS,
    KNOWN_BY,
    MODULUS_SOURCES,
    POISSON_RATIO,
    PROPERTIES,
    SOLID,
    STANDARD_ERRORS,
    TENSILE_MODULUS,
    THICKNESS,
    Column,
    Kind,
)
from softness_bayes.data.reading import OneTable
from softness_bayes.data.tables import Fault, FloatArray, IntArray, Table, TableError, grouped, read_only
from softness_bayes.data.texts import is_missing, listing, natural
from softness_bayes.data.titles import analysed
from softness_bayes.touch.contact import PLATE_LENGTH, PRINTED_RIGIDITY, FabricModulus

USUAL_POISSON_RATIO = 0.3
"""Poisson ratio [-] of a fabric for which none is given (model.md 10)."""

_BOTH_LIMITS = "effective_modulus_low_kpa and effective_modulus_high_kpa"
_EXPECTED = (
    "expected effective_modulus_kpa, or bending_rigidity_n_m, or both tensile_modulus_mpa and thickness_mm, "
    f"or both {_BOTH_LIMITS}"
)


def bases(properties: Mapping[str, FloatArray]) -> tuple[str, ...]:
    """Return the source column of each fabric's modulus, empty if there is none."""
    given = {name: ~np.isnan(values) for name, values in properties.items()}
    measured = (
        given["effective_modulus"],
        given["effective_modulus_low"],
        given["bending_rigidity"],
        given["tensile_modulus"] & given["thickness"],
    )
    return tuple(np.select(measured, [column.name for column in MODULUS_SOURCES], "").tolist())


def _incomplete(properties: Mapping[str, FloatArray]) -> dict[int, str]:
    """Return the faults in the properties of fabrics: invalid limits, or too few properties for a modulus."""
    basis = bases(properties)
    found = {}
    for i, source in enumerate(basis):
        own = {name: values[i] for name, values in properties.items()}
        low, high = own["effective_modulus_low"], own["effective_modulus_high"]
        bracketed = not (np.isnan(low) and np.isnan(high))
        half = not (np.isnan(own["tensile_modulus"]) and np.isnan(own["thickness"]))
        if bracketed and not low < high:
            low, high = (f"{value / EFFECTIVE_MODULUS.factor:g}" for value in (low, high))
            found[i] = f"{_BOTH_LIMITS} are {low} and {high}, expected both, the first smaller than the second"
        elif bracketed and not np.isnan(own["effective_modulus"]):
            found[i] = f"expected effective_modulus_kpa, or {_BOTH_LIMITS}, but not all three"
        elif not source and (half or not any(basis)):
            found[i] = _EXPECTED
    return found


_PLAUSIBLE = (
    ("tensile_modulus", TENSILE_MODULUS, Range(1e4, 2e9), "is tensile_modulus_mpa in kPa or Pa?"),
    ("thickness", THICKNESS, Range(2e-5, 2.5e-2), "is thickness_mm in µm or m?"),
)
"""Property, column, plausible range for cloth [SI] and likely mistake outside it."""
MODULI = Range(1e1, 3e7)
"""E_fab of cloth [Pa]: 618 measured fabrics have 0.3 to 300 kPa, stiff ones like those in the paper some thousand."""
USUAL_MODULI = Range(1e2, 5e6)
"""Median E_fab of a set of fabrics [Pa]."""
AGREEMENT = 1.1
"""Largest ratio of two moduli of one fabric without a note."""
_UNITS = {
    "effective_modulus_kpa": "in Pa or MPa",
    "effective_modulus_low_kpa": "in Pa or MPa",
    "bending_rigidity_n_m": "in gf·cm²/cm or µN·m",
    "tensile_modulus_mpa": "in other units than MPa and mm",
}


def _unmeasured() -> FloatArray:
    return np.array(np.nan)


@dataclass(frozen=True, eq=False)
class Fabrics(OneTable):
    """Measured properties of some fabrics: arrays (n,) over the fabrics, NaN for properties that were not measured.

    Columns of a table, one row per fabric: `fabric`; in each row `effective_modulus_kpa`, or `bending_rigidity_n_m`,
    or `tensile_modulus_mpa` and `thickness_mm`, or `effective_modulus_low_kpa` and `effective_modulus_high_kpa`, or
    nothing if the modulus is unknown; `poisson_ratio` where known; `batch` if several laboratories measured; standard
    errors of the measured properties where known, relative to their values (`effective_modulus_cv`) or in their units
    (`effective_modulus_sd_kpa`).

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
    tensile_modulus_cv, thickness_cv, bending_rigidity_cv, effective_modulus_cv
        Standard errors relative to the values; 0 for exact values.
    effective_modulus_low, effective_modulus_high
        Limits of an E_fab that was not measured [Pa].
    batch
        Batch of each fabric, whose moduli share one error; "" for all by default.
    source, rows, digest, notes
        File, line of each fabric in it, SHA-256 of its bytes, and notes for the user.

    Raises
    ------
    InputError
        If names repeat, a value is out of range, limits are invalid, or no fabric has the properties for a modulus. If
        only some fabrics lack them, their moduli are unknown.
    """

    kind: ClassVar[Kind] = FABRICS

    names: tuple[str, ...]
    tensile_modulus: FloatArray = field(default_factory=_unmeasured)
    thickness: FloatArray = field(default_factory=_unmeasured)
    poisson_ratio: FloatArray = field(default_factory=_unmeasured)
    bending_rigidity: FloatArray = field(default_factory=_unmeasured)
    effective_modulus: FloatArray = field(default_factory=_unmeasured)
    tensile_modulus_cv: FloatArray = field(default_factory=_unmeasured)
    thickness_cv: FloatArray = field(default_factory=_unmeasured)
    bending_rigidity_cv: FloatArray = field(default_factory=_unmeasured)
    effective_modulus_cv: FloatArray = field(default_factory=_unmeasured)
    effective_modulus_low: FloatArray = field(default_factory=_unmeasured)
    effective_modulus_high: FloatArray = field(default_factory=_unmeasured)
    batch: tuple[str, ...] = ()
    source: str = "fabrics"
    rows: tuple[int, ...] = ()
    digest: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.names, str) or not hasattr(self.names, "__iter__"):
            refuse("fabrics: names", self.names, "a sequence of names, such as ('felt', 'lawn')")
        object.__setattr__(self, "names", tuple(self.names))
        if len(set(self.names)) < len(self.names):
            raise InputError(f"{self.source}: two fabrics have the same name")
        object.__setattr__(self, "batch", tuple(map(str, self.batch)) or ("",) * len(self.names))
        if len(self.batch) != len(self.names):
            raise InputError(f"{self.source}: {len(self.batch)} batches of {len(self.names)} fabrics")
        for name, column in PROPERTIES.items():
            values = np.broadcast_to(numbers(f"fabrics: {name}", getattr(self, name)), len(self.names))
            if column is POISSON_RATIO:
                values = np.where(np.isnan(values), USUAL_POISSON_RATIO, values)
            for i, value in enumerate(values):
                if not (np.isnan(value) or column.holds(value)):
                    raise InputError(f"{self._place(i)}: {name} is {value}, expected {column.expected()}")
            object.__setattr__(self, name, read_only(values, float))
        wrong = _incomplete({name: getattr(self, name) for name in PROPERTIES})
        if wrong:
            faults = [Fault(-1, "", f"{self._spot(i)}: {problem}") for i, problem in wrong.items()]
            raise TableError(self.source, faults)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def basis(self) -> tuple[str, ...]:
        """Source column of each fabric's modulus, empty if there is none."""
        return bases({name: getattr(self, name) for name in PROPERTIES})

    def modulus(
        self, reading: FabricModulus = PRINTED_RIGIDITY, length: float = PLATE_LENGTH, unknown: float | None = None
    ) -> FloatArray:
        """Return the effective modulus E_fab = D / l³ (n,) [Pa], or as measured (model.md 1).

        For limits, it is their geometric mean.

        Parameters
        ----------
        reading
            Formula for D [N m] from E_ten, h and nu_fab, if it was not measured.
        length
            l [m].
        unknown
            Value for fabrics without a modulus [Pa].

        Raises
        ------
        InputError
            If a modulus exceeds that of any solid, or is unknown and no value is given for it.
        """
        with np.errstate(over="ignore", under="ignore"):
            computed = reading.rigidity(self.tensile_modulus, self.thickness, self.poisson_ratio)
            rigidity = np.where(np.isnan(self.bending_rigidity), computed, self.bending_rigidity)
            bracketed = np.sqrt(self.effective_modulus_low) * np.sqrt(self.effective_modulus_high)
            modulus = np.where(np.isnan(bracketed), rigidity / length**3, bracketed)
            modulus = np.where(np.isnan(self.effective_modulus), modulus, self.effective_modulus)
        known = np.array([bool(basis) for basis in self.basis])
        if unknown is not None:
            modulus = np.where(known, modulus, unknown)
        elif not known.all():
            raise InputError(f"{self._place(int(known.argmin()))}: its modulus is unknown; {_EXPECTED}")
        brackets = (self.effective_modulus_low, self.effective_modulus_high)
        for values in (modulus, *(np.where(np.isnan(end), modulus, end) for end in brackets)):
            for i, value in enumerate(values):
                if not SOLID.holds(value):
                    raise InputError(f"{self._place(i)}: E_fab is {value:g} Pa, expected {SOLID}")
        return modulus

    def modulus_cv(self) -> FloatArray:
        """Return the relative standard error of each fabric's E_fab (n,), NaN if none is given or applicable.

        A rigidity from E_ten h³ has that of E_ten and three times that of h, taken as independent errors of the
        logarithms: sd(log E_fab)² = sd(log E_ten)² + 9 sd(log h)² (model.md 1).
        """
        tensile, thickness = log_sd(self.tensile_modulus_cv), log_sd(self.thickness_cv)
        none = np.isnan(tensile) & np.isnan(thickness)
        squared = np.where(none, np.nan, np.nan_to_num(tensile) ** 2 + 9.0 * np.nan_to_num(thickness) ** 2)
        basis = np.array(self.basis)
        by_basis = {
            "effective_modulus_kpa": self.effective_modulus_cv,
            "bending_rigidity_n_m": self.bending_rigidity_cv,
            "tensile_modulus_mpa": np.sqrt(np.expm1(squared)),
        }
        return np.select([basis == name for name in by_basis], [*by_basis.values()], np.nan)

    def take(self, names: tuple[str, ...]) -> Fabrics:
        """Return the fabrics of these names, in their order."""
        place = {name: i for i, name in enumerate(self.names)}
        index = [place[name] for name in names]
        properties = {name: getattr(self, name)[index] for name in PROPERTIES}
        rows = tuple(self.rows[i] for i in index) if self.rows else ()
        return replace(self, names=names, rows=rows, batch=tuple(self.batch[i] for i in index), **properties)

    def cells(self) -> dict[str, list[str]]:
        """Return the nonempty columns as text for a file."""
        columns = {
            column.name: [column.write(value) for value in getattr(self, name)] for name, column in PROPERTIES.items()
        }
        return {name: texts for name, texts in {**columns, "batch": [*self.batch]}.items() if any(texts)}

    def _spot(self, i: int) -> str:
        row = f"row {self.rows[i]}, " if self.rows else ""
        return f"{row}fabric {quoted(self.names[i])}"

    def _place(self, i: int) -> str:
        return f"{self.source}: {self._spot(i)}"

    @classmethod
    def from_table(cls, table: Table, repeated: bool = False) -> Fabrics:
        """Return the fabrics of a table; in a table of ratings (`repeated`) the rows of a fabric must agree."""
        labels = table.labels("fabric")
        named = [column for column in MODULUS_SOURCES if column.name in table]
        if not named or (named == [TENSILE_MODULUS] and THICKNESS.name not in table):
            table.lack(f"no column for moduli: {_EXPECTED}", *(column.name for column in (*MODULUS_SOURCES, THICKNESS)))
            table.check()
        directions = [text.casefold() for text in table.texts("direction")]
        directed = len(set(directions)) > 1
        names = natural(labels) if repeated else [*dict.fromkeys(labels)]
        place = {name: k for k, name in enumerate(names)}
        fabric = np.array([place[name] for name in labels])
        first = np.unique(fabric, return_index=True)[1]
        for i in [] if repeated or directed else np.setdiff1d(np.arange(len(table)), first).tolist():
            table.fault(i, "fabric", "expected one row for each fabric", "; give the mean of repeated measurements")
            fabric[i] = -1
        properties: dict[str, Any] = {
            name: _property(table, column, fabric, directions if name in _DIRECTED else [""] * len(table))
            for name, column in PROPERTIES.items()
        }
        for name in STANDARD_ERRORS:
            _take_standard_errors(table, fabric, first, name, properties)
        of_rows = table.texts("batch")
        # in a table of ratings, batches may be those of people or days
        strange = any(of_rows[i] != of_rows[first[fabric[i]]] for i in np.flatnonzero(fabric >= 0).tolist())
        batch = table.labels("batch") if "batch" in table and not strange else [""] * len(table)
        faulty = fabric[np.isin(table.rows, [row for row, _ in table.faults])]
        sound = np.setdiff1d(np.arange(len(names)), faulty)
        some = {name: values[sound] for name, values in properties.items()}
        if not table.faults or any(bases(some)):
            for k, problem in _incomplete(some).items():
                i = first[sound[k]]
                table.refuse(f"row {table.rows[i]}, fabric {quoted(labels[i])}: {problem}")
        table.check()
        notes = list(table.notes)
        if directed:
            told = listing([*dict.fromkeys(filter(None, directions))])
            notes.append(f"rigidities and moduli are geometric means over directions: {told}")
            columns = [table.texts(PROPERTIES[name].name) for name in _DIRECTED]
            measured = [i for i in range(len(table)) if not all(is_missing(texts[i]) for texts in columns)]
            count = Counter(name for name, direction in {(labels[i], directions[i]) for i in measured} if direction)
            if fewer := [name for name in names if 0 < count[name] < max(count.values())]:
                notes.append(f"looks wrong: not measured in all directions: {listing(fewer)}")
        if strange:
            notes.append("column batch is not that of moduli, because it differs between rows of a fabric; not used")
        thick = ["thickness_mm"] * ("thickness_mm" in table)
        thick += [title for title in table.others if analysed(title).bags & KNOWN_BY["thickness_mm"]]
        if thick and "bending_rigidity_n_m" in table and "effective_modulus_kpa" not in table:
            notes.append(
                f"{thick[0]} is not used where a rigidity D is measured: by the printed relation "
                "E_fab is D / l³ with a fixed length l (model.md 1)"
            )
        if usual := np.isnan(properties["poisson_ratio"]).sum():
            notes.append(
                f"poisson_ratio {USUAL_POISSON_RATIO} is used for {usual} of {len(names)} fabrics without a value"
            )
        lines = tuple(int(row) for row in table.rows[first])
        batches = tuple(batch[i] for i in first)
        found = cls(tuple(names), **properties, batch=batches, source=table.place, rows=lines, digest=table.digest)
        if unknown := [name for name, basis in zip(found.names, found.basis, strict=True) if not basis]:
            notes.append(f"fabrics of unknown modulus: {listing(unknown)}")
        return replace(found, notes=tuple(f"{table.label}: {note}" for note in (*notes, *found.implausible())))

    def implausible(self) -> list[str]:
        """Return notes on values that are implausible for cloth, and on properties that imply different moduli.

        Raises
        ------
        InputError
            For moduli outside the valid range.
        """
        basis = self.basis
        modulus = np.where([bool(column) for column in basis], self.modulus(unknown=1.0), np.nan)
        source = next(column for column in basis if column)
        remedy = f"is {source} {_UNITS[source]}, or is the unit wrong by a factor of a thousand?"
        measured = [(getattr(self, name), column.name, column, *rest) for name, column, *rest in _PLAUSIBLE]
        notes = []
        for values, what, column, usual, wrong in (*measured, (modulus, "E_fab", EFFECTIVE_MODULUS, MODULI, remedy)):
            strange = [i for i, value in enumerate(values) if not np.isnan(value) and not usual.holds(value)]
            if strange:
                shown = listing([f"{self.names[i]} {float(values[i]) / column.factor:.3g}" for i in strange], 3)
                expected = usual.within(1 / column.factor, column.unit)
                count = f"{what} of {len(strange)} of {len(self)} fabrics"
                notes.append(f"looks wrong: {count} ({shown}), expected {expected}: {wrong}")
        median = float(np.exp(np.nanmedian(np.log(modulus))))
        if not any("E_fab" in note for note in notes) and not USUAL_MODULI.holds(median):
            expected = USUAL_MODULI.within(1 / EFFECTIVE_MODULUS.factor, EFFECTIVE_MODULUS.unit)
            said = f"the fabrics' median E_fab is {median / 1e3:.3g} kPa"
            notes.append(f"looks wrong: {said}, expected {expected}: {remedy}")
        with np.errstate(over="ignore", under="ignore"):
            computed = PRINTED_RIGIDITY.rigidity(self.tensile_modulus, self.thickness, self.poisson_ratio)
        both = "tensile_modulus_mpa and thickness_mm"
        for other, rigidity in (("bending_rigidity_n_m", self.bending_rigidity), (both, computed)):
            differ = [
                f"{self.names[i]} {modulus[i] / 1e3:.3g} and {value / 1e3:.3g} kPa"
                for i, value in enumerate((rigidity / PLATE_LENGTH**3).tolist())
                if basis[i] not in other and value > 0 and not 1 / AGREEMENT <= modulus[i] / value <= AGREEMENT
            ]
            if differ:
                notes.append(f"E_fab from the column used and from {other} differ: {listing(differ, 3)}")
        return notes


def warn_of_moduli(fabrics: Fabrics) -> None:
    """Warn of moduli that no cloth has, as ``softness-bayes check`` does."""
    for note in fabrics.implausible():
        if "E_fab" in note and "looks wrong" in note:
            warnings.warn(f"{fabrics.source}: {note}", stacklevel=4)


_DIRECTED = frozenset({"bending_rigidity", "tensile_modulus", "effective_modulus"})


def _property(table: Table, column: Column, fabric: IntArray, directions: Sequence[str]) -> FloatArray:
    """Return a property of each fabric [SI], the geometric mean over its directions; NaN without a value.

    Values of one fabric and direction must agree.
    """
    filed, found = table.numbers(column), np.full(fabric.max() + 1, np.nan)
    for k, rows in grouped(fabric.tolist()).items():
        first: dict[str, int] = {}
        for i in [i for i in rows if k >= 0 and not np.isnan(filed[i])]:
            j = first.setdefault(directions[i], i)
            if filed[i] != filed[j]:
                texts, name = table.texts(column.name), table.texts("fabric")[i]
                problem = f"{quoted(name)} has {quoted(texts[i])} here and {quoted(texts[j])} in row {table.rows[j]}"
                table.problem(i, column.name, problem)
        if first:
            values = filed[[*first.values()]]
            found[k] = values[0] if len(values) == 1 else np.exp(np.log(values).mean())
    return found


def _take_standard_errors(
    table: Table, fabric: IntArray, first: IntArray, name: str, properties: dict[str, FloatArray]
) -> None:
    """Add the errors of a property in its own unit to the relative ones.

    A row with both, an error without a value, or an error that is too large is a fault.
    """
    column, relative, absolute = PROPERTIES[name], PROPERTIES[f"{name}_cv"], STANDARD_ERRORS[name]
    value, cv = properties[name], properties[f"{name}_cv"]
    sd = _property(table, absolute, fabric, [""] * len(table))
    for k in np.flatnonzero(~(np.isnan(sd) & np.isnan(cv))).tolist():
        rows, i = np.flatnonzero(fabric == k).tolist(), int(first[k])
        if any(table.is_faulty(j, column.name, relative.name, absolute.name) for j in rows):
            continue
        given = relative if np.isnan(sd[k]) else absolute
        if not (np.isnan(sd[k]) or np.isnan(cv[k])):
            table.problem(i, given.name, f"expected this or {relative.name}, but not both")
        elif np.isnan(value[k]):
            table.problem(i, given.name, f"an error of {column.name}, which has no value in this row")
        elif given is absolute:
            with np.errstate(over="ignore", under="ignore"):
                cv[k] = sd[k] / value[k]
            if not relative.holds(cv[k]):
                table.fault(i, given.name, f"expected at most {RELATIVE_ERRORS.high:g} times the value")


def log_sd(cv: FloatArray) -> FloatArray:
    """Return the standard deviation of the logarithm of a log-normal quantity with relative standard deviation cv."""
    return np.sqrt(np.log1p(np.asarray(cv, float) ** 2))
