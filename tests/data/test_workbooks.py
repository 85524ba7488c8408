"""Workbooks and DataFrames: the same ratings as from text, and what is refused."""

import contextlib
import sys
import zipfile

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from softness_bayes.base.errors import InputError
from softness_bayes.cli import main
from softness_bayes.data import Compression, Fabrics, Ratings, fabrics_csv, ratings_csv, read_experiment
from softness_bayes.touch.contact import Indentation
from support.refusals import refusal

RATINGS = pd.DataFrame(
    {
        "participant": ["01", "2", "01"],
        "fabric": ["voile", "denim", "denim"],
        "indentation_mm": [0.3, 2, 1.1],
        "rating": [5, 7.25, None],
    }
)
CLOTH = pd.DataFrame({"fabric": ["voile", "denim"], "E (MPa)": [3.2, 33], "thickness [µm]": [220, 680]})
FORCES = pd.DataFrame({"participant": ["a", "a"], "indentation_mm": [0.5, 1.0], "force_n": [0.1, 0.4]})


def same(read: Ratings) -> None:
    assert (read.participants, read.fabrics) == (("01", "2"), ("denim", "voile"))
    assert read.loads == (Indentation(0.0003), Indentation(0.002))
    assert read.rating.tolist() == [5, 7.25]
    assert read.n_missing == 1


def book(path, index=False, **sheets):
    pytest.importorskip("openpyxl")
    with pd.ExcelWriter(path) as writer:
        for name, frame in sheets.items():
            frame.to_excel(writer, sheet_name=name, index=index)
    return path


# frames


def test_frames_are_read_as_files_are(tmp_path):
    same(Ratings.read(RATINGS))
    assert Fabrics.read(CLOTH).thickness.tolist() == [220e-6, 680e-6]
    assert len(Compression.read(FORCES)) == 2
    experiment = read_experiment(RATINGS, CLOTH, compression_path=FORCES)
    assert experiment.fabrics.names == ("voile", "denim")
    assert any("DataFrame of fabrics: column 'E (MPa)' is read as" in note for note in experiment.notes)
    path = tmp_path / "ratings.csv"
    path.write_text(ratings_csv(experiment.ratings, experiment.fabrics), encoding="utf-8")
    again = read_experiment(path)
    assert fabrics_csv(again.fabrics.take(experiment.fabrics.names)) == fabrics_csv(experiment.fabrics)
    np.testing.assert_array_equal(again.ratings.rating, experiment.ratings.rating)


def test_frames_keep_the_ids_and_the_digits_they_have():
    frame = RATINGS.assign(
        participant=pd.Categorical(["P2", "P10", "P2"]),
        fabric=[1.0, 2.0, 2.0],  # whole numbers beside a missing one
        indentation_mm=np.array([0.98, 1.03, 1], dtype=np.float32),
        rating=pd.array([5, 7, None], dtype="Int64"),
    )
    read = Ratings.read(frame)
    assert (read.participants, read.fabrics) == (("P2", "P10"), ("1", "2"))
    assert read.loads == (Indentation(0.00098), Indentation(0.00103))
    assert read.rating.tolist() == [5, 7]


def test_frames_with_an_index_have_it_as_a_column():
    same(Ratings.read(RATINGS.set_index(["participant", "fabric"])))
    same(Ratings.read(RATINGS.set_index("fabric", drop=True)))
    with pytest.raises(InputError, match="cannot insert"):
        Ratings.read(RATINGS.set_index("fabric", drop=False))


@pytest.mark.parametrize(
    ("frame", "problem"),
    [
        (RATINGS.assign(rating=[5, "x", 3]), "DataFrame of ratings: row 1, column 'rating': expected a finite number"),
        (
            RATINGS.assign(rating=pd.Timestamp("2024-02-01")),
            "row 0, column 'rating': expected a finite number, got '20",
        ),
        (RATINGS.assign(rating=[5, "1,234", 3]), "row 1, column 'rating': '1,234' may be 1.234 or 1234"),
        (RATINGS.assign(Rating=1), "DataFrame of ratings: header: 2 columns are called 'rating'"),
        (RATINGS.iloc[:0], "there is no row below the header"),
        (pd.concat({"a": RATINGS}, axis=1), "the columns have 2 levels, expected one"),
        ([1, 2], "expected the path of a table or a pandas DataFrame, got list"),
    ],
)
def test_frames_that_are_no_table_are_refused(frame, problem):
    assert problem in refusal(Ratings.read, frame)


def test_numbers_of_a_frame_have_a_point_whatever_its_texts_have():
    frame = RATINGS.assign(rating=[1.234, "0,5", 3.5])
    assert Ratings.read(frame).rating.tolist() == [1.234, 0.5, 3.5]
    assert Ratings.read(frame, decimal=",").rating.tolist() == [1.234, 0.5, 3.5]


# workbooks


def test_a_workbook_of_one_sheet_keeps_its_ids_and_rows(tmp_path):
    path = book(tmp_path / "ratings.xlsx", Tabelle1=RATINGS)
    read = Ratings.read(path)
    same(read)
    assert read.rows.tolist() == [2, 3]
    assert len(read.digest) == 64
    assert read.source == str(path)


@pytest.mark.parametrize("title", ["effective_modulus_cv", "effective modulus cv (%)"])
def test_cells_that_are_shown_as_percentages_are_read_as_such(tmp_path, title):
    openpyxl = pytest.importorskip("openpyxl")
    work = openpyxl.Workbook()
    for row in (["fabric", "effective_modulus_kpa", title], ["a", 10, 0.15]):
        work.active.append(row)
    work.active["C2"].number_format = "0.0%"
    work.save(tmp_path / "fabrics.xlsx")
    assert Fabrics.read(tmp_path / "fabrics.xlsx").effective_modulus_cv.tolist() == [0.15]


@pytest.mark.parametrize("names", [("ratings", "fabrics"), ("Tabelle1", "Tabelle2"), ("Blatt", "Fabrics")])
def test_ratings_and_fabrics_on_two_sheets(tmp_path, names):
    path = book(tmp_path / "study.xlsx", **dict(zip(names, (RATINGS, CLOTH), strict=True)))
    experiment = read_experiment(path)
    same(Ratings.read(path))
    assert experiment.fabrics.names == ("voile", "denim")
    assert any(f"sheet '{names[1]}', found in the workbook of the ratings" in note for note in experiment.notes)
    assert read_experiment(path, path).fabrics.thickness.tolist() == [220e-6, 680e-6]


def test_sheets_of_which_several_may_be_meant_are_named(tmp_path):
    path = book(tmp_path / "study.xlsx", monday=RATINGS, tuesday=RATINGS.assign(age=3))
    with pytest.raises(
        InputError, match="2 of the sheets 'monday', 'tuesday' may contain the ratings; rename the right one to"
    ) as refused:
        Ratings.read(path)
    # who follows the first advice drops a day's ratings
    assert str(refused.value).endswith("or give them the same titles if they belong together")
    with pytest.raises(InputError, match="none of the sheets 'monday', 'tuesday' may contain the fabrics"):
        Fabrics.read(path)


def test_sheets_that_are_copies_of_each_other_are_refused(tmp_path):
    frame = pd.DataFrame(
        {"participant": ["P1"] * 6, "fabric": [*"abcdef"], "force_n": 1.0, "rating": [2.5, 7.1, 4.4, 9.3, 6.2, 8.8]}
    )
    path = book(tmp_path / "study.xlsx", raw=frame, clean=frame)
    assert "6 rows are copies of other rows" in refusal(Ratings.read, path)


def test_damaged_workbooks_end_in_no_other_error(tmp_path):
    pytest.importorskip("openpyxl")
    path = tmp_path / "ratings.xlsx"
    whole = book(tmp_path / "whole.xlsx", a=RATINGS).read_bytes()
    random = np.random.default_rng(4)
    for _ in range(30):
        damaged = bytearray(whole)
        for place in random.integers(len(whole), size=20):
            damaged[place] = random.integers(256)
        path.write_bytes(bytes(damaged))
        with contextlib.suppress(InputError):
            Ratings.read(path)


# their libraries


@pytest.mark.parametrize(("content", "engine"), [(None, "openpyxl"), (b"PAR1", "pyarrow"), (b"$FL2", "pyreadstat")])
def test_without_the_engine_the_remedy_is_named(tmp_path, monkeypatch, content, engine):
    monkeypatch.setitem(sys.modules, engine, None)
    path = tmp_path / "ratings.csv"
    if content is None:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("xl/workbook.xml", "")
    else:
        path.write_bytes(content)
    done = CliRunner().invoke(main, ["check", "--data", str(path)])
    assert done.exit_code == 2
    assert f"{engine}, which is not installed: pip install 'softness-bayes[tables]'" in done.output
