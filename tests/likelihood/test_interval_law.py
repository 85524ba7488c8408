"""Probabilities of intervals, their derivatives and their limits."""

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest, norm, t

from softness_bayes.errors import InputError
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT, error_law_named
from softness_bayes.likelihood.interval_law import NARROW, Rows, derivatives, log_probability, scaled_derivatives
from softness_bayes.likelihood.interval_rule import REACHES, by_rule, rule
from softness_bayes.likelihood.rater_rows import LawParameters
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.row_scores import below, score_at

LAWS = NORMAL, STUDENT, LAPSES
SPREAD, ONE = np.array([[0.4]]), np.array([[1.0]])
POINT = RatingParameters(*[np.ones(1)] * 8, np.array([3.3]), np.array([0.05]))
WIDTH = np.concatenate([np.zeros(5), 10.0 ** np.linspace(-7.0, 0.6, 20)])
MIDDLE = np.linspace(-2.5, 2.5, 25)
ROWS = Rows(MIDDLE - WIDTH / 2, MIDDLE + WIDTH / 2, np.log(np.linspace(0.01, 0.2, 25)))
EXPECTED = 0.3 * np.sin(np.arange(25.0))[None]


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
    assert_allclose(log_probability(law, ROWS, EXPECTED, SPREAD, POINT), np.log(expected), atol=2e-6)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_derivatives_are_those_of_differences(law):
    def at(shift):
        return derivatives(law, ROWS, EXPECTED + shift, SPREAD, POINT)

    h = 1e-3
    exact = at(0.0)
    assert_allclose(exact[0], log_probability(law, ROWS, EXPECTED, SPREAD, POINT), rtol=1e-13)
    for k in range(1, 5):
        each = [at(j * h)[k - 1] for j in (-2, -1, 1, 2)]
        difference = (each[0] - 8.0 * each[1] + 8.0 * each[2] - each[3]) / (12.0 * h)
        wide = WIDTH / SPREAD[0] > 2.0 * NARROW
        assert_allclose(exact[k][:, wide | (WIDTH == 0)], difference[:, wide | (WIDTH == 0)], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("law", [NORMAL, STUDENT], ids=lambda law: law.name)
def test_grids_sum_to_one(law):
    """Whole numbers from 0 on, of which 0 has no lower end: all their probabilities together."""
    edge = np.log(np.arange(0, 300_000, dtype=float) + 0.5)
    rows = Rows(np.concatenate([[-np.inf], edge[:-1]]), edge, np.full(edge.size, -np.inf))
    for expected in (-2.0, 3.0):
        found = np.exp(log_probability(law, rows, np.full((1, edge.size), expected), SPREAD, POINT)).sum()
        beyond = distribution(law).sf((edge[-1] - expected) / 0.4)
        assert_allclose(found + beyond, 1.0, atol=1e-9)


def test_limits_are_the_normal_density():
    """Resolution to 0, degrees of freedom to infinity, lapses to 0: the closed form's density, to 1e-10."""
    exact = Rows(MIDDLE, MIDDLE, np.full(25, -1.0))
    expected = norm.logpdf(MIDDLE, EXPECTED, 0.4)
    assert_allclose(log_probability(NORMAL, exact, EXPECTED, SPREAD, POINT), expected, rtol=1e-12)
    for width in (1e-5, 1e-6):
        fine = Rows(MIDDLE - width / 2, MIDDLE + width / 2, exact.lapse)
        found = log_probability(NORMAL, fine, EXPECTED, SPREAD, POINT) - np.log(fine.high - fine.low)
        assert_allclose(found, expected, atol=1e-8 * (width / 1e-5) ** 2 + 1e-10)
    many, never = POINT._replace(nu=np.array([1e12])), POINT._replace(lapse=np.zeros(1))
    assert_allclose(log_probability(STUDENT, exact, EXPECTED, SPREAD, many), expected, atol=1e-9)
    assert_allclose(log_probability(LAPSES, exact, EXPECTED, SPREAD, never), expected, atol=1e-12)


def test_far_intervals_keep_their_digits():
    rows = Rows(np.array([20.0, -21.0, 12.0]), np.array([20.5, -20.5, np.inf]), np.full(3, -np.inf))
    found = log_probability(NORMAL, rows, np.zeros((1, 3)), np.ones((1, 1)), POINT)
    tails = [norm.logsf(20.0) + np.log1p(-np.exp(norm.logsf(20.5) - norm.logsf(20.0))), 0.0, norm.logsf(12.0)]
    tails[1] = norm.logcdf(-20.5) + np.log1p(-np.exp(norm.logcdf(-21.0) - norm.logcdf(-20.5)))
    assert_allclose(found[0], tails, rtol=1e-12)
    for part in derivatives(NORMAL, rows, np.zeros((1, 3)), np.ones((1, 1)), POINT):
        assert np.isfinite(part).all()


@pytest.mark.parametrize("law", [NORMAL, LAPSES], ids=lambda law: law.name)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_derivatives_far_from_an_interval_keep_their_digits(law, side):
    """Against 80 digits: intervals with one or two finite ends, 90 to 1e12 spreads away; lapses leave nothing there."""
    away = np.array([90.0, 120.0, 1e3, 1e5, 1e8, 1e10, 1e12])

    def log_mass(z, width):
        # by symmetry the mass above a distance z, less that above z + width
        above = [mpmath.erfc(x / mpmath.sqrt(2)) for x in ((z,) if np.isinf(width) else (z, z + width))]
        return mpmath.log(above[0] - sum(above[1:]))

    for width in (0.7, np.inf):
        low, high = (np.full(away.size, end) for end in ((0.0, width) if side > 0 else (-width, 0.0)))
        found = scaled_derivatives(law, Rows(low, high, np.full(away.size, -3.0)), -side * away[None], ONE, POINT)
        if law is LAPSES:
            assert_allclose(found[0], np.full((1, away.size), np.log(0.05) - 3.0), rtol=1e-12)
            assert_allclose(found[1:], np.zeros((4, 1, away.size)), atol=1e-300)
            continue
        with mpmath.workdps(80):
            known = [mpmath.taylor(lambda z, w=width: log_mass(z, w), mpmath.mpf(z), 4) for z in away[:4]]
        for order in range(1, 5):
            truth = [float(exact[order] * mpmath.factorial(order)) * (-side) ** order for exact in known]
            # the series end after 1/c^4 relative to their first term
            assert_allclose(found[order][0, 1:4], truth[1:], rtol=10.0 ** (order - 9), err_msg=str(order))
            # nearer, by moments, which have lost some digits
            assert_allclose(found[order][0, 0], truth[0], rtol=1e-9, atol=10.0 ** (2 * order - 11))
        assert_allclose(found[1][0, 4:], side * away[4:], rtol=1e-15)
        assert_allclose(found[2][0, 4:], -1.0, rtol=1e-15)
        assert_allclose(np.abs(found[3:])[..., 4:], 0.0, atol=1e-20)


def test_an_expectation_at_the_end_of_an_open_interval_among_outlying_ones():
    """Its distance is 0 and the interval infinite: their product is not a number, and must not be formed."""
    low, high = np.array([0.0, 1e3]), np.array([np.inf, 1e3 + 1.0])
    found = scaled_derivatives(NORMAL, Rows(low, high, np.full(2, -3.0)), np.zeros((1, 2)), ONE, POINT)
    assert np.isfinite(found).all()
    # half of the law lies in the first interval: slopes of log(ndtr) at 0
    density = np.sqrt(2.0 / np.pi)
    assert_allclose([part[0, 0] for part in found[:3]], [np.log(0.5), density, -(density**2)], rtol=1e-12)


@pytest.mark.parametrize("law", [NORMAL, STUDENT], ids=lambda law: law.name)
def test_scores_of_intervals_are_normal(law):
    """Draws put on a coarse grid: scores at uniform shares of their intervals are standard normal."""
    rng, size = np.random.default_rng(3), 4000
    latent = 0.4 + 0.4 * law.draw(rng, (1, size), POINT)[0]
    number = np.floor(np.exp(latent) + 0.5)
    with np.errstate(divide="ignore"):
        rows = Rows(np.log(np.maximum(number - 0.5, 0.0)), np.log(number + 0.5), np.full(size, -np.inf))
    expected = np.full((1, size), 0.4)
    scores = score_at(law, rows, rng.uniform(size=size), expected, SPREAD, POINT)[0]
    assert kstest(scores, "norm").pvalue > 1e-3
    assert kstest(score_at(law, rows, np.full(size, 0.5), expected, SPREAD, POINT)[0], "norm").pvalue < 1e-6
    places = below(law, rows, expected, SPREAD, POINT)[0]
    assert_allclose(places.mean(), 0.5, atol=0.02)


@pytest.mark.parametrize("inside", [reach.inside for reach in REACHES])
def test_rules_are_exact_for_polynomials(inside):
    points, weights, at_ends = rule(inside)
    for degree in range(2 * inside + 8):
        coefficients = np.eye(degree + 1)[-1]
        found = weights @ np.polynomial.Legendre(coefficients)(points)
        for j, weight in enumerate(at_ends):
            low, high = np.polynomial.Legendre(coefficients).deriv(j)(np.array([-1.0, 1.0]))
            found += weight * (low + (-1) ** j * high)
        assert_allclose(found, 2.0 if degree == 0 else 0.0, atol=1e-11)
    # and no further
    beyond = np.polynomial.Legendre(np.eye(2 * inside + 9)[-1])
    ends = sum(w * 2.0 * beyond.deriv(j)(1.0) * (-1) ** j for j, w in enumerate(at_ends))
    assert abs(weights @ beyond(points) + ends) > 1e-6


@pytest.mark.parametrize("nu", [0.5, 1.0, 2.0, 4.0, 8.0, 30.0, 300.0, np.inf])
def test_the_rule_serves_intervals_to_one_in_ten_million(nu):
    """Of every width that it takes, near and far; narrower and wider ones, and steep ones, are refused."""
    law, one = (NORMAL, norm) if nu == np.inf else (STUDENT, t(nu))
    parameters = POINT._replace(nu=np.array([nu]))
    middle = np.linspace(0.0, 30.0, 700)
    for factor in (0.01, 0.1, *(reach.widest for reach in REACHES)):
        half = np.full(middle.size, 0.5 * factor * np.ravel(law.smooth(parameters))[0] * (1.0 - 1e-9))
        low, high = middle - half, middle + half
        served = by_rule(law, middle[None], half[None], NARROW, parameters)
        good = served.good
        exact = np.where(low > 0, one.sf(low) - one.sf(high), one.cdf(high) - one.cdf(low))[good]
        assert_allclose(served.probability[0, good] * one.pdf(0.0), exact, rtol=1e-7)
        assert good[: good.size // 60].all()  # up to errors of 0.5
        assert nu < np.inf or factor < 0.2 or not good[-1]
    assert not by_rule(law, middle[None], 1.1 * half[None], NARROW, parameters).good.any()
    assert not by_rule(law, middle[None], np.full_like(half, 0.45 * NARROW)[None], NARROW, parameters).good.any()


def test_points_in_one_call_are_those_alone():
    """Rows are computed by one way for a whole block: the ways agree, and no row takes another's."""
    points = POINT._replace(nu=np.array([0.6, 3.3, 40.0]))
    spread = np.array([[0.02], [0.4], [5.0]])
    together = log_probability(STUDENT, ROWS, np.repeat(EXPECTED, 3, axis=0), spread, points)
    for k in range(3):
        alone = POINT._replace(nu=points.nu[k : k + 1])
        assert_allclose(together[k : k + 1], log_probability(STUDENT, ROWS, EXPECTED, spread[k], alone), atol=2e-7)


def test_names_of_laws():
    assert error_law_named("student") is STUDENT
    with pytest.raises(InputError, match="'cauchy' is not known, expected normal or student or lapses"):
        error_law_named("cauchy")


@pytest.mark.parametrize("nu", [0.5, 3.0, 30.0, 1e9])
def test_derivatives_of_student_s_log_density_are_those_of_the_density(nu):
    """The closed forms of exact numbers, against the cumulants of the derivatives of the density over itself."""
    point = LawParameters(np.array([nu]), np.array([0.05]))
    error = np.linspace(-9.0, 9.0, 181)[None]
    found = STUDENT.averaged(error, None, point)
    one, two, three, four = STUDENT.slopes(error, point, 4)
    expected = (
        STUDENT.log_density(error, point),
        one,
        two - one**2,
        three - 3.0 * two * one + 2.0 * one**3,
        four - 4.0 * three * one - 3.0 * two**2 + 12.0 * two * one**2 - 6.0 * one**4,
    )
    for part, wanted in zip(found, expected, strict=True):
        assert_allclose(part, wanted, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize("width", [0.0, 0.1, 0.9], ids=["exact", "narrow", "wide"])
def test_fifth_and_sixth_derivatives_are_those_of_differences(law, width):
    rows = Rows(MIDDLE - width / 2, MIDDLE + width / 2, ROWS.lapse)

    def at(shift):
        return scaled_derivatives(law, rows, EXPECTED + shift * SPREAD, SPREAD, POINT, orders=6)

    h, found = 1e-2, at(0.0)
    for k in range(1, 5):
        assert_allclose(found[k], scaled_derivatives(law, rows, EXPECTED, SPREAD, POINT)[k], rtol=1e-9, atol=1e-9)
    for k in (5, 6):
        each = [at(j * h)[k - 1] for j in (-2, -1, 1, 2)]
        difference = (each[0] - 8.0 * each[1] + 8.0 * each[2] - each[3]) / (12.0 * h)
        assert_allclose(found[k], difference, rtol=1e-3, atol=1e-3 * np.abs(difference).max() + 2e-4)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_single_precision_errs_in_the_sixth_digit(law):
    """Of intervals and exact numbers; with lapses exact numbers keep double precision."""
    wide = np.linspace(0.02, 0.9, 25)
    point = LawParameters(np.array([3.3]), np.array([0.05]))
    for width, largest in ((wide, 3e-6), (np.zeros(25), 0.0 if law.lapses else 3e-6)):
        rows = Rows(MIDDLE - width / 2, MIDDLE + width / 2, ROWS.lapse)
        double, single = (scaled_derivatives(law, rows, EXPECTED, SPREAD, point, each) for each in (False, True))
        error = np.abs(single[0] - double[0]).max()
        assert error <= largest
        assert (error > 1e-9) == (largest > 0.0)  # the precision is in fact lower
        for one, other in zip(single[1:], double[1:], strict=law != NORMAL):
            assert_allclose(one, other, atol=2e-4 * np.abs(other).max() + 5e-3)


def test_intervals_too_improbable_for_single_precision_are_computed_in_double():
    point, far = LawParameters(np.array([3.3]), np.array([0.05])), np.array([0.0, 11.0, 14.0, 30.0])
    rows = Rows(far - 0.1, far + 0.1, np.full(4, -np.inf))
    zero = np.zeros((1, 4))
    double, single = (scaled_derivatives(NORMAL, rows, zero, ONE, point, each) for each in (False, True))
    assert_allclose(single[0], double[0], rtol=1e-6)
    assert np.isfinite(single).all()
