"""Slopes of raters' log densities by power sums, where rows are narrow, and the starts of the search for modes."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import log_ndtr

from softness_bayes.likelihood import narrow_rows
from softness_bayes.likelihood.categories import CategoryModel, CategoryRatings
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.error_laws import ERROR_LAWS, GUMBEL, NORMAL, STUDENT
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings
from softness_bayes.likelihood.rater_rows import LawParameters
from softness_bayes.likelihood.stated import Stated
from support.interval_tables import design_of, points_of, table

LAWS = NORMAL, STUDENT


SPREAD = 0.15


def errors_of(observed, rate, points):
    """Largest errors of the mean slopes of a rater's rows, in spreads, against those without series, for each order."""
    points, integrals = points._replace(varsigma=np.full_like(points.varsigma, SPREAD)), observed._integrals
    given, _ = observed._given(rate, points)
    start = integrals._starts.near(integrals, given, single=True)
    here = start.a + 0.3 * np.random.default_rng(5).standard_normal(start.a.shape)
    _, others = integrals._narrow.slopes(given, start, here)
    assert 0.1 < others.mean() < 0.8  # the table has both kinds
    error = integrals._slopes_near(given, here, start, True, 4) - integrals._slopes(given, here)
    return (np.abs(error) * SPREAD ** np.arange(5)[:, None, None] / integrals.count).max(axis=(1, 2))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize("outliers", [0.0, 0.2])
@pytest.mark.parametrize("folded", [False, True], ids=["distinct", "folded"])
def test_slopes_are_those_of_all_rows(law, outliers, folded):
    """Wide intervals, zeros and outliers among narrow ones; folded rows are equal ratings of one condition."""
    observed, rate, points = table(3, 7, 12 if folded else 1, law=law, step=1.0, outliers=outliers, spread=0.2)
    assert (observed._integrals._times > 1.0).any() == folded
    assert (errors_of(observed, rate, points) < [5e-6, 2e-4, 5e-4, 5e-3, 0.03]).all()


def test_series_of_steep_rows_would_be_wrong(monkeypatch):
    """Control: rows that are many spreads off are left to distribution functions."""
    observed, rate, points = table(3, 7, 4, step=1.0, outliers=0.2, spread=0.2)
    assert errors_of(observed, rate, points)[0] < 2e-6
    monkeypatch.setattr(narrow_rows, "STEEPEST", np.inf)
    assert errors_of(observed, rate, points)[0] > 0.1


def test_tables_of_wide_intervals_have_no_narrow_rows():
    """Where most are wide, the rule for intervals takes them all."""
    observed, rate, points = table(3, 7, 4, law=STUDENT, step=4.0)
    given, _ = observed._given(rate, points)
    integrals = observed._integrals
    start = integrals._starts.near(integrals, given, single=True)
    assert integrals._narrow.slopes(given, start, start.a) is None


@pytest.mark.parametrize("law", [*ERROR_LAWS.values(), GUMBEL], ids=lambda law: law.name)
def test_log_probability_below_is_that_of_the_normal_score(law):
    errors, point = np.linspace(-2.0, 6.0, 81)[None], LawParameters(np.array([4.0]), np.array([0.0]))
    expected = log_ndtr(law.normal_scores(errors, point))
    assert_allclose(law.log_below(errors, point), expected, rtol=1e-5, atol=1e-8)


def test_start_of_open_rows_is_that_of_their_probability():
    """The slope and curvature of ends, by differences of the log probability, also far beyond an end."""
    observed, rate, points = table(2, 3, 4, step=6.0)  # many zeros
    given, _ = observed._given(rate, points)
    integrals = observed._integrals
    starts, a = integrals._starts, np.array([[-1.0, 0.0, 1.0], [-2.0, 1.0, 3.0], [0.5, 2.0, 1e4]])
    open_ended = np.isinf(given.rows.low)
    assert 3 < open_ended.sum() < open_ended.size
    pull, bent = starts.pulls_of_ends(given, a)

    def value(a):
        x = (given.rows.high - given.drive - a[:, integrals.rater]) / given.spread
        return np.add.reduceat(
            np.where(open_ended, log_ndtr(np.where(open_ended, x, 0.0)), 0.0), integrals.first, axis=1
        )

    h = 1e-3 * given.spread
    up, here, down = value(a + h), value(a), value(a - h)
    assert_allclose(pull / given.spread, (up - down) / (2.0 * h), rtol=1e-4, atol=1e-4)
    near = np.abs(a) < 100.0
    assert_allclose((bent / given.spread**2)[near], ((2.0 * here - up - down) / h**2)[near], rtol=1e-2, atol=0.1)
    count = np.add.reduceat(open_ended, integrals.first).astype(float)
    assert_allclose(bent[2, 2], count[2])


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_what_is_kept_of_some_widths_is_not_used_for_others(law):
    """Of categories, whose thresholds are parameters: with all of them numbers, intervals have one axis."""
    rng, design = np.random.default_rng(1), design_of(4, 6)
    model, answers = CategoryModel(RISES, law=law, categories=7), rng.integers(2, 7, design.n_rows).astype(float)
    rate = np.linspace(0.0, 30.0, 6) * np.ones((2, 1))

    def log_likelihood(observed, gap):
        given = {"gamma": 1.0, "tau": 0.5, "varsigma": 1.0, "eps": 0.1, "nu": 5.0, "omega": 0.0}
        return observed.log_likelihood(rate, model.take(given | {f"gap_{k}": gap for k in range(2, 7)}))

    used, fresh = CategoryRatings(answers, design, model), CategoryRatings(answers, design, model)
    before = log_likelihood(used, 0.5)
    expected = log_likelihood(fresh, 0.7)
    assert_allclose(log_likelihood(used, 0.7), expected, rtol=1e-12)
    assert (np.abs(before - expected) > 1.0).all()
    # what is kept goes to no other process
    assert pickle.dumps(used) == pickle.dumps(CategoryRatings(answers, design, model))


@pytest.mark.parametrize(("law", "nu"), [(NORMAL, 5.0), (STUDENT, 1e12)])
def test_errors_of_thousands_of_spreads_do_not_overflow(law, nu):
    """Exact numbers far off among narrow intervals, in single precision; warnings are errors here."""
    design, rng = design_of(4, 6), np.random.default_rng(1)
    step = np.where(design.participant < 3, 0.0, 0.01)
    values = np.full(design.n_rows, 5.0)
    values[:5] *= np.exp(4.0)
    said = Stated(values, step, step / 2, np.full(values.size, np.inf))
    observed = IntervalRatings(values, design, IntervalModel(RISES, law=law), stated=said)
    points = points_of(rng, varsigma=1.5e-3, nu=nu, gamma=0.0, tau=0.5)
    found = observed.log_likelihood(np.ones((3, 6)), points)
    assert_allclose(found, observed.finer().log_likelihood(np.ones((3, 6)), points), rtol=1e-6)
