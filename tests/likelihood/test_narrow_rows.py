"""Slopes of raters' log densities by power sums, where rows are narrow, and the starts of the search for modes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import log_ndtr

from softness_bayes.likelihood import narrow_rows
from softness_bayes.likelihood.error_laws import ERROR_LAWS, GUMBEL, NORMAL, STUDENT
from softness_bayes.likelihood.rater_rows import LawParameters
from support.interval_tables import table

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
    assert (errors_of(observed, rate, points) < [5e-6, 2e-4, 5e-4, 3e-3, 4e-3]).all()


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
