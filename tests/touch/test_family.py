"""Many fabrics under one load: interpolation against evaluation, what it costs, and the memory of large scenes."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from softness_bayes.touch import batches
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.family import MANY, NODES, interpolated
from softness_bayes.touch.population import Population
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.stress import HERTZ

FABRICS = np.geomspace(1e2, 1e8, 2000)


def draws(rng, size, paper):
    return paper(
        b=1e5 * np.exp(0.5 * rng.normal(size=size)),
        m=2.0 * np.exp(0.3 * rng.normal(size=size)),
        alpha=20.3 * np.exp(0.1 * rng.normal(size=size)),
        beta=0.6e-3 * np.exp(0.3 * rng.normal(size=size)),
        sigma_0=9e3 * np.exp(0.4 * rng.normal(size=size)),
    )


class Steps:
    """Functions 0 up to a place of their own, then a power with smooth company; counts what is asked of it."""

    def __init__(self, starts, power):
        self.starts, self.power, self.asked = np.asarray(starts), power, 0

    def __call__(self, vector, x):
        self.asked += x.size
        beyond = np.maximum(x - self.starts[vector][:, None], 0.0)
        return np.where(beyond > 0, beyond**self.power * np.exp(np.sin(x)), 0.0)


@pytest.mark.parametrize("power", [0.0, 1.0, 1.5])
def test_onsets_of_every_order(power, rng):
    at = np.sort(rng.uniform(-5, 9, 3000))
    steps = Steps([-9.0, -5.0, 0.123, 8.9999, 20.0], power)
    exact = steps(np.arange(5), np.broadcast_to(at, (5, at.size)))
    for tolerance in (1e-4, 1e-9):
        found = interpolated(steps, 5, at, tolerance, 1e-6)
        np.testing.assert_allclose(found, exact, atol=10 * tolerance * exact.max())
        assert (found[exact == 0] == 0).all()


def test_evaluations_grow_with_the_logarithm_of_the_points():
    asked = []
    for points in (10**3, 10**4, 10**5):
        steps = Steps([0.123], 1.5)
        interpolated(steps, 1, np.linspace(-5, 9, points), 1e-6, 1e-6)
        asked.append(steps.asked)
    assert asked[2] < 500
    # tenfold points halve the panels about the onset a few times more, two halves of NODES each
    assert max(np.diff(asked)) <= 5 * 2 * NODES


def test_few_or_no_points_apart(rng):
    steps = Steps([0.0], 1.0)
    for at in (np.array([2.0]), np.array([2.0, np.nextafter(2.0, 3.0)]), rng.uniform(-1, 1, 5)):
        at = np.sort(at)
        np.testing.assert_array_equal(interpolated(steps, 1, at, 1e-6, 1.0)[0], steps(np.zeros(1, int), at[None])[0])
    assert interpolated(steps, 0, np.array([1.0, 2.0]), 1e-6, 1.0).shape == (0, 2)


@pytest.mark.parametrize("load", [Indentation(2e-3), Force(1.0)], ids=str)
@pytest.mark.parametrize("onset_rate", [0.0, 12.0])
def test_interpolated_rates_are_the_evaluated_ones(load, onset_rate, smooth_firing, rng, paper):
    scene = Scene(FABRICS, rng.uniform(0.0, 0.45, FABRICS.size), [load], smooth_firing(onset_rate=onset_rate))
    parameters = draws(rng, 8, paper)
    # patches that reach the pad's edges, and a threshold among the fabrics
    parameters.sigma_0[:2] = 300.0, 12e3
    found, exact = scene.total_rate(parameters), scene.respond(parameters).total_rate
    peak = exact.max(axis=1)
    assert (peak > 0).sum() > 4
    error = np.abs(found - exact).max(axis=1) / np.maximum(peak, 1.0)
    # the stress fields' tolerance is 3e-6, and what it leaves of the response a few times that
    assert error.max() < 5e-6
    logs = np.log((found / scene.n_receptors + 0.1) / (exact / scene.n_receptors + 0.1))
    assert np.abs(logs).max() < 2e-5
    assert ((found > 0) == (exact > 0)).all()


def test_interpolation_adds_little_to_the_error(smooth_firing, rng, paper):
    scene = Scene(FABRICS[::6], 0.3, [Indentation(1e-3)], smooth_firing())
    assert FABRICS[::6].size > MANY
    parameters = draws(rng, 6, paper)
    added = np.abs(scene.total_rate(parameters) - scene.respond(parameters).total_rate).max()
    fine = scene.refined().respond(parameters).total_rate
    assert added < 0.5 * np.abs(scene.respond(parameters).total_rate - fine).max()


def test_order_repetition_company_and_loads_do_not_show(smooth_firing, rng, paper):
    firing, loads = smooth_firing(), [Indentation(1e-3), Force(0.5)]
    fabrics = FABRICS[::5]
    scene, parameters = Scene(fabrics, 0.3, loads, firing), draws(rng, 4, paper)
    rate = scene.total_rate(parameters)
    order = rng.permutation(fabrics.size)
    shuffled = Scene(fabrics[order], 0.3, loads, firing).total_rate(parameters)
    np.testing.assert_allclose(shuffled.reshape(4, 2, -1), rate.reshape(4, 2, -1)[:, :, order], rtol=1e-12)
    single = scene.total_rate(type(parameters)(*(np.broadcast_to(v, 4)[1] for v in parameters)))
    np.testing.assert_allclose(single, rate[1], rtol=1e-12)
    repeated = Scene(np.tile(fabrics, 2), 0.3, loads[:1], firing).total_rate(parameters)
    np.testing.assert_allclose(repeated, np.tile(rate[:, : fabrics.size], 2), rtol=1e-12)
    # a load of few fabrics beside one of many
    index = np.append(np.arange(fabrics.size), [3, 70, 399])
    mixed = Scene(fabrics, 0.3, loads, firing, index, np.repeat([0, 1], [fabrics.size, 3]))
    exact = mixed.respond(parameters).total_rate
    np.testing.assert_allclose(mixed.total_rate(parameters), exact, atol=5e-6 * exact.max())
    assert scene.total_rate(paper()).shape == (2 * fabrics.size,)


def test_hertz_is_monotone_between_the_nodes(smooth_firing, paper):
    scene = Scene(FABRICS, 0.3, [Indentation(1e-3)], smooth_firing(), readings=Readings(pressure=HERTZ))
    rate = scene.total_rate(paper())
    assert (np.diff(rate) >= -2e-6 * rate.max()).all()


MEASURE = """
import resource, sys
import numpy as np
from softness_bayes.touch import scene
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.firing import CurveError, RateCurve
from softness_bayes.touch.parameters import TouchParameters

method, vectors, many = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
class Firing:
    curve = RateCurve(np.array(18.0), np.array(0.0), np.array([14.0, 4.0]), 60.0, CurveError(0, 0, 0))
    def curves(self, parameters):
        return self.curve
scene.MANY = many
touched = scene.Scene(np.geomspace(1e2, 1e8, 10_000), 0.3, [Indentation(2e-3)], Firing())
b = 1e5 * np.exp(0.5 * np.random.default_rng(0).normal(size=vectors))
def ask(b):
    return getattr(touched, method)(TouchParameters(b, 2.0, 20.3, 0.6e-3, 9e3, 1.05, 1.16, 1.0, 1.5))
ask(b[:1])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
ask(b)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def extra_memory(*arguments):
    """Peak memory [MiB] of one call on 10 000 conditions, beyond that of one vector."""
    if sys.platform != "linux":
        pytest.skip("ru_maxrss is in KiB on Linux")
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, *map(str, arguments)], capture_output=True, text=True, check=True, timeout=300
    )
    return float(done.stdout)


@pytest.mark.parametrize("many", [MANY, pytest.param(10**9, marks=pytest.mark.slow)], ids=["interpolated", "evaluated"])
def test_memory_of_ten_thousand_conditions(many):
    # the answer itself takes 0.08 MiB for each vector
    assert extra_memory("total_rate", 16, many) < 100


@pytest.mark.slow
@pytest.mark.parametrize(("method", "many"), [("total_rate", MANY), ("total_rate", 10**9), ("respond", MANY)], ids=str)
def test_ten_thousand_conditions_and_256_vectors_stay_under_a_gigabyte(method, many):
    assert extra_memory(method, 256, many) < 1024


def test_evaluation_is_chunked(smooth_firing, paper, monkeypatch):
    """What is handled at once does not grow with the number of vectors or conditions."""
    scene = Scene(FABRICS[::20], 0.3, [Indentation(1e-3)], smooth_firing())
    seen = []
    monkeypatch.setattr(batches, "CHUNK", 10_000)
    sums = Population.sums
    monkeypatch.setattr(
        Population, "sums", lambda self, profile, *rest: seen.append(profile.peak.size) or sums(self, profile, *rest)
    )
    scene.total_rate(paper(b=np.geomspace(5e4, 2e5, 40)))
    assert sum(seen) == 40 * 100
    assert max(seen) <= 1000
