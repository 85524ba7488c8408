"""The comparison of samplers: weights, the count of evaluations, and a row."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest

from softness_bayes.tools import benchmark_samplers
from softness_bayes.tools.benchmark_samplers import COLUMNS, NO_DENSITY, WAYS, Counted, Way, Weighted, row, weighted
from support.fake_scene import fake_posterior
from support.paths import ROOT


def test_effective_draws_are_those_of_the_worst_mean(rng):
    theta = rng.standard_normal((20_000, 3))
    equal = weighted(theta, np.zeros(len(theta)))
    assert equal.effective == pytest.approx(len(theta))
    # weights exp(z): the mean of the first is worst, and it moves by one standard deviation
    tilted = weighted(theta, theta[:, 0])
    assert tilted.weight @ theta == pytest.approx([1.0, 0.0, 0.0], abs=0.05)
    assert tilted.effective < 0.45 * len(theta)


def test_the_unit_cube_is_mapped_to_the_prior_and_evaluations_are_counted(rng):
    posterior = fake_posterior()
    target = Counted(posterior)
    u = rng.random((8, target.dimension))
    theta = target.theta(u)
    assert target.theta(np.full(target.dimension, 0.5)) == pytest.approx(posterior.space.median)
    found = target.batch(theta)
    inside = found > NO_DENSITY
    np.testing.assert_allclose(found[inside], posterior.log_likelihood(theta)[inside])
    assert target.single(theta[0]) == pytest.approx(found[0])
    assert target.evaluations == 9
    # negative control: beyond the support of a prior there is no density, and the model is not asked
    theta[:, posterior.names.index("tau")] = -1.0
    assert (target.batch(theta) == NO_DENSITY).all()


def test_a_row_says_how_far_another_answer_lies(rng):
    theta = rng.standard_normal((5000, 2))
    one = Weighted(theta, np.full(len(theta), 1 / len(theta)), 5000.0, True)
    found = dict(zip(COLUMNS, row("same", 1, one, 2.0, 10, one), strict=True))
    assert found["largest_shift_of_a_mean_in_sd"] == "0.000"
    moved = dict(zip(COLUMNS, row("other", 1, one._replace(theta=1.5 * theta + 0.3), 2.0, 10, one), strict=True))
    assert float(moved["largest_shift_of_a_mean_in_sd"]) > 0.25
    assert float(moved["least_ratio_of_sds"]) == pytest.approx(1.5, abs=0.01)


def test_samplers_that_are_not_installed_are_named(monkeypatch, capsys, tmp_path):
    nothing = {name: way._replace(needs="no_such_package") for name, way in WAYS.items()}
    monkeypatch.setattr(benchmark_samplers, "WAYS", nothing)
    benchmark_samplers.main([str(tmp_path / "samplers.csv")])
    assert capsys.readouterr().out.count("not installed") == len(WAYS)


def test_rows_of_other_samplers_are_kept(monkeypatch, tmp_path):
    """Each call adds its samplers to the file; the first one always runs, for the comparison."""
    calls = []

    def first(target, seed):
        calls.append(seed)
        theta = np.random.default_rng(seed).standard_normal((50, target.dimension))
        return Weighted(theta, np.full(50, 1 / 50), 50.0, True)

    ways = {"a": Way(first, "emcee")} | {name: Way(lambda *at: first(*at), "emcee") for name in "bc"}
    monkeypatch.setattr(benchmark_samplers, "WAYS", ways)
    monkeypatch.setattr(benchmark_samplers, "ours", first)
    monkeypatch.setattr(benchmark_samplers, "build", lambda *_: SimpleNamespace(posterior=fake_posterior()))
    file = tmp_path / "samplers.csv"
    benchmark_samplers.main([str(file), "--seeds", "1", "--samplers", "b"])
    before = benchmark_samplers.kept_rows(file)
    assert [*before] == [("a", "1"), ("b", "1")]
    benchmark_samplers.main([str(file), "--seeds", "1", "--samplers", "c"])
    after = benchmark_samplers.kept_rows(file)
    assert [*after] == [("a", "1"), ("b", "1"), ("c", "1")]
    assert after["b", "1"] == before["b", "1"]
    assert len(calls) == 4


def test_the_kept_runs_agree():
    """emcee's default move has the same means within its effective draws, and no sampler is far from them."""
    with (ROOT / "notebooks" / "results" / "samplers.csv").open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    assert {one["sampler"] for one in rows} == {*WAYS}
    assert all([one["seed"] for one in rows].count(seed) == len(WAYS) for seed in ("1", "2"))
    for one in rows:
        draws, shift = float(one["effective_draws"]), float(one["largest_shift_of_a_mean_in_sd"])
        assert shift < (4.0 / np.sqrt(draws) if one["sampler"].startswith("emcee") else 0.5), one
        speed = float(one["effective_draws_per_second"])
        assert speed == pytest.approx(draws / float(one["processor_s"]), rel=0.02)
        if one["sampler"] != "softness-bayes":
            (ours,) = (o for o in rows if o["sampler"] == "softness-bayes" and o["seed"] == one["seed"])
            assert speed < 0.1 * float(ours["effective_draws_per_second"])
