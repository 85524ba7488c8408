"""The membrane: gating, folds and exact firing rates against independent computations."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softness_bayes.base.errors import NumericalError
from softness_bayes.touch.neuron import limit_cycle
from softness_bayes.touch.neuron.cells import Cells, fold, rest, steady_state
from softness_bayes.touch.neuron.limit_cycle import step
from softness_bayes.touch.neuron.membrane import (
    CONNOR_STEVENS,
    HODGKIN_HUXLEY,
    MEMBRANES,
    PAPER_CHANNELS,
    PRINTED,
    Channels,
    Membrane,
    steady_terms,
)
from softness_bayes.touch.neuron.rate import Onset, firing_rate, onset, rheobase
from support.onsets import EXACT_ENOUGH, HODGKIN_HUXLEY_OWN
from support.paths import REFERENCE

every_membrane = pytest.mark.parametrize("membrane", MEMBRANES.values(), ids=MEMBRANES.keys())


# --- the membrane written a second time, one cell, plain Python: the oracle -----------------------------------------


def _ratio(x: float, width: float) -> float:
    return width if abs(x / width) < 1e-7 else x / -math.expm1(-x / width)


def _connor_stevens_rates(v: float) -> list[tuple[float, float]]:
    e = math.exp
    return [
        (0.38 * _ratio(v + 29.7, 10), 15.2 * e(-(v + 54.7) / 18)),
        (0.266 * e(-(v + 48) / 20), 3.8 / (1 + e(-(v + 18) / 10))),
        (0.019 * _ratio(v + 45.7, 10), 0.2375 * e(-(v + 55.7) / 80)),
    ]


def _hodgkin_huxley_rates(v: float) -> list[tuple[float, float]]:
    e = math.exp
    return [
        (0.1 * _ratio(v + 40, 10), 4 * e(-(v + 65) / 18)),
        (0.07 * e(-(v + 65) / 20), 1 / (1 + e(-(v + 35) / 10))),
        (0.01 * _ratio(v + 55, 10), 0.125 * e(-(v + 65) / 80)),
    ]


def _a_current(v: float) -> list[tuple[float, float]]:
    e = math.exp
    a = (0.0761 * e((v + 94.22) / 31.84) / (1 + e((v + 1.17) / 28.93))) ** (1 / 3)
    b = (1 / (1 + e((v + 53.3) / 14.54))) ** 4
    return [(a, 0.3632 + 1.158 / (1 + e((v + 55.96) / 20.12))), (b, 1.24 + 2.678 / (1 + e((v + 50) / 16.027)))]


ORACLES: dict[str, tuple[Callable[[float], list[tuple[float, float]]], tuple[float, ...], tuple[float, ...]]] = {
    "connor-stevens": (_connor_stevens_rates, (120, 20, 0.3, 47.7), (55, -72, -17, -75)),
    "hodgkin-huxley": (_hodgkin_huxley_rates, (120, 36, 0.3, 0), (50, -77, -54.387, -75)),
    "printed": (_hodgkin_huxley_rates, (120, 36, 0.3, 47.7), (50, -77, -54.387, -75)),
}


def oracle_slope(name: str, channels: Channels, current: float) -> Callable[[float, np.ndarray], list[float]]:
    rates, conductances, (e_na, e_k, e_l, e_a) = ORACLES[name]
    g_na, g_k, g_l, g_a = (c * g for c, g in zip(channels, conductances, strict=True))

    def slope(_t: float, y: np.ndarray) -> list[float]:
        v, m, h, n, a, b = y
        gates = [opening * (1 - x) - closing * x for x, (opening, closing) in zip((m, h, n), rates(v), strict=True)]
        gates += [(limit - x) / tau for x, (limit, tau) in zip((a, b), _a_current(v), strict=True)]
        total = g_na * m**3 * h * (e_na - v) + g_k * n**4 * (e_k - v) + g_l * (e_l - v) + g_a * a**3 * b * (e_a - v)
        return [total + current, *gates]

    return slope


# --- gating ---------------------------------------------------------------------------------------------------------


@every_membrane
def test_gating_agrees_with_the_formulas(membrane: Membrane) -> None:
    voltage = np.linspace(-110.0, 70.0, 181) + 0.123
    opening, total = membrane.gating.rates(voltage)
    row = {name: i for i, name in enumerate(membrane.gating.names)}
    for i, v in enumerate(voltage):
        for name, (a, b) in zip("mhn", ORACLES[membrane.name][0](v), strict=True):
            assert opening[row[name], i] == pytest.approx(a, rel=1e-13)
            assert total[row[name], i] == pytest.approx(a + b, rel=1e-13)
        for name, (limit, tau) in zip("AB", _a_current(v), strict=True):
            if name in row:
                assert opening[row[name], i] == pytest.approx(limit / tau, rel=1e-13)
                assert total[row[name], i] == pytest.approx(1 / tau, rel=1e-13)


@every_membrane
@pytest.mark.parametrize("offset", [0.0, 1e-300, -1e-14, 1e-9, -1e-5, 1e-3, 0.19, -0.21])
def test_removable_singularities_are_exact(membrane: Membrane, offset: float) -> None:
    kinetics = membrane.gating.kinetics
    for row, rate in ((0, kinetics.m_open), (-1, kinetics.n_open)):
        voltage = np.array([offset - rate.offset])
        x = mpmath.mpf(float(voltage[0])) + mpmath.mpf(rate.offset)
        with mpmath.workdps(40):
            exact = rate.scale * (x / -mpmath.expm1(-x / rate.width) if x else rate.width)
        opening, _ = membrane.gating.rates(voltage)
        assert opening[row, 0] == pytest.approx(float(exact), rel=1e-14)


@every_membrane
def test_gating_is_finite_everywhere(membrane: Membrane) -> None:
    voltage = np.array([-1e308, -1e6, -5e3, -1e3, 1e3, 5e3, 1e6, 1e308])
    for rate in membrane.gating.rates_and_slopes(voltage):
        assert np.isfinite(rate).all()
    opening, total = membrane.gating.rates(voltage)
    assert (opening >= 0.0).all()
    assert (opening <= total).all()


# --- the vector field and the step ----------------------------------------------------------------------------------


def _one(channels: Channels = PAPER_CHANNELS) -> Channels:
    return Channels(*(np.atleast_1d(np.asarray(c, dtype=float)) for c in channels))


@every_membrane
def test_slope_agrees_with_the_oracle(membrane: Membrane) -> None:
    cells = Cells.of(membrane, _one(), np.array([20.3]))
    gates = {"m": 0.3, "h": 0.4, "n": 0.45, "A": 0.6, "B": 0.2}
    state = np.array([[-50.0], *([gates[name]] for name in membrane.gating.names)])
    expected = oracle_slope(membrane.name, PAPER_CHANNELS, 20.3)(0.0, np.array([-50.0, *gates.values()]))
    slope = cells.slope(state)[:, 0]
    assert slope[0] == pytest.approx(expected[0], rel=1e-12)
    for name, value in zip(membrane.gating.names, slope[1:], strict=True):
        assert value == pytest.approx(expected[1 + list(gates).index(name)], rel=1e-12)


@pytest.mark.parametrize(("membrane", "steps"), [(CONNOR_STEVENS, 100), (HODGKIN_HUXLEY, 400), (PRINTED, 100)])
def test_step_has_order_five(membrane: Membrane, steps: int) -> None:
    cells = Cells.of(membrane, _one(), np.array([20.3]))
    state = steady_state(np.array([-60.0]), membrane)

    def slope(_t: float, y: np.ndarray) -> np.ndarray:
        return cells.slope(y[:, None])[:, 0]

    exact = solve_ivp(slope, (0.0, 4.0), state[:, 0], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    errors = []
    for count in (steps, 2 * steps):
        after = state
        for _ in range(count):
            after, _, _ = step(cells, after, np.array([4.0 / count]))
        errors.append(np.abs(after[:, 0] - exact).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.4)


# --- rest and folds -------------------------------------------------------------------------------------------------


@every_membrane
def test_rest_is_an_equilibrium(membrane: Membrane) -> None:
    channels = Channels(*(np.array(c) for c in ([1.05, 1.0], [1.16, 1.2], [1.0, 0.9], [1.5, 1.6])))
    state = rest(channels, membrane)
    assert np.abs(Cells.of(membrane, channels, np.zeros(2)).slope(state)).max() < 1e-10
    np.testing.assert_allclose((channels * steady_terms(state[0], membrane).current).sum(axis=0), 0.0, atol=1e-10)


def test_fold_is_the_maximum_of_the_steady_current() -> None:
    found = fold(_one(), CONNOR_STEVENS)
    near = np.array(PAPER_CHANNELS) @ steady_terms(found.voltage + np.linspace(-0.5, 0.5, 101), CONNOR_STEVENS).current
    assert near.argmax() == 50
    assert found.current[0] == pytest.approx(near.max(), abs=1e-12)
    assert found.prefactor[0] == pytest.approx(10.53, abs=0.005)
    assert np.isnan(fold(_one(), HODGKIN_HUXLEY).current[0])


# --- exact rates ----------------------------------------------------------------------------------------------------


@every_membrane
def test_rates_of_other_simulators(membrane: Membrane) -> None:
    with (REFERENCE / "firing_rate.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row.pop("membrane") == membrane.name]
    *channels, current, expected = np.array([[float(value) for value in row.values()] for row in rows]).T
    rate, silent = firing_rate(current, Channels(*channels), membrane), expected == 0.0
    assert (rate[silent] == 0.0).all()
    np.testing.assert_allclose(rate[~silent], expected[~silent], rtol=3e-7)


@pytest.mark.parametrize(
    ("membrane", "currents"),
    [
        (CONNOR_STEVENS, [-20.0, 0.0, 17.9, 250.0]),  # the last in depolarisation block
        (HODGKIN_HUXLEY, [9.0, 250.0]),  # one spike, then rest
        (PRINTED, [49.0, 250.0]),  # several spikes, then rest
    ],
)
def test_silence_is_exactly_zero(membrane: Membrane, currents: list[float]) -> None:
    np.testing.assert_array_equal(firing_rate(currents, membrane=membrane, tolerance=EXACT_ENOUGH), 0.0)


def test_firing_begins_arbitrarily_slowly_above_a_fold() -> None:
    found = fold(_one(), CONNOR_STEVENS)
    excess = np.array([1e-9, 1e-7, 1e-5, 1e-4, 3.9e-4, 4.1e-4, 1e-3])
    ratio = firing_rate(found.current + excess, tolerance=EXACT_ENOUGH) / np.sqrt(excess)
    assert ratio[0] == pytest.approx(found.prefactor[0], rel=1e-4)
    assert (np.diff(ratio) > 0.0).all()


PATIENT = 0.18668151656502305
"""Rate [Hz] of the paper's membrane 0.0175² µA/cm² above the fold, integrated with a tolerance of 1e-11."""


def test_continuation_agrees_with_waiting() -> None:
    found = fold(_one(), CONNOR_STEVENS)
    current = found.current + 0.0175**2
    assert firing_rate(current)[0] == pytest.approx(PATIENT, rel=3e-7)


def test_an_undecided_orbit_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limit_cycle, "_MAX_STEPS", 100)
    with pytest.raises(NumericalError, match=r"20\.3"):
        firing_rate(20.3)


# --- rheobase -------------------------------------------------------------------------------------------------------


def test_rheobase_at_a_fold() -> None:
    begin = onset()
    assert begin.rheobase == pytest.approx(17.98653633, abs=1e-7)
    assert begin.rate == 0.0
    around = firing_rate(begin.rheobase + np.array([-1e-6, 1e-6]), tolerance=EXACT_ENOUGH)
    assert around[0] == 0.0 < around[1]
    several = rheobase(PAPER_CHANNELS._replace(c_A=np.array([[1.5], [1.6], [1.5]])))
    assert several.shape == (3, 1)
    assert several[0, 0] == several[2, 0] == begin.rheobase
    assert several[1, 0] > begin.rheobase


def test_rheobase_at_a_fold_of_orbits(born_onset: Onset) -> None:
    assert born_onset.born
    assert born_onset.rheobase == pytest.approx(6.2603, abs=1e-4)
    assert born_onset.rate == pytest.approx(50.33, abs=0.1)  # its slope by the current is infinite there
    current = born_onset.rheobase + np.array([-0.02, 0.02])
    around = firing_rate(current, HODGKIN_HUXLEY_OWN, HODGKIN_HUXLEY, EXACT_ENOUGH)
    assert around[0] == 0.0
    assert around[1] == pytest.approx(50.33, rel=0.03)


@pytest.mark.slow
def test_a_fold_of_orbits_is_not_hidden_by_slow_passing() -> None:
    # just below the fold spikes go on for long: these multipliers were once taken to begin otherwise for that
    channels = Channels(0.984165, 1.274492, 0.9266, 1.5)
    plain = onset(channels, HODGKIN_HUXLEY)
    assert plain.born
    # an expectation says where to look first, and nothing else
    for shift in (0.003, 0.5):
        other = onset(channels, HODGKIN_HUXLEY, plain.rheobase + shift)
        assert other.rheobase == pytest.approx(plain.rheobase, abs=1e-4)
        assert other.rate == pytest.approx(plain.rate, abs=0.05)
    around = firing_rate(plain.rheobase + np.array([-5e-3, 5e-3]), channels, HODGKIN_HUXLEY)
    assert around[0] == 0.0
    assert around[1] > plain.rate


def test_a_membrane_without_sodium_never_fires() -> None:
    begin = onset(PAPER_CHANNELS._replace(c_Na=0.0), HODGKIN_HUXLEY)
    assert np.isinf(begin.rheobase)
    assert begin.rate == 0.0
