"""Tables of known numbers, changed as laboratories and programs change them: read to the same numbers, or refused.

Each change keeps the meaning of the table for a person who reads it. So whatever is read must be the numbers that were
written; a table may be refused, but some of every kind must be read unless it has no clear meaning.
"""

import bz2
import csv
import gzip
import io
import json
import lzma
import re
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
import openpyxl
import pandas as pd
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import read_experiment
from softness_bayes.data.texts import identity
from support.randomness import SEED

FABRICS = ("velvet", "jersey", "poplin", "twill", "denim", "canvas")
STATISTICS = {
    "mean": np.mean,
    "sd": lambda x: np.std(x, ddof=1),
    "total": np.sum,
    "median": np.median,
    "sem": lambda x: np.std(x, ddof=1) / np.sqrt(len(x)),
}
NAMES_OF = {
    "mean": ("Mean", "Average", "Mittelwert", "media", "平均", "Mean (n=6)", "Grand mean", "", "avg"),
    "sd": ("SD", "Std", "Standardabweichung", "écart-type", "標準偏差"),
    "total": ("Total", "Sum", "Summe", "合計", "TOTAL"),
    "median": ("Median", "médiane", "median"),
    "sem": ("SEM", "sem"),
}


@dataclass(frozen=True)
class Tables:
    """Ratings as rows of text by title, fabrics, what was meant, and how both are written."""

    rows: list[dict[str, str]]
    cloth: list[dict[str, str]]
    truth: list[tuple]
    moduli: dict[tuple, float]
    above: list[list[str]] = field(default_factory=list)
    second: dict[str, str] = field(default_factory=dict)
    below: list[list[str]] = field(default_factory=list)
    cloth_second: dict[str, str] = field(default_factory=dict)
    form: str = "csv"
    separator: str = ","
    mark: str = "."
    encoding: str = "utf-8"
    options: dict = field(default_factory=dict)
    damaged: int = -1
    """Row of a rating that was replaced by another text."""


def made(random: np.random.Generator) -> Tables:
    """Ratings of a few people, fabrics and loads, with several decimals or in whole numbers."""
    people = [f"P{k:02d}" for k in range(1, int(random.integers(3, 7)))]
    if random.random() < 0.3:
        people = [str(k) for k in range(1, len(people) + 1)]
    fabrics = FABRICS[: random.integers(3, 7)]
    loads = ["1", "2"][: random.integers(1, 3)]
    trials = ["1", "2"][: random.integers(1, 3)]
    digits = int(random.choice([0, 1, 2]))
    rows, truth = [], []
    for who in people:
        scale = random.lognormal(2.0, 0.7)
        for trial in trials:
            for load in loads:
                for j, fabric in enumerate(fabrics):
                    value = max(1.0, scale * np.exp(-0.3 * j + 0.2 * float(load) + 0.3 * random.normal()))
                    text = f"{value:.{digits}f}"
                    row = {"participant": who, "fabric": fabric, "indentation_mm": load, "trial": trial, "rating": text}
                    rows.append(row)
                    truth.append((who, fabric, float(load), float(text)))
    moduli = {identity(name): 25.0 * 2.2**j for j, name in enumerate(FABRICS)}
    cloth = [{"fabric": f, "effective_modulus_kpa": f"{moduli[identity(f)]:.6g}"} for f in FABRICS]
    moduli = {identity(c["fabric"]): float(c["effective_modulus_kpa"]) * 1e3 for c in cloth}
    return Tables(rows, cloth, truth, moduli)


def renamed(rows, old, new):
    return [{new if title == old else title: text for title, text in row.items()} for row in rows]


# changes


def spelt(name, random):
    """Another spelling of a name, equal as a number, or but for zeros in front, case or punctuation."""
    if name.isdigit():
        return str(random.choice([f"{name}.0", f"0{name}", f"00{name}", f"{name}.00"]))
    head, tail = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    other = [f"{head.lower()}{tail}", f"{head.upper()}{tail}", f"{head} {tail}".strip(), f"{head}-{tail}".strip("-")]
    return str(random.choice([*other, *([f"{head}{int(tail)}", f"{head}0{tail}"] if tail else [])]))


def other_spellings(t, random):
    column = str(random.choice(["participant", "fabric"]))
    chosen = {row[column]: spelt(row[column], random) for row in t.rows}
    share = float(random.choice([0.1, 0.5, 1.0]))
    rows = [{**row, column: chosen[row[column]] if random.random() < share else row[column]} for row in t.rows]
    return replace(t, rows=rows)


def statistics(t, random):
    kinds = random.permutation(list(STATISTICS))[: random.integers(1, 3)]
    rows = list(t.rows)
    for kind in kinds:
        name = str(random.choice(NAMES_OF[kind]))
        by = {}
        for row in t.rows:
            by.setdefault(tuple((k, v) for k, v in row.items() if k not in ("participant", "rating")), []).append(row)
        for key, own in by.items():
            value = STATISTICS[kind]([float(row["rating"]) for row in own])
            rows.append({**dict(key), "participant": name, "rating": f"{value:.3f}"})
    return replace(t, rows=rows)


PEOPLE = ("ID", "sub", "Subj", "user_id", "PROLIFIC_PID", "Participant Private ID", "Name", "Vpn", "who", "rater_nr")
PEOPLE += ("Subject", "panelist", "initials", "login", "pp", "Kürzel")


def column_of_people(t, random):
    return replace(t, rows=renamed(t.rows, "participant", str(random.choice(PEOPLE))))


INCIDENTAL = (
    *(("resolution", "1920x1080"), ("resolution", "1080"), ("screen resolution", "1920x1080"), ("n", "6")),
    *(("mean", "5"), ("list", "A"), ("session", "1"), ("Participant Public ID", "BLIND"), ("age", "30"), ("sd", "2")),
)


def incidental(t, random):
    title, cells = INCIDENTAL[random.integers(len(INCIDENTAL))]
    return replace(t, rows=[{**row, title: cells} for row in t.rows])


def varying(t, random):
    title = str(random.choice(["rt", "Event Index", "", "timestamp", "order", "block no", "score time"]))
    return replace(t, rows=[{title: f"{k + 1}", **row} for k, row in enumerate(t.rows)])


def copies(t, random):
    who = t.rows[0].get("participant", None)
    some = t.rows if random.random() < 0.5 or who is None else [r for r in t.rows if r["participant"] == who]
    return replace(t, rows=[*t.rows, *map(dict, some)])


def without_trial(t, random):
    return replace(t, rows=[{k: v for k, v in row.items() if k != "trial"} for row in t.rows])


POWERS = (
    *("E_fab (10^{power} kPa)", "E_fab [×10{raised} kPa]", "E_fab (kPa x 10^{power})", "E_fab (1e{power} kPa)"),
    *("E_fab x 10^{power} (kPa)", "E_fab × 10{raised} [kPa]", "effective modulus x10^{power} (kPa)"),
    *("E_fab [10^{power} kPa] (kPa)", "E_fab (kPa) *10^{power}"),
)


def power_of_ten(t, random):
    """Moduli in thousands or hundredths, with the power in the unit or in the title."""
    power = int(random.choice([-3, -2, 2, 3]))
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    title = str(random.choice(POWERS)).format(power=power, raised=raised)
    cloth = []
    for row in t.cloth:
        value = float(row["effective_modulus_kpa"]) / 10.0**power
        cloth.append({"fabric": row["fabric"], title: repr(float(f"{value:.12g}"))})
    return replace(t, cloth=cloth)


UNITS = {"kPa": 1e3, "MPa": 1e6, "Pa": 1.0, "N/mm²": 1e6, "gf/cm^2": 98.0665}


def other_unit(t, random):
    unit = str(random.choice(list(UNITS)))
    title = str(random.choice(["effective modulus", "E_fab", "modulus effective", "Effective_Modulus", "E fab"]))
    where = str(random.choice(["title", "below", "words"]))
    text = f"{title} ({unit})" if where == "title" else f"{title}_{unit}" if where == "words" else title
    cloth = [
        {"fabric": r["fabric"], text: f"{float(r['effective_modulus_kpa']) * 1e3 / UNITS[unit]:.12g}"} for r in t.cloth
    ]
    return replace(t, cloth=cloth, cloth_second={text: unit} if where == "below" else {})


def two_directions(t, random):
    one, two = [("warp", "weft"), ("-1", "-2"), ("MD", "CD"), ("Kette", "Schuss")][random.integers(4)]
    long = random.random() < 0.4 and one != "-1"
    cloth = []
    for row in t.cloth:
        value, ratio = float(row["effective_modulus_kpa"]) * 1e3 * 1e-9 * 1e6, float(random.uniform(1.05, 2.0))
        a, b = f"{value * ratio:.12g}", f"{value / ratio:.12g}"
        if long:
            cloth += [{"fabric": row["fabric"], "Direction": d, "B (µN·m)": v} for d, v in ((one, a), (two, b))]
        else:
            names = [f"B{d} (µN·m)" if d[0] == "-" else f"Bending rigidity {d} (µN·m)" for d in (one, two)]
            cloth.append({"fabric": row["fabric"], names[0]: a, names[1]: b})
    return replace(t, cloth=cloth)


def above(t, random):
    general = ["General : Sample name", "finger 01"]
    lines = [["Study 1"], general, ["# lab A", "2024"], ["# softness"], ["Exported by X"]]
    return replace(t, above=[lines[k] for k in random.permutation(5)[: random.integers(1, 3)]])


def below(t, random):
    lines = [["Note: session 2 was interrupted"], ["* rated twice"], ["Source: lab notebook, page 3"]]
    return replace(t, below=[lines[random.integers(3)]])


def units_below(t, random):
    title, unit = [("indentation_mm", "mm"), ("Depth", "(mm)"), ("indentation", "[mm]")][random.integers(3)]
    second = {title: unit} | ({"rating": "-"} if random.random() < 0.3 else {})
    return replace(t, rows=renamed(t.rows, "indentation_mm", title), second=second)


def dialect(t, random):
    separator, mark = [(";", ","), (";", "."), ("\t", "."), ("\t", ","), ("|", "."), (",", ".")][random.integers(6)]
    return replace(t, separator=separator, mark=mark)


def encoded(t, random):
    return replace(t, encoding=str(random.choice(["utf-8-sig", "utf-16"])))


def compressed(t, random):
    return replace(t, form=str(random.choice(["gz", "bz2", "xz"])))


def as_json(t, random):
    return replace(t, form=str(random.choice(["json", "jsonl", "split"])))


def as_workbook(t, random):
    return replace(t, form=str(random.choice(["xlsx", "sheets"])))


def as_answers(t, random):
    rows = [{**row, "rating": json.dumps({"Q0": row["rating"]})} for row in t.rows]
    return replace(t, rows=renamed(rows, "rating", str(random.choice(["response", "rating"]))))


def strange_digits(t, random):
    wide = str.maketrans("0123456789.", "０１２３４５６７８９．")
    return replace(t, rows=[{**row, "rating": row["rating"].translate(wide)} for row in t.rows])


def percents(t, random):
    return replace(t, rows=[{**row, "rating": f"{row['rating']}%"} for row in t.rows])


def beside(rows, titles, name):
    """Rows in which the ratings stand beside each other, under titles made of some cells."""
    found = []
    for row in rows:
        rest = {title: text for title, text in row.items() if title not in (*titles, "rating")}
        own = name(*(row[title] for title in titles))
        there = next((one for before, one in found if before == rest and own not in one), None)
        if there is None:
            found.append((rest, there := {}))
        there[own] = row["rating"]
    return [rest | own for rest, own in found]


def fabrics_in_columns(t, random):
    name = str(random.choice(["{} @ {} mm", "{}_{}mm", "{} {} mm", "How soft is it? [{}]", "Softness - {}"]))
    if name[-2:] == "{}" or "[" in name:
        if len({row["indentation_mm"] for row in t.rows}) > 1:
            name = "{} {} mm"
        else:
            t = replace(t, options={"indentation_mm": float(t.rows[0]["indentation_mm"])})
    return replace(t, rows=beside(t.rows, ("fabric", "indentation_mm"), name.format))


def people_in_columns(t, random):
    return replace(
        t, rows=beside(t.rows, ("participant",), lambda who: who if who[:1] in "Pp" and who else f"judge {who}")
    )


def units_in_cells(t, random):
    def written(load):
        return str(random.choice([f"{load} mm", f"{load}mm", f"{load}000 µm", f"0.{load} cm"]))

    rows = [{**row, "indentation_mm": written(row["indentation_mm"])} for row in t.rows]
    return replace(t, rows=renamed(rows, "indentation_mm", str(random.choice(["indentation_mm", "depth", "Tiefe"]))))


def headers_again(t, random):
    rows = list(t.rows)
    for _ in range(random.integers(1, 4)):
        rows.insert(int(random.integers(1, len(rows))), {title: title for title in t.rows[0]})
    return replace(t, rows=rows)


def practice(t, random):
    title, word = [("phase", "practice"), ("Block", "Training"), ("trial_type", "warm-up")][random.integers(3)]
    rows = [{**row, "rating": "1", title: word} for row in t.rows[: random.integers(1, 4)]]
    return replace(t, rows=[*rows, *({**row, title: "main"} for row in t.rows)])


def practice_loop(t, random):
    """Rows of a loop of its own, as PsychoPy writes them."""
    loop = [{**row, "rating": "1", "practice.thisN": str(k)} for k, row in enumerate(t.rows[:2])]
    return replace(t, rows=[*loop, *({**row, "practice.thisN": ""} for row in t.rows)])


def attributes(t, random):
    """Ratings of further attributes, in rows of their own."""
    title, soft = [("attribute", "softness"), ("Question", "Softness"), ("Merkmal", "Weichheit")][random.integers(3)]
    rows = [{**row, title: soft} for row in t.rows]
    for other in ["warmth", "roughness"][: random.integers(1, 3)]:
        rows += [{**row, "rating": f"{random.uniform(1, 50):.1f}", title: other} for row in t.rows]
    return replace(t, rows=rows)


def shuffled(t, random):
    titles = [str(title) for title in random.permutation(list(t.rows[0]))]
    rows = [{title: t.rows[k].get(title, "") for title in titles} for k in random.permutation(len(t.rows))]
    return replace(t, rows=rows)


DAMAGE = (
    *("", " ", "-", "na", "n/a", "0", "7", "3.5", "3,5", "1.234", "1,234", "12,34,567", "1e1", "1E+1", "1e", "0x10"),
    *("1_0", "٣", "½", "5%", "--1", "1/2", "=1+1", "'5", "five", "inf", "nan", "1e400", "99999", "007", ".5", "5."),
    *(",5", "5,", "2026-11-23"),
)


def damage(t, random):
    k, text = int(random.integers(len(t.rows))), str(random.choice(DAMAGE))
    rows = [{**row, "rating": text} if i == k else row for i, row in enumerate(t.rows)]
    return replace(t, rows=rows, damaged=k)


def meant(text: str, mark: str) -> float | None:
    """What a text means where `mark` stands before decimals; NaN if it is empty, None if it is no number."""
    if text.strip().casefold() in ("", "na", "n/a", "nan", "-"):
        return np.nan
    text = text.translate(str.maketrans(".,", ",.")) if mark == "," else text
    if re.fullmatch(r"[+-]?[0-9]{1,3}(,[0-9]{3})+(\.[0-9]*)?", text):
        text = text.replace(",", "")
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        return None
    return float(text)


def told_truths(t, text):
    """The rows that may be meant with a damaged rating, by each decimal mark that the others do not rule out."""
    typed = t.form in ("xlsx", "sheets")  # such numbers show no mark
    marks = t.mark if not typed and any("." in f"{value:g}" for *_, value in t.truth) else ",."
    values = {meant(shown(text, t.mark), mark) for mark in marks} - {None}
    values |= {np.nan} if typed and text[:1] == "=" else set()  # no program has computed the formula
    own = [[] if np.isnan(value) else [(*t.truth[t.damaged][:3], value)] for value in values]
    return [t.truth[: t.damaged] + rows + t.truth[t.damaged + 1 :] for rows in own]


FIRST = (damage, statistics, other_spellings, without_trial, strange_digits, percents, as_answers)
SECOND = (column_of_people, incidental, varying, copies, units_below, fabrics_in_columns, people_in_columns, shuffled)
SECOND += (units_in_cells, headers_again, practice, practice_loop, attributes)
CLOTH = (power_of_ten, other_unit, two_directions)
FORMS = (above, below, dialect, encoded, compressed, as_json, as_workbook)


def changed(random: np.random.Generator) -> tuple[Tables, tuple[str, ...], str]:
    """A table after one to three changes, their names, and the text of a damaged rating."""
    t, names, text = made(random), [], ""
    for group in (FIRST, SECOND, CLOTH, FORMS):
        if random.random() < 0.55:
            change = group[random.integers(len(group))]
            if change in (people_in_columns, fabrics_in_columns, copies) and "participant" not in t.rows[0]:
                continue
            if change in (fabrics_in_columns, people_in_columns) and t.rows[0].get("rating", "{").startswith("{"):
                continue
            t = change(t, random)
            text = t.rows[t.damaged]["rating"] if change is damage else text
            names.append(change.__name__)
    return t, tuple(names), text


def shown(cell: str, mark: str) -> str:
    """A cell as it is written with a decimal mark."""
    return cell.replace(".", mark) if cell.replace(".", "").isdigit() else cell


def written(t: Tables, rows, second, separator=",", mark=".", above=(), below=()) -> str:
    """The text of a table."""
    titles = [*dict.fromkeys(title for row in rows for title in row)]
    text = io.StringIO()
    writer = csv.writer(text, delimiter=separator, lineterminator="\n")
    writer.writerows(above)
    writer.writerow(titles)
    if second:
        writer.writerow([second.get(title, "") for title in titles])
    for row in rows:
        cells = [row.get(title, "") for title in titles]
        writer.writerow([shown(cell, mark) for cell in cells])
    writer.writerows(below)
    return text.getvalue()


def workbook(t: Tables) -> bytes:
    """A workbook of typed numbers, on one sheet or one for each participant."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    title = next((title for title in t.rows[0] if t.rows[0][title] == t.truth[0][0]), None)
    apart = t.form == "sheets" and title is not None and not (t.above or t.below or t.second)
    sheets = dict.fromkeys(row[title] for row in t.rows) if apart else {"data": None}
    if len({str(name).casefold() for name in sheets}) < len(sheets):
        return workbook(replace(t, form="xlsx"))
    for name in sheets:
        if not name or set(name) & set("[]:*?/\\"):
            return workbook(replace(t, form="xlsx"))
        sheet = book.create_sheet(f"P{name}" if name[0].isdigit() else name)
        own = [row for row in t.rows if not apart or row[title] == name]
        titles = [text for text in dict.fromkeys(text for row in t.rows for text in row) if not apart or text != title]
        lines = [*t.above, titles, *([[t.second.get(text, "") for text in titles]] if t.second else [])]
        for line in [*lines, *([row.get(text, "") for text in titles] for row in own), *t.below]:
            sheet.append([float(cell) if re.fullmatch(r"[1-9][0-9]*(\.[0-9]+)?", cell) else cell for cell in line])
    content = io.BytesIO()
    book.save(content)
    return content.getvalue()


def filed(t: Tables, folder):
    """Write both tables; return their paths."""
    cloth = folder / "fabrics.csv"
    cloth.write_text(written(t, t.cloth, t.cloth_second), encoding="utf-8")
    text = written(t, t.rows, t.second, t.separator, t.mark, t.above, t.below)
    content = text.encode(t.encoding)
    if t.form in ("json", "jsonl", "split") and not (t.above or t.below or t.second or "" in t.rows[0]):
        frame = pd.DataFrame(t.rows)
        if t.form == "json":
            content = frame.to_json(orient="records").encode()
        elif t.form == "jsonl":
            content = frame.to_json(orient="records", lines=True).encode()
        else:
            content = frame.to_json(orient="split", index=False).encode()
    if t.form in ("xlsx", "sheets"):
        content = workbook(t)
    packed = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress}.get(t.form)
    path = folder / "ratings.csv"
    path.write_bytes(content if packed is None else packed(content))
    return path, cloth


def meaning(rows) -> Counter:
    """What each person rated, whatever the person's name."""
    by = {}
    for who, fabric, load, value in rows:
        by.setdefault(identity(who), []).append((identity(fabric), round(load, 9), value))
    return Counter(tuple(sorted(own)) for own in by.values())


def read(path, cloth, options):
    found = read_experiment(path, cloth, **options)
    y = found.ratings
    depth = [float(f"{load.depth * 1e3:.9g}") for load in y.loads]
    rows = zip(y.participant, y.fabric, y.load, y.rating, strict=True)
    told = [(y.participants[p], y.fabrics[f], depth[k], float(f"{value:.12g}")) for p, f, k, value in rows]
    moduli = dict(zip(map(identity, found.fabrics.names), found.fabrics.modulus().tolist(), strict=True))
    return told, moduli, any("are rows copied?" in note for note in found.notes)


def mutate(folder, random: np.random.Generator, cases: int) -> Counter:
    """Read changed tables; return how many were read and refused, by change."""
    seen: Counter = Counter()
    for _ in range(cases):
        t, names, text = changed(random)
        truths = told_truths(t, text) if "damage" in names else [t.truth]
        path, cloth = filed(t, folder)
        try:
            told, moduli, asked = read(path, cloth, t.options)
            outcome = "read"
            right = meaning(told) in map(meaning, truths)
            assert right or ("copies" in names and asked), (names, path.read_bytes()[:1500])
            for name, modulus in moduli.items():
                assert abs(modulus / t.moduli[name] - 1.0) < 1e-9, (names, cloth.read_text())
        except InputError:
            outcome = "refused"
        for name in names or ("nothing",):
            seen[name, outcome] += 1
    return seen


def test_changed_tables_are_read_to_the_same_numbers_or_refused(tmp_path):
    seen = mutate(tmp_path, np.random.default_rng([SEED, 49]), 350)
    assert not seen["nothing", "refused"]
    for change in (*FIRST, *SECOND, *CLOTH, *FORMS):
        assert seen[change.__name__, "read"] > 0, change.__name__


@pytest.mark.slow
@pytest.mark.parametrize("part", range(20))
def test_two_hundred_thousand_changed_tables(tmp_path, part):
    mutate(tmp_path, np.random.default_rng([SEED, 50, part]), 10_000)


@pytest.mark.parametrize("change", [lambda y: y * 10, lambda y: y + 0.001, lambda y: np.nan])
def test_a_misreading_is_found(change):
    """Negative controls: one rating that is another number, or none, fails the comparison."""
    rows = made(np.random.default_rng(3)).truth
    assert meaning([*rows[:-1], (*rows[-1][:3], change(rows[-1][3]))]) != meaning(rows)
    assert meaning(rows[:-1]) != meaning(rows)
    assert meant("five", ".") is None
    assert meant("1.234", ",") == 1234
