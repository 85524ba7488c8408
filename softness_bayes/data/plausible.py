"""Plausibility checks: codes for missing ratings, and values that are valid but unlikely to have been measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from softness_bayes.data.columns import (
    BENDING_RIGIDITY,
    EFFECTIVE_MODULUS,
    EFFECTIVE_MODULUS_LOW,
    TENSILE_MODULUS,
    THICKNESS,
    Column,
)
from softness_bayes.data.names import listing
from softness_bayes.data.tables import FloatArray
from softness_bayes.ranges import Range

CLOTH = {
    "tensile_modulus": (TENSILE_MODULUS, Range(1e4, 2e9), "in kPa or Pa"),
    "thickness": (THICKNESS, Range(2e-5, 2.5e-2), "in µm or m"),
}
"""Column, plausible range for cloth [SI] and likely mistake outside it, by property of fabrics."""
MODULI = Range(1e1, 3e7)
"""E_fab of cloth [Pa]: 618 measured fabrics have 0.3 to 300 kPa, stiff ones like those in the paper some thousand."""
USUAL_MODULI = Range(1e2, 5e6)
"""Median E_fab of a set of fabrics [Pa]."""
AGREEMENT = 1.1
"""Largest ratio of two moduli of one fabric without a note."""
MISSING_CODES = frozenset({"99", "999", "9999", "99999", "-9", "-99", "-999", "-9999", "-99999"})
"""Numbers commonly used as codes for missing ratings."""
FAR = 9.0
"""Ratio of the absolute value of such a number to the largest other rating above which it is a code, as for 99 among
ratings up to 10."""

_UNITS = {
    EFFECTIVE_MODULUS.name: "in Pa or MPa",
    EFFECTIVE_MODULUS_LOW.name: "in Pa or MPa",
    BENDING_RIGIDITY.name: "in gf·cm²/cm or µN·m",
    TENSILE_MODULUS.name: "in other units than MPa and mm",
}


def cloth_notes(
    names: Sequence[str], properties: Mapping[str, FloatArray], modulus: FloatArray, basis: Sequence[str]
) -> list[str]:
    """Return notes on properties and moduli outside the range of any cloth.

    Parameters
    ----------
    names
        The fabrics.
    properties
        Measured properties [SI], by their names in `CLOTH`; NaN where missing.
    modulus
        E_fab [Pa], NaN if unknown.
    basis
        Source column of each modulus.
    """
    notes = []
    for name, (column, usual, remedy) in CLOTH.items():
        if note := _beyond(names, properties[name], column.name, column, usual):
            notes.append(f"{note}: is {column.name} {remedy}?")
    source = next(column for column in basis if column)
    wrong = f"is {source} {_UNITS[source]}, or is the unit wrong by a factor of a thousand?"
    if note := _beyond(names, modulus, "E_fab", EFFECTIVE_MODULUS, MODULI):
        notes.append(f"{note}: {wrong}")
    elif not USUAL_MODULI.holds(median := float(np.exp(np.nanmedian(np.log(modulus))))):
        expected = USUAL_MODULI.within(1 / EFFECTIVE_MODULUS.factor, EFFECTIVE_MODULUS.unit)
        notes.append(f"looks wrong: the fabrics' median E_fab is {median / 1e3:.3g} kPa, expected {expected}: {wrong}")
    return notes


def other_moduli(
    names: Sequence[str], basis: Sequence[str], modulus: FloatArray, others: Mapping[str, FloatArray]
) -> list[str]:
    """Return notes on fabrics whose other properties imply a different modulus from the one used.

    Parameters
    ----------
    names, basis, modulus
        The fabrics, the source column of each E_fab, and E_fab [Pa].
    others
        E_fab [Pa] implied by other columns, by column; NaN if not available.
    """
    notes = []
    for column, other in others.items():
        differ = [
            f"{name} {taken / 1e3:.3g} and {value / 1e3:.3g} kPa"
            for name, source, taken, value in zip(names, basis, modulus.tolist(), other.tolist(), strict=True)
            if source != column and value > 0 and not 1 / AGREEMENT <= taken / value <= AGREEMENT
        ]
        if differ:
            notes.append(f"E_fab from the column used and from {column} differ: {listing(differ, 3)}")
    return notes


def _beyond(names: Sequence[str], values: FloatArray, what: str, column: Column, usual: Range) -> str:
    """Return a note on the values outside the usual range, empty if there are none."""
    strange = [i for i, value in enumerate(values) if not np.isnan(value) and not usual.holds(value)]
    if not strange:
        return ""
    shown = [f"{names[i]} {float(values[i]) / column.factor:.3g}" for i in strange]
    expected = usual.within(1 / column.factor, column.unit)
    return f"looks wrong: {what} of {len(strange)} of {len(names)} fabrics ({listing(shown, 3)}), expected {expected}"


def missing_codes(texts: Sequence[str], values: FloatArray) -> list[int]:
    """Return the ratings that are codes for missing values, such as 999 or -99.

    A code is `FAR` times as far from 0 as every other rating, or the only negative number among positive ones.

    Parameters
    ----------
    texts, values
        The ratings as written, and as numbers, NaN if missing.
    """
    codes = [i for i, text in enumerate(texts) if text in MISSING_CODES and not np.isnan(values[i])]
    others = np.delete(values, codes)
    others = others[~np.isnan(others)]
    if not others.size:
        return []
    largest = np.abs(others).max()  # it may be too large for a multiplication
    return [i for i in codes if abs(values[i]) / FAR >= largest or (values[i] < 0 <= others.min())]
