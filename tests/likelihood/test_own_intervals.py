"""Raters' own exponents and noise with intervals, heavy tails and fabrics' deviations: limits and brute force."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import kstest

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.group_conditionals import block_log_likelihood
from softness_bayes.likelihood.intervals import IntervalModel, SliderModel
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.own_answers import OwnAnswersModel
from softness_bayes.likelihood.own_effects import OwnEffects
from softness_bayes.likelihood.own_intervals import OwnIntervalModel, OwnSliderModel
from softness_bayes.likelihood.quadrature import FAST, FINE
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.stated import Stated

LAWS = NORMAL, STUDENT, LAPSES
KINDS = (("gamma",), ("varsigma",), ("gamma", "varsigma"))
BOTH = KINDS[2]
TRUTH = {"gamma": 0.6, "tau": 0.4, "varsigma": 0.25, "omega": 0.0, "tau_gamma": 0.25, "tau_varsigma": 0.25}


def table(law, differ, raters=12, fabrics=8, loads=3, step=0.0, points=4, seed=1, of=OwnIntervalModel, **values):
    """Simulated ratings with their likelihood, the model, rates and points near the truth."""
    rng, conditions = np.random.default_rng(seed), fabrics * loads
    design = Design(
        np.tile(np.arange(conditions), raters),
        np.repeat(np.arange(raters), conditions),
        np.arange(conditions) % fabrics,
        raters,
    )
    model = of(RISES, law=law, differ=differ)
    truth = {**TRUTH, "eps": 0.1, "nu": 4.0, "lapse": 0.03, **values}
    one = RatingParameters(*(np.full(1, truth.get(name, 0.0)) for name in RatingParameters._fields))
    rate = np.exp(rng.normal(2.0, 1.0, conditions)) * np.exp(0.03 * rng.standard_normal((points, conditions)))
    level = (np.log(2.5) if step else np.log(20.0)) if model.end == np.inf else 0.0
    effects = model.draw_effects(rng, one, (1,), raters, fabrics, {"mu": np.full(1, level)})
    y = model.draw_ratings(rng, design, model.drive(design, rate[:1], one), one, effects)[0]
    said = None
    if step:
        zero = np.zeros(y.size)
        said = Stated(y, zero + step, zero + 0.5 * step, zero + (model.end - 0.5 * step), model.end)
        y = said.rounded(y)
        said = said._replace(values=y)
    near = RatingParameters(*(v[0] * np.exp(0.15 * rng.standard_normal(points)) for v in one))
    return model.observe(y, design, said), rate, near


@pytest.mark.parametrize("differ", KINDS)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("step", [0.0, 1.0])
def test_without_differences_raters_are_alike(law, differ, step):
    observed, rate, points = table(law, differ, step=step, omega=0.2)
    alike = points._replace(tau_gamma=0.0 * points.tau, tau_varsigma=0.0 * points.tau)
    usual = IntervalModel(RISES, law=law).observe(observed.values, observed.design, observed._stated)
    for omega in (0.0 * points.omega, points.omega):
        one, other = (y.with_quadrature(FINE) for y in (observed, usual))
        found, expected = (y.log_likelihood(rate, alike._replace(omega=omega)) for y in (one, other))
        # the normal law of deviations with heavy tails averages each row over its rater's scale in another way
        assert_allclose(found, expected, rtol=0, atol=0.05 if omega.any() else 2e-5)
    differences = observed.log_likelihood(rate, points) - observed.log_likelihood(rate, alike)
    assert (np.abs(differences) > 0.3).any()


def test_the_limit_is_the_closed_form():
    for law, largest in ((NORMAL, 1e-10), (STUDENT, 2e-9)):
        observed, rate, points = table(law, BOTH, omega=0.3)
        limit = points._replace(tau_gamma=np.zeros(4), tau_varsigma=np.zeros(4), nu=np.full(4, 1e14))
        closed = LogRatings(observed.values, observed.design, RatingModel(RISES)).log_likelihood(rate, limit)
        assert_allclose(observed.log_likelihood(rate, limit), closed, rtol=0, atol=largest)


@pytest.mark.parametrize("differ", KINDS)
def test_exact_numbers_are_those_of_sums_of_squares(differ):
    """The model of exact numbers has sufficient statistics, and integrates in another way."""
    observed, rate, points = table(NORMAL, differ)
    assert observed._quadrature == FAST
    other = OwnAnswersModel(RISES, differ=differ).observe(observed.values, observed.design).finer()
    expected = other.log_likelihood(rate, points)
    assert_allclose(observed.log_likelihood(rate, points), expected, rtol=0, atol=1e-3)
    assert_allclose(
        observed.finer().log_likelihood(rate, points), expected, rtol=0, atol=1e-5 if len(differ) == 1 else 1e-3
    )
    left, alone = observed.log_likelihood_loo(rate, points), other.log_likelihood_loo(rate, points)
    assert_allclose(left, alone, rtol=0, atol=1e-3)
    assert_allclose(observed.below_loo(rate, points), other.below_loo(rate, points), rtol=0, atol=1e-4)
    people = observed.log_likelihood_participants(rate, points)
    assert_allclose(people, other.log_likelihood_participants(rate, points), rtol=0, atol=5e-3)


LARGEST = {"normal": 1e-3, "student": 1e-2, "lapses": 3e-3}
"""Largest error of the log-likelihood near the truth by error law, of 720 ratings of 30 raters. With heavy tails the
density of a rater's exponent may have shoulders, which the nodes of the run do not resolve."""


@pytest.mark.parametrize("differ", KINDS[:2])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("step", [0.0, 1.0])
def test_the_usual_nodes_are_enough(law, differ, step):
    observed, rate, points = table(law, differ, 30, step=step)
    if step:
        assert (observed.values < 0.5).any()  # ratings of 0
    expected = observed.finer().log_likelihood(rate, points)
    assert_allclose(observed.log_likelihood(rate, points), expected, rtol=0, atol=LARGEST[law.name])


def given_answers(observed, rate, p, k, felt=True, nodes=15):
    """Log ratings as dense normal vectors, summed over nodes of every rater's exponent or noise.

    With `felt`, exponents multiply fabrics' deviations.
    """
    design, model, p = observed.design, observed.model, RatingParameters(*(np.asarray(v)[k] for v in p))
    drive = model.drive(design, rate[k], p)[design.condition]
    fabric, person = design.fabric[design.condition], design.participant
    x, weight = np.polynomial.hermite_e.hermegauss(nodes)
    log, terms = np.log(observed.values), []
    for at in product(range(nodes), repeat=design.n_participants):
        u = x[list(at)][person]
        g, h = np.exp(p.tau_gamma * u), np.ones(person.size)
        if model.differ == ("varsigma",):
            g, h = h, np.exp(p.tau_varsigma * u)
        deviating = np.outer(g, g) if felt else 1.0
        covariance = 9.0 + p.tau**2 * (person[:, None] == person) + np.diag((p.varsigma * h) ** 2)
        covariance = covariance + p.omega**2 * deviating * (fabric[:, None] == fabric)
        root = np.linalg.cholesky(covariance)
        score = np.linalg.solve(root, log - np.log(20.0) - g * drive)
        log_weight = np.log(weight[list(at)] / np.sqrt(2.0 * np.pi)).sum()
        terms.append(log_weight - 0.5 * score @ score - np.log(np.diag(root)).sum())
    return logsumexp(terms) - 0.5 * log.size * np.log(2.0 * np.pi) - log.sum()


@pytest.mark.parametrize(("differ", "largest"), [(("gamma",), 0.12), (("varsigma",), 0.4)])
def test_deviations_of_fabrics_are_those_of_brute_force(differ, largest):
    """Three raters and four fabrics, twelve ratings of each: Laplace's method is at its worst with few of them."""
    observed, rate, points = table(NORMAL, differ, 3, 4, omega=0.3)
    expected = np.array([given_answers(observed, rate, points, k) for k in range(4)])
    assert_allclose(observed.log_likelihood(rate, points), expected, rtol=0, atol=largest)
    # the reference of the check after each run
    assert_allclose(observed.finer().log_likelihood(rate, points), expected, rtol=0, atol=0.06)
    without = observed.log_likelihood(rate, points._replace(omega=np.zeros(4)))
    assert (np.abs(without - expected) > 1.0).any()
    if differ == ("gamma",):
        beside = given_answers(observed, rate, points, 0, felt=False)
        assert abs(beside - expected[0]) > 0.2


@pytest.mark.parametrize("law", LAWS)
def test_rows_left_out_are_what_the_others_lack(law):
    observed, rate, points = table(law, BOTH, 5, 7, step=1.0, points=2)
    fine, rows = observed.with_quadrature(FINE), np.arange(0, observed.design.n_rows, 29)
    block = np.full(observed.design.n_rows, -1)
    whole = fine.log_likelihood(rate, points)
    found = observed.log_likelihood_loo(rate, points)[:, rows]
    for k, row in enumerate(rows):
        block[:] = np.arange(block.size) == row
        expected = whole - fine.without(block > 0).log_likelihood(rate, points)
        assert_allclose(found[:, k], expected, rtol=0, atol=0.02)
    people = observed.log_likelihood_participants(rate, points)
    expected = block_log_likelihood(fine, rate, points, observed.design.participant)
    assert_allclose(people, expected, rtol=0, atol=0.1)


def test_rows_left_out_beside_deviations_of_fabrics():
    """The law of a row's expectation is taken as normal; errors are small beside those of one standard deviation."""
    observed, rate, points = table(STUDENT, ("gamma",), 20, points=2, omega=0.2)
    rows = np.arange(0, observed.design.n_rows, 23)
    found, whole = observed.log_likelihood_loo(rate, points)[:, rows], observed.log_likelihood(rate, points)
    rest = [observed.without(np.arange(observed.design.n_rows) == row) for row in rows]
    expected = np.stack([whole - one.log_likelihood(rate, points) for one in rest], axis=1)
    assert np.abs(found - expected).mean() < 0.03
    assert np.ptp(expected) > 2.0
    below = observed.below_loo(rate, points)
    assert ((below > 0.0) & (below < 1.0)).all()
    assert kstest(below[0], "uniform").pvalue > 1e-4


def effects_of_tables(law, differ, tables, **values):
    """Effects of the prior, and those drawn given tables made of them, by name (tables, k)."""
    observed, rate, points = table(law, differ, 6, 6, points=1, omega=0.3, **values)
    rng = np.random.default_rng(2)
    before, after = [], []
    for _ in range(tables):
        effects = observed.new_effects(rng, points, (1,), {"mu": np.full(1, 3.0) + 0.5 * rng.standard_normal(1)})
        made = observed.replicate(rng, observed.drive(rate, points), points, effects)[0]
        drawn = observed.with_values(made).draw_effects(rng, rate, points)
        before.append(effects)
        after.append(drawn)
    return {
        name: [np.array([getattr(one, name)[0] for one in each]) for each in (before, after)]
        for name in OwnEffects._fields[1:]
    }


def spread_alike(drawn, p=1e-3):
    """Whether drawn effects have the law of those that the tables were made of."""
    return all(kstest(after.ravel(), before.ravel()).pvalue > p for before, after in drawn.values())


@pytest.mark.parametrize("law", [NORMAL, STUDENT])
def test_effects_are_drawn_given_the_ratings(law):
    drawn = effects_of_tables(law, ("gamma",), 60)
    drawn.pop("log_varsigma")
    assert spread_alike(drawn)
    # and they follow the ratings
    for name in ("participant", "fabric", "log_gamma"):
        before, after = drawn[name]
        assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.5, name
    # negative control: exponents that are a tenth too large
    before, after = drawn["log_gamma"]
    assert not spread_alike({"log_gamma": [before, after + 0.1]})


@pytest.mark.slow
def test_effects_of_both_kinds_are_drawn_given_the_ratings():
    drawn = effects_of_tables(LAPSES, BOTH, 150)
    assert spread_alike(drawn)
    before, after = drawn["log_varsigma"]
    assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.4


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("law", LAWS)
def test_far_from_the_data_it_stays_a_number(law):
    observed, rate, points = table(law, BOTH, 6, step=1.0, points=8)
    wide = points._replace(
        gamma=np.array([0.0, 5.0, 0.6, 0.6, 0.6, 0.6, 20.0, 0.6]),
        tau=np.array([0.4, 0.0, 9.0, 0.4, 0.4, 0.4, 1e-6, 0.4]),
        varsigma=np.array([0.3, 0.3, 0.3, 1e-4, 30.0, 0.3, 1e-3, 0.2]),
        tau_gamma=np.array([3.0, 0.3, 0.3, 0.3, 0.3, 9.0, 2.0, 1e-6]),
        tau_varsigma=np.array([3.0, 0.3, 0.3, 0.3, 0.3, 9.0, 2.0, 1e-6]),
    )
    for omega in (0.0, 0.3, 5.0):
        found = observed.log_likelihood(rate, wide._replace(omega=np.full(8, omega)))
        assert np.isfinite(found).all(), omega
        assert (found < observed.log_likelihood(rate, points).max() + 20.0).all()


def test_a_rater_with_only_zeros_and_one_with_equal_ratings():
    observed, rate, points = table(STUDENT, ("gamma",), step=1.0)
    values = observed.values.copy()
    person = observed.design.participant
    values[person == 0] = 0.25
    values[person == 1] = 7.0
    odd = type(observed)(values, observed.design, observed.model, stated=observed._stated._replace(values=values))
    found, finer = (one.log_likelihood(rate, points) for one in (odd, odd.finer()))
    assert_allclose(found, finer, rtol=0, atol=0.04)
    assert np.isfinite(odd.log_likelihood_loo(rate, points)).all()
    effects = odd.draw_effects(np.random.default_rng(1), rate, points)
    assert (effects.participant[:, 0] < effects.participant[:, 2:].min(axis=1)).all()


def test_sliders_have_them_too():
    values = {"gamma": 0.4, "tau": 0.3, "varsigma": 0.3}
    observed, rate, points = table(NORMAL, BOTH, step=0.05, of=OwnSliderModel, **values)
    assert ((observed.values > 0.0) & (observed.values < 1.0)).all()
    finer = observed.finer().log_likelihood(rate, points)
    assert_allclose(observed.log_likelihood(rate, points), finer, rtol=0, atol=2e-3)
    alike = points._replace(tau_gamma=np.zeros(4), tau_varsigma=np.zeros(4))
    usual = SliderModel(RISES).observe(observed.values, observed.design, observed._stated)
    assert_allclose(observed.log_likelihood(rate, alike), usual.log_likelihood(rate, alike), rtol=0, atol=1e-3)


def test_order_and_units_do_not_matter():
    observed, rate, points = table(STUDENT, BOTH, omega=0.2)
    design, order = observed.design, np.random.default_rng(3).permutation(observed.design.n_rows)
    turned = Design(design.condition[order], design.participant[order], design.fabric, design.n_participants)
    other = observed.model.observe(observed.values[order], turned)
    expected = observed.log_likelihood(rate, points)
    assert_allclose(other.log_likelihood(rate, points), expected, rtol=1e-8)
    ten = OwnIntervalModel(RISES, centre=200.0, law=STUDENT, differ=BOTH).observe(10.0 * observed.values, design)
    shift = design.n_rows * np.log(10.0)
    assert_allclose(ten.log_likelihood(rate, points) + shift, expected, rtol=1e-8)
