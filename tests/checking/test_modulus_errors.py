"""Errors of moduli: first-order shifts of posterior means against exact ones."""

import numpy as np
from numpy.testing import assert_allclose

from softness_bayes.checking.modulus_errors import (
    DIRECTIONS,
    directions,
    moved_most,
    posterior_shift,
    scores,
    shift_table,
)
from softness_bayes.checking.sentences import shift_sentences
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.sampler.chain_statistics import GROUPS
from support.points import rated

FABRICS, LOADS, PEOPLE = 8, 3, 20
DESIGN = Design(
    np.tile(np.arange(FABRICS * LOADS), PEOPLE),
    np.repeat(np.arange(PEOPLE), FABRICS * LOADS),
    np.repeat(np.arange(FABRICS), LOADS),
    PEOPLE,
)
TRUTH = rated(gamma=1.0, tau=0.3, varsigma=0.3)


def rated(rng):
    """Ratings of some response, and draws of its rates and parameters."""
    model, rate = RatingModel(), np.exp(rng.normal(0.0, 0.7, DESIGN.n_conditions)) * 20.0
    effects = model.draw_effects(rng, TRUTH, (), PEOPLE, FABRICS, {"mu": 3.0})
    values = model.draw_ratings(rng, DESIGN, model.drive(DESIGN, rate, TRUTH), TRUTH, effects)
    return model.observe(values, DESIGN), np.tile(rate, (100, 1)), TRUTH.each(lambda v: np.full(100, v))


def normal_toy(rng, draws, fabrics=6):
    """Draws of q ~ N(0, 1) with a score 2 q + noise for fabric 0, 1 q + noise for fabric 1, else noise."""
    q = rng.standard_normal(draws)
    loading = np.zeros(fabrics)
    loading[:2] = 2.0, 1.0
    return q, q[:, None] * loading + rng.standard_normal((draws, fabrics)), float(np.hypot(2.0, 1.0))


def test_the_shift_is_that_of_a_normal_posterior_within_its_error(rng):
    found, true = [], 0.0
    for _ in range(50):
        q, score, true = normal_toy(rng, 1000)
        found.append(posterior_shift(q, score))
    sd, error = np.array(found).T
    assert abs(sd.mean() - true) < 4 * sd.std() / np.sqrt(sd.size)
    assert 0.6 < error.mean() / sd.std() < 1.6


def test_no_shift_stays_within_its_error(rng):
    found = [posterior_shift(rng.standard_normal(1000), rng.standard_normal((1000, 24))) for _ in range(40)]
    assert np.mean([sd >= 2 * mcse for sd, mcse in found]) < 0.15
    # a negative control: without subtracting what noise adds, every one would be
    q, s = rng.standard_normal(1000), rng.standard_normal((1000, 24))
    assert np.sqrt(((q @ s / 1000) ** 2).sum()) > 2 * posterior_shift(q, s)[1]


def test_draws_without_a_turning_point_are_left_out(rng):
    q, score, true = normal_toy(rng, 4000)
    some = np.where(rng.random(q.size) < 0.3, np.nan, q)
    assert_allclose(posterior_shift(some, score)[0], true, rtol=0.15)
    alone = np.where(np.arange(100) == 3, 1.0, 0.0)  # one group of draws has all the spread
    for nothing in (np.full(100, np.nan), np.ones(100), alone, q[:30]):
        assert np.isnan(posterior_shift(nothing, score[: nothing.size])[0])


def test_the_shift_is_the_movement_of_a_linear_fit(rng):
    """Log ratings linear in theta: refitting with wrong moduli moves the mean by what the draws foretell."""
    n, k, sd = 200, 2, 0.3
    x, d = rng.standard_normal((n, k)), rng.standard_normal((n, 3))
    theta = np.array([1.0, -0.5])
    y = x @ theta + sd * rng.standard_normal(n)
    precision = x.T @ x / sd**2 + np.eye(k)
    mean, covariance = np.linalg.solve(precision, x.T @ y / sd**2), np.linalg.inv(precision)
    draws = rng.multivariate_normal(mean, covariance, 20_000)
    score = (y - draws @ x.T) @ d / sd**2  # of shifts d of the expectation
    # an error of the inputs moves the data's expectation by -d, and the fit by the regression of that
    exact = np.linalg.solve(precision, x.T @ d / sd**2) / np.sqrt(covariance.diagonal())[:, None]
    for j in range(k):
        assert_allclose(posterior_shift(draws[:, j], score)[0], np.linalg.norm(exact[j]), rtol=0.05)


def test_scores_are_derivatives_of_the_likelihood(rng):
    observation, rates, parameters = rated(rng)
    step, signs = 1e-4, directions(np.arange(FABRICS), FABRICS)[0]
    found = scores(observation, (rates * np.exp(-step), rates * np.exp(step)), parameters, signs, step)
    for f in range(FABRICS):
        own = np.where(DESIGN.fabric == f, 1.0, 0.0)
        up, down = (observation.log_likelihood(rates * np.exp(side * step * own), parameters) for side in (1, -1))
        assert_allclose(found[:, f], (up - down) / (2 * step), rtol=1e-3, atol=1e-4)


def test_many_fabrics_are_moved_at_once(rng):
    total = 400
    signs, share = directions(np.arange(total), total)
    assert signs.shape == (DIRECTIONS, total)
    covariances = rng.standard_normal(total)
    assert_allclose(share * ((signs @ covariances) ** 2).sum(), (covariances**2).sum(), rtol=0.9)
    few, one = directions(np.array([3, 5]), 8)
    assert one == 1.0
    assert few.tolist() == [[float(k == f) for k in range(8)] for f in (3, 5)]


def test_what_is_not_clear_is_not_said():
    table = shift_table({"b": (15.0, 1.0), "m": (3.0, 2.9), "gamma": (7.5, 0.5)})
    assert_allclose(table.loc["b"].to_numpy(float), [1.5, 0.1])
    said = shift_sentences(table)
    assert [line.strip() for line in said[1:]] == ["b: more than 1", "gamma: 0.75 ± 0.05"]
    assert moved_most(table) == ("b", 1.5)
    assert shift_sentences(table.loc[["m"]]) == []
    assert moved_most(table.loc[["m"]]) is None
    assert GROUPS > 2
