"""Monte-Carlo errors of shares and quantiles against their spread over runs, and the table that carries them."""

import numpy as np
import pytest

from oracles.autoregressive import autoregressive
from softness_bayes.checking.inflection import CurveShape, Inflection, turning_table
from softness_bayes.sampler.chain_statistics import effective_size, quantile, share

ENSEMBLES, STEPS, WALKERS = 2, 60, 20


def runs(rng, tau, count=150):
    """Walks (ensembles, steps, walkers) of many runs."""
    shape = (ENSEMBLES, STEPS, WALKERS, 1)
    return [autoregressive(rng, shape, tau)[..., 0] for _ in range(count)]


@pytest.mark.parametrize("tau", [1.0, 6.0])
def test_errors_are_the_spread_over_runs(rng, tau):
    """Of a share, and of quantiles of the draws that have a value; the larger tau, the larger."""
    walks = runs(rng, tau)
    held = [np.where(one > -0.5, one, np.nan) for one in walks]  # who has a value is random too
    for estimates in (
        [share(one > 0.8) for one in walks],
        [quantile(one, 0.5) for one in walks],
        [quantile(one, 0.05) for one in held],
        [quantile(one, 0.95) for one in held],
    ):
        spread = np.std([one.value for one in estimates])
        said = np.sqrt(np.mean([one.error**2 for one in estimates]))
        assert said == pytest.approx(spread, rel=0.25)
        if tau > 1:  # negative control: as if draws were independent
            assert said / np.sqrt(tau) < 0.6 * spread


def test_values_are_those_of_all_draws(rng):
    (one,) = runs(rng, 2.0, 1)
    assert share(one > 0.3).value == np.mean(one > 0.3)
    assert quantile(one, 0.3).value == np.quantile(one, 0.3)
    gaps = np.where(one > 0, one, np.nan)
    assert quantile(gaps, 0.3).value == np.quantile(one[one > 0], 0.3)


def test_certainty_has_an_error_and_nothing_has_none(rng):
    every = share(np.ones((1, 50, 40), bool))
    assert every.value == 1
    # as of one draw of each walker, because steps that are all equal do not show how long they depend on each other
    assert every == share(np.ones((1, 1, 40), bool)) == share(np.ones((2, 500, 20), bool))
    assert 0.01 < every.error < 0.02
    nothing = quantile(np.full((1, 50, 4), np.nan), 0.5)
    assert np.isnan(nothing.value)
    assert np.isnan(nothing.error)
    assert effective_size(np.zeros((2, 30, 4))) == 8
    one = np.full((1, 50, 4), np.nan)
    one[0, 7, 2] = 3.0
    assert quantile(one, 0.95) == (3.0, 0.0)


def test_a_walker_that_never_crosses_costs_draws(rng):
    """Half of the walkers always have it, half never: nobody's draws tell anything of the share but the first."""
    stuck = np.broadcast_to(np.arange(WALKERS) % 2 == 0, (1, STEPS, WALKERS))
    assert effective_size(stuck.astype(float)) < 5 * WALKERS
    assert effective_size(rng.random((1, STEPS, WALKERS))) > 0.7 * STEPS * WALKERS


def test_the_table_is_made_of_the_draws(rng):
    chains, draws = 6, 80
    outcome = rng.choice([*map(int, CurveShape)], (chains, draws, 2), p=[0.3, 0.5, 0.2]).astype(np.int8)
    modulus = np.where(outcome == CurveShape.INTERIOR, rng.lognormal(12, 0.3, outcome.shape), np.nan)
    inside = (outcome == CurveShape.INTERIOR) & (modulus < 2e5)
    turn = Inflection(outcome, modulus, modulus / 5e4, modulus * 1e-5, modulus * 1e-6, inside)
    before = Inflection(*(field[:1, :50] for field in turn))
    table = turning_table(turn, ["1 mm", "2 mm"], before, ensembles=2)
    for k, load in enumerate(table.index):
        known = modulus[..., k][outcome[..., k] == CurveShape.INTERIOR] * 1e-3
        row = table.loc[load]
        assert row["p_interior"] == pytest.approx(np.mean(outcome[..., k] == CurveShape.INTERIOR))
        assert row["prior_p_interior"] == pytest.approx(np.mean(outcome[0, :50, k] == CurveShape.INTERIOR))
        assert row["p_inside"] == pytest.approx(inside[..., k].mean())
        np.testing.assert_allclose(
            row[["e_fab_kpa_low", "e_fab_kpa_high"]].astype(float), np.quantile(known, [0.05, 0.95])
        )
        walks = modulus[..., k].reshape(2, 3, draws).swapaxes(1, 2) * 1e-3
        assert row["e_fab_kpa_high_mcse"] == pytest.approx(quantile(walks, 0.95).error)
        assert row["p_interior_mcse"] == pytest.approx(np.sqrt(0.25 / (chains * draws)), rel=0.3)
    # without draws of the prior it says nothing of it
    assert turning_table(turn, ["1 mm", "2 mm"])["prior_p_interior"].isna().all()
