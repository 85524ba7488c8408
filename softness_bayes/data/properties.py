"""Properties of fabrics: columns, standard errors, and the value of each fabric in the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softness_bayes.data.columns import (
    BENDING_RIGIDITY,
    BENDING_RIGIDITY_CV,
    BENDING_RIGIDITY_SD,
    EFFECTIVE_MODULUS,
    EFFECTIVE_MODULUS_CV,
    EFFECTIVE_MODULUS_HIGH,
    EFFECTIVE_MODULUS_LOW,
    EFFECTIVE_MODULUS_SD,
    MODULUS_SOURCES,
    POISSON_RATIO,
    TENSILE_MODULUS,
    TENSILE_MODULUS_CV,
    TENSILE_MODULUS_SD,
    THICKNESS,
    THICKNESS_CV,
    THICKNESS_SD,
    Column,
)
from softness_bayes.data.tables import FloatArray, Table
from softness_bayes.errors import quoted
from softness_bayes.ranges import RELATIVE_ERRORS

PROPERTIES: Mapping[str, Column] = {
    "tensile_modulus": TENSILE_MODULUS,
    "thickness": THICKNESS,
    "poisson_ratio": POISSON_RATIO,
    "bending_rigidity": BENDING_RIGIDITY,
    "effective_modulus": EFFECTIVE_MODULUS,
    "tensile_modulus_cv": TENSILE_MODULUS_CV,
    "thickness_cv": THICKNESS_CV,
    "bending_rigidity_cv": BENDING_RIGIDITY_CV,
    "effective_modulus_cv": EFFECTIVE_MODULUS_CV,
    "effective_modulus_low": EFFECTIVE_MODULUS_LOW,
    "effective_modulus_high": EFFECTIVE_MODULUS_HIGH,
}
"""Columns by field of `Fabrics`."""


STANDARD_ERRORS: Mapping[str, Column] = {
    "tensile_modulus": TENSILE_MODULUS_SD,
    "thickness": THICKNESS_SD,
    "bending_rigidity": BENDING_RIGIDITY_SD,
    "effective_modulus": EFFECTIVE_MODULUS_SD,
}
"""Columns of standard errors, in the unit of the property, by property of `Fabrics`; NAME_cv is relative."""


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


def relative_errors(
    table: Table, rows: Mapping[str, list[int]], name: str, value: FloatArray, cv: FloatArray
) -> FloatArray:
    """Return the relative errors of a property, each given as relative (`cv`) or in the unit of the property.

    A row with both, an error without a value, or an error that is too large is a fault.
    """
    column, relative, absolute = PROPERTIES[name], PROPERTIES[f"{name}_cv"], STANDARD_ERRORS[name]
    filed = table.numbers(absolute)
    found = np.array(cv)
    for k, own in enumerate(rows.values()):
        sd, i = agreed(table, absolute, filed, own), own[0]
        if any(table.is_faulty(j, c.name) for j in own for c in (column, relative, absolute) if c.name in table):
            continue
        in_units, as_ratio = not np.isnan(sd), not np.isnan(cv[k])
        given = absolute if in_units else relative
        if in_units and as_ratio:
            table.fault(i, given.name, f"expected this or {relative.name}, but not both")
        elif (in_units or as_ratio) and np.isnan(value[k]):
            table.fault(i, given.name, f"an error of {column.name}, which has no value in this row")
        elif in_units:
            with np.errstate(over="ignore", under="ignore"):
                found[k] = sd / value[k]
            if not relative.holds(found[k]):
                limit = f"expected at most {RELATIVE_ERRORS.high:g} times the value"
                table.fault(i, given.name, f"{limit}, got {quoted(table.cells[given.name][i])}")
    return found


def agreed(table: Table, column: Column, filed: FloatArray, own: list[int]) -> float:
    """Return a fabric's value of a property, which must agree in all its rows; NaN if no row has one."""
    given = [i for i in own if not np.isnan(filed[i])]
    for i in given:
        if filed[i] != filed[given[0]]:
            value, first = (table.cells[column.name][j] for j in (i, given[0]))
            fabric, row = table.cells["fabric"][i], table.rows[given[0]]
            table.fault(i, column.name, f"{quoted(fabric)} has {quoted(value)} here and {quoted(first)} in row {row}")
    return float(filed[given[0]]) if given else np.nan
