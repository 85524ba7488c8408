"""The cost of uncertain inputs: its rows, and those that are kept."""

from types import SimpleNamespace

import pandas as pd

from softness_bayes.tools import benchmark_uncertain
from softness_bayes.tools.benchmark_uncertain import CALL_COLUMNS, CALLS, CASES, EXACT, RUN_COLUMNS, RUNS, positions
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
    monkeypatch.setattr(benchmark_uncertain, "build", lambda *_: SimpleNamespace(posterior=Normal()))
    monkeypatch.setattr(benchmark_uncertain, "CASES", {EXACT: None, "other": None})
    arguments = [str(tmp_path), "--seeds", "1", "--rounds", "2"]
    benchmark_uncertain.main(arguments)
    runs, calls = (pd.read_csv(tmp_path / name) for name in (RUNS, CALLS))
    assert (tuple(runs.columns), tuple(calls.columns)) == (RUN_COLUMNS, CALL_COLUMNS)
    assert runs["inputs"].tolist() == [EXACT, "other"]
    # the same law and seed: the same walk
    assert runs["evaluations"].nunique() == 1
    assert len(calls) == 4
    assert (calls.loc[calls["inputs"] == EXACT, "ratio"] == 1.0).all()
    benchmark_uncertain.main(arguments)
    assert pd.read_csv(tmp_path / RUNS).equals(runs)


def test_calls_are_of_half_an_ensemble_where_the_walk_is():
    found = positions(Normal(mean=3.0, sd=0.02))
    assert found.shape == (10, 3)
    assert abs(found - 3.0).max() < 0.1


def test_kept_runs_converged_and_their_costs_are_near_those_asked():
    """At most 3 and 6 times the run with exact inputs were asked."""
    runs, calls = (pd.read_csv(KEPT / name) for name in (RUNS, CALLS))
    assert set(runs["inputs"]) == set(calls["inputs"]) == {*CASES}
    assert runs["converged"].all()
    count = runs.pivot(index="seed", columns="inputs", values="evaluations")
    cost = count.div(count[EXACT], axis=0).mean() * calls.groupby("inputs")["ratio"].median()
    for name, most in (("all moduli uncertain", 3.0), ("raters' own `b`", 6.0)):
        assert 1.0 < cost[name] < 1.15 * most
