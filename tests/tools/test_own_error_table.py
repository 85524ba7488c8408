"""Cost and error where raters have exponents or noise of their own."""

import csv

from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.own_intervals import OwnIntervalRatings
from softness_bayes.tools.own_errors import KINDS, Kind, Row, measured
from support.paths import ROOT


def test_an_error_is_against_finer_integrals(monkeypatch):
    kind, few = Kind(NORMAL, 1.0, ("gamma",)), {"near": 2, "far": 1, "draws": 64, "repeats": 1}
    row = measured(kind, **few)
    assert row.ratings == "whole numbers, normal, gamma"
    assert 1e-8 < row.near < 2e-3
    assert row.cost > 1.0
    # negative control: a reference that is off by 0.1
    right = OwnIntervalRatings.finer

    def wrong(self):
        found = right(self)
        found._log += 0.1
        return found

    monkeypatch.setattr(OwnIntervalRatings, "finer", wrong)
    assert measured(kind, **few).near > 0.05


def test_the_kept_table_has_every_kind_and_errors_that_a_posterior_can_bear():
    with (ROOT / "notebooks" / "results" / "own_errors.csv").open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    assert [*rows[0]] == [*Row._fields]
    assert [row["ratings"] for row in rows] == [kind.words for kind in KINDS]
    # changes of the error alone change the posterior
    assert max(float(row["near_sd"]) for row in rows) <= 0.1
    assert max(float(row["near_sd"]) for row in rows if "omega" not in row["ratings"]) <= 2e-3
