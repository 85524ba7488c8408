"""What the looks at the chains say, on walks whose autocorrelation and modes are known."""

from __future__ import annotations

import emcee
import numpy as np
import pytest
from scipy.signal import lfilter

from softness_bayes.inference.autocorrelation import autocorrelation_time
from softness_bayes.inference.diagnostics import Goal, look, r_hat_between

NAMES = ("x", "y")


def walks(rng, steps, phi, ensembles=4, walkers=20):
    """First-order autoregressive walks of unit variance, shape (ensembles, steps, walkers, quantities)."""
    noise = rng.standard_normal((ensembles, steps + 500, walkers, len(NAMES))) * np.sqrt(1 - phi**2)
    return lfilter([1.0], [1.0, -phi], noise, axis=1)[:, 500:]


@pytest.mark.parametrize("phi", [0.5, 0.9])
def test_tau_is_that_of_an_autoregressive_walk_and_emcees(rng, phi):
    values = walks(rng, 20_000, phi)
    tau = autocorrelation_time(np.moveaxis(values, -1, 1))
    np.testing.assert_allclose(tau.mean(axis=0), (1 + phi) / (1 - phi), rtol=0.05)
    np.testing.assert_allclose(tau[0], emcee.autocorr.integrated_time(values[0], quiet=True), rtol=1e-6)


def test_a_long_run_converges_at_two_looks_that_can_be_compared(rng):
    """The first look has no tau to compare its own with: it never counts."""
    values = walks(rng, 4000, 0.8)
    first = look(NAMES, values[:, :3800])
    second = look(NAMES, values[:, :3900], before=first)
    third = look(NAMES, values, before=second)
    assert (first.looks_passed, second.looks_passed, third.looks_passed) == (0, 1, 2)
    assert [v.converged for v in (first, second, third)] == [False, False, True]
    assert third.more_steps == 0
    assert third.sentence().startswith("Converged")


def test_a_short_run_says_what_is_missing_and_how_much(rng):
    verdict = look(NAMES, walks(rng, 300, 0.95))
    assert not verdict.converged
    assert "of 50 tau kept" in verdict.sentence()
    # tau is 39: 50 of them and the burn-in take about 2200 steps
    assert 500 < verdict.more_steps < 6000


def test_ensembles_in_different_modes_are_told_apart(rng):
    """Each walks well in a mode of its own: only the comparison between ensembles can tell."""
    values = walks(rng, 5000, 0.5)
    values[2:, ..., 1] += 6.0
    before = look(NAMES, values)
    verdict = look(NAMES, values, before=before)
    assert verdict.lengths > 50
    assert not verdict.converged
    assert "ensembles disagree about y" in verdict.sentence()
    assert r_hat_between(np.moveaxis(values, -1, 1))[1] > 1.5


def test_a_drift_common_to_all_walkers_is_seen(rng):
    values = walks(rng, 4000, 0.5)
    values[..., 0] += np.linspace(0, 4, 4000)[:, None]
    verdict = look(NAMES, values, before=look(NAMES, values))
    assert not verdict.converged


def test_walkers_that_never_move_are_counted(rng):
    values = walks(rng, 2000, 0.5)
    values[1, :, 3] = 0.0
    verdict = look(NAMES, values)
    assert verdict.stuck == 1
    assert not verdict.converged
    assert "1 walkers never moved" in verdict.sentence()


def test_the_goal_can_be_set(rng):
    values = walks(rng, 400, 0.5)
    easy = Goal(lengths=10.0, looks=1, tau_change=np.inf, ess=100.0)
    assert look(NAMES, values, goal=easy).converged
    assert not look(NAMES, values).converged
