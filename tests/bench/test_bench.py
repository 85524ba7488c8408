"""The benchmark: what peers compute, how they are compared, what is drawn, and that all of it runs."""

import math
from importlib import import_module

import numpy as np
import pandas as pd
import pytest

from softness_bayes.bench import growth, peers, tables
from softness_bayes.bench.peers import Peer, measure, ratio
from softness_bayes.bench.precision import CHANNELS, QUICK, Point
from softness_bayes.bench.solvers import solve_each, step_all
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.neuron.rate import firing_rate
from support.command_line import call, refused

CURRENT = np.array([20.3, 22.0])


def test_peers_simulate_the_same_membrane():
    exact = firing_rate(CURRENT)
    np.testing.assert_allclose(solve_each("LSODA", 1e-6, CURRENT[:1], 120.0), exact[:1], rtol=3e-3)
    coarse, fine = (np.abs(step_all(step, CURRENT, 150.0) / exact - 1) for step in (0.1, 0.025))
    assert fine.max() < 0.03
    # a first-order method: a quarter of the step, about a quarter of the error
    np.testing.assert_allclose(fine / coarse, 0.25, atol=0.12)
    assert step_all(0.1, np.array([5.0]), 50.0) == [0.0]
    assert solve_each("RK45", 1e-3, np.array([5.0]), 30.0) == [0.0]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of other projects
# spike times in Brian2 are multiples of its step, here 0.02 of 200 ms
@pytest.mark.parametrize(("module", "package", "least"), [("brian", "brian2", 1e-4), ("jax_cells", "diffrax", 1e-7)])
def test_simulators_of_other_hands_converge_to_the_exact_rate(module, package, least):
    pytest.importorskip(package, reason=f"{package} comes with the extra 'peers'", exc_type=Exception)
    current = np.array([20.3, 30.0, 60.0])
    exact = firing_rate(current)
    coarse, fine = (
        float(np.abs(peer.rates(current, 400.0) / exact - 1.0).max())
        for peer in import_module(f"softness_bayes.bench.{module}").PEERS
    )
    assert fine < least
    assert fine < coarse
    # negative control: rates of other multipliers are far away
    other = firing_rate(current, PAPER_CHANNELS._replace(c_K=1.17))
    assert np.abs(other / exact - 1.0).max() > 10.0 * least


def test_a_peer_is_scaled_by_receptor_and_judged_by_exact_rates(monkeypatch):
    def law(current):
        return 10.0 * np.sqrt(current - 16.0)

    monkeypatch.setattr(peers, "firing_rate", law)
    exact = Peer("ours", "again", lambda current, _: law(current), True)
    wrong = Peer("wrong", "by 2 %", lambda current, _: 1.02 * law(current), False)
    assert measure(exact, 1000.0, QUICK).error_peak == 0.0
    point = measure(wrong, 1000.0, QUICK)
    assert point.error_peak == pytest.approx(0.02)
    assert point.seconds > 0


def test_the_ratio_is_of_the_quickest_setting_that_is_no_worse():
    held = [
        Point(CHANNELS[0], "", seconds, error, error) for seconds, error in ((1e-5, 1e-2), (2e-5, 1e-3), (4e-5, 1e-5))
    ]
    free = Point(CHANNELS[1], "", 1e-6, 1e-9, 1e-9)
    peer = Point("peer", "p", 1.0, 5e-3, np.nan)
    assert ratio(peer, [*held, free]) == pytest.approx(5e4)
    assert math.isnan(ratio(peer._replace(error_peak=1e-7), held))


def test_growth_is_the_slope_between_neighbouring_sizes(monkeypatch):
    """Of known times: quadratic in the ratings, constant in the loads."""
    times = {"ratings": lambda n: 1e-6 * n**2, "loads": lambda n: 2.0}
    monkeypatch.setattr(growth, "measured", lambda table: (times[table.what](table.size), 100.0))
    found = [*growth.grown([table for table in growth.TABLES if table.what in times])]
    assert [one.size for one in found] == [1020, 10_200, 102_000, 30, 300, 3000]
    np.testing.assert_allclose([one.exponent for one in found], [np.nan, 2.0, 2.0, np.nan, 0.0, 0.0], atol=1e-12)


def test_draws_of_emcee_are_those_of_its_published_autocorrelation_time():
    """Of a normal density of 13 dimensions, on which the stretch move takes 140 to 180 steps for a draw."""
    start = np.random.default_rng(0).standard_normal((80, 13))
    found = tables.default_moves(_Normal(), start, 4000)
    assert 1e3 / 200 < found < 1e3 / 110


class _Normal:
    def __call__(self, z):
        return -0.5 * (z**2).sum(axis=-1)

    def natural(self, z):
        return z


def test_time_and_memory_are_those_of_the_process():
    seconds, megabytes = growth.timed("--help")
    assert 0.0 < seconds < 60.0
    assert 10.0 < megabytes < 2000.0
    with pytest.raises(RuntimeError, match=r"(?s)ended with 2: .*--nothing"):
        growth.timed("--nothing")


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of other projects
def test_all_of_it_runs(tmp_path):
    done = call("bench", "--quick", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "work_precision.csv")
    assert {*CHANNELS, "SciPy solve_ivp", "NumPy exponential Euler"} <= {*table["way"]}
    assert (table["seconds"] > 0).all()
    ours = table[table["way"].isin(CHANNELS)]
    assert (ours[["error_peak", "error_log"]].max(axis=1) <= ours["accuracy"]).all()
    assert (table["ratio"].dropna() > 1e3).all()
    assert (tmp_path / "work_precision.png").stat().st_size > 0
    refused(call("bench", "--quick", "--out", tmp_path), "work_precision.csv", "--force")
    refused(call("bench", "--scale", "--tables", "--out", tmp_path), "one of them")
    done = call("bench", "--scale", "--quick", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "out" / "whole_runs.csv")
    assert table["what"].tolist() == ["ratings", "conditions", "loads", "predictions"]
    assert (table["seconds"] > 0).all()
    assert table["megabytes"].between(50, 4000).all()
