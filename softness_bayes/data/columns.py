"""Columns and units of files: names, also in other languages, bounds, and exact conversion to SI."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal
from functools import lru_cache
from typing import NamedTuple

from softness_bayes.errors import quoted
from softness_bayes.ranges import ANY, FORCES, INDENTATIONS, LOAD_ERRORS, RELATIVE_ERRORS, RESOLUTIONS, Range


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

_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
_EXPONENT = r"(?:\^|\*\*)\s*[({]?\s*"
_POWER = (
    rf"(?:10\s*(?:{_EXPONENT}(?P<e>[+-]?[0-9]{{1,2}})[)}}]?|(?P<s>[+-][0-9]{{1,2}}))"
    r"|1?[eE](?P<x>[+-]?[0-9]{1,2})|(?P<z>10+))"
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


def plain_text(text: str) -> str:
    """Return a text in its Unicode normal form, with `^` before raised digits and one sign for minus."""
    raised = re.sub("[⁰¹²³⁴-⁹⁺⁻]{2,}|(?<=10)[⁰¹²³⁴-⁹]", lambda match: f"^{match[0].translate(_RAISED)}", text)
    return unicodedata.normalize("NFKC", raised).replace("\u2212", "-").strip()


@lru_cache(2**16)
def power_in(title: str) -> tuple[str, str]:
    """Return a title without the power of ten in it, as in `B x 10^2`, and the power as written, empty if none."""
    text = plain_text(title)
    match = _IN_TITLE.search(text)
    if match is None:
        return title, ""
    bracket = next((one for one in re.finditer(r"[\[(][^\])]*[\])]", text) if match[0].strip() in one[0]), match)
    return f"{text[: bracket.start()]} {text[bracket.end() :]}".strip(), match[0].strip()


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


@lru_cache(2**16)
def unit_named(text: str, quantity: str) -> Unit | None:
    """Return a unit of a quantity, which may have a power of ten (`10^-4 N m`), None if there is none of this name."""
    spelt = _spelling(text)
    if unit := _KNOWN[quantity].get(spelt) or _KNOWN[quantity].get(spelt.casefold()):
        return unit
    for pattern in _SCALED:
        if (match := pattern.fullmatch(plain_text(text))) and (unit := unit_named(match["unit"], quantity)):
            given = match["e"] or match["s"] or match["x"]
            power = len(match["z"]) - 1 if given is None else int(given)
            return Unit(f"10^{power} {unit.name}", unit.factor.scaleb(power))
    return None


@lru_cache(2**16)
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
    (`depth, mm`), or among the words (`depth_um`, `bending_N_m`, `modulus_kPa_low`). What stands in brackets need not
    be one.
    """
    if len(title) > LONGEST_TITLE:
        return title, None
    title = plain_text(title)
    if match := _BRACKETS.fullmatch(title):
        return match[1], Spelt(match[2].strip(), bracketed=True)
    if (match := _BEHIND.fullmatch(title)) and is_unit(match[2]) and match[2] not in _ONLY_BRACKETED:
        return match[1], Spelt(match[2], bracketed=False)
    words = re.split(r"[_\s]+", title)
    for end in range(len(words), 1, -1):
        for start in range(max(1, end - 3), end):
            part = words[start:end]
            for text in (" ".join(part), f"{' '.join(part[:-1])}/{part[-1]}"):
                single = end < len(words) and len(text) < 2  # a letter among words is no unit
                if is_unit(text) and text.casefold() not in _ONLY_BRACKETED and not single:
                    return " ".join([*words[:start], *words[end:]]), Spelt(text, bracketed=False)
    return title, None


MISSING = frozenset({"", "na", "n/a", "n.a.", "#n/a", "nan", "null", "none", "-", "–", "—", "."})
"""Texts for a missing number, in any case. Only an empty name is missing: NA may be initials."""


def looks_numeric(text: str) -> bool:
    """Return whether a text is a plain number, with any decimal mark."""
    return re.fullmatch(r"[-+]?[0-9]+(?:[.,][0-9]+)?(?:[eE][-+]?[0-9]+)?", text.strip()) is not None


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

NUMBERS: dict[str, Column] = {}
"""The columns of numbers, by name."""


def _number(name: str, label: str, unit: str, power: int = 0, range: Range = ANY, reason: str = "") -> Column:
    """Declare a column of numbers."""
    NUMBERS[name] = Column(name, label, unit, power, range, reason)
    return NUMBERS[name]


INDENTATION = _number(
    "indentation_mm", "indentation", "mm", power=-3, range=FINGERTIP, reason="a fingertip's radius is 8 mm"
)
FORCE = _number("force_n", "force", "N", range=BEARABLE, reason="a finger cannot bear more")
LOAD_CV = _number("load_cv", "relative error of the load", "", range=LOAD_ERRORS)
RESOLUTION = _number("resolution", "step of the rater's grid of numbers", "", range=RESOLUTIONS)
RATING = _number("rating", "rating", "")
RANK = _number("rank", "rank", "", range=_POSITIVE)
MEAN = _number("mean", "arithmetic mean of a cell's ratings", "", range=_POSITIVE)
GEOMETRIC_MEAN = _number("geometric_mean", "geometric mean of a cell's ratings", "", range=_POSITIVE)
SD = _number("sd", "standard deviation of a cell's ratings", "", range=_POSITIVE)
SE = _number("se", "standard error of a cell's mean", "", range=_POSITIVE)
GEOMETRIC_SD = _number(
    "geometric_sd", "geometric standard deviation of a cell's ratings", "", range=Range(1.0, above=True)
)
RATERS = _number("n", "number of raters of a cell", "", range=Range(2.0, 1e6))
TENSILE_MODULUS = _number("tensile_modulus_mpa", "tensile modulus", "MPa", power=6, range=_POSITIVE)
THICKNESS = _number("thickness_mm", "thickness", "mm", power=-3, range=_POSITIVE)
POISSON_RATIO = _number("poisson_ratio", "Poisson ratio", "", range=Range(-1.0, 0.5, above=True))
BENDING_RIGIDITY = _number("bending_rigidity_n_m", "bending rigidity", "N m", range=_POSITIVE)
EFFECTIVE_MODULUS = _number("effective_modulus_kpa", "effective modulus", "kPa", power=3, range=_POSITIVE)
TENSILE_MODULUS_CV = _number("tensile_modulus_cv", "relative error of the tensile modulus", "", range=RELATIVE_ERRORS)
THICKNESS_CV = _number("thickness_cv", "relative error of the thickness", "", range=RELATIVE_ERRORS)
BENDING_RIGIDITY_CV = _number("bending_rigidity_cv", "relative error of the rigidity", "", range=RELATIVE_ERRORS)
EFFECTIVE_MODULUS_CV = _number("effective_modulus_cv", "relative error of the modulus", "", range=RELATIVE_ERRORS)
TENSILE_MODULUS_SD = _number("tensile_modulus_sd_mpa", "standard error of the tensile modulus", "MPa", 6, _NOT_NEGATIVE)
THICKNESS_SD = _number("thickness_sd_mm", "standard error of the thickness", "mm", -3, _NOT_NEGATIVE)
BENDING_RIGIDITY_SD = _number("bending_rigidity_sd_n_m", "standard error of the rigidity", "N m", 0, _NOT_NEGATIVE)
EFFECTIVE_MODULUS_SD = _number("effective_modulus_sd_kpa", "standard error of the modulus", "kPa", 3, _NOT_NEGATIVE)
EFFECTIVE_MODULUS_LOW = _number("effective_modulus_low_kpa", "least modulus", "kPa", 3, _POSITIVE)
EFFECTIVE_MODULUS_HIGH = _number("effective_modulus_high_kpa", "largest modulus", "kPa", 3, _POSITIVE)

SECOND_FABRIC = "fabric_2"
"""Column of the other fabric of a pair."""
LABELS = ("participant", "fabric", SECOND_FABRIC, "session", "trial", "list", "indentor", "direction")
"""The columns of names."""
OF_CELLS = frozenset({MEAN.name, GEOMETRIC_MEAN.name, SD.name, SE.name, GEOMETRIC_SD.name, RATERS.name})
"""Columns of cells of several raters, used instead of ratings."""
MODULUS_SOURCES = (EFFECTIVE_MODULUS, EFFECTIVE_MODULUS_LOW, BENDING_RIGIDITY, TENSILE_MODULUS)
"""Sources of a fabric's modulus; the first available one is used. A lower limit requires an upper limit, and a tensile
modulus requires a thickness."""
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


_WORDS: Mapping[str, str] = {
    "participant": (
        "participant id, participants, subject, subject id, subjects, rater, observer, assessor, panelist, "
        "panellist, respondent, judge, ppt, Versuchsperson, VP, Proband, Probandin, Teilnehmer, Teilnehmerin, "
        "sujet, participante, sujeto, soggetto, partecipante, deelnehmer, proefpersoon, deltagare, "
        "försöksperson, osallistuja, uczestnik, badany, účastník, katılımcı, участник, испытуемый, 被験者, "
        "参加者, 実験参加者, 評価者, 被试, 被试者, 受试者, 参与者, 참가자, 피험자"
    ),
    "fabric": (
        "fabric id, fabric name, fabrics, cloth, textile, material, sample, sample id, specimen, swatch, "
        "stimulus, Stoff, Stoffprobe, Gewebe, Textil, Probe, tissu, étoffe, matériau, échantillon, tela, "
        "tejido, tessuto, tecido, stof, tyg, kangas, tkanina, látka, kumaş, ткань, материал, образец, 布, "
        "生地, 布地, 織物, 素材, 試料, 面料, 织物, 布料, 材料, 样品, 직물, 원단, 소재"
    ),
    "session": "session number, session no, block, block number, Sitzung, séance, sesión, sessione, sessie, セッション",
    "trial": (
        "trial number, trial no, repetition, Durchgang, Wiederholung, essai, répétition, ensayo, repetición, "
        "prova, ripetizione, 試行, 試行番号, 试次, 시행"
    ),
    "indentor": "indenter",
    "direction": "fabric direction, yarn direction, Richtung, sens, dirección, direzione, направление, 方向",
    "rating": (
        "ratings, softness, softness rating, rating of softness, perceived softness, magnitude, "
        "magnitude estimate, magnitude estimation, estimate, judgement, judgment, score, Weichheit, "
        "Weichheitsurteil, Bewertung, Urteil, Einschätzung, Größenschätzung, douceur, souplesse, évaluation, "
        "jugement, suavidad, blandura, valoración, morbidezza, valutazione, maciez, avaliação, zachtheid, "
        "beoordeling, mjukhet, skattning, pehmeys, arvio, miękkość, ocena, měkkost, hodnocení, yumuşaklık, "
        "мягкость, оценка, 柔らかさ, やわらかさ, 軟らかさ, 評価, 評価値, 評定, 評定値, 柔软度, 柔软性, 柔软感, "
        "评分, 부드러움, 평가"
    ),
    "indentation_mm": (
        "indentation depth, depth, displacement, penetration, penetration depth, Eindringtiefe, Eindrücktiefe, "
        "Eindrucktiefe, Tiefe, profondeur, enfoncement, profondeur d'indentation, profundidad, "
        "profundidad de indentación, profondità, indringdiepte, глубина, глубина вдавливания, 押し込み量, "
        "押込み量, 押込量, 押し込み深さ, 押込み深さ, 压入深度, 压痕深度, 압입 깊이"
    ),
    "force_n": (
        "contact force, normal force, load, Kraft, Normalkraft, Anpresskraft, fuerza, forza, força, kracht, "
        "сила, 力, 荷重, 押し付け力, 接触力, 힘, 하중"
    ),
    "tensile_modulus_mpa": (
        "E, E modulus, Young's modulus, Youngs modulus, Young modulus, elastic modulus, modulus of elasticity, "
        "E-Modul, Elastizitätsmodul, Zugmodul, module d'Young, module de Young, module d'élasticité, "
        "módulo de Young, módulo elástico, modulo di Young, elasticiteitsmodulus, модуль Юнга, "
        "модуль упругости, ヤング率, 弾性率, 引張弾性率, 杨氏模量, 弹性模量, 영률"
    ),
    "thickness_mm": (
        "fabric thickness, h, t, T0, T2, Dicke, Stoffdicke, Gewebedicke, épaisseur, espesor, spessore, espessura, "
        "dikte, tjocklek, paksuus, grubość, толщина, 厚さ, 厚み, 厚度, 두께"
    ),
    "poisson_ratio": (
        "Poisson's ratio, Poissons ratio, Poisson, nu, ν, Poissonzahl, Poisson-Zahl, Querkontraktionszahl, "
        "coefficient de Poisson, coeficiente de Poisson, coefficiente di Poisson, коэффициент Пуассона, "
        "ポアソン比, 泊松比, 푸아송비"
    ),
    "bending_rigidity_n_m": (
        "B, bending stiffness, flexural rigidity, flexural stiffness, Biegesteifigkeit, rigidité de flexion, "
        "rigidité en flexion, rigidez a la flexión, rigidità flessionale, buigstijfheid, жёсткость при изгибе, "
        "жесткость при изгибе, 曲げ剛性, 弯曲刚度, 抗弯刚度, 굽힘강성, 굽힘 강성"
    ),
    "mean": (
        "mean rating, mean ratings, mean softness, average, avg, arithmetic mean, M, Mittelwert, moyenne, "
        "media, promedio, gemiddelde, medelvärde, średnia, среднее, 平均, 平均値, 均值, 平均值, 평균"
    ),
    "sd": (
        "std, stdev, std dev, standard deviation, Standardabweichung, écart-type, desviación estándar, "
        "deviazione standard, standaardafwijking, 標準偏差, 标准差, 표준편차"
    ),
    "se": "sem, standard error, std error, standard error of the mean, Standardfehler, 標準誤差, 标准误",
    "n": "number of raters, number of participants, raters, n raters, n participants, 人数",
    "geometric_mean": "geomean, geo mean, gm, geometrisches Mittel, moyenne géométrique, 幾何平均, 几何平均",
    "geometric_sd": "gsd, geometric standard deviation, geo sd, 幾何標準偏差",
    "effective_modulus_kpa": "E_fab, E_eff, effektiver Modul, module effectif, 有効弾性率, 有效模量",
}
SYNONYMS: Mapping[str, tuple[str, ...]] = {name: tuple(words.split(", ")) for name, words in _WORDS.items()}
"""Name of a column here -> its names elsewhere, without units. Case, spaces, strokes and underlines do not matter; a
name stands for one column only."""


@lru_cache(2**16)
def key(title: str) -> str:
    """Return what a title shares with those that differ in case, Unicode form, spaces and punctuation only."""
    text = unicodedata.normalize("NFKC", title).casefold()
    return " ".join(re.sub(r"[\W_]+", " ", unicodedata.normalize("NFKC", text)).split())


@lru_cache(2**16)
def bag(title: str) -> str:
    """Return what a title shares with those of the same words in any order."""
    return " ".join(sorted(key(title).split()))


WORDS_FOR_RATINGS = frozenset(
    {"rating", "ratings", "estimate", "estimates", "magnitude", "judgement", "judgment", "score", "feel", "response"}
    | {word for noun in ("soft", "hard", "stiff", "firm") for word in (noun, f"{noun}ness")}
)
"""Words in the title of a column of ratings that has another name."""

LESS_CLEAR: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "ratings": {
        "participant": (
            *("prolific pid", "prolific id", "participant private id", "private id", "worker id", "user id", "user"),
            *("subj", "subj id", "sub", "sub id", "pid", "ppid", "person", "person id", "panelist id", "assessor id"),
            *("rater id", "judge id", "sona id", "subject code", "participant code", "subject nr", "participant nr"),
            *("VP Nr", "id", "name", "initials", "response id", "participant public id", "public id"),
        ),
        "rating": ("response", "slider response", "rating response", "answer"),
    },
    "fabrics": {"fabric": ("id", "name", "code", "article", "style", "designation", "fabric code", "fabric no")},
    "compression": {
        "participant": ("id", "subj", "sub", "user id", "pid", "name", "finger"),
        "indentation_mm": (
            *("extension", "compressive extension", "compressive displacement", "travel", "position", "stroke"),
            *("crosshead", "Weg", "Standardweg", "Verschiebung", "Traversenweg", "déplacement", "変位"),
        ),
        "force_n": ("compressive load", "standard force", "Standardkraft", "compressive force", "試験力"),
    },
}
"""Names that mean a column in one kind of table only, by the kind, the clearest first."""

_SUMMARIES = (
    "mean, means, average, avg, median, total, sum, sd, std, stdev, sem, variance, count, minimum, maximum, overall, "
    "geomean, quartile, percentile, cv, Mittelwert, Mittel, Durchschnitt, Summe, gesamt, Standardabweichung, Anzahl, "
    "moyenne, médiane, écart-type, somme, media, promedio, mediana, suma, desviación, varianza, somma, soma, média, "
    "gemiddelde, totaal, standaardafwijking, medelvärde, summa, keskiarvo, średnia, průměr, ortalama, среднее, "
    "медиана, сумма, итого, 平均, 平均値, 中央値, 合計, 標準偏差, 均值, 平均值, "
    "总计, 合计, 标准差, 평균, 합계, 표준편차"
)
SUMMARIES = frozenset(map(key, _SUMMARIES.split(", ")))
"""Names of rows that are statistics of other rows."""
PERHAPS_SUMMARIES = frozenset({"m", "n", "se", "min", "max", "all", "everyone", "group", "s d", "s e", "alle", "tous"})
"""Names of such rows that may also be those of people."""


def summarises(name: str) -> bool:
    """Return whether a name is that of a statistic, such as `Mean`, `Total (n = 6)` or `Grand mean`."""
    words = key(name).split()
    return key(name) in SUMMARIES or (1 < len(words) <= 6 and not SUMMARIES.isdisjoint((words[0], " ".join(words[1:]))))


_WARP = "warp wale wales lengthwise longitudinal length md machine kette kettrichtung chaîne ordito urdimbre 1"
_WEFT = "weft filling course courses widthwise crosswise transverse width cd cross schuss schussrichtung trame trama 2"
DIRECTIONS: Mapping[str, str] = {
    word: name for name, words in (("warp", _WARP), ("weft", _WEFT)) for word in words.split(" ")
}
"""Words for the two directions of a fabric."""
