"""Averaged rate curves stored with a run: they are used again, for the same membrane alone."""

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base import arviz_bridge
from softness_bayes.results.data_groups import restore_curves, stored_curves
from softness_bayes.results.result import Result
from softness_bayes.touch.neuron import fixed_channels as module
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import HODGKIN_HUXLEY, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT, CurveError, RateCurve
from softness_bayes.touch.readings import Readings


class SimulatedError(Exception):
    """A curve was about to be simulated."""


@pytest.fixture
def simulate(monkeypatch):
    """Return a function that sets how curves are simulated; no curve is known."""
    monkeypatch.setattr(module, "_KNOWN", {})
    return lambda make: monkeypatch.setattr(module, "noisy_curve", make)


def made(noise, channels, membrane, max_current):
    error = CurveError(0.01 * noise, 1e-3, 0.25)
    return RateCurve(np.array(17.0), np.array(0.25), np.array([14.0, noise, max_current]), max_current, error)


def refused(*_):
    raise SimulatedError


def test_stored_curves_are_not_simulated_again(simulate):
    simulate(made)
    first = FixedChannels(noise=2.0)
    values = {name: np.float64(value) for name, value in PAPER_CHANNELS._asdict().items()}
    readings = {f"reading_{place}": name for place, name in Readings().names.items()}
    attributes = {**stored_curves(first), **readings, "noise": 2.0}
    result = Result(arviz_bridge.to_tree({"constant_data": values}, attrs=attributes), pd.DataFrame())
    simulate(refused)
    assert FixedChannels(noise=2.0).curve is first.curve  # from memory
    module._KNOWN.clear()
    with pytest.raises(SimulatedError):
        FixedChannels(noise=2.0)
    restore_curves(result)
    again = FixedChannels(noise=2.0)
    for one, other in zip(again.averaged, first.averaged, strict=True):
        np.testing.assert_array_equal(one.coefficients, other.coefficients)
        assert (one.rheobase, one.onset_rate, one.max_current) == (other.rheobase, other.onset_rate, other.max_current)
        assert one.error == other.error
    assert again.averaged[1].max_current == LARGEST_CURRENT
    for other in ({"noise": 2.1}, {"channels": PAPER_CHANNELS._replace(c_K=1.1)}, {"membrane": HODGKIN_HUXLEY}):
        with pytest.raises(SimulatedError):
            FixedChannels(**{"noise": 2.0, **other})


def test_without_noise_nothing_is_stored(simulate):
    simulate(refused)
    assert stored_curves(FixedChannels()) == {}
