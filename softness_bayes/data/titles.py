"""Titles of columns: their words, their unit and a power of ten, analysed once each."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from decimal import Decimal
from functools import lru_cache
from typing import NamedTuple

from softness_bayes.data.texts import plain_text


class Unit(NamedTuple):
    """A unit: its name, and the SI units in one of it."""

    name: str
    factor: Decimal


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
    "time": {"1": ("s", "sec", "second", "seconds"), "1e-3": ("ms", "msec", "millisecond", "milliseconds")},
    "frequency": {
        "1": ("Hz", "1/s", "s^-1", "per s", "imp/s", "impulses/s", "impulses per s", "ips", "spikes/s", "spikes per s"),
        "1e3": ("kHz", "1/ms", "imp/ms", "impulses/ms", "spikes/ms"),
    },
    "curvature": {
        "1": ("1/m", "m^-1", "per m"),
        "1e2": ("1/cm", "cm^-1", "per cm"),
        "1e3": ("1/mm", "mm^-1", "per mm"),
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

_EXPONENT = r"(?:\^|\*\*)\s*[({]?\s*"
_POWER = (
    rf"(?:10\s*(?:{_EXPONENT}(?P<e>[+-]?[0-9]{{1,2}})[)}}]?|(?P<s>[+-][0-9]{{1,2}}))"
    r"|1?[eE](?P<x>[+-]?[0-9]{1,2})|(?P<z>10+)|(?P<d>0[.,]0*1|1/10+))"
)
_SIGN = r"\s*[x×*·.]?\s*"
_SCALED = tuple(
    re.compile(text)
    for text in (rf"{_SIGN}{_POWER}{_SIGN}(?P<unit>[^\W\d].*)", rf"(?P<unit>.*?[^\d\s]){_SIGN}{_POWER}")
)
_TIMES = r"(?:(?<![^\W\d_])[xX]|[×*·/÷])\s*"
_IN_TITLE = re.compile(
    rf"[\s(\[]*(?:{_TIMES}10+(?:\s*{_EXPONENT}[+-]?[0-9]{{1,2}}|[+-][0-9]{{1,2}})?|10\s*{_EXPONENT}[+-]?[0-9]{{1,2}}"
    r"|\b1[eE][+-]?[0-9]{1,2})\b[)}\]]*"
)
"""A power of ten beside the words of a title."""


@lru_cache(2**16)
def _spelling(text: str) -> str:
    """Return a unit in the one spelling that all of its ways of writing share."""
    text = unicodedata.normalize("NFKC", text).replace("\u03bc", "u").replace("^", "").strip()
    return re.sub(r"\s*[\u00b7\u22c5\u2219\u2022\u00d7*.]\s*|(?<=\w)\s+(?=\w)", ".", text).replace(" ", "")


_EXACT = {
    quantity: {_spelling(text): Unit(texts[0], Decimal(size)) for size, texts in units.items() for text in texts}
    for quantity, units in UNITS.items()
}
# of the units that differ in capitals only, the first one has the small letters
_KNOWN = {
    quantity: {**{text.casefold(): unit for text, unit in reversed(units.items())}, **units}
    for quantity, units in _EXACT.items()
}


@lru_cache(2**16)
def unit_named(text: str, quantity: str) -> Unit | None:
    """Return a unit of a quantity, which may have a power of ten (`10^-4 N m`), None if there is none of this name."""
    spelt = _spelling(text)
    if unit := _KNOWN[quantity].get(spelt) or _KNOWN[quantity].get(spelt.casefold()):
        return unit
    for pattern in _SCALED:
        if (match := pattern.fullmatch(plain_text(text))) and (unit := unit_named(match["unit"], quantity)):
            given = match["e"] or match["s"] or match["x"]
            zeros = (match["z"] or match["d"] or "").count("0")
            power = int(given) if given else zeros if match["z"] else -zeros
            return Unit(f"10^{power} {unit.name}", unit.factor.scaleb(power))
    return None


@lru_cache(2**16)
def is_unit(text: str) -> bool:
    """Return whether some quantity has a unit of this name."""
    return any(unit_named(text, quantity) for quantity in UNITS)


_MEASURED = re.compile(r"([+-]?[0-9]+(?:\.[0-9]+|,[0-9]{1,2})?(?:[eE][+-]?[0-9]+)?)\s*([^\s0-9.,+-].*)")


def measured(text: str, quantity: str) -> tuple[str, Unit] | None:
    """Return the number, with a decimal point, and the unit of a text such as 2 mm; None for another one."""
    match = _MEASURED.fullmatch(text)
    unit = unit_named(match[2], quantity) if match else None
    return (match[1].replace(",", "."), unit) if match and unit else None


@lru_cache(2**16)
def key(title: str) -> str:
    """Return what a title shares with those that differ in case, Unicode form, spaces and punctuation only."""
    text = unicodedata.normalize("NFKC", title).casefold()
    return " ".join(re.sub(r"[\W_]+", " ", unicodedata.normalize("NFKC", text)).split())


def bag(title: str) -> str:
    """Return what a title shares with those of the same words in any order."""
    return " ".join(sorted(key(title).split()))


class Title(NamedTuple):
    """A title of a column and its parts.

    A unit stands in brackets behind the title (`E (MPa)`, `depth [mm]`), behind a comma, a stroke or the word in
    (`depth, mm`), or among the words (`depth_um`, `bending_N_m`, `modulus_kPa_low`).
    """

    text: str
    """The title as written."""
    stem: str
    """The title without its unit and its power of ten."""
    unit: str | None
    """The unit as written, or whatever stands in brackets; None if there is neither."""
    bracketed: bool
    """True if the unit stands in brackets."""
    power: str
    """A power of ten beside the words, as in `B x 10^2`; empty if there is none."""
    bags: frozenset[str]
    """The sorted words of the title with and without its unit, and without a symbol, as in `Bending rigidity, B`."""


@lru_cache(2**16)
def analysed(text: str) -> Title:
    """Return a title and its parts."""
    # what Gorilla writes before the columns of its spreadsheet says nothing
    bare = re.sub(r"^spreadsheet\s*:\s*", "", text, flags=re.IGNORECASE)
    stem, unit, bracketed = _without_unit(bare)
    plain, power = plain_text(stem), ""
    if match := _IN_TITLE.search(plain):
        power = match[0].strip()
        brackets = re.finditer(r"[\[(][^\])]*[\])]", plain)
        beside = next((one for one in brackets if power in one[0]), match)
        stem = f"{plain[: beside.start()]} {plain[beside.end() :]}".strip()
        if unit is None:
            stem, unit, bracketed = _without_unit(stem)
    words = [word for word in key(stem).split() if len(word) > 1 or not word.isalpha()]
    apart = re.sub("(?<=[a-z])(?=[A-Z][a-zA-Z])", " ", stem)  # ResponseId
    bags = {bag(text), bag(stem), bag(apart)} | ({bag(" ".join(words))} if len(words) > 1 else set())
    return Title(text, stem, unit, bracketed, power, frozenset(bags))


def _without_unit(title: str) -> tuple[str, str | None, bool]:
    """Return a title without its unit, the unit as written, and whether it stands in brackets."""
    if len(title) > LONGEST_TITLE:
        return title, None, False
    title = plain_text(title)
    if match := _BRACKETS.fullmatch(title):
        return match[1], match[2].strip(), True
    if (match := _BEHIND.fullmatch(title)) and is_unit(match[2]) and match[2] not in _ONLY_BRACKETED:
        return match[1], match[2], False
    words = re.split(r"[_\s]+", title)
    for end in range(len(words), 1, -1):
        for start in range(max(1, end - 3), end):
            part = words[start:end]
            if _SCALED[1].fullmatch(plain_text(part[-1] if len(part) == 1 else " ".join(part))):
                continue  # a power of ten behind the words of a title is none of the unit
            for text in (" ".join(part), f"{' '.join(part[:-1])}/{part[-1]}"):
                single = end < len(words) and len(text) < 2  # a letter among words is no unit
                if is_unit(text) and text.casefold() not in _ONLY_BRACKETED and not single:
                    return " ".join([*words[:start], *words[end:]]), text, False
    return title, None, False
