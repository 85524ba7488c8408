"""The noise-averaged rate curve against independent simulations, and where it meets the exact one."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.touch.neuron import fixed_channels as module
from softness_bayes.touch.neuron.fixed_channels import LEAST_RATE, noisy_curve
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.spikes import firing_statistics


@pytest.fixture(scope="module")
def curve():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_REACHES", module._REACHES[:8])  # the curve ends within the first
        patch.setattr(module, "_STEP", 0.03)  # as stable, and exact enough for so few runs
        return noisy_curve(4.0, runs=4, duration=200.0, seed=1)


def test_rates_agree_with_other_simulations_within_the_stated_error(curve):
    current = np.array([17.8, 18.5, 20.3, 30.0])
    again = firing_statistics(current, 4.0, np.random.default_rng(7), duration=200.0, runs=8, step=0.02)
    allowed = curve.error.hertz + 4.0 * again.rate_error
    assert (np.abs(curve.rate(current) - again.rate) < allowed).all()
    # far above the rheobase noise changes little; about it, noise makes membranes fire that would be silent
    assert curve.rate(np.array([38.0]))[0] == pytest.approx(float(firing_rate(38.0)), rel=0.02)
    assert curve.rate(np.array([17.8]))[0] > 0.5
    assert firing_rate(17.8) == 0.0


def test_the_curve_ends_where_the_mean_rate_is_least(curve):
    assert 14.0 < float(curve.rheobase) < 17.8
    at = np.array([float(curve.rheobase) - 0.1, float(curve.rheobase) + 1e-9])
    np.testing.assert_allclose(curve.rate(at), [0.0, LEAST_RATE], atol=1e-2)
    assert 0 < curve.error.hertz < 5.0


def test_noise_that_is_none_and_currents_that_are_silent_are_refused():
    with pytest.raises(InputError, match=r"noise is 0\.0, expected a finite number above 0 and at most 100"):
        noisy_curve(0.0)
    with pytest.raises(InputError, match="silent up to 10"):
        noisy_curve(1.0, max_current=10.0)
