"""The power of the check of a turning point: against simulations of its own, and where there is nothing to notice."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from softness_bayes.checking.quantities import find_turn
from softness_bayes.checking.turning_check import (
    DOUBTFUL,
    TurnQuantities,
    departs,
    fall,
    fall_p_value,
    plateau,
    plateau_quantities,
    power,
)
from softness_bayes.likelihood.layout import Additive
from support.made_ratings import COUNT, LAY, LOAD, MODULUS, SHALLOW, STEEP, ratings, tables


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


def test_departure_shares_its_level():
    """Half for a fall that is too small; half, or all where there is no fall, for what else is known."""
    nan, fine = np.nan, [0.5, 0.5, 0.5]
    assert not departs(np.array(fine), np.array(0.97))
    assert departs(np.array(fine), np.array(0.976))
    assert not departs(np.array(fine), np.array(0.001))  # falling too far is left to the drop
    limit = DOUBTFUL / 2 / 3 / 2
    assert not departs(np.array([0.5, 0.5, 1.01 * limit]), np.array(0.5))
    assert departs(np.array([0.5, 0.5, 0.99 * limit]), np.array(0.5))
    assert departs(np.array([0.5, 1 - 0.99 * limit, 0.5]), np.array(0.5))
    assert departs(np.array([0.5, 1 - 1.99 * limit, 0.5]), np.array(nan))
    few = np.array([[nan, nan, 0.02], [nan, nan, 0.03], [nan] * 3])
    assert departs(few, np.full(3, nan)).tolist() == [True, False, False]


def test_p_of_the_fall_is_its_normal_tail(rng):
    many = rng.normal(1.0, 0.3, 4000)
    assert fall_p_value(np.array([0.4, 1.0]), many) == pytest.approx(norm.sf([0.4, 1.0], 1.0, 0.3), abs=0.01)
    assert np.isnan(fall_p_value(np.array([0.4]), np.full(50, np.nan))).all()


@pytest.mark.parametrize("rates", [STEEP, SHALLOW], ids=["steep", "shallow"])
def test_power_is_the_share_of_new_tables_that_fail(rng, rates):
    """Tables of a response that levels off, made anew and judged one by one, each p-value by counting."""
    filed = ratings(rng, LAY.design, rates)
    same, other = tables(rng, LAY, filed, rates)
    alternative, excess = plateau_quantities(LAY, same, other)
    expected = LAY.fit(same).condition.mean(axis=0)
    replicates = TurnQuantities.of(LAY, LAY.fit(same), expected, excess)
    found = power(alternative, replicates)
    anew = tables(rng, LAY, filed, rates, 200)[1]
    failed = np.zeros((200, 2), bool)
    for t, table in enumerate(anew):
        fit = LAY.fit(table)
        values = Additive(*(np.asarray(x) for x in fit))
        shown = [*find_turn(LAY, values), fall(LAY, fit.condition, expected, excess)]
        for k in range(2):
            p_values = []
            for value, many in list(zip(shown, replicates, strict=True))[:3]:
                known = many[:, k][~np.isnan(many[:, k])]
                if not np.isnan(value[k]) and known.size:
                    p_values.append(np.mean(known > value[k]) + np.mean(known == value[k]) / 2)
            small = norm.cdf(shown[3][k], replicates.fall[:, k].mean(), replicates.fall[:, k].std(ddof=1))
            failed[t, k] = min(min(p, 1 - p) for p in p_values) < 0.025 / len(p_values) / 2 or small < 0.025
    for k in range(2):
        error = np.hypot(found[k].error, np.sqrt(0.25 / 200))
        assert found[k].value == pytest.approx(failed[:, k].mean(), abs=3 * error)
        assert (found[k].value > 0.9) == (rates is STEEP)
        assert (found[k].value < 0.3) == (rates is SHALLOW)
        least = np.sqrt(found[k].value * (1 - found[k].value) / COUNT)
        assert 0 < found[k].error < 0.1
        assert found[k].error > 0.99 * least


def test_the_error_of_the_power_is_its_spread_over_replicates(rng):
    rates = np.tile([0.0, 0.3, 1.2, 2.4, 2.2, 2.0], 2)
    filed, found = ratings(rng, LAY.design, rates), []
    for _ in range(25):
        same, other = tables(rng, LAY, filed, rates, 200)
        alternative, excess = plateau_quantities(LAY, same, other)
        fit = LAY.fit(same)
        found += power(alternative, TurnQuantities.of(LAY, fit, fit.condition.mean(axis=0), excess))[:1]
    values, errors = np.transpose(found)
    assert 0.1 < values.mean() < 0.9
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.5)


def test_the_model_itself_hardly_fails_its_check(rng):
    """And a response that never falls is its own alternative, so that its power is this share."""
    for rates in (STEEP, np.tile(np.geomspace(0.2, 4.0, 6), 2)):
        filed = ratings(rng, LAY.design, rates)
        same, other = tables(rng, LAY, filed, rates)
        _, excess = plateau_quantities(LAY, same, other)
        fit = LAY.fit(same)
        own = TurnQuantities.of(LAY, fit, fit.condition.mean(axis=0), excess)
        assert all(one.value < 0.09 for one in power(own, own))
        if rates is not STEEP:
            np.testing.assert_array_equal(same, other)
            assert np.isnan(own.fall).all()


def test_too_few_fabrics_have_no_power():
    nothing = TurnQuantities(*np.full((4, 20, 2), np.nan))
    assert all(np.isnan(one.value) for one in power(nothing, nothing))
