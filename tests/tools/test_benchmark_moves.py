"""The comparison of moves: what it measures, on a target of known autocorrelation, and what it prints."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import softness_bayes
from softness_bayes.tools import benchmark_moves
from softness_bayes.tools.benchmark_moves import DATA, WAYS, measure


class Normal:
    """A normal law in some dimensions."""

    def __init__(self, dimension):
        self.names = tuple(f"x{k}" for k in range(dimension))

    def natural(self, z):
        return z

    def __call__(self, z):
        return -0.5 * (z**2).sum(axis=-1)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, len(self.names)))


@pytest.mark.slow
def test_the_slow_way_is_told_from_the_quick_one():
    stretch, default = (measure(Normal(6), way, 600) for way in (WAYS["stretch"], [*WAYS.values()][-1]))
    # the stretch move is known for tau near ten times the dimension; proposals from the law itself need a few steps
    assert stretch.tau > 3 * default.tau
    assert default.tau < 10
    assert default.lengths == pytest.approx(600 / default.tau, rel=0.2)
    assert default.ess_per_second > 0


def test_the_table_has_every_way_and_marks_short_runs(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(benchmark_moves, "DATA", {"a normal law": lambda: Normal(2)})
    monkeypatch.setattr(benchmark_moves, "STEPS", 60)
    benchmark_moves.main([str(tmp_path / "moves.csv")])
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "a normal law (2 parameters):"
    rows = lines[5:]
    for line, name in zip(rows, WAYS, strict=True):
        assert name in line
        assert " > " in line
        assert " < " in line
    written = pd.read_csv(tmp_path / "moves.csv")
    assert tuple(written.columns) == tuple(kept().columns)
    assert written["way"].tolist() == [*WAYS]
    assert written["too_short"].all()


def kept():
    return pd.read_csv(Path(softness_bayes.__file__).parents[1] / "notebooks" / "results" / "moves.csv")


def test_every_way_is_kept_for_every_data_set_and_the_default_is_the_best_of_them():
    found = kept()
    assert list(zip(found["ratings"], found["way"], strict=True)) == [(data, way) for data in DATA for way in WAYS]
    best = found.loc[found.groupby("ratings")["effective_draws_per_second"].idxmax(), "way"]
    assert (best == [*WAYS][-1]).all()


def test_there_are_four_data_sets_at_least_and_one_of_them_starts():
    assert len(DATA) >= 4
    target = DATA["4 fabrics, 1 indentation, 4 raters"]()
    assert np.isfinite(target(target.draw_start(np.random.default_rng(1), 8))).any()
