"""Raters' own exponents and noise: limits, dense sums, resolution, ranks of the spreads."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import halfnorm, kstest, multivariate_normal, norm

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.directions import FREE, RISES
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.own_answers import FAST, FEW, AnswerNodes, OwnAnswers, OwnAnswersModel
from softness_bayes.likelihood.ratings import RatingParameters

KINDS = (("gamma",), ("varsigma",), ("gamma", "varsigma"))
BOTH = KINDS[2]
TRUTH = RatingParameters(1.0, 0.5, 0.3, 0.0, 0.1, tau_gamma=0.25, tau_varsigma=0.3)


def crossed(raters, conditions):
    """Everybody rates everything once."""
    people = np.repeat(np.arange(raters), conditions)
    return Design(np.tile(np.arange(conditions), raters), people, np.arange(conditions) // 3, raters)


def batch(size, of=TRUTH):
    return RatingParameters(*(np.full(size, float(value)) for value in of))


def made(rng, design, differ=BOTH, points=1, of=TRUTH):
    """A table, and mean rates at some points about the one that it was made at."""
    rate = np.exp(rng.normal(1.0, 1.0, design.n_conditions)) * np.exp(
        0.05 * rng.standard_normal((points, design.n_conditions))
    )
    model, parameters = OwnAnswersModel(RISES, differ=differ), batch(1, of)
    effects = model.draw_effects(rng, parameters, (1,), design.n_participants, design.n_fabrics)
    y = model.draw_ratings(rng, design, model.drive(design, rate[:1], parameters), parameters, effects)[0]
    return model.observe(y, design), rate


@pytest.mark.parametrize("differ", KINDS)
@pytest.mark.parametrize(("raters", "nodes"), [(24, FAST), (4, FEW)])
def test_spreads_of_nothing_give_the_closed_form(rng, raters, nodes, differ):
    observed, rate = made(rng, crossed(raters, 12), differ, 5)
    assert observed._nodes == nodes
    nothing = batch(5)._replace(tau_gamma=np.zeros(5), tau_varsigma=np.zeros(5), tau=np.array([0.0, 0.1, 0.5, 1, 3]))
    usual = LogRatings(observed.values, observed.design, RatingModel(RISES))
    for member in ("log_likelihood", "log_likelihood_loo", "below_loo", "log_likelihood_participants"):
        expected = getattr(usual, member)(rate, nothing)
        assert_allclose(getattr(observed, member)(rate, nothing), expected, rtol=0, atol=1e-8, err_msg=member)
    # and is reached as the square of the spread
    found = [
        np.abs(observed.log_likelihood(rate, nothing._replace(tau_gamma=size, tau_varsigma=size)) - expected).max()
        for expected in [usual.log_likelihood(rate, nothing)]
        for size in (np.full(5, 2e-3), np.full(5, 1e-3))
    ]
    assert_allclose(found[0] / found[1], 4.0, rtol=0.02)


def dense(y, drive, p):
    """One rater's log density at levels of mu, summed over dense grids of exponents and noise."""
    level, own = np.linspace(-8.0, 14.0, 141), np.linspace(-6.0, 6.0, 61)
    weight, z = norm.logpdf(own) + np.log(own[1] - own[0]), np.log(y)
    parts = []
    for w, of_noise in zip(own, weight, strict=True):
        noise = p.varsigma * np.exp(p.tau_varsigma * w)
        law = multivariate_normal(cov=p.tau**2 + noise**2 * np.eye(z.size))
        gap = z - np.exp(p.tau_gamma * own)[:, None, None] * drive - level[:, None]
        parts.append(logsumexp(law.logpdf(gap) + weight[:, None], axis=0) + of_noise)
    return logsumexp(parts, axis=0), norm.logpdf(level, np.log(20.0), 3.0) + np.log(level[1] - level[0])


def test_it_is_the_sum_over_dense_grids():
    """Two raters of six ratings, the skewest of laws; more nodes come as near as one likes."""
    design = crossed(2, 6)
    observed, rate = made(np.random.default_rng(3), design)
    drive = observed.drive(rate, batch(1))[0]
    parts = [dense(observed.values[design.participant == k], drive, TRUTH) for k in range(2)]
    expected = logsumexp(parts[0][0] + parts[1][0] + parts[0][1]) - np.log(observed.values).sum()
    for nodes, error in ((AnswerNodes(31, 31, 0), 1e-6), (FEW, 1e-3)):
        fitted = OwnAnswers(observed.values, design, observed.model, nodes=nodes)
        assert_allclose(fitted.log_likelihood(rate, batch(1)), expected, rtol=0, atol=error)


@pytest.mark.parametrize(("differ", "near", "far"), [(KINDS[0], 1e-5, 1e-2), (KINDS[1], 1e-5, 1e-2), (BOTH, 2e-3, 0.2)])
def test_the_usual_nodes_are_enough(rng, differ, near, far):
    """Against twice as many: near the truth, and at draws of the prior of the rating's parameters."""
    observed, rate = made(rng, crossed(20, 18), differ, 60)
    for spread, most in ((0.05, near), (0.5, far)):
        moved = (value * np.exp(spread * rng.standard_normal(60)) for value in batch(60))
        parameters = RatingParameters(*moved)._replace(omega=np.zeros(60))
        found, finer = observed.log_likelihood(rate, parameters), observed.finer().log_likelihood(rate, parameters)
        assert np.abs(found - finer).max() < most
        # a rule of three nodes would be noticed
        coarse = OwnAnswers(observed.values, observed.design, observed.model, nodes=AnswerNodes(3, 3, 3))
        assert np.abs(coarse.log_likelihood(rate, parameters) - finer).max() > most


def test_far_from_the_data_it_stays_a_number(rng):
    observed, rate = made(rng, crossed(9, 10))
    for change in (
        {"tau_gamma": 100.0},
        {"tau_varsigma": 100.0},
        {"varsigma": 1e-4},
        {"gamma": 1e3},
        {"gamma": -1.0},
        {"tau": 0.0},
        {"tau": 100.0},
    ):
        parameters = batch(1, TRUTH._replace(**change))
        for member in ("log_likelihood", "log_likelihood_loo", "log_likelihood_participants"):
            assert np.isfinite(getattr(observed, member)(rate, parameters)).all(), change


def test_an_exponent_may_have_either_sign(rng):
    """With `FREE` the exponent's sign is that of gamma: the reflected response has the same density."""
    observed, rate = made(rng, crossed(9, 10))
    free = OwnAnswersModel(FREE, differ=BOTH).observe(observed.values, observed.design)
    falls = free.log_likelihood(rate, batch(1, TRUTH._replace(gamma=-1.0)))
    x = np.log(rate + 0.1)
    turned = np.exp(2.0 * (x @ observed.design.weight)[:, None] - x) - 0.1
    assert_allclose(observed.log_likelihood(turned, batch(1)), falls, rtol=1e-9)


def test_ratings_of_another_unit_tell_the_same(rng):
    """Ratings of an 80 times larger modulus about an 80 times larger prior have the same density of logs."""
    observed, rate = made(rng, crossed(9, 10))
    other = replace(observed.model, centre=80.0 * observed.model.centre).observe(
        80.0 * observed.values, observed.design
    )
    expected = observed.log_likelihood(rate, batch(1)) - observed.values.size * np.log(80.0)
    assert_allclose(other.log_likelihood(rate, batch(1)), expected, rtol=1e-10)


GRID = np.linspace(0.0, 1.2, 25)[1:] - 0.025


def places(rng, tables, fit=lambda model: model):
    """Probability below the true spreads in their posteriors over a grid, their priors being half-normal."""
    design, found = crossed(12, 12), []
    exponent, noise = (spread.ravel() for spread in np.meshgrid(GRID, GRID, indexing="ij"))
    prior = halfnorm.logpdf(exponent, scale=0.3) + halfnorm.logpdf(noise, scale=0.4)
    for _ in range(tables):
        # uniform within the cells of the grid, so that grid and truth have one law
        weight = np.exp(prior - logsumexp(prior))
        cell = rng.choice(weight.size, p=weight)
        truth = TRUTH._replace(tau_gamma=exponent[cell], tau_varsigma=noise[cell])
        observed, rate = made(rng, design, of=truth)
        observed = fit(observed.model).observe(observed.values, design)
        points = batch(exponent.size)._replace(tau_gamma=exponent, tau_varsigma=noise)
        law = prior + observed.log_likelihood(rate[:1], points)
        law = np.exp(law - logsumexp(law)).reshape(GRID.size, GRID.size)
        for axis, k in ((1, cell // GRID.size), (0, cell % GRID.size)):
            share = law.sum(axis=axis)
            found.append(share[:k].sum() + rng.uniform() * share[k])
    return np.array(found).reshape(tables, 2)


def narrow(model):
    """A fit that takes raters for half as different as they are."""

    class Narrow(OwnAnswersModel):
        def spreads(self, parameters):
            return tuple(0.5 * spread for spread in super().spreads(parameters))

    return Narrow(model.direction, differ=model.differ)


@pytest.mark.parametrize("tables", [24, pytest.param(400, marks=pytest.mark.slow)])
def test_the_spreads_have_uniform_ranks(tables):
    found = places(np.random.default_rng(3), tables)
    for k in (0, 1):
        assert kstest(found[:, k], "uniform").pvalue > 1e-3
    # the control: a fault that the same test finds
    wrong = places(np.random.default_rng(4), tables, narrow)
    assert all(kstest(wrong[:, k], "uniform").pvalue < 1e-3 for k in (0, 1))
