"""Tables of cells, as papers print them: read, converted with a measured error, refused where they do not tell."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Ratings, ratings_csv
from softness_bayes.likelihood.scales import AGGREGATED, MAGNITUDE
from softness_bayes.model.interpretation import interpret
from softness_bayes.model.options import ModelOptions
from support.refusals import refusal

GEOMETRIC = """fabric,indentation_mm,Geometric_Mean,geometric_sd,N
voile,1,5.5,1.8,20
denim,1,8,,20
voile,2,3,1.7,20
denim,2,,2.0,20
"""
ARITHMETIC = "fabric,force_n,mean,sd,n\nvoile,1,5,2.5,20\ndenim,1,8,4,20\n"


def test_geometric_means_are_read_as_they_are_and_read_back(file):
    found = Ratings.read(file(GEOMETRIC))
    assert found.participants == ("raters",)
    assert found.rating.tolist() == [5.5, 8.0, 3.0]
    assert found.cells.raters == 20
    assert found.cells.geometric_sd.tolist() == pytest.approx([1.8, np.nan, 1.7], nan_ok=True)
    assert found.notes == (
        "ratings.csv: rows are geometric means of 20 raters, with the standard deviations of their log ratings",
        "ratings.csv: 1 of 4 ratings is missing",
    )
    again = Ratings.read(file(ratings_csv(found), "again.csv"))
    assert again.rating.tolist() == found.rating.tolist()
    np.testing.assert_array_equal(again.cells.geometric_sd, found.cells.geometric_sd)
    alone = Ratings.read(file("fabric,force_n,geometric_mean,n\na,1,2,9\nb,1,3,9\n"))
    assert alone.cells == (9, None)
    assert "without the standard deviations" in alone.notes[0]


def test_arithmetic_means_are_converted_as_log_normal(file):
    found = Ratings.read(file(ARITHMETIC))
    variance = np.log(1.25)
    np.testing.assert_allclose(np.log(found.rating), np.log([5.0, 8.0]) - 0.5 * variance)
    np.testing.assert_allclose(np.log(found.cells.geometric_sd), variance**0.5)
    assert any("converted as if ratings were log-normal, an approximation" in note for note in found.notes)
    assert not [note for note in Ratings.read(file(GEOMETRIC)).notes if "approximation" in note]
    assert Ratings.read(file(ratings_csv(found), "again.csv")).rating.tolist() == found.rating.tolist()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GEOMETRIC.replace(",1.8,20", ",1.8,19"), "cells of 19 to 20 raters; expected the same raters in every cell"),
        (GEOMETRIC.replace(",1.8,20", ",1.8,"), "row 2, column 'N': expected a whole number, got ''"),
        (GEOMETRIC.replace("1.8", "0.8"), "row 2, column 'geometric_sd': expected a finite number above 1, got '0.8'"),
        (GEOMETRIC.replace("5.5", "0"), "row 2, column 'Geometric_Mean': expected a finite number above 0, got '0'"),
        (GEOMETRIC.replace("voile,2", "voile,1"), "a cell of one fabric and load is in several rows"),
        (GEOMETRIC.replace(",N", ",people"), "no column 'n'; its columns are 'fabric', 'indentation_mm'"),
        (ARITHMETIC.replace("sd", "x"), "column 'mean': an arithmetic mean alone does not determine the geometric one"),
        (ARITHMETIC.replace("sd", "se"), "column 'se': standard deviations are 2.2 times the means (median)"),
        (ARITHMETIC.replace("2.5", ""), "row 2, column 'sd': expected a standard deviation with the mean, got ''"),
        (ARITHMETIC.replace("2.5", "6").replace("8,4", "8,12"), "standard deviations are 1.4 times the means (median)"),
    ],
)
def test_what_does_not_tell_is_refused(file, text, said):
    assert said in refusal(Ratings.read, file(text))


def test_a_standard_error_is_a_standard_deviation_over_the_root_of_the_raters(file):
    by_sd, by_se = "fabric,force_n,mean,sd,n\na,1,20,8,16\nb,1,9,4,16\n", "Stoff,Kraft (N),Mittelwert,SEM,n\n"
    found, same = Ratings.read(file(by_sd)), Ratings.read(file(f"{by_se}a,1,20,2,16\nb,1,9,1,16\n", "se.csv"))
    np.testing.assert_allclose(same.rating, found.rating, rtol=1e-14)
    np.testing.assert_allclose(same.cells.geometric_sd, found.cells.geometric_sd, rtol=1e-14)
    assert any("a standard deviation is the standard error times √16" in note for note in same.notes)
    assert "se.csv: column 'Mittelwert' is read as mean" in same.notes
    assert Ratings.read(file(ratings_csv(same), "again.csv")).rating.tolist() == same.rating.tolist()


def test_single_ratings_beside_such_columns_stay_single_ratings(file):
    path = file("participant,fabric,force_n,rating,mean,sd,n\n1,a,1,5,5,1,20\n1,b,1,6,7,2,20\n")
    found = Ratings.read(path)
    assert found.cells is None
    assert found.rating.tolist() == [5.0, 6.0]
    assert "ratings.csv: unused columns: mean, sd" in found.notes
    assert Ratings.read(file("fabric,force_n,rating,n\na,1,5,20\nb,1,6,20\n")).cells is None


def test_the_scale_is_asked_for_by_name(file):
    cells, single = Ratings.read(file(GEOMETRIC)), Ratings.read(file("fabric,force_n,rating\na,1,5\nb,1,6\n"))
    with pytest.raises(InputError, match=r"means of 20 raters, which are aggregated.*add --ratings aggregated"):
        interpret(cells, ModelOptions(scale=MAGNITUDE))
    with pytest.raises(InputError, match=r"geometric means of n raters: expected the columns geometric_mean"):
        interpret(single, ModelOptions(scale=AGGREGATED))
    meaning = interpret(cells, ModelOptions(scale=AGGREGATED))
    assert meaning.raters == 20
    assert meaning.note == (
        "ratings: geometric means of 20 raters each, 2 of them with the standard deviation of their log ratings"
    )
