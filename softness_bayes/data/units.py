"""Units in the headers of tables: their spellings, and their exact factors to SI."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from decimal import Decimal
from functools import lru_cache
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit: its name, and the SI units in one of it."""

    name: str
    factor: Decimal


class Spelt(NamedTuple):
    """A unit as written in a header."""

    text: str
    """The unit, or whatever stands in brackets."""
    bracketed: bool


UNITS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "length": {
        "1": ("m", "metre", "metres", "meter", "meters"),
        "1e-2": ("cm", "centimetre", "centimetres", "centimeter", "centimeters"),
        "1e-3": ("mm", "millimetre", "millimetres", "millimeter", "millimeters"),
        "1e-6": ("µm", "micron", "microns", "micrometre", "micrometres", "micrometer", "micrometers"),
        "1e-9": ("nm", "nanometre", "nanometres", "nanometer", "nanometers"),
        "0.0254": ("inch", "in", "inches"),
        "2.54e-5": ("mil", "mils", "thou"),
    },
    "force": {
        "1": ("N", "newton", "newtons"),
        "1e-2": ("cN",),
        "1e-3": ("mN", "millinewton", "millinewtons"),
        "1e-6": ("µN",),
        "1e3": ("kN",),
        "1e-5": ("dyn", "dyne", "dynes"),
        "9.80665e-3": ("gf", "g", "gram-force", "grams-force", "gram", "grams", "pond"),
        "9.80665": ("kgf", "kg", "kp"),
        "0.27801385095378125": ("ozf", "oz"),
        "4.4482216152605": ("lbf", "lb"),
    },
    "pressure": {
        "1": ("Pa", "N/m²", "pascal"),
        "1e2": ("hPa",),
        "1e3": ("kPa", "kN/m²", "mN/mm²"),
        "1e6": ("MPa", "N/mm²", "MN/m²"),
        "1e9": ("GPa", "kN/mm²"),
        "1e-3": ("mPa",),
        "1e4": ("N/cm²",),
        "1e5": ("bar",),
        "98.0665": ("gf/cm²", "g/cm²"),
        "98066.5": ("kgf/cm²", "kg/cm²"),
        "9806650": ("kgf/mm²", "kg/mm²"),
        "6894.757293168361336722673445346890693781387562775": ("psi",),
    },
    "rigidity": {
        "1": ("N·m", "Nm", "N·m²/m", "Nm²/m"),
        "1e-3": ("mN·m", "mNm", "N·mm", "Nmm", "mN·m²/m"),
        "1e-6": ("µN·m", "µNm", "mN·mm", "mNmm", "µN·m²/m"),
        "1e-5": ("mN·cm", "mNcm", "mN·cm²/cm"),
        "1e-4": ("cN·cm", "cNcm", "cN·cm²/cm"),
        "1e-2": ("N·cm", "Ncm", "N·cm²/cm"),
        "1e-7": ("dyn·cm", "dyn·cm²/cm"),
        "9.80665e-5": ("gf·cm²/cm", "gfcm²/cm", "gf·cm·cm/cm", "g·cm²/cm", "gf·cm", "gfcm"),
        "9.80665e-8": ("mgf·cm", "mg·cm", "mgcm"),
    },
    "ratio": {"1": ("-", "–", "1"), "1e-2": ("%", "percent", "per cent", "pct")},
}
"""Quantity -> SI units in one -> spellings, the name of the unit first.

Kawabata's system gives the rigidity of a strip per width, gf·cm²/cm; grams of a force are grams-force."""

LONGEST_TITLE = 200
"""Largest number of characters of a title that is searched for a unit."""
_BRACKETS = re.compile(r"(.*?)\s*[\[(【〔]([^\])】〕]*)[\])】〕]")
_BEHIND = re.compile(r"(.*\S)(?:\s*[,;]\s*|\s+in\s+|\s+/\s*)(\S.*)")
_ONLY_BRACKETED = frozenset({"in", "bar", "1", "-", "–"})
"""Units that may be words or numbers where they do not stand in brackets."""


@lru_cache(2**16)
def _spelling(text: str) -> str:
    """Return a unit in the one spelling that all of its ways of writing share."""
    text = unicodedata.normalize("NFKC", text).replace("\u03bc", "u").replace("^", "").strip()
    return re.sub(r"\s*[\u00b7\u22c5\u2219\u2022\u00d7*.]\s*|(?<=\w)\s+(?=\w)", ".", text).replace(" ", "")


def _spellings(quantity: str) -> dict[str, Unit]:
    """Return the units of a quantity by their spellings; in small letters too, of which the first one counts."""
    exact = {
        _spelling(text): Unit(texts[0], Decimal(factor)) for factor, texts in UNITS[quantity].items() for text in texts
    }
    folded: dict[str, Unit] = {}
    for text, unit in exact.items():
        folded.setdefault(text.casefold(), unit)
    return folded | exact


_KNOWN = {quantity: _spellings(quantity) for quantity in UNITS}


def unit_named(text: str, quantity: str) -> Unit | None:
    """Return a unit of a quantity, None if there is none of this name."""
    text = _spelling(text)
    return _KNOWN[quantity].get(text) or _KNOWN[quantity].get(text.casefold())


def is_unit(text: str) -> bool:
    """Return whether some quantity has a unit of this name."""
    return any(unit_named(text, quantity) for quantity in UNITS)


def names_of(quantity: str) -> str:
    """Return the names of a quantity's units, for a message."""
    return ", ".join(texts[0] for texts in UNITS[quantity].values())


@lru_cache(2**16)  # each title of a wide table is looked at for every column
def title_and_unit(title: str) -> tuple[str, Spelt | None]:
    """Return a column's title without its unit, and the unit as written.

    A unit stands in brackets behind the title (`E (MPa)`, `depth [mm]`), behind a comma, a stroke or the word in
    (`depth, mm`), or as the last words (`depth_um`, `bending_N_m`). What stands in brackets need not be one.
    """
    if len(title) > LONGEST_TITLE:
        return title, None
    title = unicodedata.normalize("NFKC", title).strip()
    if match := _BRACKETS.fullmatch(title):
        return match[1], Spelt(match[2].strip(), bracketed=True)
    if (match := _BEHIND.fullmatch(title)) and is_unit(match[2]) and match[2] not in _ONLY_BRACKETED:
        return match[1], Spelt(match[2], bracketed=False)
    words = re.split(r"[_\s]+", title)
    for k in range(max(1, len(words) - 3), len(words)):
        text = " ".join(words[k:])
        if is_unit(text) and text.casefold() not in _ONLY_BRACKETED:
            return " ".join(words[:k]), Spelt(text, bracketed=False)
    return title, None
