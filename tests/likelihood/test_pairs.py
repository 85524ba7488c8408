"""Answers to pairs of touches: a probit of their difference, guesses, and their table."""

from io import StringIO

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics, Ratings
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL
from softness_bayes.likelihood.orders import OrderModel, PairModel, PairRatings
from support.points import rated

RATE = np.array([0.0, 2.0, 7.0, 30.0])
POINT = rated(np.float64(0.8), 0.0, np.float64(1.5), 0.0, np.float64(0.1))


def asked(condition, answers, law=None, reference=None):
    """Pairs of conditions, two rows each, of which the first was called softer or not."""
    condition = np.asarray(condition)
    design = Design(condition.ravel(), np.zeros(condition.size, int), np.arange(4), 1)
    values = np.stack([answers, 1.0 - np.asarray(answers, float)], axis=1).ravel()
    model = PairModel(law=law or NORMAL, guesses_given=reference is not None)
    sides = None if reference is None else (condition == reference).ravel() & (np.diff(condition) != 0).repeat(2)
    return PairRatings(values, design, model, lists=np.repeat(np.arange(len(condition)), 2), reference=sides)


def test_a_guess_rate_is_the_floor_of_comparisons_alone():
    sure = POINT.replace(varsigma=np.float64(1e-3), guess=np.float64(1 / 3), lapse=np.float64(0.06))
    pairs = [[0, 1], [0, 1], [1, 3], [1, 3], [1, 1]]  # fabric 1 is the reference, in either place
    observed = asked(pairs, [1, 0, 0, 1, 1], LAPSES, reference=1)
    chances = np.exp(observed.log_likelihood_answers(RATE, sure))
    assert_allclose(chances, [1 / 3, 2 / 3, 0.97, 0.03, 0.5], rtol=1e-9)


def test_answers_with_a_guess_rate_are_recovered_and_equal_guesses_fail():
    """Replicates have the stated chances; the rate is found again; guesses that prefer no side are the control."""
    rng, truth = np.random.default_rng(5), POINT.replace(guess=np.float64(1 / 3), lapse=np.float64(0.04))
    pairs = np.repeat([[0, 1], [2, 1], [1, 3]], 1500, axis=0)
    blank = asked(pairs, np.ones(len(pairs)), LAPSES, reference=1)
    made = blank.replicate(rng, blank.drive(RATE, truth), truth, None).reshape(-1, 2)[:, 0]
    share = made.reshape(3, -1).mean(axis=1)
    expected = blank.expected(RATE, truth, None)
    assert_allclose([share[0], share[1], 1.0 - share[2]], expected[[0, 2, 3]], atol=4.0 * 0.5 / np.sqrt(1500))

    def loss(observed, point):
        size, lapse, guess = np.exp(point)
        value = observed.log_likelihood(RATE, truth.replace(gamma=size, lapse=lapse, guess=guess))
        return float("inf") if max(guess, lapse) > 0.6 else -float(value)

    right, wrong = asked(pairs, made, LAPSES, reference=1), asked(pairs, made, LAPSES)
    start = np.log([0.5, 0.1, 0.1])
    found, control = (minimize(lambda z, o=one: loss(o, z), start, method="Nelder-Mead") for one in (right, wrong))
    assert np.exp(found.x)[[0, 2]] == pytest.approx([0.8, 1 / 3], rel=0.15)
    assert control.fun > found.fun + 50.0
    others = right.without(np.arange(len(made) * 2) < 2000)
    assert others.log_likelihood(RATE, truth) == pytest.approx(right.log_likelihood_answers(RATE, truth)[1000:].sum())


def test_each_pair_is_one_answer():
    """Rows of a pair share its density, so their sum counts every answer twice; answers count it once."""
    observed = asked([[0, 1], [2, 1], [3, 0]], [1, 1, 0])
    whole = observed.log_likelihood(RATE, POINT)
    assert observed.log_likelihood_answers(RATE, POINT).shape == (3,)
    assert_allclose(observed.log_likelihood_answers(RATE, POINT).sum(), whole, rtol=1e-12)
    assert_allclose(observed.left_out(RATE, POINT).log_density.sum(), 2.0 * whole, rtol=1e-12)


def test_expected_shares_are_means_over_what_stands_beside():
    """Of a list, the sum of chances against its other touches; of all lists, the mean of replicates."""
    design = Design(np.tile(np.arange(4), 3000), np.repeat(np.arange(3000), 4), np.arange(4), 3000)
    model, rng = OrderModel(), np.random.default_rng(2)
    observed = model.observe(np.tile([0.0, 1 / 3, 2 / 3, 1.0], 3000), design)
    made = observed.replicate(rng, observed.drive(RATE, POINT), POINT, None).reshape(-1, 4)
    expected = observed.expected(RATE, POINT, None)
    assert_allclose(made.mean(axis=0), expected, atol=4.0 * 0.4 / np.sqrt(3000))
    assert_allclose(expected.mean(), 0.5, rtol=1e-12)


def test_lists_of_three_are_no_pairs():
    design = Design(np.arange(3), np.zeros(3, int), np.arange(3), 1)
    with pytest.raises(InputError, match="a list holds 3 touches, expected pairs"):
        PairRatings([1, 2, 3], design)


CLOTH = Fabrics(("a", "b", "c"), effective_modulus=np.array([1e3, 1e4, 1e5]))
TABLE = "participant,fabric,fabric_2,indentation_mm,rating\nP1,a,b,2,1\nP1,c,b,2,0\nP2,a,c,2,0.5\nP2,b,c,2,\n"


def read(text):
    return Ratings.read(pd.read_csv(StringIO(text), dtype=str, keep_default_na=False), CLOTH)


def test_rows_of_pairs_become_two_rows():
    ratings = read(TABLE)
    assert [ratings.fabrics[k] for k in ratings.fabric] == ["a", "b", "c", "b", "a", "c"]
    assert ratings.rating.tolist() == [1.0, 0.0, 0.0, 1.0, 0.5, 0.5]
    assert ratings.lists.tolist() == [0, 0, 1, 1, 2, 2]
    assert ratings.paired
    assert any("1 means that fabric was softer than fabric_2" in note for note in ratings.notes)


def test_a_fabric_with_itself_is_a_catch_trial():
    ratings = read(TABLE.replace("a,b,2", "a,a,2", 1))
    assert ratings.lists.tolist() == [0, 0, 1, 1]
    assert any("1 catch trial (a fabric with itself)" in note for note in ratings.notes)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2,1\n", "2,7\n", "expected 1 if the first fabric of the pair was softer, .* got '7'"),
        ("c,b,2", "c,z,2", "'z' is not a fabric"),
        ("c,b,2", "c,,2", "fabric_2"),
        ("rating\n", "rating,list\n", "each row is already a pair, so a list has no meaning"),
    ],
)
def test_tables_of_pairs_that_are_refused(old, new, message):
    text = TABLE.replace(old, new, 1)
    if "list" in new:
        text = "\n".join(line if "list" in line else f"{line},1" for line in text.strip().split("\n")) + "\n"
    with pytest.raises(InputError, match=message):
        read(text)
