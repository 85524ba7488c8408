"""The comparison of moves with and without blocks: its rows, and those that are kept."""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd

import softness_bayes
from softness_bayes.sampler.moves import MANY_DIMENSIONS_MOVES
from softness_bayes.tools import benchmark_blocks
from softness_bayes.tools.benchmark_blocks import COLUMNS, WAYS

KEPT = Path(softness_bayes.__file__).parents[1] / "notebooks" / "results" / "many_parameters.csv"


class Normal:
    """A normal law in three dimensions."""

    names = ("x", "y", "z")

    def natural(self, z):
        return z

    def __call__(self, z):
        return -0.5 * (z**2).sum(axis=-1)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, 3))


def test_rows_have_the_length_of_a_run_to_convergence(monkeypatch, tmp_path):
    monkeypatch.setattr(benchmark_blocks, "build", lambda *_: SimpleNamespace(posterior=Normal()))
    monkeypatch.setattr(benchmark_blocks, "SEEDS", (1,))
    benchmark_blocks.main([str(tmp_path / "blocks.csv")])
    found = pd.read_csv(tmp_path / "blocks.csv")
    assert tuple(found.columns) == COLUMNS
    assert found["moves"].tolist() == [*WAYS]
    assert found["converged"].all()
    # four ensembles of twenty walkers, for at least fifty autocorrelation times
    assert (found["evaluations"] > 4 * 20 * 50 * found["tau_steps"]).all()


def test_kept_runs_converged_and_are_those_of_the_default_moves():
    assert WAYS["with blocks"] is MANY_DIMENSIONS_MOVES
    found = pd.read_csv(KEPT)
    assert tuple(found.columns) == COLUMNS
    assert set(found["moves"]) == {*WAYS}
    assert found["converged"].all()
