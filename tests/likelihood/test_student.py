"""Tails of the normal and of Student's law against SciPy's, and Student's law against the normal one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import erfcx
from scipy.stats import norm, t

from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.error_laws import (
    LEAST_FREEDOM,
    STUDENT,
    normal_tail_ratio,
    student_log_density,
    student_tail_ratio,
)

ERRORS = np.concatenate([np.linspace(-9.0, 9.0, 181), [-40.0, 33.0, 1e3]])


@pytest.mark.parametrize("nu", [LEAST_FREEDOM, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0, 101.0, 1e4, 1e12])
def test_density_is_that_of_scipy(nu):
    assert_allclose(student_log_density(ERRORS, np.array(nu)), t.logpdf(ERRORS, nu), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("nu", [LEAST_FREEDOM, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0, 1e4])
def test_tails_are_those_of_scipy(nu):
    """Relative to the tail, and of intervals far narrower than the spread to their probabilities."""
    u = np.linspace(0.0, 20.0, 2001)
    found, expected = student_tail_ratio(u, np.array(nu)) * t.pdf(u, nu), t.sf(u, nu)
    assert_allclose(found, expected, rtol=5e-7, atol=1e-300)
    near = u[1:] < 5.0
    assert_allclose(-np.diff(found)[near], -np.diff(expected)[near], rtol=5e-6)


def test_normal_tails_are_those_of_scipy():
    u = np.linspace(0.0, 40.0, 4001)
    found, expected = normal_tail_ratio(u), np.sqrt(np.pi / 2.0) * erfcx(u / np.sqrt(2.0))
    assert_allclose(found[u < 5.0], expected[u < 5.0], rtol=1e-10)
    assert_allclose(found, expected, rtol=1e-5)
    assert_allclose(normal_tail_ratio(u.astype(np.float32)), found, rtol=1e-6)
    assert np.isfinite(normal_tail_ratio(np.array([1e15, -1e15]))).all()


@pytest.mark.parametrize("nu", [LEAST_FREEDOM, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0])
def test_normal_scores_have_the_same_probability(nu):
    near = ERRORS[np.abs(ERRORS) < 8.0]
    expected = np.where(near < 0, norm.ppf(t.cdf(near, nu)), norm.isf(t.sf(near, nu)))
    assert_allclose(STUDENT.normal_scores(near, Parameters(nu=nu)), expected, atol=5e-7)


def test_scores_are_odd_and_rise():
    u = np.linspace(0.0, 50.0, 10001)
    for nu in (LEAST_FREEDOM, 3.0, 50.0):
        score = STUDENT.normal_scores(u, Parameters(nu=nu))
        assert (STUDENT.normal_scores(-u, Parameters(nu=nu)) == -score).all()
        assert (np.diff(score) > 0).all()
