"""Columns of tables: names, also in other languages, ranges, exact conversion to SI, and the kinds of tables."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Container, Mapping
from dataclasses import dataclass
from decimal import MAX_EMAX, MIN_EMIN, Context, Decimal
from typing import NamedTuple

from softness_bayes.base.errors import quoted
from softness_bayes.base.ranges import ANY, FORCES, INDENTATIONS, LOAD_ERRORS, RELATIVE_ERRORS, RESOLUTIONS, Range
from softness_bayes.data.texts import Marks
from softness_bayes.data.titles import Unit, analysed, bag, is_unit, key


@dataclass(frozen=True)
class Column:
    """A column of numbers: its name in files, its label, its unit and its range.

    Parameters
    ----------
    name
        Name in a CSV header; the unit is part of it.
    label, unit
        Text for axes and tables.
    quantity
        What is measured, as in `titles.UNITS`; empty for numbers whose brackets contain remarks.
    range
        Allowed values [SI].
    reason
        Reason for the upper limit.
    """

    name: str
    label: str
    unit: str
    quantity: str
    range: Range = ANY
    reason: str = ""

    @property
    def power(self) -> int:
        """The unit is 10^power SI units; shifting the decimal point keeps each value bitwise when written and read."""
        return {"mm": -3, "kPa": 3, "MPa": 6}.get(self.unit, 0)

    @property
    def factor(self) -> float:
        """SI units in one unit of the column."""
        return 10.0**self.power

    @property
    def axis(self) -> str:
        """Label of an axis."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def expected(self, unit: Unit | None = None) -> str:
        """Return the allowed values in words, in the column's unit or another one."""
        own = Unit("", Decimal(1).scaleb(self.power)) if unit is None else unit
        allowed = str(self.range.within(1.0 / float(own.factor), own.name))
        return f"{allowed} ({self.reason})" if self.reason else allowed

    def holds(self, value: float) -> bool:
        """Return whether `value` [SI] is allowed in the column."""
        return self.range.holds(value)

    def parse(self, text: str, unit: Unit | None = None) -> float:
        """Return the value [SI] of a number with a decimal point, in another unit than that of the column if given.

        Raises
        ------
        ValueError
            If the text is not a number or out of range; the message says what was expected.
        """
        match = re.fullmatch(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eE]([+-]?[0-9]{1,9}))?", text)
        if not match:
            value = math.nan
        elif unit is None:
            value = float(f"{match[1]}e{int(match[2] or 0) + self.power}")
        else:
            value = float(Context(prec=60, Emax=MAX_EMAX, Emin=MIN_EMIN).multiply(Decimal(text), unit.factor))
        if not self.holds(value):
            raise ValueError(f"expected {self.expected(unit)}, got {quoted(text)}")
        return value

    def write(self, value: float) -> str:
        """Return the text from which `parse` gives exactly `value` [SI]; NaN gives an empty cell."""
        if math.isnan(value):
            return ""
        number = Decimal(repr(float(value))).scaleb(-self.power).normalize()
        return f"{number:f}" if -6 < number.adjusted() < 16 else str(number)


NUMBERS: dict[str, Column] = {}
"""The columns of numbers, by name."""


def _number(name: str, label: str, unit: str = "", range: Range = ANY, reason: str = "") -> Column:
    """Declare a column of numbers; without a unit, a ratio."""
    quantities = {"": "ratio", "mm": "length", "N": "force", "kPa": "pressure", "MPa": "pressure", "N m": "rigidity"}
    quantities |= {"s": "time", "Hz": "frequency", "1/m": "curvature"}
    NUMBERS[name] = Column(name, label, unit, quantities.get(unit, ""), range, reason)
    return NUMBERS[name]


def _scale(name: str, label: str, range: Range = ANY) -> Column:
    """Declare a column of numbers whose brackets contain remarks."""
    NUMBERS[name] = Column(name, label, "", "", range)
    return NUMBERS[name]


_POSITIVE = Range(0.0, above=True)

SOLID = Range(1e-15, 1e21, "Pa")
"""Range of valid effective moduli; implausible values within this range cause a note."""
FINGERTIP = Range(INDENTATIONS.low, 8e-3, "m")
"""Indentations of a fingertip, whose radius is 8 mm."""
BEARABLE = Range(FORCES.low, 1e2, "N")
"""Forces that a finger can bear."""

INDENTATION = _number("indentation_mm", "indentation", "mm", FINGERTIP, "a fingertip's radius is 8 mm")
FORCE = _number("force_n", "force", "N", BEARABLE, "a finger cannot bear more")
LOAD_CV = _number("load_cv", "relative error of the load", range=LOAD_ERRORS)
RESOLUTION = _scale("resolution", "step of the rater's grid of numbers", RESOLUTIONS)
RATING = _scale("rating", "rating")
RANK = _scale("rank", "rank", _POSITIVE)
MEAN = _scale("mean", "arithmetic mean of a cell's ratings", _POSITIVE)
GEOMETRIC_MEAN = _scale("geometric_mean", "geometric mean of a cell's ratings", _POSITIVE)
SD = _scale("sd", "standard deviation of a cell's ratings", _POSITIVE)
SE = _scale("se", "standard error of a cell's mean", _POSITIVE)
GEOMETRIC_SD = _scale("geometric_sd", "geometric standard deviation of a cell's ratings", Range(1.0, above=True))
RATERS = _scale("n", "number of raters of a cell, or of averaged responses", Range(2.0, 1e6))
TENSILE_MODULUS = _number("tensile_modulus_mpa", "tensile modulus", "MPa", _POSITIVE)
THICKNESS = _number("thickness_mm", "thickness", "mm", _POSITIVE)
POISSON_RATIO = _number("poisson_ratio", "Poisson ratio", range=Range(-1.0, 0.5, above=True))
BENDING_RIGIDITY = _number("bending_rigidity_n_m", "bending rigidity", "N m", _POSITIVE)
EFFECTIVE_MODULUS = _number("effective_modulus_kpa", "effective modulus", "kPa", _POSITIVE)
EFFECTIVE_MODULUS_LOW = _number("effective_modulus_low_kpa", "least modulus", "kPa", _POSITIVE)
EFFECTIVE_MODULUS_HIGH = _number("effective_modulus_high_kpa", "largest modulus", "kPa", _POSITIVE)
_MEASURED = {
    "tensile_modulus": TENSILE_MODULUS,
    "thickness": THICKNESS,
    "bending_rigidity": BENDING_RIGIDITY,
    "effective_modulus": EFFECTIVE_MODULUS,
}
PROPERTIES: Mapping[str, Column] = {
    "tensile_modulus": TENSILE_MODULUS,
    "thickness": THICKNESS,
    "poisson_ratio": POISSON_RATIO,
    "bending_rigidity": BENDING_RIGIDITY,
    "effective_modulus": EFFECTIVE_MODULUS,
    **{
        f"{name}_cv": _number(f"{name}_cv", f"relative error of the {column.label}", range=RELATIVE_ERRORS)
        for name, column in _MEASURED.items()
    },
    "effective_modulus_low": EFFECTIVE_MODULUS_LOW,
    "effective_modulus_high": EFFECTIVE_MODULUS_HIGH,
}
"""Columns by field of `Fabrics`."""
STANDARD_ERRORS: Mapping[str, Column] = {
    name: _number(
        column.name.replace(name, f"{name}_sd"), f"standard error of the {column.label}", column.unit, Range(0.0)
    )
    for name, column in _MEASURED.items()
}
"""Columns of standard errors, in the unit of the property, by property of `Fabrics`; NAME_cv is relative."""

DISTANCE = _number("distance_mm", "distance from the contact's axis", "mm", Range(0.0, 0.05))
CURVATURE = _number("probe_curvature_per_m", "curvature of the probe", "1/m", Range(-1e4, 1e4))
RATE = _number("rate_hz", "firing rate", "Hz", Range(0.0, 1e3))
RATE_SD = _number("sd_hz", "sd of averaged firing rates", "Hz", Range(0.0, 1e3, above=True))
COUNT = _scale("count", "number of spikes", Range(0.0, 1e6))
WINDOW = _number("window_s", "duration of the count", "s", Range(1e-3, 1e4))

LABELS: Mapping[str, str] = {
    "participant": "who rated, or whose finger was pressed; without it all rows are of one",
    "fabric": "name of the fabric",
    "fabric_2": "other fabric of a pair: rating 1 if `fabric` was softer, 0 if this one, 0.5 if neither",
    "session": "session or block",
    "trial": "number of the trial or repetition",
    "list": "list to which a rank or a touch of a pair belongs; otherwise a participant's touches under one load",
    "indentor": "shape that was pressed; only rows of a flat plate are used",
    "direction": "warp or weft, whose geometric mean is used",
    "batch": "laboratory, tester or delivery whose moduli share one error",
    "recording": "source of the rates; sources are compared",
    "afferent": "name of the nerve fibre; blank for a mean of several",
    "species": "species of the afferents",
}
"""The columns of names, and what each holds."""
NAMES = (*LABELS, *NUMBERS)
"""The names of all columns."""
OF_CELLS = ("mean", "geometric_mean", "sd", "se", "geometric_sd", "n")
"""Columns of cells of several raters, used instead of ratings."""
MODULUS_SOURCES = (EFFECTIVE_MODULUS, EFFECTIVE_MODULUS_LOW, BENDING_RIGIDITY, TENSILE_MODULUS)
"""Sources of a fabric's modulus; the first available one is used. A lower limit requires an upper limit, and a tensile
modulus requires a thickness."""


def holds_cells(names: Container[str]) -> bool:
    """Return whether a table with these columns has cell means instead of ratings."""
    return "rating" not in names and ("geometric_mean" in names or ("mean" in names and "n" in names))


# names of columns elsewhere


_SOFTNESS = (
    "softness, softness rating, rating of softness, perceived softness, Weichheit, Weichheitsurteil, douceur, "
    "souplesse, suavidad, blandura, morbidezza, maciez, zachtheid, mjukhet, pehmeys, miękkość, měkkost, yumuşaklık, "
    "мягкость, 柔らかさ, やわらかさ, 軟らかさ, 柔软度, 柔软性, 柔软感, 부드러움"
)
SOFTNESS = frozenset(map(bag, _SOFTNESS.split(", ")))
"""The sorted words of names of softness."""

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
        f"{_SOFTNESS}, ratings, magnitude, magnitude estimate, magnitude estimation, estimate, judgement, judgment, "
        "score, Bewertung, Urteil, Einschätzung, Größenschätzung, évaluation, jugement, valoración, valutazione, "
        "avaliação, beoordeling, skattning, arvio, ocena, hodnocení, оценка, 評価, 評価値, 評定, 評定値, 评分, 평가"
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

KNOWN_BY: Mapping[str, frozenset[str]] = {
    name: frozenset(map(bag, (name, analysed(name).stem, *SYNONYMS.get(name, ())))) for name in NAMES
}
"""The sorted words of each column's standard name, with and without its unit, and of its synonyms."""
OWNERS: Mapping[str, str] = {words: name for name in reversed(NAMES) for words in KNOWN_BY[name]}
"""Sorted words of a title -> the column that they mean."""


def quantity_of(name: str) -> str:
    """Return the quantity of a column; empty for names and scales, whose brackets contain remarks."""
    return NUMBERS[name].quantity if name in NUMBERS else ""


LESS_CLEAR: Mapping[str, Mapping[str, str]] = {
    "ratings": {
        "participant": (
            "prolific pid, prolific id, participant private id, private id, worker id, user id, user, subj, subj id, "
            "sub, sub id, pid, ppid, person, person id, panelist id, assessor id, rater id, judge id, sona id, "
            "subject code, participant code, subject nr, participant nr, VP Nr, id, name, initials, response id, "
            "participant public id, public id"
        ),
        "rating": "response, slider response, rating response, key resp keys, answer",
        "trial": "rep, repeat, replicate, run, cycle",
    },
    "fabrics": {"fabric": "id, name, code, article, style, designation, fabric code, fabric no"},
    "compression": {
        "participant": "id, subj, sub, user id, pid, name, finger",
        "trial": "rep, repeat, replicate, run, cycle, cycle number, test",
        "indentation_mm": (
            "extension, compressive extension, compressive displacement, travel, position, stroke, crosshead, Weg, "
            "Standardweg, Verschiebung, Traversenweg, déplacement, 変位"
        ),
        "force_n": "compressive load, standard force, Standardkraft, compressive force, 試験力",
    },
    "afferents": {
        "afferent": "unit, fibre, fiber, neuron, cell",
        "probe_curvature_per_m": "curvature, curvature per m, probe curvature",
        "distance_mm": "distance, distance from centre, distance from center",
        "rate_hz": "rate, firing rate, response, impulses per s, spikes per s",
        "count": "spikes, impulses, spike count",
        "window_s": "window, duration",
    },
}
"""Names that mean a column in one kind of table only, by the kind, the clearest first."""


def _words(text: str) -> list[str]:
    """Return words with commas between them."""
    return text.split(", ")


WORDS_FOR_RATINGS = frozenset(
    _words(
        "rating, ratings, estimate, estimates, magnitude, judgement, judgment, score, feel, response, soft, softness"
    )
)
"""Words in the title of a column of ratings that has another name."""
_HARD = frozenset(
    _words(
        "hard, harder, hardness, stiff, stiffness, firm, firmness, hart, härte, steifigkeit, dur, dureté, rigidité, "
        "duro, dureza, durezza, 硬さ, かたさ, 硬い, かたい, 固い, 硬"
    )
)
"""Words in the title of a column of ratings that are higher for harder."""
_SOFT = frozenset(_words("soft, softest, weich, doux, douce, mou, suave, blando, morbido, 柔らかい, やわらかい, 柔软"))
_NOT = frozenset(_words("not, least, nicht, pas, non, no"))
ANCHOR = re.compile(r"([0-9]+)\s*[=:]\s*([^\W\d]+(?:\s+[^\W\d]+)*)|([^\W\d]+)\s*[=:]\s*([0-9]+)")
"""An end of a scale in a title, such as `7 = very soft`."""


def is_reversed(title: str) -> bool:
    """Return whether the title of ratings says that higher ones are harder: hardness, or an end such as 7 = hard."""
    ends = [({*key(m[2] or m[3]).split()}, int(m[1] or m[4])) for m in ANCHOR.finditer(title)]
    for end, number in ends:
        if end & (_HARD | _SOFT):
            hard = bool(end & _HARD) != bool(end & _NOT)
            # of an end alone, 0 and 1 are the lower one
            return hard == (number > 1 if len(ends) == 1 else number == max(n for _, n in ends))
    # the last word is the upper end, as in `soft - hard`
    words = [word for word in key(title).split() if word in _HARD or word.startswith("soft")]
    return bool(words) and words[-1] in _HARD


def reversed_remark(title: str) -> str:
    """Return what to do with ratings of hardness."""
    return (
        f"column {quoted(title)} seems to be higher for harder, but ratings must be higher for softer; reverse them, "
        "as by 8 minus the rating on a scale from 1 to 7, in a column 'rating'"
    )


_SUMMARIES = (
    "means, median, total, sum, variance, count, minimum, maximum, overall, geomean, quartile, percentile, cv, var, "
    "range, iqr, skewness, kurtosis, rank, ranks, valid n, subtotal, summary, Zusammenfassung, StAbw, Varianz, "
    "Spannweite, Mittel, Durchschnitt, Summe, gesamt, Anzahl, médiane, ecart type, somme, mediana, suma, desviación, "
    "varianza, somma, soma, média, totaal, summa, keskiarvo, průměr, ortalama, медиана, сумма, итого, 中央値, 合計, "
    "总计, 合计, 합계"
)
PERHAPS_SUMMARIES = frozenset(
    {"m", "n", "se", "min", "max", "all", "everyone", "group", "s d", "s e", "alle", "tous", "q1", "q3"}
)
"""Names of rows that are statistics of other rows, or those of people."""
_MOMENTS = [word for name in ("mean", "sd", "se") for word in (name, *SYNONYMS[name])]
SUMMARIES = frozenset(map(key, (*_MOMENTS, *_words(_SUMMARIES)))) - PERHAPS_SUMMARIES
"""Names of rows that are statistics of other rows."""


def summarises(name: str) -> bool:
    """Return whether a name is that of a statistic, such as `Mean`, `Total (n = 6)` or `Grand mean`."""
    words, title = key(name).split(), analysed(name)
    if title.unit and is_unit(title.unit) and title.bags & OWNERS.keys():
        return True  # a row of properties, such as E (kPa)
    if re.match(r"n\s*=", name.casefold()):
        return True
    return key(name) in SUMMARIES or (1 < len(words) <= 6 and not SUMMARIES.isdisjoint((words[0], " ".join(words[1:]))))


_WARP = (
    "warp, wale, wales, lengthwise, longitudinal, length, md, machine, kette, kettrichtung, chaîne, ordito, urdimbre, 1"
)
_WEFT = (
    "weft, filling, course, courses, widthwise, crosswise, transverse, width, cd, cross, schuss, schussrichtung, "
    "trame, trama, 2"
)
DIRECTIONS: Mapping[str, str] = {
    **dict.fromkeys(_words(_WARP), "warp"),
    **dict.fromkeys(_words(_WEFT), "weft"),
}
"""Words for the two directions of a fabric."""


# kinds of tables


class Kind(NamedTuple):
    """A kind of table, by the columns that it may have.

    Standard names and those given by `--column` take precedence over others.
    """

    sheet: str
    """The kind; the name of its sheet in a workbook."""
    columns: frozenset[str]
    """The columns that are read."""
    marks: tuple[frozenset[str], ...]
    """Sets of columns that tell the sheet if none has the name, the most telling first."""
    enough: tuple[tuple[tuple[frozenset[str], ...], frozenset[str]], ...] = ()
    """Alternative sets, one of which under standard names is enough, and columns then not sought by other names."""
    given: frozenset[str] = frozenset()
    """Columns whose values are given separately: columns that may contain them are reported but not read."""

    def sought(self, present: Container[str]) -> list[str]:
        """Return the columns to be sought by other names, in the order of declaration."""
        enough = [others for sets, others in self.enough if any(all(n in present for n in one) for one in sets)]
        done = frozenset().union(*enough)
        return [name for name in NAMES if name in self.columns and name not in present and name not in done]

    def and_also(self, other: Kind) -> Kind:
        """Return this kind of table with the columns of another kind beside its own."""
        return self._replace(columns=self.columns | other.columns, enough=self.enough + other.enough)


def _named(names: str) -> frozenset[str]:
    """Return the columns of these names, which must be declared."""
    if unknown := {*names.split()} - {*NAMES}:
        raise KeyError(unknown)
    return frozenset(names.split())


_LOADS = (_named("indentation_mm"), _named("force_n"))
_HELD = _LOADS[0] | _LOADS[1]
_MODULI = (
    _named("effective_modulus_kpa"),
    _named("effective_modulus_low_kpa effective_modulus_high_kpa"),
    _named("bending_rigidity_n_m"),
    _named("tensile_modulus_mpa thickness_mm"),
)

LOADED = Kind(
    "ratings",
    _named("participant fabric fabric_2 session trial list rating resolution load_cv"),
    (_named("rating"), _named("participant")),
    given=_HELD,
)
"""Ratings under a load that is given separately; a wide table has no column of ratings."""
RATINGS = LOADED._replace(columns=LOADED.columns | _HELD, enough=((_LOADS, _HELD),), given=frozenset())
"""Ratings with a load in each row."""
FABRICS = Kind(
    "fabrics",
    _named("fabric direction batch") | {column.name for column in (*PROPERTIES.values(), *STANDARD_ERRORS.values())},
    _MODULI,
    enough=(
        # a measured rigidity takes precedence over tensile modulus and thickness, and is compared with them
        (_MODULI, _MODULI[0] | _MODULI[1] | _MODULI[3]),
        (_MODULI[:2], _MODULI[2]),
    ),
)
"""Fabrics."""
FORCES_OF_A_PLATE = Kind("compression", _named("participant trial indentor indentation_mm force_n"), (_HELD,))
"""Forces of a rigid plate."""
AFFERENTS = Kind(
    "afferents",
    _named("recording afferent species n probe_curvature_per_m distance_mm rate_hz sd_hz count window_s") | _HELD,
    (_named("probe_curvature_per_m"),),
    enough=((_LOADS, _HELD), ((_named("rate_hz"), _named("count")), _named("rate_hz count"))),
)
"""Firing recorded from afferents."""
ORDER = Kind("ratings", _named("fabric"), (_named("rating"),))
"""An observed order of fabrics."""


class Request(NamedTuple):
    """Instructions for reading a table: its kind, and the user's words about it."""

    kind: Kind
    renames: Mapping[str, str]
    """Name of a column here -> its name in the file; names that the file lacks are ignored."""
    decimal: Marks = None
    """Mark before decimals, or marks by table; None if the numbers tell."""
    wide: bool = False
    """True if the user called a table of ratings wide."""
    fabrics: Collection[str] | None = None
    """Names of the fabrics, None where they are not known."""
