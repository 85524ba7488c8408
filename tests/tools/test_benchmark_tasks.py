"""Benchmark of many tasks: what it measures on processes of this machine, and its kept table."""

import csv

from softness_bayes.tools import benchmark_tasks as bench
from support.paths import ROOT


def test_processes_are_measured(monkeypatch):
    for name, value in {"EMPTY": 20, "SLEEPING": 2, "LENGTH": 0.05, "PASSES": 1, "MANY": (5, 10, 15)}.items():
        monkeypatch.setattr(bench, name, value)
    row = bench.measure("processes", 2)
    assert 0.0 < float(row["efficiency"]) <= 1.0
    assert float(row["wall_ms"]) > 0.0
    assert row["scheduler_ms"] == ""
    peaks = [float(row[f"peak_mb_{count}"]) for count in (5, 10, 15)]
    assert peaks == sorted(peaks)


def test_the_kept_table():
    with (ROOT / bench.TABLE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["on"], row["workers"]) for row in rows] == [(on, k) for on in ("processes", "dask") for k in "12"]
    assert all(0.5 < float(row["efficiency"]) <= 1.0 for row in rows)
    assert all(row["scheduler_ms"] == "" or float(row["scheduler_ms"]) > 0.0 for row in rows)
