"""Student's t law against SciPy and the normal law."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm, t

from softness_bayes.likelihood.student import LEAST, log_below, log_density, normal_score, sixth_over_fourth

ERRORS = np.concatenate([np.linspace(-9.0, 9.0, 181), [-40.0, 33.0, 1e3]])


@pytest.mark.parametrize("nu", [LEAST, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0, 101.0, 1e4, 1e12])
def test_density_is_that_of_scipy(nu):
    assert_allclose(log_density(ERRORS, np.array(nu)), t.logpdf(ERRORS, nu), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("nu", [LEAST, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0])
def test_normal_scores_have_the_same_probability(nu):
    near = ERRORS[np.abs(ERRORS) < 8.0]
    expected = np.where(near < 0, norm.ppf(t.cdf(near, nu)), norm.isf(t.sf(near, nu)))
    assert_allclose(normal_score(near, np.array(nu)), expected, atol=3e-6 if nu < 2.0 else 5e-7)


def test_the_limit_of_many_degrees_of_freedom_is_the_normal_law():
    u = np.linspace(-6.0, 6.0, 121)
    assert_allclose(normal_score(u, np.array(1e12)), u, atol=1e-10)
    assert_allclose(log_density(u, np.array(1e12)), norm.logpdf(u), atol=1e-9)


def test_scores_are_odd_and_rise():
    u = np.linspace(-50.0, 50.0, 20001)
    for nu in (LEAST, 3.0, 50.0):
        score = normal_score(u, np.array(nu))
        assert_allclose(score, -score[::-1], rtol=1e-12, atol=1e-12)
        assert (np.diff(score) > 0).all()


@pytest.mark.parametrize("nu", [LEAST, 2.0, 5.0, 30.0, 1e4])
def test_expected_sixth_derivative_over_the_fourth(nu):
    """Against Taylor series of log(1 + x²/nu) about points, averaged over the law by substituting x = sqrt(nu) tan."""
    angle = (np.arange(4000) + 0.5) / 4000 * np.pi - 0.5 * np.pi
    weight = np.cos(angle) ** (nu - 1.0)
    weight /= weight.sum()
    x = np.tan(angle)
    # 1 + (x + d)² over 1 + x² is a quadratic of d, whose logarithm is the sum of the powers of its inverse roots
    roots = np.array([x + 1j, x - 1j]) / (1.0 + x * x)
    sums = {n: (roots**n).sum(axis=0).real for n in (4, 6)}
    fourth, sixth = (-np.prod(np.arange(1.0, n)) * weight @ sums[n] * (-1.0) ** n for n in (4, 6))
    assert_allclose(sixth_over_fourth(np.array(nu)), sixth / fourth / nu, rtol=1e-6)
    assert sixth_over_fourth(np.array(nu)) < 0.0


def test_the_normal_law_has_no_sixth_derivative():
    assert_allclose(sixth_over_fourth(np.array([1e9, np.inf])), 0.0, atol=1e-7)


@pytest.mark.parametrize("nu", [LEAST, 2.0, 12.0, 99.0, 1e4, 1e12])
def test_log_probability_below_is_that_of_scipy(nu):
    """Of few errors by SciPy's distribution function, unless it underflows, and of many by normal scores."""
    near = ERRORS[np.abs(ERRORS) < 8.0]
    expected = np.log(t.cdf(near, nu))
    few, many = (log_below(np.tile(near, count), np.array([nu]))[: near.size] for count in (1, 9))
    assert_allclose(few, expected, rtol=1e-9, atol=1e-14)
    assert_allclose(many, expected, rtol=3e-5, atol=1e-6)
    assert np.isfinite(log_below(np.array([-1e40, -300.0, 0.0]), np.array([nu]))).all()
