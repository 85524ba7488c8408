"""Whether the intervals of predicted ratings hold what was left out of simulated laboratories."""

import numpy as np
import pandas as pd
import pytest

from softness_bayes.data import Fabrics
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.readable import percent
from softness_bayes.tools.rating_coverage import (
    CASES,
    COLUMNS,
    LEAST_FIRING,
    LEFT_OUT,
    RATERS,
    fitted,
    laboratory,
    without,
)
from support.pages import tables
from support.paths import DATA, ROOT


def test_laboratories_differ_and_fire():
    fabrics = Fabrics.read(DATA / "fabrics.csv")
    made = [laboratory(fabrics, number, MAGNITUDE) for number in (0, 1)]
    assert made[0].truth["sigma_0"] != made[1].truth["sigma_0"]
    for one in made:
        assert (one.total_rate > 0).mean() >= LEAST_FIRING
    whole = made[0].ratings
    assert len(whole.participants) == RATERS + LEFT_OUT
    kept = np.arange(len(fabrics)) % 4 != 1
    rated = without(whole, kept)
    assert rated.fabrics == tuple(np.array(whole.fabrics)[kept])
    assert len(rated) == RATERS * kept.sum() * 3
    filed = {(p, f, k): y for p, f, k, y in zip(whole.participant, whole.fabric, whole.load, whole.rating, strict=True)}
    place = np.flatnonzero(kept)
    again = zip(rated.participant, rated.fabric, rated.load, rated.rating, strict=True)
    assert all(filed[p, place[f], k] == y for p, f, k, y in again)


def test_the_page_says_what_was_measured():
    kept = pd.read_csv(ROOT / "notebooks" / "results" / "predicted_ratings" / "coverage.csv")
    assert [*kept.columns] == [*COLUMNS]
    sums = kept.groupby(["case", "left_out"])[["values", "held_50", "held_90"]].sum()
    rows = [row for one in tables("calibration.md") for row in one.rows if "left out" in row]
    assert len(rows) == len(sums)
    for row in rows:
        found = sums.loc[row["ratings"], row["left out"]]
        assert int(row["values"]) == found["values"]
        for mass in (50, 90):
            assert row[f"{mass} % interval"] == percent(found[f"held_{mass}"] / found["values"], 1)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_intervals_hold_what_is_left_out(case):
    """Laboratories of different parameters, some fabrics and some raters left out, fitted with held channels."""
    rows = pd.concat([pd.DataFrame(fitted(number, case, DATA)) for number in range(100, 108)])
    assert {*rows} == {*COLUMNS}
    sums = rows.groupby("left_out")[["values", "held_50", "held_90"]].sum()
    share = sums["held_90"] / sums["values"]
    assert share.loc[["fabrics", "raters", "fabrics and raters"]].between(0.85, 0.95).all(), share
