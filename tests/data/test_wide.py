"""Wide tables: the same ratings as the long form has, and what is refused."""

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics, Ratings, read_experiment
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.touch.contact import Force
from support.refusals import refusal

CLOTH = Fabrics(("voile", "denim", "felt"), effective_modulus=np.array([3e3, 100e3, 20e3]))
FIELDS = ("participants", "fabrics", "loads", "n_missing")
ARRAYS = ("participant", "fabric", "load", "rating")


def assert_same(read, long):
    for name in FIELDS:
        assert getattr(read, name) == getattr(long, name), name
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(read, name), getattr(long, name))


def long_form(file, rows):
    return Ratings.read(file("participant,fabric,indentation_mm,force_n,rating\n" + "\n".join(rows) + "\n", "long.csv"))


@pytest.mark.parametrize(
    "titles",
    [
        ["voile @ 1 mm", "voile @ 2.5 mm", "denim @ 1 mm"],
        ["voile (1000 µm)", "voile [2500 um]", "denim 1000um"],
        ['"voile 1,0 mm"', '"voile, 2,5 mm"', '"denim / 1 mm"'],
    ],
)
def test_a_column_per_fabric_and_load(file, titles):
    text = f"participant,age,{','.join(titles)}\nP2,31,5,6,7\nP10,40,1e1,,8\n"
    path = file(text)
    read = Ratings.read(path)
    rows = ["P2,voile,1,,5", "P2,voile,2.5,,6", "P2,denim,1,,7", "P10,voile,1,,10", "P10,voile,2.5,,", "P10,denim,1,,8"]
    long = Ratings.read(
        file("participant,fabric,indentation_mm,rating\n" + "\n".join(rows).replace(",,", ",") + "\n", "l.csv")
    )
    assert_same(read, long)
    assert read.rows.tolist() == [2, 2, 2, 3, 3]
    bare = ", ".join(title.strip('"') for title in titles)
    assert f"ratings.csv: one column per fabric and load: {bare}" in read.notes
    assert Ratings.read(path, CLOTH).fabrics == ("voile", "denim")
    assert read.covariates["age"]


def test_a_column_per_fabric_with_loads_in_rows_or_given(file):
    path = file("subject,indentation_mm,voile,denim\nP1,1,5,6\nP1,2,7,8\n")
    rows = ["P1,voile,1,,5", "P1,denim,1,,6", "P1,voile,2,,7", "P1,denim,2,,8"]
    for options in ({"wide": True}, {"fabrics": CLOTH.take(("denim", "voile"))}):
        assert_same(Ratings.read(path, **options), long_form(file, rows))
    given = Ratings.read(file("subject,voile,denim\nP1,5,6\n"), CLOTH, force_n=1.5)
    assert (given.loads, given.fabrics) == ((Force(1.5),), ("voile", "denim"))
    bare = file("subject,voile,denim\nP1,5,6\n")
    assert "no columns 'fabric' and 'rating'" in refusal(Ratings.read, bare)


def test_errors_name_the_column_of_the_file(file):
    path = file("participant,voile_1mm,denim_1mm\nP1,5,six\n")
    assert refusal(Ratings.read, path) == f"{path}: row 2, column 'denim_1mm': expected a finite number, got 'six'"
    path = file("participant;voile_1mm;denim_1mm\nP1;5;1,234\n")
    assert refusal(Ratings.read, path).startswith(f"{path}: row 2, column 'denim_1mm': '1,234' may be 1.234 or 1234")
    path = file("participant,voile_1mm,denim_1mm\nP1,5,-1\n")
    with pytest.raises(InputError, match="row 2, column 'voile_1mm … denim_1mm': expected a magnitude estimate of 0"):
        MAGNITUDE.require(Ratings.read(path))
    path = file("participant,voile_1mm,denim\nP1,5,6\n")
    assert "row 2, column 'denim': expected a load" in refusal(Ratings.read, path, wide=True)


def test_what_may_be_a_misspelt_fabric_is_refused(file):
    path = file("participant,age,voile_1mm,demin_1mm,felt_1mm\nP1,30,5,6,7\n")
    assert refusal(Ratings.read, path, CLOTH) == (
        f"{path}: row 1, column 'demin_1mm': 'demin' is not a known fabric (did you mean 'denim'?)"
    )
    path = file("participant,age,voile,demin,felt\nP1,30,5,6,7\n")
    message = refusal(Ratings.read, path, CLOTH, force_n=1)
    assert "column 'demin': 'demin' is not a known fabric (did you mean 'denim'?)" in message
    read = Ratings.read(file("participant,age,voile,denim\nP1,30,5,6\n"), CLOTH, force_n=1)
    assert read.covariates == {"age": ("30",)}


@pytest.mark.parametrize(
    ("header", "options", "problem"),
    [
        ("participant,x,y", {"wide": True, "fabrics": CLOTH}, "no column"),
        ("indentation_mm,voile_1mm,denim_1mm", {}, "but there is a column 'indentation_mm', too; rename it"),
        ("participant,voile_9999mm,denim_9999mm", {}, "no column"),
        ("participant,voile_1mm,denim_1mm", {"force_n": 1.0}, "apply only to tables without a load column"),
    ],
)
def test_wide_tables_that_contradict_are_refused(file, header, options, problem):
    assert problem in refusal(Ratings.read, file(f"{header}\n1,2,3\n"), **options)


def test_fabrics_that_are_beside_or_in_frames_make_a_table_wide(file):
    cloth = file("fabric,effective_modulus_kpa\nvoile,3\ndenim,100\n", "fabrics.csv")
    path = file("participant,voile,denim\nP1,5,6\nP2,5,7\n")
    beside = read_experiment(path, force_n=1.0)
    assert beside.ratings.rating.tolist() == [5, 6, 5, 7]
    frames = read_experiment(pd.read_csv(path), pd.read_csv(cloth), force_n=1.0)
    assert_same(frames.ratings, beside.ratings)
