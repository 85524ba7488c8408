"""People's own means against closed forms, brute force, a sampler, and maximum likelihood; and their coverage."""

import pickle
from dataclasses import replace
from itertools import permutations

import emcee
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr
from scipy.stats import multivariate_normal, norm, t

from softness_bayes.base.errors import InputError
from softness_bayes.data import Ratings
from softness_bayes.data.forms import AggregatedCells
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.scales import AGGREGATED, CATEGORIES, MAGNITUDE, PAIRS, RANKS
from softness_bayes.model.options import ModelOptions
from softness_bayes.people.answers import WIDE, told_pairs
from softness_bayes.people.free_means import FreeMeans
from support.laboratories import FABRICS, KINDS, LOADS, RATERS, laboratory, pairs_of

EXACT = ModelOptions(errors=NORMAL, resolution=0.0)


def logs(ratings):
    """Return the logarithms of a complete table, shape (raters, conditions)."""
    return np.log(ratings.rating).reshape(len(RATERS), -1)


def test_means_of_exact_numbers_are_those_of_a_mixed_model(rng):
    """In a complete design, REML gives column means and the residual variance of the additive fit, whatever tau."""
    ratings = laboratory("normal", rng).ratings
    filed = logs(ratings)
    rest = filed - filed.mean(axis=0) - filed.mean(axis=1, keepdims=True) + filed.mean()
    freedom = (filed.shape[0] - 1) * (filed.shape[1] - 1)
    error = np.sqrt((rest**2).sum() / freedom / len(RATERS))
    found = FreeMeans(ratings, EXACT)
    assert found.means.mean(axis=0) == pytest.approx(filed.mean(axis=0), abs=0.05 * error)
    assert found.means.std(axis=0) == pytest.approx(np.full(filed.shape[1], error), rel=0.08)
    apart = np.subtract(*filed.mean(axis=0)[:2]) / error / np.sqrt(2.0)
    assert found.p_higher(np.array([0, 1]))[0, 1] == pytest.approx(t(freedom).cdf(apart), abs=0.02)


def test_means_of_an_incomplete_design_are_those_of_statsmodels(rng):
    """REML of a mixed model: raters who each rated some fabrics; contrasts, their errors, and the odds of orders."""
    models = pytest.importorskip("statsmodels.regression.mixed_linear_model", reason="statsmodels is not installed")
    who, fabric = np.array([(p, k) for p in range(14) for k in sorted(rng.choice(8, 6, replace=False))]).T
    y = 3.0 + 0.2 * fabric + 0.5 * rng.standard_normal(14)[who] + 0.3 * rng.standard_normal(who.size)
    people, cloth = (tuple(f"{word} {k}" for k in range(n)) for word, n in (("rater", 14), ("cloth", 8)))
    ratings = Ratings(people, cloth, LOADS[:1], who, fabric, 0 * who, np.exp(y), np.arange(who.size) + 2)
    found = FreeMeans(ratings, EXACT)
    fit = models.MixedLM(y, np.eye(8)[fabric], groups=who).fit(reml=True)
    centred = np.eye(8) - 0.125
    covariance = np.asarray(fit.cov_params())[:8, :8]
    errors = np.sqrt(np.diag(centred @ covariance @ centred))
    np.testing.assert_allclose(found.means.mean(axis=0) @ centred, centred @ fit.fe_params, atol=0.08 * errors.min())
    np.testing.assert_allclose((found.means @ centred).std(axis=0), errors, rtol=0.1)
    apart = np.subtract.outer(fit.fe_params, fit.fe_params)
    spread = np.sqrt(np.add.outer(np.diag(covariance), np.diag(covariance)) - 2.0 * covariance + 1e-12)
    np.testing.assert_allclose(found.p_higher(np.arange(8)) + 0.5 * np.eye(8), norm.cdf(apart / spread), atol=0.03)


@pytest.mark.parametrize("kind", ["slider", "ranks"])
def test_means_do_not_depend_on_the_process(kind, rng):
    """A run computes them in another process, to which the table and the options are sent."""
    ratings, options, _ = laboratory(kind, rng)
    sent = pickle.loads(pickle.dumps((ratings, options)))
    np.testing.assert_array_equal(FreeMeans(*sent).means, FreeMeans(ratings, options).means)


def test_density_of_a_left_out_answer_is_that_of_the_other_answers(rng):
    """By brute force: the normal law of all ratings, from its covariance, without the one and with it."""
    made = laboratory("normal", rng).ratings
    ratings = Ratings.crossed(RATERS[:4], FABRICS[:3], LOADS[:1], made.rating.reshape(12, 5, 2)[:4, :3, :1])
    found = FreeMeans(ratings, ModelOptions(errors=NORMAL, resolution=0.0, fix={"tau": 0.5, "varsigma": 0.3}))
    y = np.log(ratings.rating)
    wide = WIDE * max(y.std(), 0.2)
    for index, density in ((ratings.fabric, found.log_density), (0 * ratings.fabric, found.log_density_alike)):
        covariance = 0.3**2 * np.eye(y.size) + 0.5**2 * np.equal.outer(ratings.participant, ratings.participant)
        covariance += wide**2 * np.equal.outer(index, index)
        whole = multivariate_normal(np.full(y.size, y.mean()), covariance).logpdf(y)
        for k in range(y.size):
            kept = np.delete(np.arange(y.size), k)
            rest = multivariate_normal(np.full(kept.size, y.mean()), covariance[np.ix_(kept, kept)]).logpdf(y[kept])
            assert density[k] == pytest.approx(whole - rest - y[k], abs=1e-8)


def test_means_of_whole_numbers_agree_with_a_sampler(rng):
    """A short run of emcee over means, raters and spreads, with the density written out again."""
    made = laboratory("whole", rng).ratings.rating.reshape(12, 5, 2)[:6, :3, :1]
    ratings = Ratings.crossed(RATERS[:6], FABRICS[:3], LOADS[:1], np.maximum(made, 1.0))
    low, high = (np.log(ratings.rating + half) for half in (-0.5, 0.5))
    middle, wide = np.log(ratings.rating).mean(), WIDE * max(np.log(ratings.rating).std(), 0.2)

    def density(point):
        means, own, spreads = point[:, :3], point[:, 3:9], np.exp(point[:, 9:])
        expected = means[:, ratings.fabric] + spreads[:, [0]] * own[:, ratings.participant]
        inside = ndtr((high - expected) / spreads[:, [1]]) - ndtr((low - expected) / spreads[:, [1]])
        prior = norm(middle, wide).logpdf(means).sum(axis=1) + norm.logpdf(own).sum(axis=1)
        prior += norm.logpdf(spreads[:, 0]) + norm(0, 0.5).logpdf(spreads[:, 1]) + point[:, 9:].sum(axis=1)
        with np.errstate(divide="ignore"):
            return np.log(inside).sum(axis=1) + prior

    start = np.concatenate([np.full(3, middle), np.zeros(6), [-0.7, -1.0]]) + 0.1 * rng.standard_normal((40, 11))
    sampler = emcee.EnsembleSampler(40, 11, density, vectorize=True)
    sampler._random.seed(1)
    sampler.run_mcmc(start, 2000)
    drawn = sampler.get_chain(discard=500, thin=10, flat=True)
    drawn = drawn[:, :3] + np.exp(drawn[:, [9]]) * drawn[:, 3:9].mean(axis=1, keepdims=True)
    found = FreeMeans(ratings, ModelOptions(errors=NORMAL, resolution=1.0)).means
    assert found.mean(axis=0) == pytest.approx(drawn.mean(axis=0), abs=0.12 * drawn.std(axis=0).min())
    assert found.std(axis=0) == pytest.approx(drawn.std(axis=0), rel=0.12)


def most_probable(log_likelihood, count):
    """Return the worths that maximise a log likelihood with the prior of free means."""
    return minimize(lambda w: 0.5 * (w**2).sum() / WIDE**2 - log_likelihood(w), np.zeros(count), method="BFGS").x


def test_worths_of_orders_are_those_of_a_plackett_luce_fit(rng):
    """With ties, whose probability is the sum over all orders of the tied touches, written out."""
    place = laboratory("ranks", rng).ratings.rating.reshape(12, 5, 2)[..., :1].copy()
    place[3, place[3, :, 0] <= 3, 0] = 1.0
    ratings = Ratings.crossed(RATERS, FABRICS, LOADS[:1], place)

    def order(worth, top_down):
        return sum(worth[i] - np.logaddexp.reduce(worth[top_down[k:]]) for k, i in enumerate(top_down))

    def log_likelihood(worth):
        total = 0.0
        for own in place[..., 0]:
            down = np.argsort(-own, kind="stable")
            tied = list(down[own[down] == 1.0])
            head = list(down[: down.size - len(tied)])
            total += np.logaddexp.reduce([order(worth, np.array(head + list(p))) for p in permutations(tied)])
        return total

    found, expected = FreeMeans(ratings, ModelOptions(scale=RANKS)), most_probable(log_likelihood, 5)
    apart = found.means - found.means.mean(axis=1, keepdims=True)
    assert apart.mean(axis=0) == pytest.approx(expected - expected.mean(), abs=0.06)


def test_worths_of_pairs_are_those_of_a_probit_fit(rng):
    ratings = laboratory("pairs", rng).ratings
    winner, loser = (ratings.fabric * 2 + ratings.load)[told_pairs(ratings)].T
    expected = most_probable(lambda w: log_ndtr(w[winner] - w[loser]).sum(), 10)
    found = FreeMeans(ratings, ModelOptions(scale=PAIRS))
    for load in (0, 1):
        ours, theirs = found.means[:, load::2], expected[load::2]
        assert (ours.mean(axis=0) - ours.mean()) == pytest.approx(theirs - theirs.mean(), abs=0.06)
    assert found.log_density.size == winner.size  # a comparison is one answer, not two ratings


def test_a_tie_is_no_answer(rng):
    ratings = pairs_of(*np.zeros((4, 2), np.intp), np.array([True, False]))
    assert told_pairs(ratings).shape == (2, 2)
    ratings.rating.flags.writeable = True
    ratings.rating[:2] = 0.5
    assert told_pairs(ratings).tolist() == [[3, 2]]


def test_means_of_cells_without_spread_have_no_interval(rng):
    """Nothing is made up about noise that a table does not show; with standard deviations there are intervals."""
    mean = np.exp(rng.normal(3.0, 0.5, (1, 5, 1)))
    for sd, known in ((None, False), (np.full(5, 1.5), True)):
        cells = Ratings.crossed(("panel",), FABRICS, LOADS[:1], mean)
        object.__setattr__(cells, "cells", AggregatedCells(9, sd))
        table = FreeMeans(cells, ModelOptions(scale=AGGREGATED)).table()
        assert table["people"].to_numpy() == pytest.approx(np.sort(mean.ravel())[::-1], rel=0.1)
        assert table[["people_low", "people_high", "p_highest"]].notna().to_numpy().all() == known


def covered(kind, number, seed=0):
    """Return the share of the true means inside 90 % intervals, and its standard error over laboratories."""
    shares = []
    for k in range(number):
        made = laboratory(kind, np.random.default_rng([seed, k]))
        found = FreeMeans(made.ratings, made.options)
        low, high = np.quantile(found.rating, (0.05, 0.95), axis=0)
        truth = made.truth[found.fabric, found.load]
        shares.append(((low <= truth) & (truth <= high)).mean())
    return np.mean(shares), np.std(shares) / np.sqrt(number)


@pytest.mark.parametrize("kind", ["normal", "pairs"])
def test_intervals_cover_the_truth_in_a_few_laboratories(kind):
    share, error = covered(kind, 12)
    assert abs(share - 0.9) < 0.04 + 2.5 * error


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_cover_the_truth(kind):
    share, _ = covered(kind, 200, 1)
    assert share == pytest.approx(0.9, abs=0.04)


def test_a_fabric_that_all_put_into_the_highest_category_is_known_to_be_there(rng):
    """The law of its mean is open above: a normal one about the mode would reach down to the lowest categories."""
    made = laboratory("categories", rng, np.array([[-0.8, -0.5], [-0.3, 0.0], [0.2, 0.4], [0.5, 0.7], [3.5, 4.0]]))
    rated = made.ratings.rating[made.ratings.fabric == 4]
    assert (rated == 6.0).all()
    found = FreeMeans(made.ratings, made.options)
    low, high = np.quantile(found.rating[:, found.fabric == 4], (0.05, 0.95), axis=0)
    assert (low > 5.5).all()
    assert (high > 5.97).all()
    rest = np.quantile(found.rating[:, found.fabric == 2], (0.05, 0.95), axis=0)
    assert (np.diff(rest, axis=0) > 0.05).all()  # others are as uncertain as before


def test_a_fabric_that_all_put_into_one_category_of_others_is_known_to_be_there(rng):
    """Between two thresholds all means are as probable, so that a normal law about the mode has no width of its own."""
    filed = np.array([[3, 3, 4, 5, 4], [4, 3, 4, 5, 3], [3, 3, 4, 5, 3], [3, 2, 4, 5, 3]], float)[..., None]
    ratings = Ratings.crossed(RATERS[:4], FABRICS, LOADS[:1], filed)
    found = FreeMeans(ratings, ModelOptions(scale=CATEGORIES, n_categories=7, errors=NORMAL))
    low, high = np.quantile(found.rating[:, 2:4], (0.05, 0.95), axis=0)
    assert (low > np.array([3.4, 4.4])).all()
    assert (high < np.array([4.6, 5.6])).all()
    assert found.p_higher(np.array([3, 2]))[0, 1] > 0.95


def test_a_custom_scale_is_refused(rng):
    with pytest.raises(InputError, match="custom scale"):
        FreeMeans(laboratory("normal", rng).ratings, ModelOptions(scale=replace(MAGNITUDE, model=RatingModel)))
