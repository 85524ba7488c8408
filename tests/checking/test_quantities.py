"""Predictive checks: p-values uniform for data of the model, and a way to fail for every quantity."""

import dataclasses

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import kstest

from softness_bayes.checking.quantities import (
    QUANTITIES,
    Columns,
    check_values,
    find_turn,
    joint_limits,
    joint_p_values,
)
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.layout import Additive, Layout
from softness_bayes.likelihood.scales import STANDARDISED
from support.made_ratings import (
    FABRICS,
    LOAD,
    LOADS,
    MODULUS,
    PLAIN,
    RATE,
    STEEP,
    layout,
    ratings,
    replicates,
)

BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}


def checked(quantity, lay, data, again):
    """The values of a quantity of some ratings compared with those of replicates."""
    return check_values(*(quantity.of(lay, lay.fit(ratings)) for ratings in (data, again)), quantity.centre)


def p_values(rng, name, column, sets, assumed_rate=RATE, assumed=PLAIN, **made):
    quantity, lay = BY_NAME[name], layout()
    found = []
    for _ in range(sets):
        filed = ratings(rng, lay.design, **made)
        again = replicates(rng, lay, filed, assumed_rate, assumed, quantity.new_participants)
        found.append(checked(quantity, lay, filed, again)[column].p_value)
    found = np.array(found)
    return found[np.isfinite(found)]


@pytest.mark.parametrize("name", BY_NAME)
def test_p_is_uniform_under_the_model(rng, name):
    found = p_values(rng, name, 0 if BY_NAME[name].columns is Columns.ALL else 1, 120, rate=STEEP, assumed_rate=STEEP)
    assert found.size > 60
    if name == "turns over":  # yes or no: right in the mean
        assert found.mean() == pytest.approx(0.5, abs=0.1)
    else:
        assert kstest(found, "uniform").pvalue > 1e-3


def heavy(rng, sign):
    def noise(size):
        values = rng.standard_normal(size)
        values[rng.integers(size, size=2)] = sign * 6.0
        return values

    return noise


CONTROLS = {
    "mean log rating": {"truth": PLAIN.replace(gamma=1.6)},
    "turns over": {"rate": np.tile(np.geomspace(0.2, 3, FABRICS), LOADS), "assumed_rate": STEEP},
    "inflection e_fab_kpa": {"rate": np.tile([0.2, 0.7, 1.2, 1.8, 3.0, 1.2], LOADS), "assumed_rate": STEEP},
    "drop beyond inflection": {"rate": np.tile(np.geomspace(0.2, 3, FABRICS), LOADS), "assumed_rate": STEEP},
    "participant log mean": {"assumed": PLAIN.replace(tau=0.02)},
    "spread of participants": {"truth": PLAIN.replace(tau=2.0)},
    "residual spread": {"truth": PLAIN.replace(varsigma=0.5)},
    "largest residual / sd": {"noise": +1.0},
    "smallest residual / sd": {"noise": -1.0},
}


@pytest.mark.parametrize("name", CONTROLS)
def test_every_quantity_finds_a_model_that_is_wrong_about_it(rng, name):
    made = dict(CONTROLS[name])
    if "noise" in made:
        made["noise"] = heavy(rng, made["noise"])
    found = p_values(rng, name, 0 if BY_NAME[name].columns is Columns.ALL else 1, 25, **made)
    assert np.mean(np.minimum(found, 1 - found) < 0.025) > 0.4


def test_the_controls_cover_all_quantities():
    assert {*CONTROLS} == {*BY_NAME}


# the fit and the turn by independent means


def test_the_additive_fit_is_least_squares(rng):
    rows = 60
    who = Design(
        np.r_[np.arange(12), rng.integers(12, size=rows - 12)], rng.integers(5, size=rows), np.arange(12) % 6, 5
    )
    y = rng.normal(3, 1, (2, rows))
    fit = Layout(who, MODULUS, LOAD).fit(np.exp(y))
    columns = np.column_stack([np.eye(12)[who.condition], np.eye(5)[who.participant]])
    for k in range(2):
        best, *_ = np.linalg.lstsq(columns, y[k], rcond=None)
        left = y[k] - columns @ best
        fitted = fit.condition[k][who.condition] + fit.participant[k][who.participant]
        np.testing.assert_allclose(y[k] - fitted, left, atol=1e-10)
        assert (fit.smallest[k], fit.largest[k]) == pytest.approx((left.min(), left.max()), abs=1e-10)
        np.testing.assert_allclose(np.diff(fit.condition[k]), np.diff(best[:12]), atol=1e-10)
        np.testing.assert_allclose(np.diff(fit.participant[k]), np.diff(best[12:]), atol=1e-10)
        freedom = rows - np.linalg.matrix_rank(columns)
        assert fit.sd[k] ** 2 * freedom == pytest.approx(((y[k] - columns @ best) ** 2).sum())
    assert fit.participant.mean() == pytest.approx(0)
    projection = columns @ np.linalg.pinv(columns)
    np.testing.assert_allclose(Layout(who, MODULUS, LOAD).leverage, np.diag(projection), atol=1e-10)


def test_the_fit_of_many_conditions_in_two_parts_is_least_squares(rng):
    """Two groups of participants without a common condition: each part has a level of its own."""
    person, condition = rng.integers(0, 10, 2000), rng.integers(0, 200, 2000)
    used, condition = np.unique(np.where(person < 5, condition, 200 + condition), return_inverse=True)
    who = Design(condition, person, np.arange(used.size), 11)  # the last participant has no ratings
    lay, y = Layout(who, np.geomspace(1e3, 1e6, used.size), np.zeros(used.size, int)), rng.normal(size=2000)
    columns = np.column_stack([np.eye(used.size)[condition], np.eye(10)[person]])
    fitted = columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    fit = lay.fit(np.exp(y))
    np.testing.assert_allclose(fit.condition[condition] + fit.participant[person], fitted, atol=1e-9)
    assert lay.residual_freedom == 2000 - np.linalg.matrix_rank(columns) == 2000 - used.size - 8
    assert np.isnan(fit.participant[10])
    assert lay.leverage.sum() == pytest.approx(used.size + 8)


def curve(*means, sd=0.05):
    """The fit of one data set whose mean ratings are given, under both loads alike."""
    nothing = np.zeros(0)
    return Additive(np.tile(np.array(means, float), LOADS), nothing, nothing, nothing, np.array(sd))


def test_a_turn_is_the_vertex_of_a_parabola():
    x = np.log(MODULUS[:FABRICS])
    place = np.log(5e4)
    turn = find_turn(layout(), curve(*(3 - 0.2 * (x - place) ** 2)))
    np.testing.assert_allclose(turn.modulus, 5e4)
    np.testing.assert_array_equal(turn.interior, [1, 1])
    heights = -0.2 * (x - place) ** 2
    np.testing.assert_allclose(turn.drop, heights.max() - heights[-1])


def test_a_turn_must_stand_out_of_the_noise():
    shallow = curve(1.0, 2.0, 3.0, 3.01, 3.0, 2.99)
    assert find_turn(layout(), shallow).interior.tolist() == [0, 0]
    assert np.isnan(find_turn(layout(), shallow).modulus).all()
    assert find_turn(layout(), shallow._replace(sd=np.array(1e-4))).interior.tolist() == [1, 1]
    rising = find_turn(layout(), curve(1, 2, 3, 4, 5, 6))
    assert rising.interior.tolist() == [0, 0]
    assert rising.drop.tolist() == [0, 0]


def test_a_falling_scale_turns_at_its_minimum():
    lay = dataclasses.replace(layout(), sign=-1.0)
    turn = find_turn(lay, curve(3, 2, 1, 0, 1, 2))
    assert turn.interior.tolist() == [1, 1]
    assert turn.drop.tolist() == [2, 2]
    assert find_turn(layout(), curve(3, 2, 1, 0, 1, 2)).interior.tolist() == [0, 0]


def test_two_fabrics_cannot_turn_over():
    who = Design(np.arange(4), np.zeros(4, int), np.array([0, 1, 0, 1]), 1)
    lay = Layout(who, np.array([1e4, 1e5, 1e4, 1e5]), np.array([0, 0, 1, 1]))
    assert np.isnan(np.array(find_turn(lay, lay.fit(np.array([1.0, 2.0, 3.0, 4.0]))))).all()


def test_one_rater_of_each_once_has_no_spread_to_judge_by():
    who = Design(np.arange(6), np.zeros(6, int), np.arange(6), 1)
    lay = Layout(who, MODULUS[:6], LOAD[:6])
    fit = lay.fit(np.tile([1.0, 2.0, 4.0, 8.0, 4.0, 2.0], (3, 1)))
    for quantity in QUANTITIES:
        values = quantity.of(lay, fit)
        known = quantity.name in ("mean log rating", "participant log mean")
        assert np.isfinite(values).all() == known, quantity.name
        assert np.isfinite(check_values(quantity.of(lay, lay.fit(np.arange(1.0, 7.0))), values)[0].p_value) == known


def test_joint_limits_hold_whole_curves(rng):
    curves = rng.standard_normal((4000, 1)) * 0.5 + rng.standard_normal((4000, 10))
    low, high = joint_limits(curves[:2000], 0.9)
    assert ((curves[2000:] >= low) & (curves[2000:] <= high)).all(axis=1).mean() == pytest.approx(0.9, abs=0.03)
    # negative control: limits for each column alone hold far fewer
    alone = np.quantile(curves[:2000], [0.05, 0.95], axis=0)
    assert ((curves[2000:] >= alone[0]) & (curves[2000:] <= alone[1])).all(axis=1).mean() < 0.7


@pytest.mark.parametrize("rating", [20.0, 1e-300, 0.1])
def test_identical_ratings_have_no_residuals_to_judge(rng, rating):
    lay = layout()
    again = replicates(rng, lay, ratings(rng, lay.design))
    same = np.full(lay.design.n_rows, rating)
    found = {name: checked(quantity, lay, same, again)[0] for name, quantity in BY_NAME.items()}
    assert found["residual spread"].p_value == 1.0
    for name in ("largest residual / sd", "smallest residual / sd", "turns over", "drop beyond inflection"):
        assert np.isnan(found[name].observed), name
        assert np.isnan(found[name].p_value), name


def test_complete_orders_have_no_spread_of_participants():
    """Every list has the same mean: what differs is rounding, and no check."""
    rng = np.random.default_rng(3)
    people, fabrics = 12, 7
    of = Design(np.tile(np.arange(fabrics), people), np.repeat(np.arange(people), fabrics), np.arange(fabrics), people)
    table = Layout(of, np.geomspace(1e3, 1e6, fabrics), np.zeros(fabrics, int), scale=STANDARDISED)
    shares = np.array([[rng.permutation(fabrics) / (fabrics - 1) for _ in range(people)] for _ in range(5)])
    fit = table.fit(shares.reshape(5, -1))
    assert (fit.participant == 0.0).all()
    assert np.isnan(BY_NAME["spread of participants"].of(table, fit)).all()


@pytest.mark.parametrize("size", [99, 999])
def test_small_joint_p_values_are_as_rare_with_few_replicates(rng, size):
    """Of exponential deviations, whose tail is the heaviest that is assumed, one in a thousand is below 0.001."""
    found = [joint_p_values(curves[0], curves[1:])[0] for curves in rng.exponential(size=(4000, size + 1, 1))]
    assert np.mean(np.array(found) < 0.001) <= 0.002


def test_joint_p_values_are_those_of_the_largest_deviation(rng):
    """Uniform for exchangeable curves, and in the tail within a factor of a few of the exact probability."""
    found = []
    for _ in range(300):
        curves = rng.standard_normal((201, 1)) * 0.5 + rng.standard_normal((201, 8)) * [1, 1, 1, 1, 5, 5, 5, 5]
        found.append(joint_p_values(curves[0], curves[1:]).min())
    assert kstest(found, "uniform").pvalue > 1e-3
    assert np.mean(np.array(found) < 0.01) < 0.035
    curves = rng.standard_normal((500, 8))
    for size in (3.5, 4.5):
        exact = 1.0 - (1.0 - 2.0 * ndtr(-size)) ** 8
        assert exact / 3 < joint_p_values(np.r_[size, np.zeros(7)], curves)[0] < 30 * exact
    assert np.isnan(joint_p_values(np.array([np.nan, 0.0]), curves[:, :2]))[0]
    assert joint_p_values(np.array([1.0]), np.zeros((99, 1)))[0] < 0.011  # no replicate turns over, but the data
