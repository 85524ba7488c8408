"""The population integral against the adaptive reference, at the places where it could go wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from oracles.reference import reference_response
from softness_bayes.touch.contact import Finger, Force, Indentation
from softness_bayes.touch.scene import Discretisation, Scene

FABRICS = np.array([2e3, 3e4, 4e5, 1e7])
LOADS = [Indentation(1e-3), Indentation(3e-3), Force(1.0)]
FINE = Discretisation(nodes=40, saturation=30.0, field_tolerance=1e-8)
RHEOBASE = 18.0


def scene(firing, finger=Finger(), loads=LOADS, fabrics=FABRICS, **choices):
    return Scene(fabrics, 0.3, loads, firing, finger=finger, **choices)


def assert_close(found, exact, share, floor=1e-3):
    """Rates within a share of the largest response; the other means where enough receptors fire to have one."""
    largest = max(exact.total_rate.max(), 1e-9)
    np.testing.assert_allclose(found.total_rate, exact.total_rate, atol=share * largest, rtol=0)
    np.testing.assert_allclose(found.responding, exact.responding, atol=20 * share * max(exact.responding.max(), 1))
    np.testing.assert_allclose(found.peak_stress, exact.peak_stress, rtol=max(share, 1e-9))
    many = exact.responding > floor * exact.responding.max()
    np.testing.assert_allclose(found.mean_rate[many], exact.mean_rate[many], rtol=100 * share)
    np.testing.assert_allclose(found.mean_interval[many], exact.mean_interval[many], rtol=100 * share)
    for name in exact.contact._fields:
        np.testing.assert_allclose(getattr(found.contact, name), getattr(exact.contact, name), rtol=1e-12)


@pytest.fixture(scope="module")
def default_scene(smooth_firing):
    return scene(smooth_firing())


@pytest.fixture(scope="module")
def fine_scene(smooth_firing):
    return scene(smooth_firing(), discretisation=FINE)


SITUATIONS = {
    "medians": {},
    "faint": {"sigma_0": 15e3},
    "small threshold stress": {"sigma_0": 300.0},
    "threshold far below any stress": {"sigma_0": -1e6},
    "step": {"beta": 1.0},
    "step far below any stress": {"beta": 1.0, "sigma_0": -1e5},
    "flat and above the rheobase": {"beta": 1e-12, "alpha": 50.0},
    "skin that does not stiffen": {"m": 0.0},
    "very stiff skin": {"b": 1e9, "m": 6.0},
    "very soft skin": {"b": 3e3, "m": 0.5, "alpha": 34.0, "sigma_0": 200.0},
    "large current and soft threshold": {"alpha": 39.0, "sigma_0": 500.0, "beta": 3e-3},
}


@pytest.mark.parametrize("situation", SITUATIONS)
def test_situations(situation, default_scene, fine_scene, paper):
    parameters = paper(**SITUATIONS[situation])
    exact = reference_response(fine_scene, parameters, fine_scene.firing.curve, rtol=1e-10)
    assert exact.total_rate.max() > 0
    assert_close(default_scene.respond(parameters), exact, 2e-4)
    assert_close(fine_scene.respond(parameters), exact, 1e-6)


def test_current_just_above_and_below_the_rheobase(default_scene, paper):
    curve = default_scene.firing.curve
    for excess in (1e-9, 1e-6, 1e-3):
        above = default_scene.respond(paper(alpha=RHEOBASE * (1 + excess), beta=1e-3))
        exact = reference_response(default_scene, paper(alpha=RHEOBASE * (1 + excess), beta=1e-3), curve)
        assert (above.total_rate > 0).any()
        np.testing.assert_allclose(above.total_rate, exact.total_rate, atol=2e-4 * exact.total_rate.max())
        below = default_scene.respond(paper(alpha=RHEOBASE * (1 - excess), beta=1e-3))
        assert (below.total_rate == 0).all()
    assert (default_scene.total_rate(paper(alpha=RHEOBASE)) == 0).all()


def test_threshold_at_the_peak_stress(default_scene, paper):
    beta, odds = 0.6e-3, 20.3 / RHEOBASE - 1
    peak = default_scene.respond(paper()).peak_stress
    for condition in (1, 5, 10):
        for shift in (0.0, 1e-16, 1e-14, 1e-10, 1e-6):
            for sign in (-1, 1):
                sigma_0 = peak[condition] * (1 + sign * shift) + math.log(odds) / beta
                found = default_scene.respond(paper(sigma_0=sigma_0))
                rate, responding = found.total_rate[condition], found.responding[condition]
                assert 0 <= rate <= 1e-3
                assert 0 <= responding <= 1e-3
                if sign * shift > 1e-14:
                    assert rate == 0
                if sign * shift < -1e-14:
                    assert rate > 0
                    assert found.mean_interval[condition] * found.mean_rate[condition] >= 1 - 1e-6


@pytest.mark.parametrize(
    "centre",
    [
        (0.0, 10e-3),
        (0.0, 0.0),
        (30e-3, 20e-3),
        (30e-3, 3e-3),
        (1e-6, 10e-3),
        (0.3e-3, 10.1e-3),
        (27e-3, 19.9e-3),
    ],
    ids=str,
)
def test_contact_at_the_edges_of_the_pad(centre, smooth_firing, paper):
    firing = smooth_firing()
    touched = scene(firing, Finger(contact_centre=centre), [Indentation(2e-3)])
    for changed in (
        {},
        {"sigma_0": 300.0},
        {"alpha": 39.0, "sigma_0": 500.0, "beta": 3e-3},
        {"sigma_0": -1e4},
    ):
        exact = reference_response(touched, paper(**changed), firing.curve)
        assert_close(touched.respond(paper(**changed)), exact, 2e-4)


def test_jump_at_the_onset(smooth_firing, paper):
    smooth, jump = smooth_firing(), smooth_firing(onset_rate=12.0)
    one, other = scene(smooth, loads=LOADS[1:]), scene(jump, loads=LOADS[1:])
    for changed in SITUATIONS.values():
        a, b = one.respond(paper(**changed)), other.respond(paper(**changed))
        # every receptor that fires gains the jump, and no other
        np.testing.assert_allclose(b.total_rate - a.total_rate, 12.0 * a.responding, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(b.responding, a.responding, rtol=1e-12)


def test_no_leap_where_the_patch_reaches_an_edge(default_scene, fine_scene, paper):
    # sigma_0 moves the last responding receptor across all kinks of the pad
    parameters = paper(sigma_0=np.linspace(150.0, 1500.0, 1001), alpha=39.0, beta=1e-3)
    found, exact = default_scene.respond(parameters), fine_scene.respond(parameters)
    assert (found.responding > 245).any()
    assert (found.responding < 40).any()
    assert (np.diff(found.total_rate, axis=0) <= 0).all()
    assert (np.diff(found.responding, axis=0) <= 1e-9).all()
    largest = exact.total_rate.max()
    np.testing.assert_allclose(found.total_rate, exact.total_rate, atol=5e-4 * largest, rtol=0)
    slope, exact_slope = (np.diff(r.total_rate, axis=0) for r in (found, exact))
    np.testing.assert_allclose(slope, exact_slope, atol=0.03 * np.abs(exact_slope).max(), rtol=0)


def test_the_rest_beyond_saturation_is_right_to_second_order(fine_scene, paper, rng):
    """With many nodes the error is that of the rest: a share of exp(-saturation) that one number would not reach."""
    parameters = paper(
        b=1e5 * np.exp(0.5 * rng.normal(size=100)),
        alpha=22.0,
        beta=0.6e-3 * np.exp(0.3 * rng.normal(size=100)),
        sigma_0=6e3 * np.exp(0.4 * rng.normal(size=100)),
    )
    exact = fine_scene.total_rate(parameters)
    for saturation in (4.0, 6.0, 8.0):
        coarse = fine_scene.coarser(Discretisation(30, saturation, 1e-8))
        error = np.abs(coarse.total_rate(parameters) - exact).max(axis=1) / exact.max(axis=1)
        # the number at saturation in place of all beyond it is wrong by up to 0.09 of the exponential
        assert error.max() < 0.05 * math.exp(-saturation)
        assert error.max() > 1e-9
