"""The cost of uncertain inputs: its rows, and those that are kept."""

from types import SimpleNamespace

import pandas as pd
import pytest

from softness_bayes.tools import benchmark_uncertain
from softness_bayes.tools.benchmark_uncertain import (
    CALL_COLUMNS,
    CALLS,
    CASES,
    EARLIER,
    EXACT,
    RUN_COLUMNS,
    RUNS,
    positions,
)
from support.paths import ROOT

KEPT = ROOT / "notebooks" / "results" / "uncertain_cost"


class Normal:
    """A normal law in three dimensions."""

    names = ("x", "y", "z")

    def __init__(self, mean=0.0, sd=1.0):
        self.mean, self.sd = mean, sd

    def natural(self, z):
        return z

    def __call__(self, z):
        return -0.5 * (((z - self.mean) / self.sd) ** 2).sum(axis=-1)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, 3))


def test_runs_are_kept_and_calls_are_timed_anew(monkeypatch, tmp_path):
    asked = []

    def run(where, name, seed):
        asked.append((where, name, seed))
        return {"parameters": 3, "steps": 100, "tau_steps": "2.0", "evaluations": 5000, "seconds": "1.5"}

    monkeypatch.setattr(benchmark_uncertain, "run", run)
    monkeypatch.setattr(benchmark_uncertain, "build", lambda *_: SimpleNamespace(posterior=Normal()))
    monkeypatch.setattr(benchmark_uncertain, "CASES", {EXACT: None, "other": None})
    arguments = [str(tmp_path), "--seeds", "1,2", "--rounds", "2"]
    benchmark_uncertain.main(arguments)
    runs, calls = (pd.read_csv(tmp_path / name) for name in (RUNS, CALLS))
    assert (tuple(runs.columns), tuple(calls.columns)) == (RUN_COLUMNS, CALL_COLUMNS)
    assert runs["inputs"].tolist() == [EXACT, "other"] * 2
    assert len(calls) == 4
    assert (calls.loc[calls["inputs"] == EXACT, "ratio"] == 1.0).all()
    asked.clear()
    # only the earlier version is missing now
    benchmark_uncertain.main([*arguments, "--other", str(tmp_path)])
    assert asked == [(tmp_path, EXACT, 1), (tmp_path, EXACT, 2)]
    assert pd.read_csv(tmp_path / RUNS)["inputs"].tolist() == [EXACT, "other"] * 2 + [EARLIER] * 2


def test_calls_are_of_half_an_ensemble_where_the_walk_is():
    found = positions(Normal(mean=3.0, sd=0.02))
    assert found.shape == (10, 3)
    assert abs(found - 3.0).max() < 0.1


@pytest.mark.slow
def test_a_run_in_a_process_of_its_own():
    found = benchmark_uncertain.run(ROOT, EXACT, 1)
    assert {*found} == {*RUN_COLUMNS} - {"inputs", "seed"}
    assert found["steps"] > 100
    assert found["evaluations"] > 1e4
    assert 0.1 < float(found["seconds"]) < 600


def test_kept_costs_are_those_asked():
    """At most 3 and 6 times the run with exact inputs were asked, with the code of that time (commit af6eab7)."""
    runs, calls = (pd.read_csv(KEPT / name) for name in (RUNS, CALLS))
    assert set(calls["inputs"]) == {*CASES}
    assert set(runs["inputs"]) == {EARLIER, *CASES}
    assert (runs.groupby("inputs")["seed"].nunique() == 3).all()
    spent = runs.pivot(index="seed", columns="inputs", values="seconds")
    cost = spent.div(spent[EARLIER], axis=0)
    assert (cost["all moduli uncertain"] < 3.0).all()
    assert (cost["raters' own `b`"] < 6.0).all()
    for name in ("all moduli uncertain", "raters' own `b`"):
        assert (spent[EXACT] < spent[name]).all()
