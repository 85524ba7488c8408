"""Error and cost of Laplace's method for fabrics' deviations."""

import csv

from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.fabric_integrals import FabricIntegrals
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.tools.fabric_errors import KINDS, Kind, Row, measured
from support.paths import ROOT


def test_an_error_is_against_the_average_over_deviations(monkeypatch):
    kind, few = Kind(MAGNITUDE, NORMAL, 1.0, 3), {"near": 2, "far": 1, "draws": 64, "repeats": 1}
    row = measured(kind, **few)
    assert row.ratings == "whole numbers, normal, 3"
    assert row.near_median < 1e-2
    assert row.cost > 1.0
    # negative control: a reference that is off by 0.1
    right = FabricIntegrals._averaged
    monkeypatch.setattr(FabricIntegrals, "_averaged", lambda self, *given: right(self, *given) + 0.1)
    assert measured(kind, **few).near_median > 0.05


def test_the_kept_table_has_every_kind_and_errors_that_a_posterior_can_bear():
    with (ROOT / "notebooks" / "results" / "fabric_errors.csv").open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    assert [*rows[0]] == [*Row._fields]
    assert [row["ratings"] for row in rows] == [kind.words for kind in KINDS]
    # changes of the error alone change the posterior
    assert max(float(row["near_sd"]) for row in rows) <= 1e-2
    assert max(float(row["cost"]) for row in rows) <= 8.0
