"""Expected information of comparisons, against sums over all answers that there can be."""

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.likelihood.comparison_information import Comparisons, order_information, pair_information
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import LAPSES
from softness_bayes.likelihood.orders import OrderModel
from softness_bayes.likelihood.pairs import PairModel
from softness_bayes.likelihood.stated import Stated
from support.points import rated

STEP = 1e-4


def likelihood(model, values, conditions):
    """One list of some conditions, whose drives are the logs of their rates."""
    design = Design(np.asarray(conditions), np.zeros(len(conditions), int), np.arange(4), 1)
    values, zero = np.asarray(values, float), np.zeros(len(conditions))
    return model.observe(
        values, design, Stated(values, zero, zero, zero + np.inf, lists=np.zeros(len(conditions), int))
    )


def summed(model, answers, conditions, drive, slopes, parameters):
    """The mean square of the score over all answers: their probabilities times the squares of their slopes."""
    found = np.zeros((slopes.shape[1],) * 2)
    for answer in answers:
        one = likelihood(model, answer, conditions)

        def log_chance(shift, one=one):
            return float(one.log_likelihood(np.exp(drive + slopes @ shift), parameters))

        score = np.array([(log_chance(e) - log_chance(-e)) / (2 * STEP) for e in STEP * np.eye(slopes.shape[1])])
        found += np.exp(log_chance(np.zeros(slopes.shape[1]))) * np.outer(score, score)
    return found


@pytest.mark.parametrize("guesses", [0.0, 0.1])
def test_information_of_a_pair(rng, guesses):
    model = PairModel(law=LAPSES)
    parameters = rated(*map(np.float64, (1.0, 0.0, 1.0 / np.sqrt(2.0), 0.0, 0.0)), lapse=np.float64(guesses))
    drive, slopes = rng.normal(size=4), rng.normal(size=(4, 3))
    expected = summed(model, [(1, 0), (0, 1)], [2, 0], drive, slopes, parameters)
    found = pair_information(Comparisons(np.array([[2, 0]]), np.ones(1)), drive, slopes, guesses)
    assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


def test_information_of_an_order(rng):
    """Of four touches all 24 orders are summed; the other estimate is a mean over simulated orders."""
    model = OrderModel()
    parameters = rated(*map(np.float64, (1.0, 0.0, np.pi / np.sqrt(6.0), 0.0, 0.0)))
    drive, slopes = rng.normal(size=4), rng.normal(size=(4, 2))
    expected = summed(model, list(permutations(range(4))), range(4), drive, slopes, parameters)
    compared = Comparisons(np.arange(4)[None], np.ones(1))
    found = order_information(rng, compared, drive, slopes, orders=4000)
    assert_allclose(found, expected, rtol=0.05, atol=0.02 * np.abs(expected).max())
    # a smaller list beside it adds its own
    both = compared.with_others(np.array([[1, 3]]), np.full(1, 2.0))
    more = order_information(rng, both, drive, slopes, orders=4000)
    two = summed(model, [(0, 1), (1, 0)], [1, 3], drive, slopes, parameters)
    assert_allclose(more - found, 2.0 * two, atol=0.05 * np.abs(expected).max())


def test_rows_become_sets():
    lists, condition = np.array([5, 5, 7, 7, 9, 9, 9]), np.array([2, 0, 0, 2, 1, 3, 2])
    found = Comparisons.of_rows(lists, condition)
    assert found.members.tolist() == [[0, 2, -1], [1, 2, 3]]
    assert found.times.tolist() == [2, 1]


def test_sure_answers_tell_nothing():
    compared = Comparisons(np.array([[0, 1]]), np.ones(1))
    assert_allclose(pair_information(compared, np.array([0.0, 60.0]), np.eye(2)), 0.0, atol=1e-200)
    assert_allclose(
        order_information(np.random.default_rng(0), compared, np.array([0.0, 60.0]), np.eye(2)), 0.0, atol=1e-20
    )
