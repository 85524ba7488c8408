"""Information of further ratings, against quadrature, closed forms of linear models, and quantities that they miss."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.experiments.information import (
    linear_gain,
    nested_gain,
    rank_bins,
    rank_scores,
    single_gains,
)


def entropy(mean, sd):
    """The entropy of a mixture of normal laws, by a dense sum."""
    at = np.linspace((mean - 9 * sd).min(), (mean + 9 * sd).max(), 8001)
    density = np.zeros_like(at)
    for m, s in zip(mean, sd, strict=True):
        density += np.exp(-0.5 * ((at - m) / s) ** 2) / (s * np.sqrt(2 * np.pi))
    density /= mean.size
    return -(density * np.log(np.maximum(density, 1e-300))).sum() * (at[1] - at[0])


@pytest.fixture
def mixtures(rng):
    """Means of three touches and one error for each draw: bell-shaped, skewed, and half silent."""
    n = 1500
    means = [rng.normal(size=n), rng.gamma(1.0, size=n), np.where(rng.random(n) < 0.4, 0.0, rng.normal(3.0, 0.2, n))]
    return np.stack(means, axis=1), np.exp(rng.normal(-1.2, 0.25, n))


def conditional(sd):
    return np.log(sd).mean() + 0.5 * np.log(2 * np.pi * np.e)


def test_information_is_that_of_dense_sums(mixtures):
    mean, sd = mixtures
    expected = np.array([entropy(column, sd) for column in mean.T])
    assert_allclose(single_gains(mean, sd[:, None]), expected - conditional(sd), atol=1e-4)
    # and about two groups, with weights: a weight of two is a draw that is there twice
    weight = np.where(np.arange(sd.size) < 500, 2.0, 1.0)
    twice = np.repeat(np.arange(sd.size), weight.astype(int))
    some = np.random.default_rng(0).permutation(bins := (mean[:, 0] > 0.5).astype(np.intp))
    for k, found in enumerate(single_gains(mean, sd[:, None], [bins], weight)):
        within = [
            sum((label[twice] == g).mean() * entropy(mean[twice, k][label[twice] == g], sd[twice][label[twice] == g])
                for g in (0, 1)) for label in (some, bins)
        ]  # fmt: skip
        assert found == pytest.approx(within[0] - within[1], abs=1e-4)


def test_a_grid_too_coarse_for_an_error_understates_the_information(rng):
    """Errors of one draw that are a thousand times smaller than those of the others."""
    mean, sd = rng.normal(size=(400, 1)), np.full((400, 1), 0.3)
    usual = single_gains(mean, sd)[0]
    sd[0] = 3e-4
    found, exact = single_gains(mean, sd)[0], entropy(mean[:, 0], np.maximum(sd[:, 0], 2e-3)) - conditional(sd)
    assert usual < found < exact


def test_information_about_one_quantity(mixtures, rng):
    mean, sd = mixtures
    everything, first = single_gains(mean, sd[:, None]), single_gains(mean, sd[:, None], [rank_bins(mean[:, 0])])
    assert (everything > 0).all()
    assert 0.85 * everything[0] < first[0] < everything[0]  # twenty bins lose little
    # the other touches tell nothing of it
    assert (np.abs(first[1:]) < 0.02).all()
    assert (np.abs(single_gains(mean, sd[:, None], [rank_bins(rng.normal(size=sd.size))])) < 0.02).all()


def test_labels_of_two_models_are_two_bins(rng):
    label = np.repeat([0.0, 1.0], 500)
    bins = rank_bins(label)
    assert np.unique(bins).size == 2
    apart = np.where(label > 0, 20.0, 0.0)[:, None] + rng.normal(size=(1000, 1))
    assert_allclose(single_gains(apart, np.ones((1, 1)), [bins]), np.log(2), atol=5e-3)


def test_draws_without_a_quantity_have_a_bin_of_their_own():
    quantity = np.r_[np.arange(50.0), np.full(50, np.nan)]
    bins = rank_bins(quantity)
    assert np.unique(bins).size == 21
    assert np.unique(bins[50:]).size == 1
    assert_allclose(rank_scores(quantity)[50:], 0.0)


@pytest.fixture
def linear(rng):
    """Six observations of three parameters with a known information."""
    slope = rng.normal(0, 0.5, (6, 3))
    theta = rng.standard_normal((20_000, 3))
    return slope, theta, theta @ slope.T, 0.3 * np.eye(6)


def test_the_closed_form_of_a_linear_model(linear, rng):
    slope, theta, mean, errors = linear
    precision = np.eye(3) + slope.T @ slope / 0.3
    expected = 0.5 * np.linalg.slogdet(precision)[1]
    assert linear_gain(np.cov(mean.T) + errors, errors) == pytest.approx(expected, abs=0.02)
    found = nested_gain(rng, mean, np.broadcast_to(errors, (len(mean), 6, 6)), {"first": theta[:, 0]}, outcomes=100)
    assert found.low < found.high
    assert 0.5 * (found.low + found.high) == pytest.approx(expected, abs=0.02)
    assert found.sd_ratio["first"] == pytest.approx(np.sqrt(np.linalg.inv(precision)[0, 0]), abs=0.02)


def test_the_closed_form_of_one_parameter(linear, rng):
    slope, theta, mean, errors = linear
    covariance = np.linalg.inv(np.eye(3) + slope.T @ slope / 0.3)
    expected = -0.5 * np.log(covariance[0, 0])
    scores = theta[:, :1]
    every = np.broadcast_to(errors, (len(mean), 6, 6))
    found = nested_gain(rng, mean, every, {"first": theta[:, 0]}, ("first",), outcomes=200)
    assert found.low <= found.high
    # twenty bins know a little less than the parameter itself
    assert expected - 0.06 < 0.5 * (found.low + found.high) < expected + 0.01
    with_scores = (mean - mean.mean(axis=0)).T @ scores / len(mean)
    whole = np.cov(mean.T) + errors
    assert linear_gain(whole, whole - with_scores @ with_scores.T) == pytest.approx(expected, abs=0.02)


def test_too_few_draws_widen_the_bracket(rng):
    """Outcomes that a single draw explains: the density without it is far too small, that with it too large."""
    theta = rng.standard_normal((200, 6))
    found = nested_gain(rng, theta, np.broadcast_to(1e-3 * np.eye(6), (200, 6, 6)), {}, outcomes=100)
    assert found.high - found.low > 1.0
    assert found.effective < 3


def test_outcomes_without_a_turning_point_have_no_width(rng):
    """Half the draws lack the quantity, and lie so far apart that no outcome is explained by draws of both kinds."""
    theta = rng.standard_normal(400)
    mean = np.where(np.arange(400) < 200, 1e3, theta)[:, None]
    some = np.where(np.arange(400) < 200, np.nan, theta)
    errors = np.full((400, 1, 1), 0.25)
    found = nested_gain(rng, mean, errors, {"turning": some, "nowhere": np.full(400, np.nan)}, outcomes=300).sd_ratio
    assert found["turning"] == pytest.approx(np.sqrt(0.2), abs=0.08)  # of a normal law with errors of variance 0.25
    assert found["nowhere"] == 1.0
