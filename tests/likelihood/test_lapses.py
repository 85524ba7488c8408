"""Lapses: their probabilities sum to 1, their draws follow them, and numbers that define the range are no lapses."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest

from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import BEYOND, LAPSES, RaterRange, WholeScale
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings
from softness_bayes.likelihood.scales import MAGNITUDE, SLIDER
from support.points import rated

WHO = Design(np.tile([0, 1, 2], 2), np.repeat([1, 0], 3), np.arange(3), 2)
NUMBERS = np.array([4.0, 40.0, 8.0, 0.5, 1.0, 3.0])


def test_the_range_is_that_of_the_raters_own_numbers_and_a_factor_more():
    found = RaterRange.of(NUMBERS, NUMBERS, WHO, MAGNITUDE)
    assert_allclose(np.exp(found.least), np.repeat([4.0, 0.5], 3) / BEYOND)
    assert_allclose(np.exp(found.most), np.repeat([40.0, 3.0], 3) * BEYOND)
    assert_allclose(np.exp(found.log_probability(NUMBERS, NUMBERS, MAGNITUDE)), 1.0 / (found.most - found.least))
    rest = found.take(np.arange(6) > 2)
    assert_allclose(rest.most, found.most[3:])
    # tables of a batch have ranges of their own
    batch = RaterRange.of(np.stack([NUMBERS, 10.0 * NUMBERS]), np.stack([NUMBERS, 10.0 * NUMBERS]), WHO, MAGNITUDE)
    assert_allclose(batch.least, np.stack([found.least, found.least + np.log(10.0)]))


def test_an_interval_from_zero_counts_with_its_upper_end():
    low, high = np.array([0.0, 0.5, 2.5, 0.0, 0.0, 0.0]), np.array([0.5, 1.5, 3.5, 0.5, 0.5, 0.5])
    found = RaterRange.of(low, high, WHO, MAGNITUDE)
    assert_allclose(np.exp(found.least), 0.5 / BEYOND)
    assert_allclose(np.exp(found.most), np.repeat([3.5, 0.5], 3) * BEYOND)
    # of a rater who answered 0 only, a lapse is 0 or a larger number equally often
    assert_allclose(np.exp(found.log_probability(low, high, MAGNITUDE))[3:], 0.5)


@pytest.mark.parametrize("scale", [MAGNITUDE, SLIDER], ids=lambda scale: scale.name)
def test_probabilities_of_all_intervals_sum_to_1_and_draws_follow_them(scale):
    ends = (
        np.r_[0.0, np.geomspace(1e-3, 0.999, 40), 1.0] if scale is SLIDER else np.r_[0.0, np.geomspace(0.01, 1e4, 60)]
    )
    law = WholeScale(1.0) if scale is SLIDER else RaterRange(np.log(np.full(6, 0.25)), np.log(np.full(6, 80.0)))
    mass = [np.exp(law.log_probability(np.full(6, a), np.full(6, b), scale)) for a, b in pairwise(ends)]
    assert_allclose(np.sum(mass, axis=0), 1.0, rtol=1e-12)
    drawn = law.draw(np.random.default_rng(3), (500, 6), scale)
    uniform = drawn if scale is SLIDER else np.log(drawn / 0.25) / np.log(80.0 / 0.25)
    assert kstest(uniform.ravel(), "uniform").pvalue > 0.01
    # an exact number has the density of a narrow interval about it, on the additive scale
    middle = np.full(6, 0.4)
    low, high = (scale.natural(scale.additive(middle) + shift) for shift in (-1e-5, 1e-5))
    narrow = law.log_probability(low, high, scale) - np.log(2e-5)
    assert_allclose(law.log_probability(middle, middle, scale), narrow, rtol=1e-6)


def test_the_extreme_numbers_of_attentive_raters_are_not_taken_for_lapses():
    """With few ratings of each rater, the most probable share of lapses is right: 0 without any."""
    rng, people, each = np.random.default_rng(5), 200, 8
    design = Design(np.tile(np.arange(4), 2 * people), np.repeat(np.arange(people), each), np.arange(4), people)
    rate, spread = np.geomspace(1.0, 20.0, 4), 0.3
    shares = np.linspace(0.0, 0.2, 41)
    points = rated(0.8, 0.5, spread, eps=0.1, nu=np.inf, lapse=shares)
    model = IntervalModel(law=LAPSES)
    said = Stated(*(np.full(design.n_rows, v) for v in (1.0, 0.5, 0.25, np.inf)))
    attentive = points.replace(lapse=0.0)
    empty = model.observe(said.values, design, said)
    effects = empty.new_effects(rng, attentive, (1,), {"mu": np.array([3.0])})
    for lapse, low, high in ((0.0, 0.0, 0.012), (0.08, 0.05, 0.11)):
        made = empty.replicate(rng, empty.drive(rate[None], attentive), attentive.replace(lapse=lapse), effects)[0]
        found = IntervalRatings(made, design, model, stated=said).log_likelihood(np.tile(rate, (41, 1)), points)
        assert low <= shares[found.argmax()] <= high
