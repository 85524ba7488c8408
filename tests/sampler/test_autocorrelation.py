"""Autocorrelation times of processes for which they are known."""

import emcee
import numpy as np
import pytest

from oracles.autoregressive import autoregressive, walks
from softness_bayes.sampler.autocorrelation import autocorrelation_time, indicator_time


@pytest.mark.parametrize("tau", [1.0, 8.0, 30.0])
def test_autocorrelation_time_is_that_of_the_process_and_emcees(tau):
    values = autoregressive(np.random.default_rng(1), (3, 3000, 20, 2), tau)
    observed = autocorrelation_time(walks(values))
    np.testing.assert_allclose(observed, tau, rtol=0.15)
    for e in range(3):
        np.testing.assert_allclose(observed[e], emcee.autocorr.integrated_time(values[e], quiet=True), rtol=1e-10)


def test_a_walker_that_never_moves_has_no_autocorrelation_time():
    values = autoregressive(np.random.default_rng(2), (1, 500, 8, 1), 3.0)
    values[:, :, 3] = 0.7
    assert autocorrelation_time(walks(values))[0, 0] == np.inf


def test_indicator_time_of_independent_and_of_stuck_walkers():
    rng = np.random.default_rng(3)
    free = rng.standard_normal((1, 1, 4000, 20))
    assert indicator_time(free, np.array([[-1.6]])) == pytest.approx(1, rel=0.1)
    # walkers that keep to one side each: few crossings, however fast each walker moves on its side
    sides = np.abs(free) * np.where(np.arange(20) < 1, -1, 1)
    assert indicator_time(sides, np.array([[0.0]]))[0, 0] > 100
    assert indicator_time(free, np.array([[-99.0]]))[0, 0] == np.inf
