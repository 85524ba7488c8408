"""Values that look wrong: refused where they are impossible, named where they are only strange."""

import re

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics, Ratings, read_experiment
from support.paths import ROOT, SHARED


def rated(file, *ratings, load="indentation_mm,1"):
    name, value = load.split(",")
    rows = "".join(f"P1,f{k},{value},{rating}\n" for k, rating in enumerate(ratings))
    return Ratings.read(file(f"participant,fabric,{name},rating\n{rows}"))


def strange(read):
    return [note for note in read.notes if "looks wrong" in note]


# loads


@pytest.mark.parametrize(
    ("load", "expected"),
    [
        ("indentation_mm,8.1", "'indentation_mm': expected a number from 1e-06 to 8 (a fingertip's radius is 8 mm)"),
        ("depth_um,8100", "'depth_um': expected a number from 0.001 to 8000 µm (a fingertip's radius is 8 mm)"),
        ("force_n,101", "'force_n': expected a number from 1e-09 to 100 (a finger cannot bear more)"),
    ],
)
def test_loads_beyond_a_finger_are_refused(file, load, expected):
    with pytest.raises(InputError, match=f"row 2, column {re.escape(expected)}, got '{load.split(',')[1]}'"):
        rated(file, 5, load=load)


# ratings


@pytest.mark.parametrize(
    ("ratings", "row"),
    [
        (["5", "7", "999"], 4),
        (["5", "-99", "7"], 3),
        (["-9", "5", "7"], 2),
        (["1", "10", "99"], 4),
    ],
)
def test_codes_for_missing_ratings_are_refused(file, ratings, row):
    with pytest.raises(InputError, match=rf"row {row}, column 'rating': -?9+ looks like a code for a missing rating"):
        rated(file, *ratings)


@pytest.mark.parametrize(
    "ratings", [["5", "7", "999.0"], ["50", "70", "99"], ["120", "999"], ["-1", "2", "-9"], ["999"]]
)
def test_ratings_that_only_look_like_codes_are_read(file, ratings):
    assert rated(file, *ratings).rating.tolist() == [float(text) for text in ratings]


def test_ratings_that_are_all_equal_are_named(file):
    assert strange(rated(file, 5, 5, 5)) == [
        "ratings.csv: looks wrong: all 3 ratings are 5, so they contain no information"
    ]
    assert strange(rated(file, 5, 5, 6)) == []


# fabrics


@pytest.mark.parametrize(
    ("columns", "values", "named"),
    [
        ("tensile_modulus_mpa,thickness_mm", "2,250", "thickness_mm of 1 of 1 fabrics (a 250), expected a number from"),
        ("tensile_modulus_mpa,thickness_mm", "2,0.00025", "is thickness_mm in µm or m?"),
        ("tensile_modulus_mpa,thickness_mm", "2e6,0.25", "tensile_modulus_mpa of 1 of 1 fabrics (a 2e+06), expected"),
        ("tensile_modulus_mpa,thickness_mm", "0.002,0.25", "is tensile_modulus_mpa in kPa or Pa?"),
        ("bending_rigidity_n_m", "0.1", "E_fab of 1 of 1 fabrics (a 1e+05), expected a number from 0.01 to 30000 kPa"),
        ("bending_rigidity_n_m", "0.1", "is bending_rigidity_n_m in gf·cm²/cm or µN·m"),
        ("effective_modulus_kpa", "14000", "median E_fab is 1.4e+04 kPa, expected a number from 0.1 to 5000"),
        ("effective_modulus_kpa", "14000000", "is effective_modulus_kpa in Pa or MPa"),
    ],
)
def test_properties_that_no_cloth_has_are_named(file, columns, values, named):
    notes = strange(Fabrics.read(file(f"fabric,{columns}\na,{values}\n")))
    assert any(named in note for note in notes), notes


def test_two_moduli_of_one_cloth_are_compared(file):
    text = "fabric,bending_rigidity_n_m,tensile_modulus_mpa,thickness_mm,poisson_ratio\nvoile,{},3.2,0.22,0.18\n"
    named = "fabrics.csv: E_fab from the column used and from tensile_modulus_mpa and thickness_mm differ: "
    named += "voile 2.94 and 3.46"
    notes = Fabrics.read(file(text.format("2.94e-6"), "fabrics.csv")).notes
    assert notes[1:] == (f"{named} kPa",)
    assert len(Fabrics.read(file(text.format("3.4e-6"), "fabrics.csv")).notes) == 1


def test_nothing_looks_wrong_in_measured_and_shipped_fabrics():
    read = [read_experiment(ROOT / "data/ratings.csv").fabrics]
    if SHARED.is_dir():
        read.append(Fabrics.read(SHARED / "data" / "lab_fabrics.csv"))
        for name in ("warp", "weft", "diag"):
            columns = {"bending_rigidity_n_m": f"bending_{name}_N_m", "fabric": "fabric_id"}
            read.append(Fabrics.read(SHARED / "data" / "fabric_bending_618_drapetester.csv", columns=columns))
        read.append(Fabrics.read(SHARED / "data" / "fabric_modulus_poisson_thickness_penava4.csv"))
    assert [strange(fabrics) for fabrics in read] == [[] for _ in read]
    assert np.isfinite(read[0].modulus()).all()
