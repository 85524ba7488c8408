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


def test_the_scheme_converges_strongly_with_order_three_halves() -> None:
    """The same Brownian path at halved steps: errors fall by 2^1.5, where Euler's fall by 2."""
    n, finest, length = 200, 2.5e-3, 2.0
    rng = np.random.default_rng(4)
    count = round(length / finest)
    normal, other = rng.standard_normal((2, count, n))
    path = np.sqrt(finest) * normal  # increments and time integrals of W on the finest grid
    area = 0.5 * finest * np.sqrt(finest) * (normal + other / np.sqrt(3.0))

    class Path:
        """A generator that hands out the standard normals of one path at a coarser step."""

        def __init__(self, many: int) -> None:
            h = many * finest
            increments, areas = path.reshape(-1, many, n), area.reshape(-1, many, n)
            whole = increments.sum(axis=1)
            before = np.cumsum(increments, axis=1) - increments
            area_ = (areas + finest * before).sum(axis=1)
            self.normal = whole / np.sqrt(h)
            self.other = np.sqrt(3.0) * (2.0 * area_ / h**1.5 - self.normal)
            self.k = -1

        def standard_normal(self, shape: tuple[int, int]) -> np.ndarray:
            self.k += 1
            return np.array([self.normal[self.k], self.other[self.k]])

    channels = Channels(*(np.full(n, c) for c in PAPER_CHANNELS))
    cells = Cells.of(CONNOR_STEVENS, channels, np.full(n, 10.0))

    def end(many: int) -> np.ndarray:
        walk = spikes._Walk(cells, rest(channels, CONNOR_STEVENS), 1.0, Path(many), many * finest)
        for _ in range(count // many):
            walk.advance(0.0, 0.0)
        return walk.state[0]

    exact = end(1)
    coarse, fine = (np.sqrt(np.mean((end(many) - exact) ** 2)) for many in (16, 8))
    assert 2.5 < coarse / fine < 4.5


def test_statistics_under_little_noise_are_those_of_the_exact_rate() -> None:
    current = np.array([[17.0], [30.0]])
    found = firing_statistics(current, 0.1, np.random.default_rng(5), duration=120.0, runs=2, step=0.02)
    assert found.rate.shape == (2, 1)
    assert found.rate[0, 0] == 0.0
    assert np.isnan(found.interval[0, 0])
    assert 1000.0 / found.interval[1, 0] == pytest.approx(float(firing_rate(30.0)), rel=1e-3)
    assert found.variation[1, 0] < 0.05
