"""What convergence takes: each part of it, on walks made to fail that part."""

import numpy as np
import pytest

from oracles.autoregressive import autoregressive, walks
from softness_bayes import arviz_bridge
from softness_bayes.sampler.chain_statistics import r_hat_between
from softness_bayes.sampler.diagnostics import Goal, look, tau_change

NAMES = ("b", "log posterior")


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


def test_separated_modes_do_not_converge_however_long_the_run():
    """The trap: each ensemble is far beyond 50 of its own tau."""
    values = autoregressive(np.random.default_rng(9), (4, 4000, 20, 2), 5.0)
    values[..., 0] += np.array([-6, 6, 6, -6])[:, None, None]
    verdict = judged(values, [3000, 3500, 4000])
    assert verdict.kept > 50 * verdict.own
    assert verdict.lengths < 2
    assert not verdict.converged
    assert "ensembles disagree about b (R-hat 1." in verdict.sentence()
    assert "the ensembles are in separate modes of b" in verdict.sentence()
    # negative control: while they are short, nobody can tell
    assert not judged(values[:, :150], [100, 150]).modes


def test_separated_modes_within_each_ensemble_do_not_converge_either():
    """The trap: ensembles agree, and no walker's own mean knows of the other mode; that of all walkers does."""
    values = autoregressive(np.random.default_rng(14), (4, 4000, 20, 2), 5.0)
    assert not judged(values, [3000, 3500, 4000]).modes
    values[:, :, :6, 0] += 12
    verdict = judged(values, [3000, 3500, 4000])
    assert verdict.kept > 50 * verdict.own
    assert verdict.r_hat.max() < 1.01
    assert not verdict.converged
    assert "walkers of an ensemble are in separate modes of b" in verdict.sentence()


def test_a_start_far_away_delays_convergence():
    """The transient lengthens tau and with it the burn-in, until it is shorter than that."""
    values = autoregressive(np.random.default_rng(11), (4, 6000, 20, 2), 5.0)
    values += 10 * np.exp(-np.arange(6000) / 30)[:, None, None]
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
    for goal in (Goal(lengths=1000), Goal(tau_change=0), Goal(r_hat=1.00001), Goal(ess=1e6), Goal(looks=5)):
        verdict = judged(values, looks, goal=goal)
        assert not verdict.converged
        assert verdict.more_steps > 0
        assert verdict.sentence().startswith("Not converged")


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ([13.0, 9.2], [12.0, 12.94], 0.06 / 13.0),  # they take turns as the slowest: the longest time is stable
        ([9.5, 8.8], [8.9, 9.0], 0.2 / 8.8),  # the slowest of before is quicker now; the slowest of now is stable
        ([10.0, 9.0], [14.0, 9.0], 0.4),
        ([10.0, 9.0], [9.0, 13.0], 0.3),
        ([10.0, 9.0], [10.0, 9.0], 0.0),
    ],
)
def test_the_longest_time_is_stable_if_it_or_that_of_its_quantity_is(before, after, expected):
    assert tau_change(np.array(after), np.array(before)) == pytest.approx(expected)


def test_a_short_run_says_what_is_missing_and_how_much():
    values = autoregressive(np.random.default_rng(8), (4, 400, 20, 2), 20.0)
    verdict = judged(values, [300, 400])
    assert not verdict.converged
    assert " autocorrelation times, 50 needed" in verdict.sentence()
    # 55 tau and what ensembles differ by are needed: 1100 steps and somewhat more
    assert verdict.steps + verdict.more_steps == pytest.approx(1300, rel=0.35)
    assert f"about {verdict.more_steps} more steps" in verdict.sentence()


def test_a_stuck_walker_is_named():
    values = autoregressive(np.random.default_rng(10), (4, 2000, 20, 2), 5.0)
    values[1, :, 4] = 0.0
    verdict = judged(values, [1500, 2000])
    assert verdict.stuck == 1
    assert not verdict.converged
    assert "1 walker never moved" in verdict.sentence()


@pytest.mark.parametrize(("times", "bounded"), [(4, False), (20, True), (30, True)])
def test_what_a_short_walk_foresees_holds(times, bounded):
    """Against the steps in which 50 true times are kept after 5 that are dropped."""
    tau, wrong = 20.0, 0
    for seed in range(20):
        values = autoregressive(np.random.default_rng(seed), (4, round(times * tau), 20, 2), tau)
        steps, most = look(NAMES, values).foreseen
        assert np.isfinite(most) == bounded
        wrong += not 0.7 * steps <= 55 * tau <= most
    assert wrong <= 1


def test_a_slow_part_that_a_short_walk_does_not_see_keeps_within_the_bound():
    """A tenth of the variance moves twelve times more slowly; its sum with the rest has a time of 12 steps."""
    rng = np.random.default_rng(20)
    for _ in range(5):
        quick, slow = (autoregressive(rng, (4, 250, 20, 2), tau) for tau in (6.0, 66.0))
        steps, most = look(NAMES, np.sqrt(0.9) * quick + np.sqrt(0.1) * slow).foreseen
        assert 0.5 * 55 * 12 <= steps <= 2.0 * 55 * 12
        assert most >= 55 * 12
