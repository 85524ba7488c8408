"""Columns of files: names, units, bounds, and the conversion between their units and SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from softness_bayes.errors import quoted
from softness_bayes.ranges import ANY, Range
from softness_bayes.touch.contact import FORCES, INDENTATIONS

_NUMBER = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eE]([+-]?[0-9]{1,9}))?")


@dataclass(frozen=True)
class Column:
    """A column of numbers: its name in files, its label, its unit and its range.

    Parameters
    ----------
    name
        Name in a CSV header; the unit is part of it.
    label, unit
        Words for axes and tables.
    power
        The unit is 10^power SI units. Reading and writing shift the decimal point of the digits instead of
        multiplying, so that a value written and read again keeps every bit.
    range
        Allowed values [SI].
    """

    name: str
    label: str
    unit: str
    power: int = 0
    range: Range = ANY

    @property
    def factor(self) -> float:
        """SI units in one unit of the column."""
        return 10.0**self.power

    @property
    def axis(self) -> str:
        """Label of an axis."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    @property
    def expected(self) -> str:
        """The allowed values, in words."""
        return str(self.range.within(10.0**-self.power))

    def holds(self, value: float) -> bool:
        """Return whether `value` [SI] is allowed in the column."""
        return self.range.holds(value)

    def parse(self, text: str, filed: str | None = None) -> float:
        """Return the value [SI] of a number with a decimal point; messages quote the text in the file, `filed`.

        Raises
        ------
        ValueError
            If the text is not a number or out of range; the message says what was expected.
        """
        match = _NUMBER.fullmatch(text)
        value = float(f"{match[1]}e{int(match[2] or 0) + self.power}") if match else math.nan
        if not self.holds(value):
            raise ValueError(f"expected {self.expected}, got {quoted(text if filed is None else filed)}")
        return value

    def write(self, value: float) -> str:
        """Return the text that `parse` turns into exactly `value` [SI]; NaN is an empty cell."""
        if math.isnan(value):
            return ""
        number = Decimal(repr(float(value))).scaleb(-self.power).normalize()
        return f"{number:f}" if -6 < number.adjusted() < 16 else str(number)


_POSITIVE = Range(0.0, above=True)

INDENTATION = Column("indentation_mm", "indentation", "mm", power=-3, range=INDENTATIONS)
FORCE = Column("force_n", "force", "N", range=FORCES)
RATING = Column("rating", "rating", "")
TENSILE_MODULUS = Column("tensile_modulus_mpa", "tensile modulus", "MPa", power=6, range=_POSITIVE)
THICKNESS = Column("thickness_mm", "thickness", "mm", power=-3, range=_POSITIVE)
POISSON_RATIO = Column("poisson_ratio", "Poisson ratio", "", range=Range(-1.0, 0.5, above=True))
BENDING_RIGIDITY = Column("bending_rigidity_n_m", "bending rigidity", "N m", range=_POSITIVE)
EFFECTIVE_MODULUS = Column("effective_modulus_kpa", "effective modulus", "kPa", power=3, range=_POSITIVE)

LABELS = ("participant", "fabric", "trial", "indentor")
"""The columns of names."""
NUMBERS: Mapping[str, Column] = {
    column.name: column
    for column in (
        INDENTATION,
        FORCE,
        RATING,
        TENSILE_MODULUS,
        THICKNESS,
        POISSON_RATIO,
        BENDING_RIGIDITY,
        EFFECTIVE_MODULUS,
    )
}
"""The columns of numbers, by name."""
MODULUS_SOURCES = (EFFECTIVE_MODULUS, BENDING_RIGIDITY, TENSILE_MODULUS)
"""Sources of a fabric's modulus; the first available one is used (a tensile modulus needs a thickness)."""
