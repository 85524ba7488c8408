"""Rate curves: against exact rates at currents they were not made from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.touch.neuron import firing as module
from softness_bayes.touch.neuron.firing import exact_curve
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import (
    HODGKIN_HUXLEY,
    PAPER_CHANNELS,
)
from softness_bayes.touch.neuron.rate import Onset, firing_rate
from softness_bayes.touch.neuron.rate_curve import RateCurve
from support.onsets import CORNER, EXACT_ENOUGH, HODGKIN_HUXLEY_OWN


@pytest.fixture(scope="module")
def curve() -> RateCurve:
    return FixedChannels().curve  # an `exact_curve`, which all tests share


def test_curve_is_as_exact_as_it_says(curve: RateCurve, rng: np.random.Generator) -> None:
    current = rng.uniform(curve.rheobase, 40.0, 200)
    exact = firing_rate(current)
    error = np.abs(curve.rate(current) - exact)
    assert error.max() < 2.0 * curve.error.hertz < 5e-4
    assert (error / exact).max() < 2.0 * curve.error.relative < 1e-4


def test_slopes_are_those_of_the_rate(curve: RateCurve) -> None:
    s = np.linspace(0.1, 0.99 * float(curve.s_max), 40)
    w, step = 2.0 * s / float(curve.s_max) - 1.0, 1e-5
    upper, lower = (curve.rate(curve.rheobase + (s + sign * step) ** 2) for sign in (1.0, -1.0))
    slope = np.polynomial.polynomial.polyval(w, curve.slopes)
    np.testing.assert_allclose(slope, (upper - lower) / (2.0 * step), rtol=1e-7)


def test_curve_of_a_jump_in_the_corner(
    corner_onset: Onset, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "onset", lambda *_, **__: corner_onset)
    curve = exact_curve(CORNER, nodes=22)
    assert curve.onset_rate > 8.0
    assert curve.error.onset_hertz < 0.5
    current = curve.rheobase + np.append(1.1e-3, rng.uniform(0.0, 20.0, 40))
    assert np.abs(curve.rate(current) - firing_rate(current, CORNER, tolerance=EXACT_ENOUGH)).max() < 0.01


@pytest.mark.slow
def test_curve_of_a_fold_of_orbits(
    born_onset: Onset, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "onset", lambda *_, **__: born_onset)
    curve = exact_curve(HODGKIN_HUXLEY_OWN, HODGKIN_HUXLEY, 60.0, nodes=20)
    current = rng.uniform(curve.rheobase + 1e-3, 60.0, 60)
    error = np.abs(curve.rate(current) - firing_rate(current, HODGKIN_HUXLEY_OWN, HODGKIN_HUXLEY, EXACT_ENOUGH))
    assert error.max() < 0.05
    assert curve.rate(curve.rheobase - 1e-6) == 0.0


def test_a_curve_that_never_rises(curve: RateCurve) -> None:
    silent = exact_curve(PAPER_CHANNELS._replace(c_Na=0.0), max_current=15.0)
    assert (silent.rate(np.linspace(-5.0, 15.0, 9)) == 0.0).all()
    low = exact_curve(max_current=17.0)
    # exp differs in its last bits between processors, and the usual curve may have been computed on another
    assert low.rheobase == pytest.approx(float(curve.rheobase), rel=1e-9)
    assert (low.rate(np.array([10.0, 17.0])) == 0.0).all()


def test_curves_refuse_what_they_do_not_cover(curve: RateCurve) -> None:
    with pytest.raises(InputError, match="beyond the 40"):
        curve.rate(np.array([20.0, 40.1]))
    with pytest.raises(InputError, match="nan"):
        curve.rate(np.array([20.0, math.nan]))
    with pytest.raises(InputError, match="one value"):
        exact_curve(PAPER_CHANNELS._replace(c_K=np.array([1.0, 1.1])))
    with pytest.raises(InputError, match="finite largest current"):
        exact_curve(max_current=math.inf)


def test_a_search_ends_when_its_steps_are_spent() -> None:
    channels = PAPER_CHANNELS._replace(c_A=0.5)
    with pytest.raises(NumericalError) as refusal:
        exact_curve(channels, steps=1000)
    assert refusal.value.exit_code == 4
    for part in ("c_A = 0.5", "1000 steps", "µA/cm²", "c_A 0.5 to 2", "connor-stevens"):
        assert part in str(refusal.value)
