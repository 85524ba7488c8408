"""Small files that would expand to large tables, and wide tables: read or refused, with 2 GB of memory and in 10 s."""

import resource
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from support.paths import ROOT
from support.randomness import SEED

openpyxl = pytest.importorskip("openpyxl")

MEMORY, SECONDS = 2**31, 10
ROWS = (
    ("participant", "fabric", "indentation_mm", "rating"),
    ("P1", "voile", 1, 5),
    ("P1", "denim", 1, 3),
    ("P2", "voile", 1, 4),
    ("P2", "denim", 1, 2),
)
SHEET = "xl/worksheets/sheet1.xml"
NOW = """
import sys
from softness_bayes.data import Ratings
from softness_bayes.base.errors import InputError
try:
    read = Ratings.read(sys.argv[1])
    print(len(read), *read.participants, *read.notes)
except InputError as error:
    print("refused:", error)
"""


def limited(program, *arguments, seconds=SECONDS):
    """Run a program with limits of memory and of processor time."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))

    command = [sys.executable, "-W", "error", "-c", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, preexec_fn=limit, timeout=240, check=False)


def book(path, change=None, **cells):
    """Write a workbook of four ratings, with further cells, and its sheet's XML changed."""
    made = openpyxl.Workbook()
    for row in ROWS:
        made.active.append(row)
    for place, value in cells.items():
        made.active[place] = value
    made.save(path)
    if change is not None:
        with zipfile.ZipFile(path) as archive:
            parts = {name: archive.read(name) for name in archive.namelist()}
        parts[SHEET] = change(parts[SHEET])
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, part in parts.items():
                archive.writestr(name, part)
    return path


def behind(*parts):
    """Return the change of a sheet's XML that adds elements behind its cells."""
    return lambda xml: xml.replace(b"</sheetData>", b"</sheetData>" + b"".join(parts))


def among(part):
    """Return the change of a sheet's XML that adds rows."""
    return lambda xml: xml.replace(b"</sheetData>", part + b"</sheetData>")


def merged(*places):
    return behind(b"<mergeCells>", *(b'<mergeCell ref="%s"/>' % one.encode() for one in places), b"</mergeCells>")


@pytest.mark.parametrize(
    ("change", "cells", "expected"),
    [
        (None, {"XFD1048576": "x"}, "row 1048576: 'x' is beyond the 4 columns of the header"),
        (None, {"XFD1048576": " "}, "4 P1 P2"),
        (None, {"XFD1": "x"}, "4 P1 P2 far.xlsx: unused columns: x"),
        (None, {"A1048576": "P3"}, "4 P1 P2 far.xlsx: 1 of 5 ratings is missing"),
        (merged("A4:A1048576"), {}, "4 P1 P2 far.xlsx: merged cells A4:A1048576: their value is used in each row"),
        (merged("F7:XFD1048576", "F1:XFD1"), {}, "4 P1 P2"),
        (behind(b'<hyperlinks><hyperlink ref="A1:XFD1048576"/></hyperlinks>'), {}, "4 P1 P2"),
        (among(b'<row r="7">' + b" " * 2**27 + b"</row>"), {}, "unpacks to 128 MB, expected at most 64 MB"),
        (among(b'<row><c r="XFD8"><v>1</v></c></row>' * 5000), {}, "more than 16777216 cells, with the empty"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_workbooks_of_few_bytes_take_little_memory_and_time(tmp_path, change, cells, expected):
    path = book(tmp_path / "far.xlsx", change, **cells)
    assert path.stat().st_size < 2 * 2**20
    done = limited(NOW, path)
    assert done.returncode == 0, done.stderr
    assert expected in done.stdout


def test_a_parquet_file_of_few_bytes_and_many_rows_is_refused(tmp_path):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path, group = tmp_path / "ratings.parquet", arrow.table({"rating": [5.0] * 10**6})
    with parquet.ParquetWriter(path, group.schema) as writer:
        for _ in range(20):
            writer.write_table(group)
    assert path.stat().st_size < 2**20
    assert "20000000 rows of 1 columns with" in limited(NOW, path).stdout


def test_text_of_too_many_columns_is_refused(tmp_path):
    path = tmp_path / "ratings.csv"
    path.write_text("a" + ",a" * 2**14 + "\n1\n", encoding="utf-8")
    assert "row 1: 16385 columns, expected at most 16384" in limited(NOW, path).stdout


TITLES = [f"measure of quality {i}" for i in range(5_000)]
OTHERS, ONES, TWOS = ("," + ",".join(texts) for texts in (TITLES, ["1"] * len(TITLES), ["2"] * len(TITLES)))
CLOTH = "fabric,effective_modulus_kpa\na,10\nb,20\n"
CHECK = "import sys; from softness_bayes.cli import main; main(['check', *sys.argv[1:]])"


@pytest.mark.parametrize(
    ("ratings", "fabrics", "expected"),
    [
        (f"participant,fabric,indentation_mm,rating{OTHERS}\nP1,a,1,5{ONES}\nP1,b,1,3{TWOS}\n", CLOTH, "2 ratings"),
        (
            f"participant,a,b{OTHERS}\nP1,5,4{ONES}\nP2,3,1{TWOS}\n",
            CLOTH + "".join(f"{i} qualities,10\n" for i in range(5_000)),
            "of 2 pairs of fabric and load",
        ),
    ],
    ids=["long", "many fabrics"],
)
def test_wide_tables_are_checked_in_little_time(tmp_path, ratings, fabrics, expected):
    (tmp_path / "ratings.csv").write_text(ratings, encoding="utf-8")
    (tmp_path / "fabrics.csv").write_text(fabrics, encoding="utf-8")
    load = [] if "indentation_mm" in ratings else ["--indentation-mm", "2"]
    done = limited(CHECK, "--data", tmp_path / "ratings.csv", *load)
    assert expected in done.stdout + done.stderr


def test_many_people_are_read_in_little_time(tmp_path):
    """The search for rows of statistics takes no time that grows with people times ratings."""
    titles = [f"fabric{k} {load} mm" for k in range(40) for load in (1, 2)]
    random = np.random.default_rng(SEED)
    rows = [f"P{k},{','.join(map('{:.1f}'.format, random.lognormal(2, 0.5, len(titles))))}\n" for k in range(300)]
    (tmp_path / "ratings.csv").write_text(f"participant,{','.join(titles)}\n{''.join(rows)}", encoding="utf-8")
    assert limited(NOW, tmp_path / "ratings.csv", seconds=8).stdout.startswith("24000 P0 P1")
