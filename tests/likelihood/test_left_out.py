"""Densities of participants given all the others, and many draws a few at a time: the same numbers, in less room."""

import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from softness_bayes.checking.checks import EXPONENTS, Residuals, check_fabrics, check_slope, loo_pit
from softness_bayes.likelihood import pieces as room
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.layout import Layout
from softness_bayes.likelihood.magnitude import LogRatings
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.plotting.rating import observed_ratings
from support.points import rated


def lab(rng, people=6, rows=50, draws=4):
    """A table with gaps, and one participant without a rating."""
    design = Design(rng.integers(6, size=rows), np.arange(rows) % (people - 1), np.arange(6) % 3, people)
    return design, rng.gamma(1, 10, (draws, 6)), rng.standard_normal(rows)


def several(rng, draws, omega, varsigma=0.3):
    """Parameters of which some are numbers and some differ between draws."""
    return rated(rng.uniform(0.5, 1.5, draws), rng.uniform(0.2, 0.9, draws), varsigma, rng.uniform(0, 1, draws) * omega)


def test_precise_ratings_lose_no_digits(rng):
    """Against the dense normal law of one participant given another; a wrong tau is told apart."""
    design = Design(np.tile(np.arange(6), 2), np.repeat([0, 1], 6), np.arange(6) % 3, 2)
    rate, noise = rng.gamma(1, 10, (1, 6)), 1e-4 * rng.standard_normal(12)
    x = np.log(rate[0] + 0.1)[design.condition]
    log_rating = np.log(20) + 0.8 * (x - x.mean()) + np.repeat([0.3, -0.2], 6) + noise
    observed = LogRatings(np.exp(log_rating), design)
    found = observed.log_likelihood_participants(rate, rated(0.8, 0.5, 1e-4))
    residual = log_rating - np.log(20) - 0.8 * (x - x.mean())
    same = design.participant[:, None] == design.participant
    for tau, alike in ((0.5, True), (0.6, False)):
        covariance = 9.0 + tau**2 * same + 1e-8 * np.eye(12)
        first, rest = slice(0, 6), slice(6, 12)
        gain = covariance[first, rest] @ np.linalg.inv(covariance[rest, rest])
        law = multivariate_normal(gain @ residual[rest], covariance[first, first] - gain @ covariance[rest, first])
        expected = law.logpdf(residual[first]) - log_rating[first].sum()
        assert (found[0, 0] == pytest.approx(expected, abs=1e-4)) == alike


# piece by piece


@pytest.mark.parametrize("omega", [0.0, 0.4])
def test_a_little_room_gives_the_same_numbers(rng, monkeypatch, omega):
    draws = 40  # ArviZ 1.x smooths tails of five draws and more
    design, rate, noise = lab(rng, draws=draws)
    points = several(rng, draws, omega)
    layout = Layout(design, np.geomspace(3e3, 6e5, 6), np.zeros(6, int))
    replicates = np.exp(rng.standard_normal((draws, design.n_rows)))

    def everything():
        observed = LogRatings(np.exp(3 + noise), design)
        effects = observed.draw_effects(np.random.default_rng(5), rate, points)
        held = Residuals(observed, rate, points, effects)
        return [
            *vars(effects).values(),
            observed.left_out(rate, points).log_density,
            observed.left_out(rate, points).below,
            observed.log_likelihood_participants(rate, points),
            *layout.fit(replicates),
            *(
                one.p_value
                for one in (
                    check_slope(held, EXPONENTS, held.response),
                    *check_fabrics(held, ["any"] * design.n_conditions),
                )
            ),
            *loo_pit(observed.left_out(rate, points), observed.discrete),
        ]

    whole = everything()
    monkeypatch.setattr(room, "ROOM", 130)
    assert len(pieces(draws, design.n_rows)) == 20
    for one, other in zip(everything(), whole, strict=True):
        assert_allclose(one, other, rtol=1e-10, atol=1e-12)


def test_room_grows_with_the_ratings_and_not_with_their_square(rng):
    """A dense indicator of 2000 participants alone would take 1.2 GB."""
    people, draws = 2000, 4
    design = Design(np.tile(np.arange(36), people), np.repeat(np.arange(people), 36), np.arange(36) // 3, people)
    layout = Layout(design, np.repeat(np.geomspace(3e3, 6e5, 12), 3), np.arange(36) % 3)
    rate, noise = rng.gamma(1, 10, (draws, 36)), rng.standard_normal(design.n_rows)
    observed, points = LogRatings(np.exp(3 + noise), design), several(rng, draws, 0.0)
    effects = observed.draw_effects(rng, rate, points)
    rating = np.where(rng.random(design.n_rows) < 0.2, np.nan, observed.values)
    tracemalloc.start()
    try:
        layout.fit(np.exp(rng.standard_normal((draws, design.n_rows))))
        held = Residuals(observed, rate, points, effects)
        check_slope(held, EXPONENTS, held.response)
        observed.log_likelihood_participants(rate, points)
        observed.left_out(rate, points)
        observed_ratings(rating, design.condition, design.participant, np.geomspace(3e3, 6e5, 36), np.zeros(36, int))
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 200e6
