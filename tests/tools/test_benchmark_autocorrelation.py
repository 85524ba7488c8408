"""The comparison of estimators of the autocorrelation time: its known walks, and the table that is kept of it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import softness_bayes
from softness_bayes.tools import benchmark_autocorrelation as tool
from softness_bayes.tools.benchmark_autocorrelation import COLUMNS, ESTIMATORS, PROCESSES, length_at_end, measure

OWN, _, COMMON = ESTIMATORS


@pytest.mark.parametrize("name", PROCESSES)
def test_walks_have_the_variance_and_the_time_that_they_should(name):
    process = PROCESSES[name]
    walks = process.walks(np.random.default_rng(3), 4 * round(process.time))[:2]
    assert walks.var() == pytest.approx(1, rel=0.1)
    # var of a mean over n steps: (1 + 2 sum (1 - k/n) rho_k) / n, with rho_k a sum of powers
    n = walks.shape[-2]
    lags = np.arange(1, n)
    powers = [share * ((time - 1) / (time + 1)) ** lags for time, share in zip(*process, strict=True)]
    expected = (1 + 2 * ((1 - lags / n) * np.sum(powers, axis=0)).sum()) / n
    assert (walks.mean(axis=-2) ** 2).mean() == pytest.approx(expected, rel=0.25)


def test_own_means_shorten_the_time_and_the_common_mean_does_not():
    process = PROCESSES["one time"]
    own, common = (measure(process, 20, ESTIMATORS[name], 1) for name in (OWN, COMMON))
    assert own.one < 0.9
    assert common.one == pytest.approx(1, abs=0.06)


def test_a_walk_ends_at_the_second_look_that_holds():
    walks = np.zeros((1, 1, 1000, 1))
    # the estimate is exact: fifty of ten steps are there at step 500, and looks are a twentieth apart
    assert length_at_end(walks, 10.0, lambda _: np.array([10.0])) == pytest.approx(50, rel=0.12)
    assert length_at_end(walks, 10.0, lambda _: np.array([30.0])) == np.inf
    # one that grows with the walk is never stable
    assert length_at_end(walks, 10.0, lambda part: np.array([part.shape[-2] / 100])) == np.inf


def kept():
    return pd.read_csv(Path(softness_bayes.__file__).parents[1] / "notebooks" / "results" / "autocorrelation.csv")


def test_the_kept_table_shows_that_runs_keep_their_promise_and_would_not_by_own_means():
    found = kept()
    assert tuple(found.columns) == COLUMNS
    assert list(zip(found["walks"], found["estimator"], strict=True)) == [(p, e) for p in PROCESSES for e in ESTIMATORS]
    alone = found.set_index(["walks", "estimator"])["at_50"].str.partition(" ")[0].astype(float).unstack()
    assert (alone[OWN] < 0.9).all()
    assert alone[COMMON]["one time"] == pytest.approx(1, abs=0.03)
    assert (alone[COMMON] > alone[OWN] + 0.1).all()
    mean, least = (found.set_index(["walks", "estimator"])[f"{n}_at_the_end"].unstack() for n in ("mean", "least"))
    assert (mean[COMMON] >= tool.GOAL.lengths).all()
    assert (least[COMMON] >= 0.98 * tool.GOAL.lengths).all()
    assert mean[OWN].min() < 0.85 * tool.GOAL.lengths
