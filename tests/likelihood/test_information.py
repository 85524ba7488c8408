"""Expected information: of normal rows by the dense formula, of comparisons by sums over all answers there can be."""

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_array

from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import LAPSES
from softness_bayes.likelihood.lists import Comparisons, order_information, pair_information
from softness_bayes.likelihood.normal_rows import EffectGroup, normal_information
from softness_bayes.likelihood.orders import OrderModel, PairModel
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


def test_sure_answers_tell_nothing():
    compared = Comparisons(np.array([[0, 1]]), np.ones(1))
    assert_allclose(pair_information(compared, np.array([0.0, 60.0]), np.eye(2)), 0.0, atol=1e-200)
    assert_allclose(
        order_information(np.random.default_rng(0), compared, np.array([0.0, 60.0]), np.eye(2)), 0.0, atol=1e-20
    )


def dense(slopes, effects, variances, sd, sd_slope, groups):
    """J' S^-1 J + tr(S^-1 dS S^-1 dS) / 2, with the covariance written out."""
    n = len(slopes)
    inverse = np.linalg.inv(sd**2 * np.eye(n) + effects @ np.diag(variances) @ effects.T)
    changes = [2 * sd * k * np.eye(n) for k in sd_slope]
    for group in groups:
        own = effects[:, group.columns] @ effects[:, group.columns].T
        changes = [c + 2 * group.sd * k * own for c, k in zip(changes, group.slope, strict=True)]
    traces = [[0.5 * np.trace(inverse @ one @ inverse @ two) for two in changes] for one in changes]
    return slopes.T @ inverse @ slopes + np.array(traces)


@pytest.mark.parametrize("fabrics", [False, True])
def test_information_is_the_dense_one(fabrics, rng):
    design = Design(rng.integers(0, 8, 50), rng.integers(0, 5, 50), np.arange(8) // 2, 5)
    of_condition = rng.normal(size=(8, 6))
    blocks = [np.eye(5)[design.participant]]
    variances, groups = [np.full(5, 0.3**2)], [EffectGroup(slice(0, 5), 0.3, rng.normal(size=6))]
    if fabrics:
        blocks.append(np.eye(4)[design.fabric[design.condition]])
        variances.append(np.full(4, 0.2**2))
        groups.append(EffectGroup(slice(5, 9), 0.2, rng.normal(size=6)))
    effects = np.concatenate([*blocks, np.ones((50, 1))], axis=1)
    variances, sd_slope = np.concatenate([*variances, [9.0]]), rng.normal(size=6)
    given, slopes = (variances, 0.4, sd_slope, groups), of_condition[design.condition]
    expected = dense(slopes, effects, *given)
    for one in (effects, csr_array(effects)):
        assert_allclose(normal_information(one, slopes, *given), expected, rtol=1e-8)
