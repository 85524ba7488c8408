"""Columns of what is known of a modulus roughly: read, refused where they do not fit, and written again."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics, fabrics_csv, read_experiment
from support.refusals import refusal

ERRORS = """fabric,effective_modulus_kpa,effective_modulus_cv,effective_modulus_sd_kpa,\
effective_modulus_low_kpa,effective_modulus_high_kpa
felt,20,0.1,,,
lawn,40,,6,,
tile,,,,1e5,1e7
foam,,,,,
gauze,3,,,,
"""
PARTS = """fabric,tensile_modulus_mpa,thickness_mm,tensile_modulus_sd_mpa,thickness_cv,\
bending_rigidity_n_m,bending_rigidity_cv
felt,3,0.5,0.3,0.05,,
lawn,3,0.5,,,,
twill,,,,,1e-5,0.2
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "fabrics.csv"
        path.write_text(text, encoding="utf-8")
        return Fabrics.read(path)

    return read


def test_errors_are_read(read):
    fabrics = read(ERRORS)
    assert_allclose(fabrics.effective_modulus_cv, [0.1, 0.15, np.nan, np.nan, np.nan])
    assert_allclose(fabrics.modulus(unknown=7.0), [20e3, 40e3, 1e9, 7.0, 3e3])
    assert_allclose(fabrics.modulus_cv(), [0.1, 0.15, np.nan, np.nan, np.nan])
    assert fabrics.basis == (
        "effective_modulus_kpa",
        "effective_modulus_kpa",
        "effective_modulus_low_kpa",
        "",
        "effective_modulus_kpa",
    )
    assert any("unknown modulus: foam" in note for note in fabrics.notes)
    with pytest.raises(InputError, match="row 5, fabric 'foam': its modulus is unknown"):
        fabrics.modulus()


def test_errors_of_parts_are_those_of_the_basis(read):
    fabrics = read(PARTS)
    s = np.sqrt(np.log1p(0.1**2) + 9 * np.log1p(0.05**2))
    assert_allclose(fabrics.modulus_cv(), [np.sqrt(np.expm1(s**2)), np.nan, 0.2])


@pytest.mark.parametrize("text", [ERRORS, PARTS])
def test_what_is_read_is_written_and_read_again(read, text):
    fabrics = read(text)
    again = read(fabrics_csv(fabrics))
    for name in ("effective_modulus_cv", "tensile_modulus_cv", "thickness_cv", "effective_modulus_low", "basis"):
        assert_array_equal(getattr(again, name), getattr(fabrics, name))
    assert_array_equal(again.modulus_cv(), fabrics.modulus_cv())


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("felt,20,0.1,", "felt,20,-0.1,", "row 2, column 'effective_modulus_cv': expected"),
        ("felt,20,0.1,", "felt,20,15,", "row 2, column 'effective_modulus_cv': expected"),
        ("felt,20,0.1,", "felt,20,0.1,2", "row 2, column 'effective_modulus_sd_kpa': expected this or"),
        ("felt,20,0.1,", "felt,,0.1,", "row 2, column 'effective_modulus_cv': an error of effective_modulus_kpa"),
        ("lawn,40,,6", "lawn,40,,600", "row 3, column 'effective_modulus_sd_kpa': expected at most 3 times"),
        ("tile,,,,1e5,1e7", "tile,,,,1e7,1e5", "fabric 'tile': effective_modulus_low_kpa and"),
        ("tile,,,,1e5,1e7", "tile,,,,1e5,", "fabric 'tile': effective_modulus_low_kpa and"),
        ("tile,,,,1e5,1e7", "tile,5,,,1e5,1e7", "not all three"),
    ],
)
def test_what_does_not_fit_is_refused(read, old, new, problem):
    assert old in ERRORS
    assert problem in refusal(read, ERRORS.replace(old, new))


def test_batches_of_moduli_are_those_on_which_all_rows_of_a_fabric_agree(tmp_path, read):
    """In a table of ratings a column of this name may be of people: it is then told and left out, without an error."""
    assert read("fabric,effective_modulus_kpa,batch\nfelt,20,A\nlawn,40,B\n").batch == ("A", "B")
    with pytest.raises(InputError, match="row 3, column 'batch'"):
        read("fabric,effective_modulus_kpa,batch\nfelt,20,A\nlawn,40,\n")
    rows = ["participant,fabric,rating,indentation_mm,effective_modulus_kpa,batch"]
    rows += [f"P{who},{name},{who + k},2,{20 * k},{who}" for who in (1, 2, 3) for k, name in ((1, "felt"), (2, "lawn"))]
    (tmp_path / "ratings.csv").write_text("\n".join(rows), encoding="utf-8")
    found = read_experiment(tmp_path / "ratings.csv")
    assert found.fabrics.batch == ("", "")
    assert any("column batch is not that of moduli" in note for note in found.notes)
