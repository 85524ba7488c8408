"""The check of a turning point: its parts by definition, its power against simulations of its own."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from softness_bayes.checking.quantities import excess_of_plateau, fall, fall_p_value, plateau, power
from support.made_ratings import LAY, LOAD, MODULUS, SHALLOW, STEEP, ratings, tables


def test_a_levelled_response_stays_at_its_peak(rng):
    response = rng.random((4, 12))
    order = rng.permutation(12)  # in whatever order the conditions come
    lay = dataclasses.replace(LAY, modulus=MODULUS[order], load=LOAD[order])
    found = plateau(lay, response)
    for d, c in np.ndindex(4, 12):
        softer = (lay.load == lay.load[c]) & (lay.modulus <= lay.modulus[c])
        assert found[d, c] == response[d, softer].max()
    np.testing.assert_array_equal(plateau(lay, found), found)


def test_fall_is_a_slope_of_least_squares(rng):
    condition, expected, excess = rng.normal(size=(3, 12)), rng.normal(size=12), rng.random(12)
    found = fall(LAY, condition, expected, excess)
    weight = LAY.design.cells.sum(axis=0)
    for k, d in np.ndindex(2, 3):
        here = k == LOAD
        columns = np.column_stack([np.ones(6), -excess[here]]) * np.sqrt(weight[here])[:, None]
        flat = expected[here] + excess[here]
        (_, slope), *_ = np.linalg.lstsq(columns, (condition[d, here] - flat) * np.sqrt(weight[here]), rcond=None)
        assert found[d, k] == pytest.approx(slope)
    np.testing.assert_allclose(fall(LAY, expected + 3.0, expected, excess), 1)
    np.testing.assert_allclose(fall(LAY, expected + excess, expected, excess), 0, atol=1e-12)
    assert np.isnan(fall(LAY, condition, expected, np.where(LOAD == 0, 0.0, excess))[:, 0]).all()


def test_p_of_the_fall_is_its_normal_tail(rng):
    many = rng.normal(1.0, 0.3, 4000)
    found = [fall_p_value(value, many) for value in (0.4, 1.0)]
    assert found == pytest.approx(norm.sf([0.4, 1.0], 1.0, 0.3), abs=0.01)
    assert np.isnan(fall_p_value(0.4, np.full(50, np.nan)))
    assert np.isnan(power(np.full(50, np.nan), 0.05)).all()


@pytest.mark.parametrize("rates", [STEEP, SHALLOW, np.tile([0.0, 0.3, 1.2, 2.4, 2.2, 2.0], 2)])
def test_power_is_the_share_of_tables_of_a_plateau_that_fail(rng, rates):
    """New tables of the response that levels off and of the model, judged one by one by counting."""
    filed = ratings(rng, LAY.design, rates)
    same, other = tables(rng, LAY, filed, rates)
    excess, expected = excess_of_plateau(LAY, same, other), LAY.fit(same).condition.mean(axis=0)
    replicates = fall(LAY, LAY.fit(same).condition, expected, excess)
    anew = [LAY.fit(made).condition for made in tables(rng, LAY, filed, rates, 300)]
    for k in range(2):
        share, error = power(replicates[:, k], 0.025)
        limit = np.quantile(replicates[:, k], 0.025)
        right, wrong = ((fall(LAY, means, expected, excess)[:, k] < limit).mean() for means in anew)
        assert share == pytest.approx(wrong, abs=0.02 + 3 * np.hypot(error, np.sqrt(0.25 / 300)))
        assert right < 0.07  # the model itself hardly fails
        assert 0 < error < 0.1
        if rates is STEEP or rates is SHALLOW:
            assert (share > 0.9) == (rates is STEEP)
            assert (share < 0.3) == (rates is SHALLOW)


def test_a_response_that_never_falls_is_its_own_alternative(rng):
    rates = np.tile(np.geomspace(0.2, 4.0, 6), 2)
    same, other = tables(rng, LAY, ratings(rng, LAY.design, rates), rates)
    np.testing.assert_array_equal(same, other)
    assert (excess_of_plateau(LAY, same, other) == 0.0).all()
