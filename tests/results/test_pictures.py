"""What a run stores for the figures of touch and membrane, against the chain itself."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest, norm

from softness_bayes.results.predictions import (
    EXCESSES,
    ILLUSTRATIONS,
    membrane_illustration,
    touch_illustration,
)
from softness_bayes.touch.contact import Finger, Force, Indentation
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.profiles import touch_profiles
from softness_bayes.touch.readings import CLASSICAL, MENDED
from softness_bayes.touch.receptors import CONSISTENT, PRINTED_DENSITY, draw_receptors, receptors_within
from softness_bayes.touch.scene import Scene

LOADS = (*(Indentation(depth * 1e-3) for depth in (1, 1.5, 2, 3)), Force(1.0))
MODULI = np.array([3e4, 5e6, 4e5])


@pytest.fixture(scope="module")
def firing():
    return FixedChannels()


@pytest.fixture(scope="module")
def scene(firing):
    return Scene(MODULI, [0.2, 0.3, 0.4], LOADS, firing)


@pytest.fixture
def draws(paper, rng):
    """A few parameter vectors around the priors' medians, with held channels."""
    spread = {name: np.exp(0.05 * rng.standard_normal(12)) for name in ("b", "m", "alpha", "beta", "sigma_0")}
    median = paper(alpha=22.0, sigma_0=6e3)._asdict()
    return TouchParameters(**{name: value * spread.get(name, np.ones(12)) for name, value in median.items()})


@pytest.mark.parametrize("readings", [MENDED, CLASSICAL], ids=lambda each: each.label)
def test_rates_along_the_pad_add_up_to_the_response(smooth_firing, draws, readings):
    scene = Scene(MODULI, 0.3, LOADS[3:], smooth_firing(rheobase=8.0), readings=readings)
    edges = 20.7e-3 * np.linspace(0, 1, 901) ** 1.5
    middle = 0.5 * (edges[1:] + edges[:-1])
    few = TouchParameters(*(value[:2] for value in draws))
    profiles = touch_profiles(scene, few, middle)
    rings = np.diff(receptors_within(edges, scene.finger, readings.receptor_density))
    response = scene.respond(few)
    assert response.total_rate.max() > 10
    assert_allclose((profiles.rate * rings).sum(axis=-1), response.total_rate, rtol=2e-3, atol=1e-3)
    assert_allclose(profiles.stress[..., 0], response.peak_stress, rtol=1e-3)
    outside = middle > response.contact.radius[..., None]
    assert (profiles.pressure[outside] == 0).all()
    assert (profiles.pressure[~outside] > 0).all()


@pytest.mark.parametrize("density", [CONSISTENT, PRINTED_DENSITY], ids=lambda each: each.name)
def test_receptors_are_drawn_from_their_density(rng, density):
    finger = Finger()
    pads = [draw_receptors(rng, finger, density) for _ in range(40)]
    places, expected = np.concatenate(pads), float(receptors_within(1.0, finger, density))
    # a Poisson count over all pads
    assert abs(len(places) - 40 * expected) < norm.isf(1e-6) * np.sqrt(40 * expected)
    grid = np.linspace(0, finger.pad_length, 4001)
    share = np.concatenate([[0.0], np.cumsum(density.at(0.5 * (grid[1:] + grid[:-1])))])
    assert kstest(places[:, 0], lambda x: np.interp(x, grid, share / share[-1])).pvalue > 1e-6
    assert kstest(places[:, 1] / finger.pad_width, "uniform").pvalue > 1e-6
    # the test tells densities apart
    even = np.linspace(0, finger.pad_length, places.shape[0])
    assert kstest(even, lambda x: np.interp(x, grid, share / share[-1])).pvalue < 1e-6


def test_a_touch_is_kept_as_quantiles_over_the_draws(scene, draws, rng):
    turn = np.full((12, len(LOADS)), np.nan)
    turn[:9, 3] = 6e5
    groups, axes, *_ = touch_illustration(rng, scene, draws, turn)
    stored = {name: variable.values for name, variable in groups[ILLUSTRATIONS].items()}
    assert axes["touch_load"].tolist() == ["1 mm", "2 mm", "1 N"]
    assert axes["touch_fabric"].tolist() == ["lowest modulus", "at the turning point", "highest modulus"]
    assert_allclose(stored["touch_e_fab_kpa"], [30, 600, 5000])
    grid = Scene([3e4, 6e5, 5e6], 0.3, [LOADS[k] for k in (0, 2, 4)], scene.firing)  # 0.3: the median ratio
    contact = grid.contact(draws)
    median = np.median(contact.radius, axis=0).reshape(3, 3) * 1e3
    assert_allclose(stored["touch_radius_mm"][2], median, rtol=1e-6)
    profiles = touch_profiles(grid, draws, axes["distance_mm"] * 1e-3)
    for name, values in (
        ("touch_stress_kpa", profiles.stress * 1e-3),
        ("touch_pressure_kpa", profiles.pressure * 1e-3),
        ("touch_rate_hz", profiles.rate),
    ):
        limits = np.quantile(values, axes["quantile"], axis=0).reshape(stored[name].shape)
        assert_allclose(stored[name], limits, rtol=1e-5, atol=1e-5)
    assert axes["distance_mm"][-1] == pytest.approx(1e3 * np.hypot(18e-3, 10e-3))
    assert sum(values.nbytes for values in stored.values()) < 1e5


def test_rate_curves_and_trains_are_those_of_the_membrane(scene, draws, rng):
    groups, axes, *_ = membrane_illustration(rng, scene, draws)
    current, rate = axes["current_ua_cm2"], groups["predictions"]["firing_rate_hz"].values
    curve = scene.firing.curve
    assert rate.shape == (1, 12, current.size)
    assert_allclose(rate[0], np.tile(curve.rate(current), (12, 1)), rtol=1e-6)
    assert rate[0, :, 0].max() == 0 < rate[0, :, -1].min()
    assert current[-1] == pytest.approx(np.quantile(draws.alpha, 0.975))
    examples = {name: variable.values for name, variable in groups[ILLUSTRATIONS].items()}
    alpha = np.median(draws.alpha)
    given = curve.rheobase + np.array(EXCESSES) * (alpha - curve.rheobase)
    assert_allclose(examples["train_current_ua_cm2"], given)
    # the last intervals of the strongest train are those of the steady rate
    train = examples["spike_time_ms"][-1]
    assert 1e3 / np.diff(train[np.isfinite(train)])[-1] == pytest.approx(float(curve.rate(alpha)[0]), rel=1e-2)


def test_a_silent_membrane_has_an_empty_train(scene, draws, rng):
    quiet = draws._replace(alpha=np.full(12, 5.0))
    groups, axes, *_ = membrane_illustration(rng, scene, quiet)
    assert np.isnan(groups[ILLUSTRATIONS]["spike_time_ms"].values).all()
    assert groups["predictions"]["firing_rate_hz"].values.max() == 0
    assert axes["current_ua_cm2"][[0, -1]].tolist() == [0.0, 5.0]
