"""Ratings on grids, with zeros and outliers: integrals against brute force, and limits against the closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.design import Stated
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings, SliderModel
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.scales import FALLS, RISES
from support.interval_tables import POINTS, design_of, on_grid, points_of, rates_of, table
from support.points import densities

LAWS = NORMAL, STUDENT, LAPSES


def test_normal_errors_of_exact_numbers_are_the_closed_form():
    observed, rate, points = table(5, 5, 4)
    closed = RatingModel(RISES).observe(observed.values, observed.design)
    own = IntervalRatings(observed.values, observed.design, observed.model)
    expected = closed.log_likelihood(rate, points)
    assert_allclose(own.log_likelihood(rate, points), expected, atol=1e-6)  # the sum over nodes
    assert_allclose(own.for_sampling().log_likelihood(rate, points), expected, rtol=1e-12)
    known = densities(closed, rate, points)
    for name, found in densities(own, rate, points).items():
        assert_allclose(found, known[name], rtol=1e-7, atol=1e-7, err_msg=name)
    assert_allclose(own.residual(rate, points, effects_of(own, rate, points)), residual_by_hand(own, rate, points))


def effects_of(observed, rate, points):
    return observed.draw_effects(np.random.default_rng(1), rate, points)


def residual_by_hand(observed, rate, points):
    effects, design = effects_of(observed, rate, points), observed.design
    expected = effects.mu[:, None] + observed.drive(rate, points)[:, design.condition]
    return np.log(observed.values) - expected - effects.participant[:, design.participant]


def test_replicates_are_on_the_grid_of_their_rater():
    observed, rate, points = table(10, 3, 4, STUDENT, 0.5)
    rng = np.random.default_rng(3)
    effects = observed.new_effects(rng, points, (POINTS,), {"mu": np.full(POINTS, -1.0)})
    made = observed.replicate(rng, observed.drive(rate, points), points, effects)
    zero = made == 0.125  # stands in for 0: half of what is rounded to it
    assert zero.any()
    assert_allclose(made[~zero] / 0.5, np.round(made[~zero] / 0.5), rtol=1e-12)
    assert (made[~zero] >= 0.5).all()


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_repeated_answers_count_as_often_as_they_were_given(law):
    """Against the same answers with differences in the last digits, none of which is a repetition."""
    observed, rate, points = table(5, 3, 4, law, tau=0.3)
    again = np.repeat(observed.values, 3)
    apart = again * (1.0 + 1e-13 * np.arange(again.size))
    repeated, different = (IntervalRatings(y, design_of(3, 12), observed.model).for_sampling() for y in (again, apart))
    # the sampler's rows have single precision
    assert_allclose(repeated.log_likelihood(rate, points), different.log_likelihood(rate, points), rtol=3e-8)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_hard_tables_have_finite_densities(law):
    """All ratings 0 but one, all the same, one rater, one row; spreads near 0 and far too large; values far off."""
    rng = np.random.default_rng(12)
    rate = rates_of(rng)
    for people, repeats, values in (
        (2, 2, np.r_[np.full(23, 0.25), 1.0]),
        (2, 2, np.full(24, 3.0)),
        (1, 1, np.full(6, 7.0)),
        (3, 2, np.r_[1e-6, np.full(34, 2.0), 1e6]),
    ):
        said = on_grid(values, 1.0)
        observed = IntervalRatings(values, design_of(people, repeats), IntervalModel(FALLS, law=law), stated=said)
        for spread in (1e-3, 0.3, 20.0):
            points = points_of(rng, varsigma=spread, tau=0.0 if people == 1 else 0.5)
            found = densities(observed, rate, points)
            assert all(np.isfinite(values).all() for values in found.values()), spread
            assert (found["all"] <= 1e-9).all()  # probabilities


@pytest.mark.parametrize("differ", [("gamma",), ("varsigma",), ("gamma", "varsigma")], ids=",".join)
@pytest.mark.parametrize("step", [0.0, 1.0])
def test_the_sampler_has_a_density_far_from_the_data_of_raters_who_differ(differ, step):
    """A step of Newton's method to where the density is below the smallest number is no rise."""
    observed, rate, points = table(14, 6, 2, step=step)
    model = IntervalModel(RISES, differ=differ)
    own = IntervalRatings(observed.values, observed.design, model, stated=observed._stated if step else None)
    for varsigma in (1e-4, 2e-3):
        far = points.replace(
            gamma=np.full(POINTS, 19.0), tau=np.full(POINTS, 0.03), varsigma=np.full(POINTS, varsigma),
            tau_gamma=np.full(POINTS, 0.04), tau_varsigma=np.full(POINTS, 0.04),
        )  # fmt: skip
        assert np.isfinite(own.for_sampling().log_likelihood(rate, far)).all()


def test_values_must_be_positive_and_finite():
    with pytest.raises(InputError, match="1 of 6 are not positive numbers"):
        IntervalRatings(np.r_[np.ones(5), 0.0], design_of(1, 1))


def shares(rng, design, step=0.0):
    """Places on a slider, with what they stand for."""
    rows = design.n_rows
    latent = 1.0 / (1.0 + np.exp(-(rng.normal(0.3, 1.2, rows))))
    said = Stated(latent, np.full(rows, step), np.full(rows, step / 2), np.full(rows, 1.0 - step / 2), 1.0)
    return said._replace(values=said.rounded(latent))


def test_replicates_on_a_slider_reach_its_ends():
    rng, design = np.random.default_rng(16), design_of(3, 4)
    said, rate, points = shares(rng, design, 0.1), rates_of(rng), points_of(rng)
    observed = SliderModel(RISES).observe(said.values, design, said)
    effects = observed.new_effects(rng, points, (POINTS,), {"mu": np.array([-2.5, 0.0, 2.5])})
    made = observed.replicate(rng, observed.drive(rate, points), points, effects)
    allowed = np.concatenate([[0.025], np.arange(1, 10) / 10.0, [0.975]])
    assert np.isclose(made[..., None], allowed).any(axis=-1).all()
    assert np.isclose(made, 0.025).any()
    assert np.isclose(made, 0.975).any()
