"""Simulated walks of the goal of a replicate: their law and times are the stated ones, and the kept table holds."""

import csv

import numpy as np
import pytest

from softness_bayes.runs.calibrate import REPLICATE
from softness_bayes.sampler.autocorrelation import autocorrelation_time
from softness_bayes.tools import rank_goal
from support.paths import ROOT


@pytest.mark.parametrize("times", rank_goal.WALKS.values())
def test_walks_have_the_stated_law(times):
    values = rank_goal._Simulated(np.random.default_rng(2), times).until(6000)[:, 1500:]
    assert values.shape == (rank_goal.ENSEMBLES, 4500, rank_goal.WALKERS, len(rank_goal.QUANTITIES))
    assert values.mean() == pytest.approx(0.0, abs=0.05)
    assert values.var() == pytest.approx(1.0, abs=0.05)
    shares = (0.8, 0.2) if len(times) == 2 else (1.0,)
    stated = sum(share * tau for share, tau in zip(shares, times, strict=True))
    found = autocorrelation_time(np.concatenate([*np.moveaxis(values, -1, 1)], axis=-1)).mean()
    assert found == pytest.approx(stated, rel=0.2)


def test_walks_remember_their_start_for_a_while():
    values = rank_goal._Simulated(np.random.default_rng(3), (60.0,)).until(1000)
    level = values.mean(axis=2)  # over the walkers of an ensemble
    expected = rank_goal.START * (59 / 61) ** np.arange(1, 1001)[:, None]
    np.testing.assert_allclose(level, np.broadcast_to(expected, level.shape), atol=1.2)


def test_a_walk_is_continued_and_not_begun_again():
    one, other = (rank_goal._Simulated(np.random.default_rng(4), (8.0, 100.0)) for _ in range(2))
    first = one.until(300).copy()
    np.testing.assert_array_equal(one.until(900)[:, :300], first)
    np.testing.assert_array_equal(one.until(900), other.until(900))


def test_few_walks_end_at_the_goal_and_the_control_does_not():
    for index in range(2):
        _, verdict = rank_goal.ranked((8.0,), rank_goal.RANKED, index)
        assert verdict.converged
        assert verdict.burn_in > 0
    _, early = rank_goal.ranked((60.0,), rank_goal.GOALS["first check, start kept"], 0)
    assert (early.steps, early.burn_in) == (REPLICATE.first_look, 0)


def test_the_kept_table():
    """No alarm at the goal, and an alarm in the control wherever the start lasts."""
    with (ROOT / rank_goal.TABLE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["goal"], row["walks"]) for row in rows] == [(g, w) for g in rank_goal.GOALS for w in rank_goal.WALKS]
    control = [row for row in rows if row["goal"] != "of a replicate"]
    assert all(row["alarms"] == "0" for row in rows if row not in control)
    assert all(int(row["alarms"]) > 0 for row in control if row["walks"] != "fast")
