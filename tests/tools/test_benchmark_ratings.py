"""Cost and error of integrated likelihoods of ratings."""

import csv

import numpy as np

from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.intervals import IntervalRatings
from softness_bayes.tools import benchmark_ratings
from softness_bayes.tools.benchmark_ratings import KINDS, Row, alternating, measured
from support.paths import ROOT


def test_calls_take_turns_and_the_fastest_counts():
    order = []
    long, short = alternating((lambda: order.append(sum(range(200_000))), lambda: order.append(0)), 11)
    assert len(order) == 40
    assert long > 10 * short


def test_an_error_is_against_other_integrals(monkeypatch):
    monkeypatch.setattr(benchmark_ratings, "NEAR", 2)
    row = measured(STUDENT, 0.0, lambda: np.ones(64).sum(), repeats=1, far=2)
    assert 1e-6 < row.near < 1e-3
    assert row.over_closed_form > 1.0
    # negative control: a likelihood without its last rating's Jacobian is far from the dense one
    right = IntervalRatings.log_likelihood
    monkeypatch.setattr(
        IntervalRatings,
        "log_likelihood",
        lambda self, *given: right(self, *given) + 0.01 * (self._quadrature == benchmark_ratings.DENSE),
    )
    assert measured(STUDENT, 0.0, lambda: np.ones(64).sum(), repeats=1, far=2).near > 5e-3


def test_the_kept_table_has_every_kind_and_errors_that_a_posterior_can_bear():
    with (ROOT / "notebooks" / "results" / "rating_integrals.csv").open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    assert [*rows[0]] == [*Row._fields]
    assert len(rows) == 1 + len(KINDS)
    assert max(float(row["near"]) for row in rows) <= 1e-3
    assert max(float(row["prior"]) for row in rows) <= 1e-3
