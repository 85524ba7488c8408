"""Convergence diagnostics on processes whose autocorrelation time is known."""

import emcee
import numpy as np
import pytest
from scipy.signal import lfilter

from softness_bayes import arviz_bridge
from softness_bayes.inference.autocorrelation import autocorrelation_time, indicator_time
from softness_bayes.inference.diagnostics import Goal, ess_tail, look, r_hat_between
from softness_bayes.inference.summary import summarise

NAMES = ("b", "log posterior")


def autoregressive(rng, shape, tau):
    """Standard normal AR(1) processes along axis 1 of (ensembles, steps, walkers, quantities)."""
    rho = (tau - 1) / (tau + 1)
    noise = rng.standard_normal(shape)
    noise[:, 0] /= np.sqrt(1 - rho**2)
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=1)


def walks(values):
    return np.moveaxis(values, -1, 1)


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


def test_effective_sizes_follow_tau():
    tau, shape = 12.0, (4, 3000, 20, 1)
    values = autoregressive(np.random.default_rng(4), shape, tau)
    draws = np.prod(shape) / tau
    table = summarise(["b"], values).loc["b"]
    assert table["ess_bulk"] == pytest.approx(draws, rel=0.2)
    # the indicators of the tails of a normal AR(1) process decorrelate faster than the process
    assert draws < table["ess_tail"] < 3 * draws
    assert table["mcse_mean"] == pytest.approx(draws**-0.5, rel=0.2)
    assert table["r_hat"] < 1.01


def test_summary_has_the_columns_of_the_file():
    values = np.random.default_rng(5).standard_normal((4, 500, 10, 2)) * [1, 2] + [0, 5]
    table = summarise(["b", "m"], values, 0.9)
    assert table.index.name == "parameter"
    expected = "mean sd hdi_low hdi_high hdi_prob ess_bulk ess_tail r_hat mcse_mean mcse_sd"
    assert " ".join(table.columns) == expected
    assert table.loc["m", "mean"] == pytest.approx(5, abs=0.1)
    assert table.loc["m", "sd"] == pytest.approx(2, rel=0.05)
    assert table.loc["b", "hdi_low"] == pytest.approx(-1.64, abs=0.15)
    assert (table["hdi_prob"] == 0.9).all()


def test_r_hat_flags_ensembles_that_disagree_and_a_common_drift():
    rng = np.random.default_rng(6)
    same = autoregressive(rng, (4, 1000, 20, 1), 5.0)
    assert r_hat_between(walks(same))[0] < 1.01
    apart = same + np.array([-3, 3, 3, 3])[:, None, None, None]
    assert r_hat_between(walks(apart))[0] > 1.3
    drifting = same + np.linspace(-1, 1, 1000)[:, None, None]
    assert r_hat_between(walks(drifting))[0] > 1.1
    # negative control: walkers one after the other instead of interleaved, which hides the drift
    concatenated = np.swapaxes(drifting[..., 0], 1, 2).reshape(4, -1)
    assert arviz_bridge.r_hat(concatenated) < 1.01
    wider = same * np.array([1, 1, 1, 3])[:, None, None, None]
    assert r_hat_between(walks(wider))[0] > 1.05


def judged(values, lengths, names=NAMES, **kwargs):
    """Verdicts of successive looks at the first so many steps."""
    verdict = None
    for steps in lengths:
        verdict = look(names, values[:, :steps], before=verdict, **kwargs)
    return verdict


def test_a_long_run_converges_at_the_second_look_and_not_before():
    values = autoregressive(np.random.default_rng(7), (4, 3000, 20, 2), 10.0)
    first = judged(values, [2400])
    assert not first.converged
    assert "not yet compared" in first.sentence()
    # the first look has no tau to compare with, so that the second is the first that can pass
    assert not judged(values, [2000, 2400]).converged
    verdict = judged(values, [2000, 2400, 2800])
    assert verdict.converged
    assert verdict.more_steps == 0
    assert verdict.kept == verdict.steps - verdict.burn_in == 2800 - verdict.burn_in
    assert verdict.burn_in == pytest.approx(50, rel=0.3)
    assert verdict.sentence().startswith("Converged after 2800 steps of 4 x 20 walkers")


def test_a_short_run_says_what_is_missing_and_how_much():
    values = autoregressive(np.random.default_rng(8), (4, 400, 20, 2), 20.0)
    verdict = judged(values, [300, 400])
    assert not verdict.converged
    assert "of 50 tau kept" in verdict.sentence()
    # 55 tau and what ensembles differ by are needed: 1100 steps and somewhat more
    assert verdict.steps + verdict.more_steps == pytest.approx(1300, rel=0.35)
    assert f"about {verdict.more_steps} more steps" in verdict.sentence()


def test_separated_modes_do_not_converge_however_long_the_run():
    """The trap: each ensemble is far beyond 50 tau and its tau is stable."""
    values = autoregressive(np.random.default_rng(9), (4, 4000, 20, 2), 5.0)
    values[..., 0] += np.array([-6, 6, 6, -6])[:, None, None]
    verdict = judged(values, [3000, 3500, 4000])
    assert verdict.lengths > 50
    assert verdict.tau_change < 0.03
    assert not verdict.converged
    assert "ensembles disagree about b (R-hat 1." in verdict.sentence()


def test_a_stuck_walker_is_named():
    values = autoregressive(np.random.default_rng(10), (4, 2000, 20, 2), 5.0)
    values[1, :, 4] = 0.0
    verdict = judged(values, [1500, 2000])
    assert verdict.stuck == 1
    assert not verdict.converged
    assert "1 walkers never moved" in verdict.sentence()


def test_a_start_far_away_delays_convergence():
    """The transient lengthens tau and with it the burn-in, until it is shorter than that."""
    values = autoregressive(np.random.default_rng(11), (4, 6000, 20, 2), 5.0)
    values += 20 * np.exp(-np.arange(6000) / 100)[:, None, None]
    assert not judged(values, [400, 500]).converged
    assert judged(values, [5000, 5500, 6000]).converged


def test_stored_strides_count_as_steps():
    values = autoregressive(np.random.default_rng(12), (4, 3000, 20, 2), 6.0)
    verdict = judged(values, [2000, 2500, 3000], stride=4)
    assert verdict.steps == 12_000
    assert verdict.tau.mean() == pytest.approx(24, rel=0.1)
    assert verdict.converged


def test_each_part_of_the_goal_can_fail_alone():
    values = autoregressive(np.random.default_rng(13), (4, 3000, 20, 2), 6.0)
    looks = [2000, 2500, 3000]
    assert judged(values, looks).converged
    for goal in (Goal(lengths=1000), Goal(tau_change=0), Goal(r_hat=1.0), Goal(ess=1e6), Goal(looks=5)):
        verdict = judged(values, looks, goal=goal)
        assert not verdict.converged
        assert verdict.more_steps > 0
        assert verdict.sentence().startswith("Not converged")


def test_tail_size_is_the_smaller_of_both_tails():
    rng = np.random.default_rng(14)
    values = rng.standard_normal((4, 2000, 20, 1))
    # the upper tail is visited in long stays
    slow = autoregressive(rng, (4, 2000, 20, 1), 40.0)
    values = np.where(slow > 1.5, values + 5, values)
    assert ess_tail(walks(values))[0] < 160_000 / 10
