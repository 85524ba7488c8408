"""Spike trains and firing under noise, against exact rates and exact laws."""

import numpy as np
import pytest

from softness_bayes.touch.neuron import spikes
from softness_bayes.touch.neuron.cells import Cells, rest
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.spikes import firing_statistics, spike_times


def test_intervals_of_a_constant_current_are_those_of_the_exact_rate() -> None:
    times = spike_times(25.0, duration=150.0)
    assert 1000.0 / (times[-1] - times[-2]) == pytest.approx(float(firing_rate(25.0)), rel=1e-5)
    assert spike_times(17.9, duration=100.0).size == 0


def test_a_pulse_makes_spikes_while_it_lasts() -> None:
    times = spike_times(lambda t: 30.0 if 40.0 <= t < 80.0 else 0.0, duration=120.0)
    assert times.size >= 3
    assert times.min() > 40.0
    assert times.max() < 82.0
    # a silent ramp below the rheobase
    assert spike_times(lambda t: 0.1 * t, duration=100.0).size == 0


def test_vanishing_noise_gives_the_same_train() -> None:
    quiet = spike_times(25.0, duration=60.0)
    noisy = spike_times(25.0, duration=60.0, noise=1e-9, rng=np.random.default_rng(0))
    np.testing.assert_allclose(noisy, quiet, atol=2e-3)


def test_subthreshold_voltage_has_the_variance_of_the_linear_membrane() -> None:
    """Weak noise about rest: an Ornstein-Uhlenbeck process, whose covariance solves a Lyapunov equation."""
    from scipy.linalg import solve_continuous_lyapunov

    n, strength, step = 400, 0.05, 0.02
    channels = Channels(*(np.full(n, c) for c in PAPER_CHANNELS))
    state = rest(channels, CONNOR_STEVENS)
    cells = Cells.of(CONNOR_STEVENS, channels, np.zeros(n))
    jacobian = cells.take(np.arange(1)).slope_and_jacobian(state[:, :1])[1]
    gates = len(state) - 1
    matrix = np.zeros((gates + 1, gates + 1))
    matrix[0, 0], matrix[0, 1:] = jacobian.voltage_by_voltage[0], jacobian.voltage_by_gate[:, 0]
    matrix[1:, 0] = jacobian.gate_by_voltage[:, 0]
    matrix[np.arange(1, gates + 1), np.arange(1, gates + 1)] = -jacobian.decay[:, 0]
    noise = np.zeros_like(matrix)
    noise[0, 0] = strength**2
    expected = solve_continuous_lyapunov(matrix, -noise)[0, 0]
    walk = spikes._Walk(cells, state, strength, np.random.default_rng(3), step)
    found = []
    for k in range(6000):
        walk.advance(0.0, 0.0)
        if k >= 3000 and k % 100 == 0:
            found.append(walk.state[0] - state[0])
    assert np.var(found) == pytest.approx(expected, rel=0.05)


def test_statistics_under_little_noise_are_those_of_the_exact_rate() -> None:
    current = np.array([[17.0], [30.0]])
    found = firing_statistics(current, 0.1, np.random.default_rng(5), duration=120.0, runs=2, step=0.02)
    assert found.rate.shape == (2, 1)
    assert found.rate[0, 0] == 0.0
    assert np.isnan(found.interval[0, 0])
    assert 1000.0 / found.interval[1, 0] == pytest.approx(float(firing_rate(30.0)), rel=1e-3)
    assert found.variation[1, 0] < 0.05
