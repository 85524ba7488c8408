"""Cost of many loads, measured on small scenes."""

import csv

import numpy as np
import pytest

from softness_bayes.tools import benchmark_loads
from softness_bayes.tools.benchmark_loads import Measured, every, written


def test_both_ways_are_measured_and_written(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(benchmark_loads, "KINDS", {"indentation": benchmark_loads.KINDS["indentation"]})
    monkeypatch.setattr(benchmark_loads, "MODULI", np.geomspace(5e3, 5e6, 3))
    monkeypatch.setattr(benchmark_loads, "CONDITIONS", 27)
    monkeypatch.setattr(benchmark_loads, "MOST_APART", 26)
    found = every((2, 26, 27), batch=3)
    assert [(one.loads, one.tables) for one in found] == [
        (2, "one for each load"),
        (26, "one for all"),
        (26, "one for each load"),
        (27, "one for all"),
    ]
    assert all(one.compile_s > 0 and one.call_ms > 0 for one in found)
    assert max(one.error for one in found) < 5e-3
    assert len(capsys.readouterr().out.splitlines()) == 4
    written(found, tmp_path / "loads.csv")
    with (tmp_path / "loads.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]] == list(Measured._fields)
    assert float(rows[1]["error"]) == pytest.approx(found[1].error, rel=0.5)
