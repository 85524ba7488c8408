"""Whether intervals hold the truth where some ratings are ten-fold."""

import numpy as np
import pandas as pd
import pytest

from softness_bayes.data import read_experiment
from softness_bayes.readable import percent
from softness_bayes.tools.outlier_coverage import CASES, COLUMNS, FACTOR, SHARE, fitted, laboratory
from support.pages import tables
from support.paths import DATA, ROOT

KEPT = ROOT / "notebooks" / "results" / "outliers" / "coverage.csv"


def held(rows):
    return rows["below"].between(0.05, 0.95)


def test_laboratories_have_the_shipped_cells_and_few_outliers():
    shipped = read_experiment(DATA / "ratings.csv").ratings
    untouched, ten_fold, elsewhere = (
        laboratory(DATA, number, CASES[case])[0].ratings
        for number, case in ((0, "untouched, normal"), (0, "ten-fold, student"), (1, "shipped ten-fold, normal"))
    )
    assert np.array_equal(untouched.participant, shipped.participant)
    assert 0.5 < np.corrcoef(np.log(untouched.rating), np.log(shipped.rating))[0, 1] < 0.99
    for made, before in ((ten_fold, untouched), (elsewhere, shipped)):
        ratio = made.rating / before.rating
        assert (ratio != 1.0).sum() == round(SHARE * len(shipped))
        np.testing.assert_allclose(ratio[ratio != 1.0], FACTOR)


def test_the_page_says_what_was_measured():
    kept = pd.read_csv(KEPT)
    assert [*kept.columns] == [*COLUMNS]
    rows = [row for one in tables("calibration.md") for row in one.rows if "fit" in row and "width for `gamma`" in row]
    assert {row["fit"] for row in rows} == {*CASES} == {*kept["case"]}
    for row in rows:
        found = kept[kept["case"] == row["fit"]]
        gamma, turning = (found[found["quantity"] == name] for name in ("gamma", "turning point at 2 mm"))
        assert int(row["fits"]) == found["lab"].nunique() >= 30
        assert row["90 % intervals that held the truth"] == percent(held(found).mean(), 1)
        assert row["those of `gamma`"] == percent(held(gamma).mean(), 1)
        assert row["width for `gamma`"] == f"{gamma['width'].median():.2f}"
        assert row["for the turning point at 2 mm"] == f"{turning['width'].median():.2f}"
        assert int(row["k of 0.7 or more"]) == (found.drop_duplicates("lab")["k"] >= 0.7).sum()


@pytest.mark.slow
def test_student_loses_nothing_by_outliers_and_normal_errors_do():
    """Three laboratories; in most of them `gamma` is known worse by a sixth with normal errors and outliers."""
    rows = pd.concat([pd.DataFrame(fitted(number, case, DATA)) for number in range(100, 103) for case in CASES])
    assert {*rows} == {*COLUMNS}
    student = rows[rows["case"].str.endswith("student")]
    assert held(student).mean() > 0.8
    width = rows[rows["quantity"] == "gamma"].pivot_table(index="lab", columns="case", values="width")
    control = width["untouched, normal"]
    assert np.median(width["ten-fold, student"] / control) < 1.15 < np.median(width["ten-fold, normal"] / control)
