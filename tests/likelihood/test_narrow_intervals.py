"""Series of densities averaged over narrow intervals, against quadrature, distribution functions and differences."""

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.likelihood import narrow_intervals
from softness_bayes.likelihood.error_laws import NORMAL, STUDENT
from softness_bayes.likelihood.interval_law import Rows, scaled_derivatives
from softness_bayes.likelihood.narrow_series import POWERS, STEEPEST, WIDEST
from softness_bayes.likelihood.rater_rows import LawParameters

ERRORS = np.linspace(-3.0, 3.0, 61)
NUS = 0.5, 2.0, 8.0, 1e6


def averaged(law, errors, half, nu=3.3):
    """Log mean densities and derivatives of one draw, by the series."""
    parameters = LawParameters(np.array([nu]), np.array([0.0]))
    return [part[0] for part in law.averaged(errors[None], np.full((1, errors.size), half**2), parameters)]


def exactly(law, errors, half, nu=3.3):
    """The same by distribution functions."""
    parameters = LawParameters(np.array([nu]), np.array([0.0]))
    rows = Rows(errors - half, errors + half, np.full(errors.size, -np.inf))
    value, *slopes = scaled_derivatives(law, rows, np.zeros((1, errors.size)), np.ones((1, 1)), parameters)
    signed = [(-1) ** k * part[0] for k, part in enumerate(slopes, 1)]
    return [value[0] - np.log(2.0 * half), *signed]


def smooth(law, nu):
    return float(np.ravel(law.smooth(LawParameters(np.array([nu]), np.array([0.0]))))[0])


@pytest.mark.parametrize(("law", "nu"), [(NORMAL, 3.3), *((STUDENT, nu) for nu in NUS)])
def test_errors_fall_with_the_powers_that_are_left_out(law, nu):
    """Half the width, whose square has these powers, leaves a quarter of the error for each power and one more."""
    errors = ERRORS[np.abs(ERRORS) < 1.5]
    half = WIDEST * smooth(law, nu)
    largest = []
    for h in (half, half / 2.0):
        found, wanted = averaged(law, errors, h, nu), exactly(law, errors, h, nu)
        largest.append([np.abs(a - b).max() for a, b in zip(found, wanted, strict=False)])
    wide, narrow = np.array(largest)
    for k, power in enumerate(POWERS[: wide.size]):
        assert wide[k] > 0.45 * 4.0 ** (power + 1) * narrow[k], k
    assert wide[0] < (3e-5 if law is NORMAL or nu > 100.0 else 3e-6)


@pytest.mark.parametrize("law", [NORMAL, STUDENT], ids=lambda law: law.name)
def test_values_are_means_of_the_density(law):
    """Against adaptive quadrature with thirty digits, which knows neither series nor distribution functions."""
    half, nu = 0.1, mpmath.mpf("3.3")

    def density(u):
        if law is NORMAL:
            return mpmath.npdf(u)
        constant = mpmath.gamma((nu + 1) / 2) / mpmath.gamma(nu / 2) / mpmath.sqrt(nu * mpmath.pi)
        return constant * (1 + u * u / nu) ** (-(nu + 1) / 2)

    with mpmath.workdps(30):
        for error in (0.0, 0.7, -2.1):
            mean = mpmath.quad(density, [error - half, error + half]) / (2 * half)
            assert averaged(law, np.array([error]), half)[0][0] == pytest.approx(float(mpmath.log(mean)), abs=2e-8)


@pytest.mark.parametrize("nu", NUS)
def test_derivatives_are_those_of_differences(nu):
    """The first two are exactly those of the value; the third and fourth are so up to the fourth power of the width."""
    h, half = 1e-3, 0.2 * smooth(STUDENT, nu)
    found = averaged(STUDENT, ERRORS, half, nu)
    for k in range(1, 5):
        up, down = (averaged(STUDENT, ERRORS + shift, half, nu)[k - 1] for shift in (h, -h))
        difference = (up - down) / (2.0 * h)
        tolerance = 1e-4 * np.abs(difference).max() if k < 3 else 3e-2 * np.abs(difference).max() + 1e-3
        assert_allclose(found[k], difference, atol=tolerance, err_msg=str(k))


def test_student_s_limit_is_the_normal_law():
    for one, other in zip(averaged(STUDENT, ERRORS, 0.1, 1e12), averaged(NORMAL, ERRORS, 0.1), strict=False):
        assert_allclose(one, other, atol=1e-6)


def test_exact_numbers_are_the_limit():
    exact = narrow_intervals.averaged(ERRORS[None], None, np.array([[3.3]]))
    for one, other in zip(exact, averaged(STUDENT, ERRORS, 1e-6), strict=True):
        assert_allclose(one[0], other, atol=1e-10)


@pytest.mark.parametrize("law", [NORMAL, STUDENT], ids=lambda law: law.name)
def test_rows_beyond_the_series_come_from_distribution_functions(law):
    """Wide intervals and distant ones among narrow ones, to 1000 spreads away, without a warning."""
    errors = np.concatenate([ERRORS, [0.0, 1.0, 8.0, 40.0, 1e3]])
    half = np.concatenate([np.full(ERRORS.size, 0.1), [0.8, 2.0, 0.3, 0.3, 0.3]])
    parameters = LawParameters(np.array([1e4 if law is STUDENT else 3.3]), np.array([0.0]))
    rows, zero = Rows(errors - half, errors + half, np.full(errors.size, -np.inf)), np.zeros((1, errors.size))
    double, single = (scaled_derivatives(law, rows, zero, np.ones((1, 1)), parameters, each) for each in (False, True))
    for k in range(3):
        assert_allclose(single[k], double[k], rtol=3e-4, atol=(1e-5, 1e-5, 3e-4)[k], err_msg=str(k))
    # the series would be wrong there
    steep = (half * errors) ** 2 > 4.0 * STEEPEST
    with np.errstate(all="ignore"):
        series = law.averaged(errors[None], half[None] ** 2, parameters)[0][0]
    wanted = double[0][0] - np.log(2.0 * half)
    assert (np.abs(series - wanted)[steep] > 1e-3).all()
    assert steep.sum() >= 3
