"""Places of fabrics, draw by draw: ties, pairs, and agreement with observed ranks."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import rankdata, spearmanr

from softness_bayes.base.errors import InputError
from softness_bayes.checking.agreement import agreement, jackknife, pairs, places, rank_correlation, ties


def test_places_share_ties_equally():
    place, probability = places([[3.0, 1.0, 1.0, 2.0], [1.0, 1.0, 1.0, 1.0], [4.0, 3.0, 2.0, 1.0]])
    assert_allclose(place, [[1, 3.5, 3.5, 2], [2.5] * 4, [1, 2, 3, 4]])
    first = np.mean([[1, 0, 0, 0], [0.25] * 4, [1, 0, 0, 0]], axis=0)
    second = np.mean([[0, 0, 0.5, 0.5], [0.25] * 4, [0, 1, 0, 0]], axis=0)
    assert_allclose(probability[:2], [first, second], atol=1e-15)


def test_probabilities_of_places_sum_to_one_both_ways(rng):
    rating = np.round(rng.normal(size=(50, 30)), 1)
    place, probability = places(rating)
    assert_allclose(probability.sum(axis=0), 1.0)
    assert_allclose(probability.sum(axis=1), 1.0)
    assert_allclose(place, [rankdata(-one) for one in rating])
    assert_allclose(probability @ np.arange(1, 31), place.mean(axis=0))


def test_pairs_and_ties(rng):
    rating = np.array([[3.0, 1.0, 1.0, 2.0], [2.0, 1.0, 1.0, 1.0], [2.0, 1.0, 1.5, 3.0]])
    softer, tie = pairs(rating)
    assert_allclose(softer + softer.T + tie, 1.0)
    assert_allclose(softer[0], [0, 1, 1, 2 / 3])
    assert_allclose(tie[1], [0, 1, 2 / 3, 1 / 3])
    order = np.array([0, 3, 2, 1])
    assert ties(tie, order).tolist() == [0, 0, 0, 0]
    two = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0.95], [0, 0, 0.95, 0]])
    assert ties(two, np.arange(4)).tolist() == [1, 1, 2, 2]
    # neighbours that tie do not draw in what has a place of its own: silent in 90, 97, 98 and 100 % of the draws
    silent = np.array([0.9, 0.97, 0.98, 1.0])
    assert ties(np.minimum.outer(silent, silent), np.arange(4)).tolist() == [0, 1, 1, 1]
    assert ties(np.ones((3, 3)), np.arange(3)).tolist() == [1, 1, 1]
    assert ties(np.zeros((3, 3)), np.arange(3)).tolist() == [0, 0, 0]


def test_agreement_of_the_same_and_of_the_opposite_order(rng):
    observed = np.array([2.0, 1.0, 3.0, 4.0, 5.0])
    for sign in (1.0, -1.0):
        for one in agreement(np.tile(sign * observed, (7, 1)), observed).values():
            assert_allclose([one["value"], one["low"], one["high"]], sign)
            assert_allclose(one["se"], 0.0, atol=1e-12)
    place = np.array([rankdata(observed + rng.normal(size=5)) for _ in range(200)])
    found = agreement(place, observed)
    each = [spearmanr(one, observed).statistic for one in place]
    assert_allclose([*found["spearman"].values()][:3], np.quantile(each, [0.5, 0.05, 0.95]))
    assert found["kendall"]["low"] < found["kendall"]["value"] < found["kendall"]["high"]
    # silent everywhere: nothing to compare
    none = agreement(np.full((4, 5), 3.0), observed)
    assert np.isnan([*none["kendall"].values()]).all()


def test_the_jackknife_is_the_spread_between_samples_of_fabrics(rng):
    measure, values, errors = partial(rank_correlation, "spearman"), [], []
    for _ in range(60):
        true = rng.normal(size=40)
        seen = true + rng.normal(size=40)
        values.append(measure(seen, true))
        errors.append(jackknife(measure, seen, true))
    assert 0.7 < np.mean(errors) / np.std(values) < 1.4


def test_too_few_fabrics_have_no_order():
    with pytest.raises(InputError, match="2 fabrics with observed ranks \\(2 distinct\\); expected 3"):
        agreement(np.ones((3, 2)), [1, 2])
    with pytest.raises(InputError, match="3 fabrics with observed ranks \\(1 dist"):
        agreement(np.ones((3, 3)), [1, 1, 1])
