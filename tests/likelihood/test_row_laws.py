"""Probabilities of rows, their derivatives and their limits."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest, norm, t

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT, error_law_named
from softness_bayes.likelihood.row_laws import RowLaw, Rows

LAWS = NORMAL, STUDENT, LAPSES
SPREAD, ONE = np.array([[0.4]]), np.array([[1.0]])
POINT = Parameters(nu=np.array([3.3]), lapse=np.array([0.05]))
WIDTH = np.concatenate([np.zeros(5), 10.0 ** np.linspace(-7.0, 0.6, 20)])
MIDDLE = np.linspace(-2.5, 2.5, 25)
ROWS = Rows(MIDDLE - WIDTH / 2, MIDDLE + WIDTH / 2, np.log(np.linspace(0.01, 0.2, 25)))
EXPECTED = 0.3 * np.sin(np.arange(25.0))[None]


def log_probability(*given):
    return RowLaw(*given).log_probability()


def distribution(law):
    return t(3.3) if law is STUDENT else norm


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_probabilities_are_those_of_scipy(law):
    low, high = ((end - EXPECTED) / SPREAD for end in (ROWS.low, ROWS.high))
    one = distribution(law)
    # from the tail in which both ends are small
    expected = np.where(low > 0, one.sf(low) - one.sf(high), one.cdf(high) - one.cdf(low))
    expected = np.where(WIDTH == 0, one.pdf(low) / SPREAD, expected)
    narrow = (WIDTH > 0) & (WIDTH < 1e-4)  # where the difference has no digits
    expected = np.where(narrow, one.pdf((MIDDLE - EXPECTED) / SPREAD) * WIDTH / SPREAD, expected)
    if law is LAPSES:
        expected = 0.95 * expected + 0.05 * np.exp(ROWS.lapse)
    assert_allclose(log_probability(law, ROWS, EXPECTED, SPREAD, POINT), np.log(expected), atol=1e-5)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_derivatives_are_those_of_differences(law):
    """With respect to the expectation and to the log spread, twice each and mixed."""
    wide = (WIDTH / SPREAD[0] > 2e-3) | (WIDTH == 0)
    exact = RowLaw(law, ROWS, EXPECTED, SPREAD, POINT).terms(noise=True)
    h = 1e-4

    def at(mean, noise):
        return RowLaw(law, ROWS, EXPECTED + mean * h, SPREAD * np.exp(noise * h), POINT).terms(noise=True)

    assert_allclose(exact.value, log_probability(law, ROWS, EXPECTED, SPREAD, POINT), rtol=1e-13)
    for first, second, step in (("of_mean", "of_mean2", (1, 0)), ("of_noise", "of_noise2", (0, 1))):
        up, down = at(*step), at(-step[0], -step[1])
        slope = (up.value - down.value) / (2.0 * h)
        assert_allclose(getattr(exact, first)[:, wide], slope[:, wide], rtol=1e-4, atol=1e-3)
        bend = (getattr(up, first) - getattr(down, first)) / (2.0 * h)
        assert_allclose(getattr(exact, second)[:, wide], bend[:, wide], rtol=1e-4, atol=1e-3)
    mixed = (at(0, 1).of_mean - at(0, -1).of_mean) / (2.0 * h)
    assert_allclose(exact.of_both[:, wide], mixed[:, wide], rtol=1e-4, atol=1e-3)


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


def test_far_intervals_keep_their_digits():
    rows = Rows(np.array([20.0, -21.0, 12.0]), np.array([20.5, -20.5, np.inf]), np.full(3, -np.inf))
    found = log_probability(NORMAL, rows, np.zeros((1, 3)), np.ones((1, 1)), POINT)
    tails = [norm.logsf(20.0) + np.log1p(-np.exp(norm.logsf(20.5) - norm.logsf(20.0))), 0.0, norm.logsf(12.0)]
    tails[1] = norm.logcdf(-20.5) + np.log1p(-np.exp(norm.logcdf(-21.0) - norm.logcdf(-20.5)))
    assert_allclose(found[0], tails, rtol=1e-12)
    for part in RowLaw(NORMAL, rows, np.zeros((1, 3)), np.ones((1, 1)), POINT).terms(noise=True):
        assert np.isfinite(part).all()


@pytest.mark.parametrize("law", [NORMAL, STUDENT], ids=lambda law: law.name)
def test_scores_of_intervals_are_normal(law):
    """Draws put on a coarse grid: scores at uniform shares of their intervals are standard normal."""
    rng, size = np.random.default_rng(3), 4000
    latent = 0.4 + 0.4 * law.draw(rng, (1, size), POINT)[0]
    number = np.floor(np.exp(latent) + 0.5)
    with np.errstate(divide="ignore"):
        rows = Rows(np.log(np.maximum(number - 0.5, 0.0)), np.log(number + 0.5), np.full(size, -np.inf))
    expected = np.full((1, size), 0.4)
    of_rows = RowLaw(law, rows, expected, SPREAD, POINT)
    scores = of_rows.scores(rng.uniform(size=size))[0]
    assert kstest(scores, "norm").pvalue > 1e-3
    assert kstest(of_rows.scores(np.full(size, 0.5))[0], "norm").pvalue < 1e-6
    places = of_rows.below()[0]
    assert_allclose(places.mean(), 0.5, atol=0.02)


def test_points_in_one_call_are_those_alone():
    """Rows are computed by one way for a whole block: the ways agree, and no row takes another's."""
    points = POINT.replace(nu=np.array([0.6, 3.3, 40.0]))
    spread = np.array([[0.02], [0.4], [5.0]])
    together = log_probability(STUDENT, ROWS, np.repeat(EXPECTED, 3, axis=0), spread, points)
    for k in range(3):
        alone = POINT.replace(nu=points.nu[k : k + 1])
        assert_allclose(together[k : k + 1], log_probability(STUDENT, ROWS, EXPECTED, spread[k], alone), rtol=1e-12)


def test_names_of_laws():
    assert error_law_named("student") is STUDENT
    with pytest.raises(InputError, match="'cauchy' is not known, expected normal or student or lapses"):
        error_law_named("cauchy")


@pytest.mark.parametrize("nu", [0.6, 3.3, 40.0])
def test_slopes_of_student_s_log_density_are_those_of_differences(nu):
    point, errors, h = Parameters(nu=np.array([nu])), np.linspace(-9.0, 9.0, 181)[None], 1e-5
    first, second = STUDENT.slopes(errors, point)
    up, down = (t(nu).logpdf(errors + step) for step in (h, -h))
    assert_allclose(first, (up - down) / (2.0 * h), atol=1e-8)
    above, under = (STUDENT.slopes(errors + step, point)[0] for step in (h, -h))
    assert_allclose(second, (above - under) / (2.0 * h), atol=1e-8)
