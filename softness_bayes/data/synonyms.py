"""Names that columns have in tables from elsewhere, in several languages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache

SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "participant": (
        *("participant id", "participants", "subject", "subject id", "subjects", "rater", "observer", "assessor"),
        *("panelist", "panellist", "respondent", "judge", "ppt"),
        *("Versuchsperson", "VP", "Proband", "Probandin", "Teilnehmer", "Teilnehmerin"),
        *("sujet", "participante", "sujeto", "soggetto", "partecipante", "deelnehmer", "proefpersoon"),
        *("deltagare", "försöksperson", "osallistuja", "uczestnik", "badany", "účastník", "katılımcı"),
        *("участник", "испытуемый", "被験者", "参加者", "実験参加者", "評価者", "被试", "被试者", "受试者", "参与者"),
        *("참가자", "피험자"),
    ),
    "fabric": (
        *("fabric id", "fabric name", "fabrics", "cloth", "textile", "material", "sample", "sample id", "specimen"),
        *("swatch", "stimulus"),
        *("Stoff", "Stoffprobe", "Gewebe", "Textil", "Probe", "tissu", "étoffe", "matériau", "échantillon"),
        *("tela", "tejido", "tessuto", "tecido", "stof", "tyg", "kangas", "tkanina", "látka", "kumaş"),
        *(
            "ткань",
            "материал",
            "образец",
            "布",
            "生地",
            "布地",
            "織物",
            "素材",
            "試料",
            "面料",
            "织物",
            "布料",
            "材料",
            "样品",
        ),
        *("직물", "원단", "소재"),
    ),
    "trial": (
        *("trial number", "trial no", "repetition", "Durchgang", "Wiederholung", "essai", "répétition", "ensayo"),
        *("repetición", "prova", "ripetizione", "試行", "試行番号", "试次", "시행"),
    ),
    "indentor": ("indenter",),
    "rating": (
        *("ratings", "softness", "softness rating", "rating of softness", "perceived softness", "magnitude"),
        *("magnitude estimate", "magnitude estimation", "estimate", "judgement", "judgment", "score"),
        *("Weichheit", "Weichheitsurteil", "Bewertung", "Urteil", "Einschätzung", "Größenschätzung"),
        *("douceur", "souplesse", "évaluation", "jugement", "suavidad", "blandura", "valoración", "morbidezza"),
        *("valutazione", "maciez", "avaliação", "zachtheid", "beoordeling", "mjukhet", "skattning", "pehmeys"),
        *("arvio", "miękkość", "ocena", "měkkost", "hodnocení", "yumuşaklık", "мягкость", "оценка"),
        *(
            "柔らかさ",
            "やわらかさ",
            "軟らかさ",
            "評価",
            "評価値",
            "評定",
            "評定値",
            "柔软度",
            "柔软性",
            "柔软感",
            "评分",
        ),
        *("부드러움", "평가"),
    ),
    "indentation_mm": (
        *("indentation depth", "depth", "displacement", "penetration", "penetration depth"),
        *("Eindringtiefe", "Eindrücktiefe", "Eindrucktiefe", "Tiefe", "profondeur", "enfoncement"),
        *("profondeur d'indentation", "profundidad", "profundidad de indentación", "profondità", "indringdiepte"),
        *("глубина", "глубина вдавливания", "押し込み量", "押込み量", "押込量", "押し込み深さ", "押込み深さ"),
        *("压入深度", "压痕深度", "압입 깊이"),
    ),
    "force_n": (
        *("contact force", "normal force", "load", "Kraft", "Normalkraft", "Anpresskraft", "fuerza", "forza"),
        *("força", "kracht", "сила", "力", "荷重", "押し付け力", "接触力", "힘", "하중"),
    ),
    "tensile_modulus_mpa": (
        *("E", "E modulus", "Young's modulus", "Youngs modulus", "Young modulus", "elastic modulus"),
        *("modulus of elasticity", "E-Modul", "Elastizitätsmodul", "Zugmodul", "module d'Young", "module de Young"),
        *("module d'élasticité", "módulo de Young", "módulo elástico", "modulo di Young", "elasticiteitsmodulus"),
        *("модуль Юнга", "модуль упругости", "ヤング率", "弾性率", "引張弾性率", "杨氏模量", "弹性模量", "영률"),
    ),
    "thickness_mm": (
        *("fabric thickness", "h", "t", "Dicke", "Stoffdicke", "Gewebedicke", "épaisseur", "espesor", "spessore"),
        *("espessura", "dikte", "tjocklek", "paksuus", "grubość", "толщина", "厚さ", "厚み", "厚度", "두께"),
    ),
    "poisson_ratio": (
        *("Poisson's ratio", "Poissons ratio", "Poisson", "nu", "ν", "Poissonzahl", "Poisson-Zahl"),
        *("Querkontraktionszahl", "coefficient de Poisson", "coeficiente de Poisson", "coefficiente di Poisson"),
        *("коэффициент Пуассона", "ポアソン比", "泊松比", "푸아송비"),
    ),
    "bending_rigidity_n_m": (
        *("B", "bending stiffness", "flexural rigidity", "flexural stiffness", "Biegesteifigkeit"),
        *("rigidité de flexion", "rigidité en flexion", "rigidez a la flexión", "rigidità flessionale"),
        *("buigstijfheid", "жёсткость при изгибе", "жесткость при изгибе", "曲げ剛性", "弯曲刚度", "抗弯刚度"),
        *("굽힘강성", "굽힘 강성"),
    ),
    "mean": (
        *("mean rating", "mean ratings", "mean softness", "average", "avg", "arithmetic mean", "M", "Mittelwert"),
        *("moyenne", "media", "promedio", "gemiddelde", "medelvärde", "średnia", "среднее", "平均", "平均値", "均值"),
        *("平均值", "평균"),
    ),
    "sd": (
        *("std", "stdev", "std dev", "standard deviation", "Standardabweichung", "écart-type", "desviación estándar"),
        *("deviazione standard", "standaardafwijking", "標準偏差", "标准差", "표준편차"),
    ),
    "se": ("sem", "standard error", "std error", "standard error of the mean", "Standardfehler", "標準誤差", "标准误"),
    "n": ("number of raters", "number of participants", "raters", "n raters", "n participants", "人数"),
    "geometric_mean": (
        "geomean",
        "geo mean",
        "gm",
        "geometrisches Mittel",
        "moyenne géométrique",
        "幾何平均",
        "几何平均",
    ),
    "geometric_sd": ("gsd", "geometric standard deviation", "geo sd", "幾何標準偏差"),
    "effective_modulus_kpa": ("E_fab", "E_eff", "effektiver Modul", "module effectif", "有効弾性率", "有效模量"),
}
"""Name of a column here -> its names elsewhere, without units. Case, spaces, strokes and underlines do not matter; a
name stands for one column only."""


@lru_cache(2**16)
def key(title: str) -> str:
    """Return what a title shares with those that differ in case, Unicode form, spaces and punctuation only."""
    text = unicodedata.normalize("NFKC", title).casefold()
    return " ".join(re.sub(r"[\W_]+", " ", unicodedata.normalize("NFKC", text)).split())


WORDS_FOR_RATINGS = frozenset(
    {"rating", "ratings", "estimate", "estimates", "magnitude", "judgement", "judgment", "score"}
    | {word for noun in ("soft", "hard", "stiff", "firm") for word in (noun, f"{noun}ness")}
)
"""Words in the title of a column of ratings that has another name."""
