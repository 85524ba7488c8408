"""Weights by an exact likelihood: known laws, harmless differences, and what a wrong model would do."""

import numpy as np
import pytest

from softness_bayes.checking.exactness import HARMLESS, Exactness, resample
from softness_bayes.checking.sentences import exactness_sentence
from softness_bayes.results.summary import reweighted, summarise
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.scene import Scene

NAMES = ("x", "y")


def test_weights_move_the_mean_to_that_of_the_exact_law() -> None:
    """Draws of N(0, 1), exact law N(0.3, 1): the ratio is known, and so is the shift."""
    x = np.random.default_rng(0).standard_normal((4000, 2))
    found = Exactness(NAMES, x, -0.5 * x[:, 0] ** 2, -0.5 * (x[:, 0] - 0.3) ** 2)
    assert found.sd == pytest.approx(0.3, rel=0.05)
    assert found.shift[0] == pytest.approx(0.3, abs=0.05)
    assert abs(found.shift[1]) < 0.05
    assert found.efficiency == pytest.approx(np.exp(-(0.3**2)), rel=0.03)
    assert found.pareto_k < 0.5
    assert not found.exact_enough
    assert exactness_sentence(found).startswith("Not exact enough")


def test_tiny_differences_with_heavy_tails_are_harmless() -> None:
    """Pareto's k alone would condemn them."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((500, 2))
    difference = 1e-6 * rng.pareto(0.8, 500)
    found = Exactness(NAMES, x, np.zeros(500), difference)
    assert found.pareto_k > 0.6 or found.sd < HARMLESS
    assert found.exact_enough
    assert found.efficiency == pytest.approx(1.0, abs=1e-4)
    assert "Pareto" not in exactness_sentence(found)


def test_an_offset_and_equal_likelihoods_change_nothing() -> None:
    x = np.random.default_rng(2).standard_normal((300, 2))
    for offset in (0.0, 1e4):
        found = Exactness(NAMES, x, np.zeros(300), np.full(300, offset))
        assert (found.sd, found.largest) == (0.0, 0.0)
        np.testing.assert_allclose(found.shift, 0.0, atol=1e-12)
        assert found.exact_enough


def test_resampling_is_in_proportion() -> None:
    weight = np.array([0.1, 0.0, 0.6, 0.3])
    with np.errstate(divide="ignore"):
        chosen = resample(np.log(weight), 1000)
    np.testing.assert_allclose(np.bincount(chosen, minlength=4) / 1000, weight, atol=1e-3)


def test_a_weighted_summary_is_that_of_the_exact_law() -> None:
    rng = np.random.default_rng(3)
    values = rng.standard_normal((4, 500, 5, 1))
    flat = values.reshape(-1, 1)
    table = summarise(["x"], values)
    assert reweighted(table, flat, np.zeros(len(flat)))["sd"].iloc[0] == pytest.approx(flat.std(ddof=1), rel=1e-3)
    moved = reweighted(table, flat, 0.5 * flat[:, 0]).loc["x"]  # exp(x/2) turns N(0, 1) into N(0.5, 1)
    assert moved["mean"] == pytest.approx(0.5, abs=0.06)
    assert moved["sd"] == pytest.approx(1.0, rel=0.06)
    assert moved["hdi_low"] == pytest.approx(0.5 - 1.645, abs=0.15)
    assert moved["hdi_high"] == pytest.approx(0.5 + 1.645, abs=0.15)
    assert moved["ess_bulk"] < table["ess_bulk"].iloc[0]
    assert moved["mcse_mean"] > table["mcse_mean"].iloc[0]


def test_surface_and_exact_rates_give_one_response() -> None:
    """End to end: the scene on the surface against one with exact rates and a finer quadrature."""
    surface = FiringSurface.load(CONNOR_STEVENS)
    scene = Scene(np.geomspace(3e3, 3e6, 5), 0.3, (Indentation(1e-3), Indentation(2.5e-3)), surface)
    from softness_bayes.parameters.choice import parameter_space

    space = parameter_space()
    touch = space.touch(space.draw_prior(np.random.default_rng(5), 12))
    fast, exact = scene.total_rate(touch), scene.exact().total_rate(touch)
    peak = exact.max()
    assert peak > 0
    np.testing.assert_allclose(fast, exact, atol=1e-4 * peak)
    # negative control: channels held at the paper's values are another model
    held = Scene(np.geomspace(3e3, 3e6, 5), 0.3, (Indentation(1e-3), Indentation(2.5e-3)), FixedChannels())
    assert np.abs(held.total_rate(touch) - exact).max() > 1e-2 * peak
