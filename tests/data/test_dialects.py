"""Tables of known numbers, written in many ways, some with one damaged cell: read as they were meant, or refused.

The numbers are known before the text is written, and what a damaged cell may mean is written out here a second time.
So a table that is accepted and misread is found, which no test that only reads what the toolkit wrote can do.
"""

import csv
import io
import re
from collections import Counter
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner

from softness_bayes.cli import main
from softness_bayes.data import Ratings, read_experiment
from softness_bayes.errors import InputError
from support.randomness import SEED

COLUMNS = ("participant", "fabric", "indentation_mm", "rating")
NAMES = {
    "participant": ("01", "1", "P3", "NA", "1e3", "émile", "12,5", "O'Hara", "=2+3", "-4"),
    "fabric": ("denim", "voile 1/2", "soie; fine", "crêpe", "T-shirt, 2 mm", '"felt"', "007", "+x"),
}
DAMAGE = (
    *("", " ", "-", "\ufeff", "na", "n/a", "0", "7", "3.5", "3,5", "1.234", "1,234", "1,234.5", "1.234,5"),
    *(
        "12,34,567",
        "1 234",
        "1e1",
        "1E+1",
        "1e",
        "0x10",
        "1_0",
        "٣",
        "½",
        "5%",
        "5 mm",
        "--1",
        "1/2",
        "=1+1",
        "'5",
        "2026-11-23",
        "five",
    ),
    *("inf", "nan", "1e400", "99999", "007", ".5", "5.", ",5", "5,", "a;b", "a,b", "a\tb", 'say "hi"', "a\nb"),
)
EMPTY = {"", "na", "n/a", "nan", "-"}


class Told(NamedTuple):
    """A row of numbers: who, what, load [mm] and rating."""

    participant: str
    fabric: str
    load: float
    rating: float


class Written(NamedTuple):
    """A table as a file, its rows, and of a damaged one the row, column and text."""

    content: bytes
    rows: list[Told]
    mark: str
    clear: bool
    """Whether the text shows its decimal mark: commas are not both separators and marks."""
    damage: tuple[int, str, str] | None


def number(value: float, mark: str, grouped: bool) -> str:
    text = f"{value:,}" if grouped else repr(value)
    return text.translate(str.maketrans(".,", ",.")) if mark == "," else text


def written(random: np.random.Generator) -> Written:
    """A table of known rows in a random dialect: separators, marks, quotes, order, case, blanks, encoding."""
    pick = random.choice
    rows = [
        Told(*(str(pick(NAMES[name])) for name in COLUMNS[:2]), float(pick([0.5, 1.25, 4.75])), 0.25 + k * 101.5)
        for k in range(random.integers(3, 9))
    ]
    delimiter, mark, grouped = str(pick([",", ";", "\t"])), str(pick([".", ","])), bool(random.random() < 0.2)
    cells = [[row[0], row[1], number(row.load, mark, False), number(row.rating, mark, grouped)] for row in rows]
    damage = None
    if random.random() < 0.6:
        i, j, text = int(random.integers(len(rows))), int(random.integers(4)), str(pick(DAMAGE))
        cells[i][j], damage = text, (i, COLUMNS[j], text)
    order = random.permutation(4)
    header = [COLUMNS[j].upper() if random.random() < 0.2 else COLUMNS[j] for j in order]
    extra = random.random() < 0.2
    pad = " " if random.random() < 0.2 and delimiter != "\t" else ""
    text = io.StringIO()
    style = csv.QUOTE_ALL if random.random() < 0.3 and not pad else csv.QUOTE_MINIMAL
    end = str(pick(["\n", "\r\n"]))
    writer = csv.writer(text, delimiter=delimiter, lineterminator=end, quoting=style)
    writer.writerow([*header, *(["remark"] if extra else [])])
    for row in cells:
        writer.writerow([*(row[j] + pad for j in order), *([f"x{mark}5"] if extra else [])])
        if random.random() < 0.05:
            text.write(end)
    encoding = str(pick(["utf-8", "utf-8-sig", "utf-16"]))
    clear = (delimiter, mark) != (",", ",")
    return Written(text.getvalue().encode(encoding), rows, mark, clear, damage)


def meant(text: str, mark: str) -> float | None:
    """What a text means where `mark` stands before decimals; NaN if it is empty, None if it is no number."""
    text = text.strip()
    if text.casefold() in EMPTY:
        return np.nan
    text = text.translate(str.maketrans(".,", ",.")) if mark == "," else text
    if re.fullmatch(r"[+-]?[0-9]{1,3}(,[0-9]{3})+(\.[0-9]*)?", text):
        text = text.replace(",", "")
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        return None
    return float(text)


def require_as_meant(table: Written, found: list[Told]) -> None:
    """Every row is the one that was told; the damaged one differs in its cell alone, or is left out as missing."""
    if table.damage is None:
        assert Counter(found) == Counter(table.rows)
        return
    i, name, text = table.damage
    others = Counter(row for k, row in enumerate(table.rows) if k != i)
    got = Counter(found)
    assert others <= got, "a damaged cell changed other rows"
    own = list((got - others).elements())
    field = {"indentation_mm": "load"}.get(name, name)
    if name in NAMES:
        assert len(own) == 1
        assert own[0]._replace(**{field: getattr(table.rows[i], field)}) == table.rows[i]
        return
    value = meant(text, table.mark)
    assert value is not None, f"{text!r} is no number"
    if np.isnan(value):
        assert not own
        assert name == "rating"
        return
    assert own == [table.rows[i]._replace(**{field: value})]


def read(path, decimal: str | None = None) -> list[Told]:
    y = Ratings.read(path, decimal=decimal)
    depth = [float(f"{load.depth * 1e3:.12g}") for load in y.loads]
    rows = zip(y.participant, y.fabric, y.load, y.rating, strict=True)
    return [Told(y.participants[p], y.fabrics[f], depth[k], float(value)) for p, f, k, value in rows]


def fuzz_dialects(folder, random: np.random.Generator, cases: int, every: int) -> Counter:
    """Read tables in many dialects, every so many of them by a command too; return how many were read and refused."""
    seen: Counter = Counter()
    path, cloth = folder / "ratings.csv", folder / "cloth.csv"
    with cloth.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([("fabric", "effective_modulus_kpa"), *((name, 50) for name in NAMES["fabric"])])
    for case in range(cases):
        table = written(random)
        path.write_bytes(table.content)
        decimal = table.mark if random.random() < 0.3 else None
        kind = "whole" if table.damage is None else "damaged"
        try:
            require_as_meant(table, read(path, decimal))
            seen[kind, "read"] += 1
        except InputError:
            assert kind == "damaged" or not (table.clear or decimal)
            seen[kind, "refused"] += 1
        if case % every == 0:
            marks = [] if decimal is None else ["--decimal", decimal]
            seen["command", check(path, cloth, marks)] += 1
    return seen


def check(path, cloth, marks: list[str]) -> int:
    """Exit code of `check`, which is 2, with a message alone, if and only if the readers refuse the tables."""
    done = CliRunner().invoke(main, ["check", "--data", str(path), "--fabrics", str(cloth), *marks])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exc_info
    problem = ""
    try:
        read_experiment(path, cloth, decimal=marks[1] if marks else None)
    except InputError as refusal:
        problem = str(refusal).splitlines()[0]
    assert done.exit_code == (2 if problem else 0), done.output
    assert problem in done.output
    return done.exit_code


def test_tables_are_read_as_meant_or_refused(tmp_path):
    seen = fuzz_dialects(tmp_path, np.random.default_rng([SEED, 5]), 250, 25)
    assert seen["whole", "read"] > 50
    assert min(seen["damaged", "read"], seen["damaged", "refused"]) > 30
    assert min(seen["command", 0], seen["command", 2]) > 0


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_forty_thousand_tables_are_read_as_meant_or_refused(tmp_path, part):
    fuzz_dialects(tmp_path, np.random.default_rng([SEED, 6, part]), 4000, 10)


KNOWN = Written(b"", [Told("01", "denim", 0.5, 0.25), Told("1", "felt", 1.25, 101.75)], ",", True, None)


@pytest.mark.parametrize(
    ("damage", "rows"),
    [
        (None, [KNOWN.rows[0], KNOWN.rows[1]._replace(rating=10175.0)]),
        (None, [KNOWN.rows[0]._replace(participant="1"), KNOWN.rows[1]]),
        (None, KNOWN.rows[:1]),
        ((0, "rating", "1.234"), [KNOWN.rows[0]._replace(rating=1.234), KNOWN.rows[1]]),
        ((0, "rating", "five"), KNOWN.rows),
        ((0, "rating", "3,5"), [KNOWN.rows[0]._replace(rating=3.5), KNOWN.rows[1]._replace(rating=1.0)]),
        ((0, "indentation_mm", ""), KNOWN.rows[1:]),
        ((1, "rating", "-"), KNOWN.rows),
        ((1, "fabric", "0"), [KNOWN.rows[0], KNOWN.rows[1]._replace(fabric="0", rating=1.0)]),
    ],
)
def test_a_misreading_is_found(damage, rows):
    """Negative controls: what a reader must not make of a table fails the comparison."""
    with pytest.raises(AssertionError):
        require_as_meant(KNOWN._replace(damage=damage), rows)
