"""Probabilities of rows: their sums, limits and digits."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm, t

from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.row_laws import RowLaw, Rows

SPREAD = np.array([[0.4]])
POINT = Parameters(nu=np.array([3.3]), lapse=np.array([0.05]))
MIDDLE = np.linspace(-2.5, 2.5, 25)
EXPECTED = 0.3 * np.sin(np.arange(25.0))[None]


def log_probability(*given):
    return RowLaw(*given).log_probability()


def distribution(law):
    return t(3.3) if law is STUDENT else norm


@pytest.mark.parametrize("law", [NORMAL, STUDENT], ids=lambda law: law.name)
def test_grids_sum_to_one(law):
    """Whole numbers from 0 on, of which 0 has no lower end: all their probabilities together."""
    edge = np.log(np.arange(0, 300_000, dtype=float) + 0.5)
    rows = Rows(np.concatenate([[-np.inf], edge[:-1]]), edge, np.full(edge.size, -np.inf))
    for expected in (-2.0, 3.0):
        found = np.exp(log_probability(law, rows, np.full((1, edge.size), expected), SPREAD, POINT)).sum()
        beyond = distribution(law).sf((edge[-1] - expected) / 0.4)
        assert_allclose(found + beyond, 1.0, atol=1e-6)


def test_limits_are_the_normal_density():
    """Resolution to 0, degrees of freedom to infinity, lapses to 0: the closed form's density, to 1e-10."""
    exact = Rows(MIDDLE, MIDDLE, np.full(25, -1.0))
    expected = norm.logpdf(MIDDLE, EXPECTED, 0.4)
    assert_allclose(log_probability(NORMAL, exact, EXPECTED, SPREAD, POINT), expected, rtol=1e-12)
    for width in (1e-5, 1e-6):
        fine = Rows(MIDDLE - width / 2, MIDDLE + width / 2, exact.lapse)
        found = log_probability(NORMAL, fine, EXPECTED, SPREAD, POINT) - np.log(fine.high - fine.low)
        assert_allclose(found, expected, atol=1e-8 * (width / 1e-5) ** 2 + 1e-10)
    many, never = POINT.replace(nu=np.array([1e12])), POINT.replace(lapse=np.zeros(1))
    assert_allclose(log_probability(STUDENT, exact, EXPECTED, SPREAD, many), expected, atol=1e-9)
    assert_allclose(log_probability(LAPSES, exact, EXPECTED, SPREAD, never), expected, atol=1e-12)


@pytest.mark.parametrize("law", [NORMAL, STUDENT, LAPSES], ids=lambda law: law.name)
@pytest.mark.parametrize("width", [3.0, 0.1, 0.01, 1e-3, 1e-5, 1e-9, 0.0])
def test_single_precision_errs_by_its_digits_over_the_width(law, width):
    """Against double precision: an interval's probability is a difference of tails, so narrow ones lose most."""
    rows = Rows(MIDDLE - width / 2, MIDDLE + width / 2, np.full(25, -1.0))
    single, double = (RowLaw(law, rows, EXPECTED, SPREAD, POINT, real).terms(True) for real in (np.float32, np.float64))
    lost = 4e-7 * (1.0 + 0.4 / max(width, 5e-4)) if width else 4e-7
    for some, exact, by in zip(single, double, (1.0, 2.0, 10.0, 2.0, 10.0, 10.0), strict=True):
        assert some.dtype == np.float32
        near = np.abs(MIDDLE - EXPECTED[0]) < 2.0
        assert_allclose(some[:, near], exact[:, near], rtol=by * lost, atol=by * lost)


def test_far_intervals_keep_their_digits():
    rows = Rows(np.array([20.0, -21.0, 12.0]), np.array([20.5, -20.5, np.inf]), np.full(3, -np.inf))
    found = log_probability(NORMAL, rows, np.zeros((1, 3)), np.ones((1, 1)), POINT)
    tails = [norm.logsf(20.0) + np.log1p(-np.exp(norm.logsf(20.5) - norm.logsf(20.0))), 0.0, norm.logsf(12.0)]
    tails[1] = norm.logcdf(-20.5) + np.log1p(-np.exp(norm.logcdf(-21.0) - norm.logcdf(-20.5)))
    assert_allclose(found[0], tails, atol=1e-6)  # relative to the probability: of Mills' ratio beyond 10
    for part in RowLaw(NORMAL, rows, np.zeros((1, 3)), np.ones((1, 1)), POINT).terms(noise=True):
        assert np.isfinite(part).all()
