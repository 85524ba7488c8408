"""Student's t law against SciPy and the normal law."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm, t

from softness_bayes.likelihood.error_laws import LEAST_FREEDOM, student_log_density, student_normal_score

ERRORS = np.concatenate([np.linspace(-9.0, 9.0, 181), [-40.0, 33.0, 1e3]])


@pytest.mark.parametrize("nu", [LEAST_FREEDOM, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0, 101.0, 1e4, 1e12])
def test_density_is_that_of_scipy(nu):
    assert_allclose(student_log_density(ERRORS, np.array(nu)), t.logpdf(ERRORS, nu), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("nu", [LEAST_FREEDOM, 0.8, 1.0, 2.0, 4.4, 12.0, 99.0])
def test_normal_scores_have_the_same_probability(nu):
    near = ERRORS[np.abs(ERRORS) < 8.0]
    expected = np.where(near < 0, norm.ppf(t.cdf(near, nu)), norm.isf(t.sf(near, nu)))
    assert_allclose(student_normal_score(near, np.array(nu)), expected, atol=3e-6 if nu < 2.0 else 5e-7)


def test_scores_are_odd_and_rise():
    u = np.linspace(-50.0, 50.0, 20001)
    for nu in (LEAST_FREEDOM, 3.0, 50.0):
        score = student_normal_score(u, np.array(nu))
        assert_allclose(score, -score[::-1], rtol=1e-12, atol=1e-12)
        assert (np.diff(score) > 0).all()
