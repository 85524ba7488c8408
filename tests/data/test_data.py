from __future__ import annotations

import hashlib
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics, Ratings, loads_of, read_experiment
from softness_bayes.data.columns import NUMBERS, POISSON_RATIO
from softness_bayes.data.ratings import with_drift
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.touch.contact import PLATE_RIGIDITY, PRINTED_RIGIDITY, Force, Indentation
from support.refusals import refusal

RATINGS = """participant,fabric,indentation_mm,rating
P2,denim,1.0,5
P10,voile,2.5,7.25
P2,voile,1.0,1e1
"""
FABRICS = """fabric,tensile_modulus_mpa,thickness_mm,poisson_ratio
voile,3.2,0.22,0.18
denim,33.0,0.68,0.15
felt,1,1,0.2
"""


def edited(text: str, row: int, old: str, new: str) -> str:
    """Change one cell of line `row`, counted from 1."""
    lines = text.split("\n")
    assert old in lines[row - 1]
    lines[row - 1] = lines[row - 1].replace(old, new)
    return "\n".join(lines)


# what is understood


def test_ratings_are_indexed_and_in_si(file):
    ratings = Ratings.read(path := file(RATINGS))
    assert ratings.participants == ("P2", "P10")
    assert ratings.fabrics == ("denim", "voile")
    assert ratings.loads == (Indentation(0.001), Indentation(0.0025))
    assert ratings.participant.tolist() == [0, 1, 0]
    assert ratings.fabric.tolist() == [0, 1, 1]
    assert ratings.load.tolist() == [0, 1, 0]
    assert ratings.rating.tolist() == [5.0, 7.25, 10.0]
    assert ratings.rows.tolist() == [2, 3, 4]
    assert (len(ratings), ratings.n_missing, ratings.notes) == (3, 0, ())
    assert ratings.digest == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(RATINGS.replace("\n", "\r"), id="CR"),
        pytest.param(RATINGS.rstrip("\n"), id="no last newline"),
        pytest.param("\ufeff" + RATINGS, id="byte-order mark"),
        pytest.param(RATINGS.encode("utf-16"), id="UTF-16"),
        pytest.param(RATINGS.replace("participant,fabric", '"Participant", FABRIC '), id="titles"),
        pytest.param(RATINGS.replace("denim", '"denim"').replace("P2", ' "P2"'), id="quoted cells"),
        pytest.param(RATINGS.replace("\n", ",,\n"), id="empty columns at the end"),
        pytest.param("\n".join(f"{i}," * (i >= 0) + line for i, line in enumerate(RATINGS.split("\n"))), id="index"),
    ],
)
def test_dialects_say_the_same(file, content):
    ratings = Ratings.read(file(content))
    assert ratings.participants == ("P2", "P10")
    assert ratings.fabrics == ("denim", "voile")
    assert ratings.loads == (Indentation(0.001), Indentation(0.0025))
    assert ratings.rating.tolist() == [5.0, 7.25, 10.0]
    assert ratings.rows.tolist() == [2, 3, 4]


def test_blank_lines_and_newlines_in_cells_keep_the_count_of_rows(file):
    text = '\nfabric,remark,indentation_mm,rating\n\na,"two\nlines",1,2\n , ,,\nb,,1,3\n'
    path = file(text)
    assert Ratings.read(path).rows.tolist() == [4, 7]
    path.write_text(text.replace("3\n", "three\n"))
    assert "row 7, column 'rating'" in refusal(Ratings.read, path)


@pytest.mark.parametrize("missing", ["", "NA", "nan", "N/A", "NULL", " ", "n.a.", "#N/A", "-", "–", "."])
def test_missing_ratings_are_counted(file, missing):
    ratings = Ratings.read(file(edited(RATINGS, 3, "7.25", missing)))
    assert ratings.rating.tolist() == [5.0, 10.0]
    assert ratings.rows.tolist() == [2, 4]
    assert ratings.n_missing == 1
    assert ratings.loads == (Indentation(0.001),)
    assert ratings.notes == ("ratings.csv: 1 of 3 ratings is missing",)


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        (
            RATINGS.replace("P10", "NA").replace("voile", "nan"),
            {},
            (("NA", "P2"), ("denim", "nan"), (1e-3, 2.5e-3), ()),
        ),
        ("fabric,force_n,rating\na,1,2\nb,0.5,3\n", {}, (("participant",), ("a", "b"), (), (0.5, 1.0))),
        (
            "fabric,force_n,indentation_mm,rating\na,2,,2\na,,3,3\na,0.5,NA,4\na,,1,5\n",
            {},
            (("participant",), ("a",), (1e-3, 3e-3), (0.5, 2.0)),
        ),
        ("fabric\tindentation_mm\tforce_n\trating\na\t\t2\t1\nb\t1\t\t3\n", {}, (None, None, (1e-3,), (2.0,))),
        ("fabric,rating\na,1\n", {"indentation_mm": 1.5}, (None, None, (1.5e-3,), ())),
        ("fabric,rating\na,1\n", {"force_n": 1.5}, (None, None, (), (1.5,))),
    ],
    ids=["names like missing numbers", "one participant", "two kinds of load", "tabs", "a depth", "a force"],
)
def test_people_fabrics_and_loads_are_those_of_the_table(file, text, options, expected):
    read = Ratings.read(file(text), **options)
    people, fabrics, depths, forces = expected
    assert people in (None, read.participants)
    assert fabrics in (None, read.fabrics)
    assert read.loads == (*map(Indentation, depths), *map(Force, forces))
    assert ("one participant" in " ".join(read.notes)) == ("participant" not in text)


def test_the_order_of_trials_comes_from_sessions_and_trials(file):
    """Trials that are numbered anew in every session follow those of the session before."""
    text = "participant,fabric,block,trial,force_n,rating\np,a,2,1,1,4\np,b,1,2,1,3\np,a,1,1,1,2\n"
    text += "q,a,1,7,1,2\nq,b,1,9,1,2\n"
    read = Ratings.read(file(text))
    assert read.order.tolist() == [1.0, 0.5, 0.0, 0.0, 1.0]
    assert read.session.tolist() == [1, 0, 0, 0, 0]
    parts = with_drift(read)
    assert parts.participants == ("p, session 1", "p, session 2", "q, session 1")
    assert parts.participant.tolist() == [1, 0, 0, 2, 2]
    assert "2 raters have a scale of their own in each session, 3 in all" in parts.notes[-1]
    plain = Ratings.read(file(text.replace("block", "posture")))
    assert len(with_drift(plain).participants) == 4  # quarters of the trials that have any
    named = Ratings.read(file(text.replace("block", "posture").replace("trial", "first")))
    assert named.order is None
    with pytest.raises(InputError, match="drift needs the order of the ratings: a column 'session' or 'trial'"):
        with_drift(named)


def test_repeats_that_differ_in_an_unused_column_are_not_called_copies(file):
    text = (
        "fabric,trial,force_n,rating,posture,day\na,1,1,2,hand,1\na,1,1,3,sitting,1\nb,1,1,3,hand,1\nb,1,1,4,foot,1\n"
    )
    note = Ratings.read(file(text)).notes[-1]
    assert "2 ratings repeat a participant, fabric, load and trial, and differ in 'posture', which is not used" in note
    copied = Ratings.read(file(text.replace("sitting", "hand"))).notes[-1]
    assert copied.endswith("is the trial right?")


def test_a_renamed_column_wins_over_its_namesake(file):
    text = "fabric,force_n,rating,softness\na,1,99,2\n"
    ratings = Ratings.read(file(text), columns={"rating": "softness"})
    assert ratings.rating.tolist() == [2.0]
    assert "unused columns: rating" in ratings.notes[0]


# the modulus of a fabric


def test_rows_may_give_the_modulus_in_different_ways(file):
    text = """fabric,tensile_modulus_mpa,thickness_mm,bending_rigidity_n_m,effective_modulus_kpa,poisson_ratio
all,1,1,1e-5,20,0.1
rigid,1,1,1e-5,,
thick,12,1,,NA,0.25
"""
    fabrics = Fabrics.read(file(text))
    assert fabrics.basis == ("effective_modulus_kpa", "bending_rigidity_n_m", "tensile_modulus_mpa")
    np.testing.assert_allclose(fabrics.modulus(PRINTED_RIGIDITY), [20e3, 1e4, 1e6 / 0.75], rtol=1e-14)
    np.testing.assert_allclose(fabrics.modulus(PLATE_RIGIDITY), [20e3, 1e4, 1e6 / (1 - 0.25**2)], rtol=1e-14)
    np.testing.assert_allclose(fabrics.modulus(length=2e-3), [20e3, 1e4 / 8, 1e6 / 0.75 / 8], rtol=1e-14)
    assert fabrics.poisson_ratio.tolist() == [0.1, 0.3, 0.25]
    assert fabrics.notes == (
        "ratings.csv: poisson_ratio 0.3 is used for 1 of 3 fabrics without a value",
        "ratings.csv: E_fab from the column used and from bending_rigidity_n_m differ: all 20 and 10 kPa",
        "ratings.csv: E_fab from the column used and from tensile_modulus_mpa and thickness_mm differ: "
        "all 20 and 92.6 kPa, rigid 10 and 119 kPa",
    )


def test_fabrics_from_arrays():
    fabrics = Fabrics(("a", "b"), bending_rigidity=np.array([1e-5, 2e-5]))
    assert fabrics.poisson_ratio.tolist() == [0.3, 0.3]
    np.testing.assert_allclose(fabrics.modulus(), [1e4, 2e4], rtol=1e-14)
    assert "fabric 'b': bending_rigidity is -1.0" in refusal(
        Fabrics, ("a", "b"), bending_rigidity=np.array([1.0, -1.0])
    )
    assert "fabric 'a': expected effective_modulus_kpa" in refusal(Fabrics, ("a",))
    assert "same name" in refusal(Fabrics, ("a", "a"), effective_modulus=np.array(1.0))


# arrays cannot be changed from outside


def test_arrays_are_copies_and_read_only(file):
    given = np.array([1e4])
    fabrics = Fabrics(("a",), effective_modulus=given)
    given[0] = 1.0
    assert fabrics.effective_modulus.tolist() == [1e4]
    ratings = Ratings.read(file(RATINGS))
    for array in (fabrics.effective_modulus, fabrics.thickness, ratings.rating, ratings.fabric, ratings.rows):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(FrozenInstanceError):
        ratings.rating = given
    assert "differ in length" in refusal(
        Ratings, ("p",), ("a",), (Force(1.0),), [0], [0], [0], rating=[1.0, 2.0], rows=[2]
    )


# what is refused, and where


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "the file is empty"),
        (",,\n", "no row below the header"),
        ("participant,fabric,indentation_mm,rating\n", "no row below the header"),
        (b"\x00\x01\x02", "not a text file"),
        (b"\xff\xfea", "UTF-16"),
        ("fabric,rating,Rating\na,1,2\n", "row 1: 2 columns are called 'rating'"),
        ('fabric,force_n,rating\n"a,1,2\nb,1,2\n', "quotation mark"),
        ("participant,rating\np,1\n", "no column 'fabric'"),
        ("fabric,force_n,feel\na,1,2\n", "its columns are 'fabric', 'force_n', 'feel'"),
        ("fabric,force_n,rating\na,1,\nb,1,NA\n", "column 'rating': there is no rating in any row"),
        ("Study 1\na,1,2\n", "is 'Study 1' a title of the table? The header must be the first"),
    ],
)
def test_files_that_are_no_table_are_refused(file, content, problem):
    path = file(content)
    message = refusal(Ratings.read, path)
    assert message.startswith(f"{path}: ")
    assert problem in message


def test_without_a_load_the_options_are_named(file):
    path = file("fabric,rating\na,1\n")
    for options in ({}, {"indentation_mm": 1.0, "force_n": 1.0}):
        message = refusal(Ratings.read, path, **options)
        assert "--indentation-mm" in message
        assert "--force-n" in message
    assert "this one has 'indentation_mm'" in refusal(Ratings.read, file(RATINGS), force_n=1.0)
    assert "force_n: expected a number from 1e-09 to 100 (a finger cannot bear more), got '-1.0'" in refusal(
        Ratings.read, path, force_n=-1
    )


@pytest.mark.parametrize("cells", ["1,2", ","])
def test_a_row_fills_one_load_column(file, cells):
    text = f"fabric,indentation_mm,force_n,rating\na,1,,2\nb,{cells},3\n"
    message = refusal(Ratings.read, file(text))
    assert "row 3, column 'force_n': expected one load: an indentation or a force, got '" in message


def test_renames_must_mean_something(file):
    path = file(RATINGS)
    assert "did you mean 'rating'?" in refusal(Ratings.read, path, columns={"ratng": "rating"})
    assert f"there is no column 'softness' in {path}" in refusal(Ratings.read, path, columns={"rating": "softness"})


@pytest.mark.parametrize("value", ["-1", "-1.5"])
def test_negative_ratings_are_refused_on_demand(file, value):
    ratings = Ratings.read(path := file(edited(RATINGS, 3, "7.25", value)))
    message = refusal(MAGNITUDE.require, ratings)
    assert message.startswith(
        f"{path}: row 3, column 'rating': expected a magnitude estimate of 0 or above, got '{value}'"
    )
    assert "1 of 3 ratings" in message
    assert "leave the cell" in message
    assert MAGNITUDE.require(Ratings.read(file(RATINGS))) is None
    assert MAGNITUDE.require(Ratings.read(file(edited(RATINGS, 3, "7.25", "0")))) is None


# ratings with their fabrics


def test_fabrics_given_by_name(file):
    path = file(FABRICS, "cloth.csv")
    ratings, fabrics, notes, *_ = read_experiment(file(RATINGS), path)
    assert ratings.fabrics == fabrics.names == ("voile", "denim")
    assert fabrics.source == str(path)
    assert [fabrics.names[i] for i in ratings.fabric] == ["denim", "voile", "voile"]
    assert fabrics.thickness.tolist() == [0.22e-3, 0.68e-3]
    assert fabrics.rows == (2, 3)
    assert notes == ("fabrics without a rating, left out: felt",)


OWN = """fabric,force_n,rating,tensile_modulus_mpa,thickness_mm
b,1,1,2,0.5
a,1,2,3,0.5
b,1,3,2.0,
b,2,,2,.5
"""


def test_fabrics_in_the_ratings_win_over_those_beside(file):
    file(FABRICS, "fabrics.csv")
    ratings, fabrics, notes, *_ = read_experiment(file(OWN))
    assert fabrics.names == ratings.fabrics == ("a", "b")
    assert fabrics.tensile_modulus.tolist() == [3e6, 2e6]
    assert fabrics.thickness.tolist() == [0.5e-3, 0.5e-3]
    assert fabrics.digest == ratings.digest
    assert not any("beside" in note for note in notes)


def test_fabrics_given_by_name_win_over_those_in_the_ratings(file):
    path = file("fabric,effective_modulus_kpa\na,10\nb,20\n", "cloth.csv")
    experiment = read_experiment(file(OWN), path)
    assert experiment.fabrics.modulus().tolist() == [10e3, 20e3]
    assert any(
        f"tensile_modulus_mpa not used, because properties of fabrics are read from {path}" in n
        for n in experiment.notes
    )


def test_a_rename_may_concern_either_file(file):
    cloth = file(FABRICS.replace("fabric", "fabric_id"), "cloth.csv")
    ratings = file(RATINGS.replace("rating", "softness"))
    columns = {"rating": "softness", "fabric": "fabric_id"}
    assert len(read_experiment(ratings, cloth, columns=columns).ratings) == 3
    message = refusal(read_experiment, ratings, cloth, columns=columns | {"trial": "block"})
    assert "there is no column 'block'" in message
    assert str(cloth) in message


# loads and units


def test_loads_are_distinct_and_ordered():
    assert loads_of([2, 0.7, 2], [0.5]) == (Indentation(0.0007), Indentation(0.002), Force(0.5))
    assert "indentation_mm: expected a number from 1e-06 to 8 (a fingertip's radius is 8 mm), got 'nan'" in refusal(
        loads_of, [math.nan]
    )


@pytest.mark.parametrize("column", NUMBERS.values(), ids=str)
def test_units_round_trip_bit_by_bit(column):
    rng = np.random.default_rng(3)
    ends = np.clip([column.range.low, column.range.high], 1e-20, 1e20)
    for value in (
        10.0 ** rng.uniform(*np.log10(ends), 300) if column is not POISSON_RATIO else rng.uniform(-1, 0.5, 300)
    ):
        assert column.parse(column.write(value)) == value
        assert float(column.write(value)) * column.factor == pytest.approx(value, rel=1e-14)
