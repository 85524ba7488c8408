"""Ranks of short replicates beside those of long ones: the mean square, its expectation, and the kept calibrations."""

import csv

import numpy as np
import pytest

from softness_bayes.checking.ranks import DRAWS
from softness_bayes.tools.rank_agreement import COMPARED, EXPECTED, LONG, SHORT, agreements, steps
from support.paths import ROOT

RESULTS = ROOT / "notebooks" / "results"


def rows_of(ranks):
    same = {"steps": "200", "converged": "True"}
    return [{"replicate": str(k), "b": str(rank), **same} for k, rank in enumerate(ranks)]


def kept():
    found = []
    for name in (LONG, SHORT):
        with (RESULTS / name / "ranks.csv").open(encoding="utf-8", newline="") as file:
            found.append([*csv.DictReader(file)])
    return found


def test_the_expected_mean_square(rng):
    """Two sets of draws of one law, and a truth of it; a wrong law differs more."""
    truth = rng.standard_normal((20_000, 1))

    def rank(width=1.0):
        return (width * rng.standard_normal((len(truth), DRAWS)) < truth).sum(axis=-1)

    one = rank()
    (same,) = agreements(rows_of(one), rows_of(rank()))
    assert same.mean_square == pytest.approx(EXPECTED, rel=0.03)
    assert abs(same.mean_square - EXPECTED) < 4.0 * same.error
    (wrong,) = agreements(rows_of(one), rows_of(rank(0.7)))
    assert wrong.mean_square > 1.5 * EXPECTED


def test_replicates_that_have_not_converged_are_left_out():
    long, short = rows_of([10, 20, 30]), rows_of([10, 24, 90])
    short[2]["converged"] = "False"
    (found,) = agreements(long, short)
    assert (found.quantity, found.replicates, found.mean_square) == ("b", 2, 8.0)
    assert steps(long, short) == (200.0, 200.0)


def test_kept_ranks_of_short_replicates_are_those_of_independent_draws():
    long, short = kept()
    found = agreements(long, short)
    assert [one.quantity for one in found] == [name for name in COMPARED if name in long[0]]
    assert len(found) == 14
    assert min(one.replicates for one in found) >= 140
    # of 14 standardised differences, the largest is above 3.5 by chance once in 150
    assert max(abs(one.mean_square - EXPECTED) / one.error for one in found) < 3.5
    assert abs(np.mean([one.mean_square for one in found]) - EXPECTED) < 4.0
    before, now = steps(long, short)
    assert now < 0.5 * before
