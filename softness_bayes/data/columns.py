"""Columns of files: names, units, bounds, and conversion between their units and SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal

from softness_bayes.data.units import UNITS, Unit, unit_named
from softness_bayes.errors import quoted
from softness_bayes.ranges import ANY, LOAD_ERRORS, RELATIVE_ERRORS, RESOLUTIONS, Range
from softness_bayes.touch.contact import FORCES, INDENTATIONS

_NUMBER = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eE]([+-]?[0-9]{1,9}))?")
_EXACT = Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN)


@dataclass(frozen=True)
class Column:
    """A column of numbers: its name in files, its label, its unit and its range.

    Parameters
    ----------
    name
        Name in a CSV header; the unit is part of it.
    label, unit
        Text for axes and tables.
    power
        The unit is 10^power SI units. Reading and writing shift the decimal point instead of multiplying, so that a
        value written and read again is bitwise identical.
    range
        Allowed values [SI].
    reason
        Reason for the upper limit.
    """

    name: str
    label: str
    unit: str
    power: int = 0
    range: Range = ANY
    reason: str = ""

    @property
    def factor(self) -> float:
        """SI units in one unit of the column."""
        return 10.0**self.power

    @property
    def axis(self) -> str:
        """Label of an axis."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    @property
    def quantity(self) -> str:
        """The quantity that is measured, as in `units.UNITS`; a ratio if the column has no unit."""
        return next((quantity for quantity in UNITS if self.unit and unit_named(self.unit, quantity)), "ratio")

    def expected(self, unit: Unit | None = None) -> str:
        """Return the allowed values in words, in the column's unit or another one."""
        own = Unit("", Decimal(1).scaleb(self.power)) if unit is None else unit
        allowed = str(self.range.within(1.0 / float(own.factor), own.name))
        return f"{allowed} ({self.reason})" if self.reason else allowed

    def holds(self, value: float) -> bool:
        """Return whether `value` [SI] is allowed in the column."""
        return self.range.holds(value)

    def parse(self, text: str, filed: str | None = None, unit: Unit | None = None) -> float:
        """Return the value [SI] of a number with a decimal point.

        Parameters
        ----------
        text
            The number.
        filed
            The text in the file, for messages.
        unit
            Unit of the number, if different from that of the column.

        Raises
        ------
        ValueError
            If the text is not a number or out of range; the message says what was expected.
        """
        match = _NUMBER.fullmatch(text)
        if not match:
            value = math.nan
        elif unit is None:
            value = float(f"{match[1]}e{int(match[2] or 0) + self.power}")
        else:
            value = float(_EXACT.multiply(Decimal(text), unit.factor))
        if not self.holds(value):
            raise ValueError(f"expected {self.expected(unit)}, got {quoted(text if filed is None else filed)}")
        return value

    def write(self, value: float) -> str:
        """Return the text from which `parse` gives exactly `value` [SI]; NaN gives an empty cell."""
        if math.isnan(value):
            return ""
        number = Decimal(repr(float(value))).scaleb(-self.power).normalize()
        return f"{number:f}" if -6 < number.adjusted() < 16 else str(number)


_POSITIVE = Range(0.0, above=True)
_NOT_NEGATIVE = Range(0.0)

SOLID = Range(1e-15, 1e21, "Pa")
"""Range of valid effective moduli; implausible values within this range cause a note."""
FINGERTIP = Range(INDENTATIONS.low, 8e-3, "m")
"""Indentations of a fingertip, whose radius is 8 mm."""
BEARABLE = Range(FORCES.low, 1e2, "N")
"""Forces that a finger can bear."""

INDENTATION = Column(
    "indentation_mm", "indentation", "mm", power=-3, range=FINGERTIP, reason="a fingertip's radius is 8 mm"
)
FORCE = Column("force_n", "force", "N", range=BEARABLE, reason="a finger cannot bear more")
RESOLUTION = Column("resolution", "step of the rater's grid of numbers", "", range=RESOLUTIONS)
LOAD_CV = Column("load_cv", "relative error of the load", "", range=LOAD_ERRORS)
RATING = Column("rating", "rating", "")
MEAN = Column("mean", "arithmetic mean of a cell's ratings", "", range=_POSITIVE)
GEOMETRIC_MEAN = Column("geometric_mean", "geometric mean of a cell's ratings", "", range=_POSITIVE)
SD = Column("sd", "standard deviation of a cell's ratings", "", range=_POSITIVE)
GEOMETRIC_SD = Column(
    "geometric_sd", "geometric standard deviation of a cell's ratings", "", range=Range(1.0, above=True)
)
SE = Column("se", "standard error of a cell's mean", "", range=_POSITIVE)
RATERS = Column("n", "number of raters of a cell", "", range=Range(2.0, 1e6))
RANK = Column("rank", "rank", "", range=_POSITIVE)
TENSILE_MODULUS = Column("tensile_modulus_mpa", "tensile modulus", "MPa", power=6, range=_POSITIVE)
THICKNESS = Column("thickness_mm", "thickness", "mm", power=-3, range=_POSITIVE)
POISSON_RATIO = Column("poisson_ratio", "Poisson ratio", "", range=Range(-1.0, 0.5, above=True))
BENDING_RIGIDITY = Column("bending_rigidity_n_m", "bending rigidity", "N m", range=_POSITIVE)
EFFECTIVE_MODULUS = Column("effective_modulus_kpa", "effective modulus", "kPa", power=3, range=_POSITIVE)

TENSILE_MODULUS_CV = Column("tensile_modulus_cv", "relative error of the tensile modulus", "", range=RELATIVE_ERRORS)
THICKNESS_CV = Column("thickness_cv", "relative error of the thickness", "", range=RELATIVE_ERRORS)
BENDING_RIGIDITY_CV = Column("bending_rigidity_cv", "relative error of the rigidity", "", range=RELATIVE_ERRORS)
EFFECTIVE_MODULUS_CV = Column("effective_modulus_cv", "relative error of the modulus", "", range=RELATIVE_ERRORS)
TENSILE_MODULUS_SD = Column("tensile_modulus_sd_mpa", "standard error of the tensile modulus", "MPa", 6, _NOT_NEGATIVE)
THICKNESS_SD = Column("thickness_sd_mm", "standard error of the thickness", "mm", -3, _NOT_NEGATIVE)
BENDING_RIGIDITY_SD = Column("bending_rigidity_sd_n_m", "standard error of the rigidity", "N m", 0, _NOT_NEGATIVE)
EFFECTIVE_MODULUS_SD = Column("effective_modulus_sd_kpa", "standard error of the modulus", "kPa", 3, _NOT_NEGATIVE)
EFFECTIVE_MODULUS_LOW = Column("effective_modulus_low_kpa", "least modulus", "kPa", 3, _POSITIVE)
EFFECTIVE_MODULUS_HIGH = Column("effective_modulus_high_kpa", "largest modulus", "kPa", 3, _POSITIVE)

SECOND_FABRIC = "fabric_2"
"""Column of the other fabric of a pair."""
LABELS = ("participant", "fabric", SECOND_FABRIC, "trial", "list", "indentor")
"""The columns of names."""
NUMBERS: Mapping[str, Column] = {
    column.name: column
    for column in (
        INDENTATION,
        FORCE,
        LOAD_CV,
        RESOLUTION,
        RATING,
        RANK,
        MEAN,
        GEOMETRIC_MEAN,
        SD,
        SE,
        GEOMETRIC_SD,
        RATERS,
        TENSILE_MODULUS,
        THICKNESS,
        POISSON_RATIO,
        BENDING_RIGIDITY,
        EFFECTIVE_MODULUS,
        TENSILE_MODULUS_CV,
        THICKNESS_CV,
        BENDING_RIGIDITY_CV,
        EFFECTIVE_MODULUS_CV,
        TENSILE_MODULUS_SD,
        THICKNESS_SD,
        BENDING_RIGIDITY_SD,
        EFFECTIVE_MODULUS_SD,
        EFFECTIVE_MODULUS_LOW,
        EFFECTIVE_MODULUS_HIGH,
    )
}
"""The columns of numbers, by name."""
OF_CELLS = frozenset({MEAN.name, GEOMETRIC_MEAN.name, SD.name, SE.name, GEOMETRIC_SD.name, RATERS.name})
"""Columns of cells of several raters, used instead of ratings."""
MODULUS_SOURCES = (EFFECTIVE_MODULUS, EFFECTIVE_MODULUS_LOW, BENDING_RIGIDITY, TENSILE_MODULUS)
"""Sources of a fabric's modulus; the first available one is used. A lower limit requires an upper limit, and a tensile
modulus requires a thickness."""
