"""Simultaneous limits against simulation and against laws that are known; ranks and continuous values."""

import numpy as np
import pytest
from scipy.stats import binom, kstest

from softness_bayes.checking.uniformity import simultaneous_band, uniformity_p_value

LEVELS = np.arange(1, 20) / 20


def inside(values, band):
    shares = (values[..., None] <= band.points * (1 + 1e-12)).mean(axis=-2)
    return ((shares >= band.low - 1e-12) & (shares <= band.high + 1e-12)).all(axis=-1)


def test_one_point_has_the_binomial_limits():
    band = simultaneous_band(50, [0.3], 0.9)
    low, high = (band.low * 50).round().astype(int)[0], (band.high * 50).round().astype(int)[0]
    law = binom(50, 0.3)
    assert law.cdf(high) - law.cdf(low - 1) >= 0.9
    # either limit one closer, and both tails are no longer even
    assert 2 * law.cdf(low - 1) < 0.1
    assert 2 * law.sf(high) < 0.1


@pytest.mark.parametrize("probability", [0.8, 0.95])
def test_band_holds_uniform_ranks_as_often_as_it_says(rng, probability):
    band = simultaneous_band(80, LEVELS, probability)
    ranks = (rng.integers(20, size=(4000, 80)) + 1) / 20
    share = inside(ranks, band).mean()
    assert share > probability - 3 * (probability * (1 - probability) / 4000) ** 0.5
    assert share < probability + 0.04  # discrete counts: a little wider than asked
    # negative control: values that lean to one side
    assert inside(rng.beta(1.6, 1, (500, 80)), band).mean() < 0.4


def test_p_values_are_uniform_under_uniformity_and_only_then(rng):
    right = [uniformity_p_value(v, LEVELS) for v in rng.random((400, 60))]
    assert kstest(right, "uniform").pvalue > 1e-3
    assert np.mean(np.array(right) < 0.05) == pytest.approx(0.05, abs=0.035)
    leaning = [uniformity_p_value(v, LEVELS) for v in rng.beta(2, 1, (50, 60))]
    narrow = [uniformity_p_value(v, LEVELS) for v in rng.beta(3, 3, (50, 60))]
    assert np.median(leaning) < 0.01
    assert np.median(narrow) < 0.01


def test_p_value_and_band_agree(rng):
    band = simultaneous_band(60, LEVELS, 0.95)
    for values in rng.beta(1.2, 1, (60, 60)):
        assert inside(values, band) == (uniformity_p_value(values, LEVELS) > 0.05) or uniformity_p_value(
            values, LEVELS
        ) == pytest.approx(0.05, abs=0.02)


def test_extreme_samples():
    assert uniformity_p_value(np.zeros(30), LEVELS) < 1e-10
    assert uniformity_p_value(np.ones(30), LEVELS) < 1e-10
    assert uniformity_p_value((np.arange(40) + 0.5) / 40, LEVELS) > 0.99
