"""Replicates beside stored ones: the mean square of ranks, its expectation, and the kept table."""

import csv

import numpy as np
import pytest

from softness_bayes.checking.ranks import DRAWS, Replicate
from softness_bayes.tools import rank_agreement
from softness_bayes.tools.rank_agreement import EXPECTED, mean_square
from support.paths import ROOT


def test_the_expected_mean_square(rng):
    """Two sets of draws of one law, and a truth of it; a wrong law differs more."""
    truth = rng.standard_normal((20_000, 1))

    def rank(width=1.0):
        return (width * rng.standard_normal((len(truth), DRAWS)) < truth).sum(axis=-1)

    one = rank()
    assert np.square(one - rank()).mean() == pytest.approx(EXPECTED, rel=0.03)
    assert np.square(one - rank(0.7)).mean() > 1.5 * EXPECTED


def test_turning_points_are_left_out():
    one = Replicate(("b", "turns[1 mm]"), (40, 99), (1.0, 1.0), 300, 10.0, True)
    assert mean_square(one, {"b": "43", "turns[1 mm]": "0"}) == 9.0


def test_the_kept_table():
    """Mean squares of the settings of a replicate are those of independent draws, within three standard errors."""
    with (ROOT / rank_agreement.TABLE).open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["settings"] == "of a replicate"]
    assert all(row["converged"] == "True" for row in rows)
    squares = np.array([float(row["mean_square"]) for row in rows])
    assert len(squares) >= 4
    assert abs(squares.mean() - EXPECTED) < 3.0 * squares.std(ddof=1) / np.sqrt(len(squares))
