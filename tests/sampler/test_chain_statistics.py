"""Autocorrelation times of processes for which they are known."""

import emcee
import numpy as np
import pytest

from oracles.autoregressive import autoregressive, walks
from softness_bayes.sampler.chain_statistics import autocorrelation_time, own_time, pooled_time


@pytest.mark.parametrize("tau", [1.0, 8.0, 30.0])
def test_own_time_is_emcees_and_both_are_that_of_a_long_process(tau):
    values = autoregressive(np.random.default_rng(1), (3, 3000, 20, 2), tau)
    own, common = own_time(walks(values)), autocorrelation_time(walks(values))
    np.testing.assert_allclose(own, tau, rtol=0.2)
    np.testing.assert_allclose(common, tau, rtol=0.25)
    for e in range(3):
        np.testing.assert_allclose(own[e], emcee.autocorr.integrated_time(values[e], quiet=True), rtol=1e-10)


def test_the_sum_is_that_of_the_autocorrelations_about_the_mean_of_all_walkers():
    values = autoregressive(np.random.default_rng(4), (1, 400, 6, 1), 5.0)[0, :, :, 0] + np.arange(6) / 4
    apart = values - values.mean()
    lags = np.array([(apart[k:] * apart[: 400 - k]).sum() for k in range(400)]) / (apart**2).sum()
    sums = 2 * np.cumsum(lags) - 1
    window = next(m for m in range(400) if m >= 5 * sums[m])
    assert autocorrelation_time(values) == pytest.approx(sums[window], rel=1e-10)


def test_walkers_that_keep_to_places_of_their_own_have_a_long_time():
    values = autoregressive(np.random.default_rng(5), (1, 1000, 20, 1), 5.0)
    values[:, :, :6] += 6.0
    assert own_time(walks(values))[0, 0] == pytest.approx(5, rel=0.2)
    assert autocorrelation_time(walks(values))[0, 0] > 100


def test_a_walker_that_never_moves_has_no_autocorrelation_time():
    values = autoregressive(np.random.default_rng(2), (1, 500, 8, 1), 3.0)
    values[:, :, 3] = 0.7
    assert autocorrelation_time(walks(values))[0, 0] == np.inf


def test_the_time_of_an_indicator_of_independent_and_of_stuck_walkers():
    free = np.random.default_rng(3).standard_normal((4000, 20))
    assert pooled_time((free <= -1.6).astype(float)) == pytest.approx(1, rel=0.1)
    # walkers that keep to one side each: few crossings, however fast each walker moves on its side
    sides = np.abs(free) * np.where(np.arange(20) < 1, -1, 1)
    assert pooled_time((sides <= 0).astype(float)) > 100
    assert pooled_time((free <= -99).astype(float)) == np.inf
