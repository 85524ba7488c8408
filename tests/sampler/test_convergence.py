"""What convergence takes: each part of it, on walks made to fail that part."""

import numpy as np
import pytest
from scipy.stats import chi2

from oracles.autoregressive import autoregressive, walks
from softness_bayes.base import arviz_bridge
from softness_bayes.sampler.chain_statistics import ess_between, ess_bulk, r_hat_between
from softness_bayes.sampler.diagnostics import Goal, look

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


def test_a_run_of_fifteen_times_converges_and_one_of_ten_does_not():
    """Five are dropped, and the rest must be ten; the spread of each estimate leaves a third."""
    values = autoregressive(np.random.default_rng(7), (4, 3000, 80, 2), 10.0)
    assert not look(NAMES, values[:, :100]).converged
    verdict = look(NAMES, values[:, :200])
    assert verdict.converged
    assert verdict.more_steps == 0
    assert verdict.kept == verdict.steps - verdict.burn_in == 200 - verdict.burn_in
    assert verdict.burn_in == pytest.approx(50, rel=0.3)
    assert verdict.sentence().startswith("Converged after 200 steps of 4 x 80 walkers")
    # the caution that is usual with one ensemble
    cautious = Goal(lengths=50.0)
    assert not look(NAMES, values[:, :400], goal=cautious).converged
    assert look(NAMES, values[:, :700], goal=cautious).converged


def test_a_mode_that_few_walkers_visit_has_no_tails():
    """Its share is judged by its mean alone: 5 and 95 % quantiles of zeros and ones say nothing."""
    rng = np.random.default_rng(12)
    values = autoregressive(rng, (4, 400, 80, 2), 10.0)
    inside = np.zeros((4, 400, 80, 2), bool)
    inside[..., 0] = True
    visits = rng.integers(0, [3, 400, 80], size=(12, 3))  # never in the last ensemble
    inside[tuple(visits.T)] = [False, True]
    verdict = look(NAMES, values, inside=inside)
    assert verdict.ess_tail.shape == (4,)
    assert verdict.ess_tail.min() > 1600
    assert verdict.more_steps >= 0


def test_what_converged_is_as_exact_as_promised():
    """Means within 0.1 sd and 5 % quantiles within 0.2 sd in 99 % of runs, stopped at the first check that passes."""
    rng, q, wrong, runs = np.random.default_rng(21), -1.6448536, 0, 100
    for _ in range(runs):
        values = autoregressive(rng, (4, 400, 40, 1), 8.0)
        verdict = next(v for n in range(120, 400, 40) if (v := look(("a",), values[:, :n])).converged)
        kept = values[:, verdict.burn_in : verdict.steps]
        wrong += abs(kept.mean()) > 0.1 or abs(np.quantile(kept, 0.05) - q) > 0.2
    assert wrong <= 1


def test_means_that_differ_between_ensembles_lower_the_sample_size():
    """The trap: movements too slow for the autocorrelations, which ensembles have in different phases."""
    rng = np.random.default_rng(22)
    values = autoregressive(rng, (4, 400, 80, 1), 8.0)
    assert look(("a",), values).converged
    values += 0.1 * np.array([-1, 1, 1, -1])[:, None, None, None]
    verdict = look(("a",), values)
    assert verdict.agrees
    assert not verdict.converged
    assert "ensembles differ in a as if ESS were" in verdict.sentence()
    # negative control: nothing else sees it
    assert ess_bulk(walks(values), verdict.tau).min() > Goal().ess


def test_the_size_between_ensembles_is_that_of_independent_draws(rng):
    """The median of the largest of three chi-squared laws of 3 degrees of freedom is that of one at 0.5^(1/3)."""
    independent, dependent = (
        4 * 200 * 20 / np.median(ess_between(walks(autoregressive(rng, (4, 200, 20, 300), tau)))) for tau in (1.0, 8.0)
    )
    assert independent == pytest.approx(chi2(3).ppf(0.5 ** (1 / 3)) / 3, rel=0.15)
    assert dependent > 4 * independent


def test_separated_modes_do_not_converge_however_long_the_run():
    """The trap: each ensemble is far beyond 50 of its own tau."""
    values = autoregressive(np.random.default_rng(9), (4, 4000, 20, 2), 5.0)
    values[..., 0] += np.array([-6, 6, 6, -6])[:, None, None]
    verdict = look(NAMES, values)
    assert verdict.kept > 50 * verdict.own
    assert verdict.lengths < 2
    assert not verdict.converged
    assert "ensembles disagree about b (R-hat 1." in verdict.sentence()
    assert "the ensembles are in separate modes of b" in verdict.sentence()
    # negative control: while they are short, nobody can tell
    assert not look(NAMES, values[:, :150]).modes


def test_separated_modes_within_each_ensemble_do_not_converge_either():
    """The trap: ensembles agree, and no walker's own mean knows of the other mode; that of all walkers does."""
    values = autoregressive(np.random.default_rng(14), (4, 4000, 20, 2), 5.0)
    assert not look(NAMES, values).modes
    values[:, :, :6, 0] += 12
    verdict = look(NAMES, values)
    assert verdict.kept > 50 * verdict.own
    assert verdict.r_hat.max() < 1.01
    assert not verdict.converged
    assert "walkers of an ensemble are in separate modes of b" in verdict.sentence()


def test_a_start_far_away_delays_convergence():
    """The transient lengthens tau and with it the burn-in, until it is shorter than that."""
    values = autoregressive(np.random.default_rng(11), (4, 6000, 20, 2), 5.0)
    values += 10 * np.exp(-np.arange(6000) / 30)[:, None, None]
    assert not look(NAMES, values[:, :150]).converged
    assert look(NAMES, values).converged


def test_stored_strides_count_as_steps():
    values = autoregressive(np.random.default_rng(12), (4, 3000, 20, 2), 6.0)
    verdict = look(NAMES, values, stride=4)
    assert verdict.steps == 12_000
    assert verdict.tau.mean() == pytest.approx(24, rel=0.1)
    assert verdict.converged


def test_each_part_of_the_goal_can_fail_alone():
    values = autoregressive(np.random.default_rng(13), (4, 3000, 20, 2), 6.0)
    assert look(NAMES, values).converged
    for goal in (Goal(lengths=1000), Goal(r_hat=1.00001), Goal(ess=1e6)):
        verdict = look(NAMES, values, goal=goal)
        assert not verdict.converged
        assert verdict.more_steps > 0
        assert verdict.sentence().startswith("Not converged")


def test_a_short_run_says_what_is_missing_and_how_much():
    values = autoregressive(np.random.default_rng(8), (4, 120, 80, 2), 20.0)
    verdict = look(NAMES, values)
    assert not verdict.converged
    assert "needed (" in verdict.sentence()
    assert verdict.steps + verdict.more_steps == pytest.approx(300, rel=0.35)
    assert f"about {verdict.more_steps} more steps" in verdict.sentence()


def test_a_stuck_walker_is_named():
    values = autoregressive(np.random.default_rng(10), (4, 2000, 20, 2), 5.0)
    values[1, :, 4] = 0.0
    verdict = look(NAMES, values)
    assert verdict.stuck == 1
    assert not verdict.converged
    assert "1 walker never moved" in verdict.sentence()


@pytest.mark.parametrize(("times", "bounded"), [(3, False), (10, True), (12, True)])
def test_what_a_short_walk_foresees_holds(times, bounded):
    """Against the steps in which ten true times are kept after five that are dropped."""
    tau, wrong = 20.0, 0
    for seed in range(20):
        values = autoregressive(np.random.default_rng(seed), (4, round(times * tau), 80, 2), tau)
        steps, most = look(NAMES, values).foreseen
        assert np.isfinite(most) == bounded
        wrong += not 0.7 * steps <= 15 * tau <= most
    assert wrong <= 1


def test_a_slow_part_that_a_short_walk_does_not_see_keeps_within_the_bound():
    """A tenth of the variance moves twelve times more slowly; its sum with the rest has a time of 12 steps."""
    rng = np.random.default_rng(20)
    for _ in range(5):
        quick, slow = (autoregressive(rng, (4, 130, 80, 2), tau) for tau in (6.0, 66.0))
        steps, most = look(NAMES, np.sqrt(0.9) * quick + np.sqrt(0.1) * slow).foreseen
        assert 0.5 * 15 * 12 <= steps <= 2.0 * 15 * 12
        assert most >= 15 * 12
