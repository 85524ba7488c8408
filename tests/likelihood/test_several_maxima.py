"""Integrals over raters' densities with several maxima, and the curvatures that show where these are needed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import norm, t

from softness_bayes.likelihood import curvatures, several_maxima, student
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.intervals import IntervalRatings
from softness_bayes.likelihood.quadrature import DENSE, FAST, FINE, SAMPLING
from softness_bayes.likelihood.stated import Stated
from support.interval_tables import table


def far_from(points, **values):
    """The points with other values, the same for all."""
    return points._replace(**{name: np.full_like(points.tau, value) for name, value in values.items()})


def two_groups(law, step=0.0, **values):
    """Three raters whose ratings under two of six conditions are far from the others, with noise far smaller."""
    observed, rate, points = table(5, 3, 4, law=law, step=step, spread=0.1)
    rate[:, :3] *= 0.1
    return observed, rate, far_from(points, **{"varsigma": 0.12, "nu": 2.5, "gamma": 3.0, **values})


def by_brute_force(observed, rate, points):
    """The log density of exact ratings, from SciPy's densities on one fine grid of scales and one of levels."""
    given, _ = observed._given(rate, points)
    integrals, found = observed._integrals, []
    for k in range(len(given.drive)):
        spread, tau = given.spread[k, 0], given.tau[k, 0]
        left = given.middle - given.drive[k]
        a = np.linspace(left.min() - 3.0, left.max() + 3.0, 8001)
        level = np.linspace(left.min() - 1.0, left.max() + 1.0, 801)
        law = norm.logpdf(a, level[:, None], tau) + np.log(a[1] - a[0])
        whole = norm.logpdf(level, integrals.mean, integrals.sd)
        for rater in range(integrals.count.size):
            errors = (left[integrals.rater == rater] - a[:, None]) / spread
            if observed.model.law == STUDENT:
                each = t.logpdf(errors, given.parameters.nu[k]) - np.log(spread)
            else:
                lapse = given.parameters.lapse[k]
                lapses = np.exp(given.rows.lapse[integrals.rater == rater])
                each = np.log((1.0 - lapse) * norm.pdf(errors) / spread + lapse * lapses)
            whole = whole + logsumexp(law + each.sum(axis=1), axis=1)
        found.append(logsumexp(whole) + np.log(level[1] - level[0]))
    return np.array(found) - observed._log


@pytest.mark.parametrize("law", [STUDENT, LAPSES], ids=lambda law: law.name)
def test_all_maxima_count(law):
    observed, rate, points = two_groups(law)
    exact = by_brute_force(observed, rate, points)
    assert observed._quadrature.fast or observed.with_quadrature(FAST)._quadrature.fast
    assert_allclose(observed.with_quadrature(FAST).log_likelihood(rate, points), exact, atol=1e-5)
    for reference in (FINE, DENSE):
        assert_allclose(observed.with_quadrature(reference).log_likelihood(rate, points), exact, atol=1e-6)
    # without a search for maxima, as in sampling, a part of the density is lost, or invented
    assert np.abs(observed.with_quadrature(SAMPLING).log_likelihood(rate, points) - exact).max() > 1e-2


@pytest.mark.parametrize("law", [STUDENT, LAPSES], ids=lambda law: law.name)
@pytest.mark.parametrize("step", [0.0, 1.0], ids=["exact", "whole"])
def test_more_points_change_nothing(law, step):
    for values in ({}, {"tau": 2.0}, {"tau": 0.01}, {"varsigma": 0.03}, {"varsigma": 0.05, "tau": 0.002}):
        observed, rate, points = two_groups(law, step, **values)
        given, _ = observed._given(rate, points)
        few, many = (several_maxima.log_density(observed._integrals, given, how) for how in (False, True))
        assert_allclose(few, many, atol=1e-5, err_msg=str(values))


def test_too_few_points_would_be_noticed(monkeypatch):
    observed, rate, points = two_groups(STUDENT)
    given, _ = observed._given(rate, points)
    exact = several_maxima.log_density(observed._integrals, given, True)
    monkeypatch.setattr(several_maxima, "STEP", 2.5)
    assert np.abs(several_maxima.log_density(observed._integrals, given) - exact).max() > 1e-4


def test_a_narrow_window_would_be_noticed(monkeypatch):
    observed, rate, points = two_groups(STUDENT)
    given, _ = observed._given(rate, points)
    exact = several_maxima.log_density(observed._integrals, given, True)
    monkeypatch.setattr(several_maxima, "DROP", 0.0)
    monkeypatch.setattr(several_maxima, "_SLACK", -2.0)
    assert np.abs(several_maxima.log_density(observed._integrals, given) - exact).max() > 1e-4


def test_without_a_spread_of_scales_all_raters_share_the_level():
    """As tau vanishes, the nodes about each level take over, and the density becomes one integral over the level."""
    observed, rate, points = two_groups(STUDENT)
    integrals = observed._integrals

    def at(tau):
        given, _ = observed._given(rate, far_from(points, tau=tau))
        return several_maxima.log_density(integrals, given), given

    found, given = at(0.0)
    level = np.linspace(-4.0, 8.0, 60_001)
    values = integrals.values(given, np.broadcast_to(level[:, None], (len(found), level.size, 3))).sum(axis=-1)
    alone = logsumexp(values + integrals.log_prior(level), axis=1) + np.log(level[1] - level[0])
    assert_allclose(found, alone, atol=1e-6)
    limit = several_maxima.NO_SPREAD * float(given.spread[0, 0]) / np.sqrt(integrals.count.max())
    assert_allclose(at(0.999 * limit)[0], at(1.001 * limit)[0], atol=1e-4)


@pytest.mark.parametrize("law", [STUDENT, LAPSES, NORMAL], ids=lambda law: law.name)
@pytest.mark.parametrize("step", [0.0, 1.0, 4.0], ids=["exact", "whole", "fours"])
def test_near_the_truth_no_draw_is_taken_for_one_with_several_maxima(law, step):
    """Nor are wide intervals, whose log densities have hardly any curvature."""
    observed, rate, points = table(8, 12, 4, law=law, step=step)
    given, _ = observed._given(rate, points)
    integrals = observed._integrals
    modes = integrals.modes(given, FAST.settled, True)
    if step == 4.0 and law != NORMAL:
        assert curvatures._least(integrals, given, modes.curvature).min() < curvatures.CONCAVE
    assert not curvatures.may_have_several_maxima(integrals, given, modes).any()


def test_draws_with_several_maxima_are_found():
    for law in (STUDENT, LAPSES):
        observed, rate, points = two_groups(law)
        given, _ = observed._given(rate, points)
        modes = observed._integrals.modes(given, FAST.settled, True)
        assert curvatures.may_have_several_maxima(observed._integrals, given, modes).all(), law.name


def test_few_rows_have_rules_of_their_own():
    observed, rate, points = table(5, 3, 2, law=STUDENT, spread=0.1)
    given, _ = observed._given(rate, far_from(points, varsigma=0.01))
    modes = observed._integrals.modes(given, FAST.settled, True)
    assert not curvatures.may_have_several_maxima(observed._integrals, given, modes).any()


@pytest.mark.parametrize("nu", [0.6, 1.0, 3.0, 12.0])
def test_expected_derivatives_are_integrals(nu):
    def fourth(u):
        q = nu + u * u
        return (nu + 1.0) * 6.0 * (nu * nu - 6.0 * nu * u * u + u**4) / q**4

    def second(u):
        return (nu + 1.0) * (nu - u * u) / (nu + u * u) ** 2

    for derivative, closed in ((second, student.expected_curvature), (fourth, student.expected_fourth)):
        exact = quad(lambda u, f=derivative: t.pdf(u, nu) * f(u), -np.inf, np.inf)[0]
        assert_allclose(closed(np.array(nu)), exact, rtol=1e-7)


def test_sixth_derivatives_are_computed_where_they_are_not_the_expected_ones(monkeypatch):
    """Noise far larger than the residuals: all rows are near the centre of the law, where derivatives differ."""
    observed, rate, points = table(8, 12, 4, law=STUDENT, spread=0.2, tau=1.5)
    observed = observed.with_quadrature(FAST)
    points = far_from(points, varsigma=1.2, nu=6.0)
    given, _ = observed._given(rate, points)
    modes = observed._integrals.modes(given, FAST.settled, True)
    assert curvatures.have_other_sixth(observed._integrals, given, modes).all()
    exact = observed.with_quadrature(FINE).log_likelihood(rate, points)
    error = np.abs(observed.log_likelihood(rate, points) - exact).max()
    monkeypatch.setattr(curvatures, "OTHER_SIXTH", np.inf)
    assert 4.0 * error < 4e-4 < np.abs(observed.log_likelihood(rate, points) - exact).max()


def test_at_the_truth_sixth_derivatives_are_the_expected_ones():
    observed, rate, points = table(8, 36, 8, law=STUDENT)
    points = far_from(points, gamma=1.0, varsigma=0.35)
    given, _ = observed._given(np.broadcast_to(rate[0], rate.shape), points)
    modes = observed._integrals.modes(given, FAST.settled, True)
    assert not curvatures.have_other_sixth(observed._integrals, given, modes).any()


def test_a_large_spread_of_scales_leaves_the_level_to_its_prior():
    observed, rate, points = two_groups(STUDENT, tau=40.0)
    given, _ = observed._given(rate, points)
    few, many = (several_maxima.log_density(observed._integrals, given, how) for how in (False, True))
    assert_allclose(few, many, atol=1e-5)


def test_raters_who_answer_zero_only_keep_the_limits_of_the_prior():
    observed, rate, points = table(5, 3, 4, law=STUDENT)
    below = np.full(observed.values.size, 20.0)
    zeros = Stated(below / 2, 2 * below, below, np.full(below.size, np.inf))
    walled = IntervalRatings(below / 2, observed.design, observed.model, stated=zeros)
    points = far_from(points, tau=0.05, nu=5.0)
    assert walled._integrals.walled.size == 3
    exact = walled.with_quadrature(FINE).log_likelihood(rate, points)
    assert_allclose(walled.with_quadrature(DENSE).log_likelihood(rate, points), exact, atol=1e-4)


def test_rows_too_far_apart_for_a_scan_are_left_to_other_rules():
    """Noise of 1e-8 would need billions of points."""
    observed, rate, points = two_groups(STUDENT)
    given, _ = observed._given(rate, far_from(points, varsigma=0.0))
    assert not several_maxima.feasible(observed._integrals, given).any()
    assert np.isfinite(observed.with_quadrature(FAST).log_likelihood(rate, far_from(points, varsigma=0.0))).all()


def test_the_form_for_sampling_is_the_same_near_the_data():
    observed, rate, points = table(8, 12, 4, law=STUDENT, step=1.0)
    sampled = observed.for_sampling()
    assert sampled._quadrature == SAMPLING
    assert_allclose(sampled.log_likelihood(rate, points), observed.log_likelihood(rate, points), rtol=0, atol=0)
    few, *_ = table(5, 3, 2, law=STUDENT)
    assert few.for_sampling() is few
