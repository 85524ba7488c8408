"""The test of uniformity: its level on uniform values, and values that are not."""

import numpy as np
import pytest
from scipy.stats import kstest

from softness_bayes.checking.quantities import simultaneous_band, uniformity_p_value

POINTS = np.arange(1, 100) / 100


@pytest.mark.parametrize("size", [20, 200])
def test_uniform_values_stay_within_the_band_as_often_as_is_said(rng, size):
    values = rng.random((2000, size))
    low, high = simultaneous_band(size, POINTS, 0.9)
    share = (values[:, :, None] <= POINTS).mean(axis=1)
    inside = ((share >= low) & (share <= high)).all(axis=1)
    assert 0.9 - 3 * np.sqrt(0.09 / 2000) < inside.mean() < 0.95
    found = np.array([uniformity_p_value(one, POINTS) for one in values[:400]])
    assert np.mean(found < 0.1) < 0.1 + 3 * np.sqrt(0.09 / 400)
    # the p-value and the band agree, and no value is below that of all points
    assert ((found < 0.1) == ~inside[:400]).mean() > 0.99
    assert all(p >= kstest(one, "uniform").pvalue - 1e-9 for p, one in zip(found, values, strict=False))


def test_other_values_are_found(rng):
    for values in (rng.beta(2, 2, 200), rng.beta(1, 1.5, 200), 0.2 + 0.6 * rng.random(200)):
        assert uniformity_p_value(values, POINTS) < 0.02
    assert uniformity_p_value(np.arange(1, 201) / 201, POINTS) > 0.99
