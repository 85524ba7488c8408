"""The expansion of raters' log densities, its error and its limits; the midpoints from which the search starts."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.likelihood import curvatures, rater_integrals
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.interval_law import Rows, scaled_derivatives
from softness_bayes.likelihood.midpoints import lapse_density, weights
from softness_bayes.likelihood.quadrature import FAST, FINE, gauss_hermite
from softness_bayes.likelihood.rater_rows import LawParameters
from softness_bayes.likelihood.scale_modes import each_over_scales, over_scales, series, taylor
from support.interval_tables import table

LAWS = NORMAL, STUDENT, LAPSES


@pytest.fixture(params=LAWS, ids=lambda law: law.name)
def many(request):
    """Six raters with 24 whole numbers each, 3 % of them outliers, and the modes of their scales."""
    observed, rate, points = table(3, 6, 4, law=request.param, step=1.0, outliers=0.03)
    given, _ = observed._given(rate, points)
    return observed, given, observed._integrals.modes(given, 0.01), (rate, points)


def test_a_series_is_its_polynomial():
    t = np.linspace(-1.0, 1.0, 5)
    coefficients = [np.array(2.0), np.array(-1.0), np.array(0.5), np.array(3.0)]
    assert_allclose(taylor(coefficients, t), 2.0 - t + 0.25 * t**2 + 0.5 * t**3, rtol=1e-14)
    assert_allclose(taylor(coefficients, t, 2), 0.5 + 3.0 * t, rtol=1e-14)


def test_derivatives_in_the_level_are_those_of_sums_at_levels(many):
    """The raters' density at levels about the mode, with nodes placed anew at each, and its expansion."""
    observed, given, modes, _ = many
    levels = modes.mu + modes.sd * np.linspace(-2.0, 2.0, 9)
    each = observed._integrals.at_levels(given, modes, series(modes), levels, FAST).sum(axis=-1)
    expanded = [part.sum(axis=-1, keepdims=True) for part in each_over_scales(modes, given.tau, FAST.scales)]
    assert_allclose(taylor(expanded, levels - modes.mu), each, atol=2e-3)
    # without its fourth and third derivative the expansion would be noticed
    for kept in (4, 3):
        lost = np.abs(taylor(expanded[:kept], levels - modes.mu) - each).max()
        assert lost > 5.0 * np.abs(taylor(expanded, levels - modes.mu) - each).max(), kept


def test_sums_over_scales_are_those_at_levels(many):
    observed, given, modes, _ = many
    x, _ = gauss_hermite(FAST.levels)
    each = observed._integrals.at_levels(given, modes, series(modes), modes.mu + modes.sd * x, FAST).sum(axis=-1)
    double, single = (over_scales(modes, given.tau, FAST.levels, FAST.scales, how) for how in (False, True))
    assert_allclose(double, each, rtol=1e-12)
    assert_allclose(single, each, atol=1e-4)
    assert np.abs(single - each).max() > 1e-9  # the precision is in fact lower


def test_raters_far_from_normal_need_more_than_four_derivatives(monkeypatch):
    """Heavy tails with three degrees of freedom: six derivatives serve them to 1e-3, four do not."""
    observed, rate, points = table(8, 12, 4, law=STUDENT, step=1.0, outliers=0.05)
    points = points._replace(nu=np.full_like(points.nu, 3.0))
    given, _ = observed._given(rate, points)
    measure = observed._integrals.modes(given, FAST.settled, True).truncation
    assert ((measure > rater_integrals.FOUR) & (measure < rater_integrals.SIX)).all()
    exact = observed.with_quadrature(FINE).log_likelihood(rate, points)
    fast = observed.with_quadrature(FAST)
    assert np.abs(fast.log_likelihood(rate, points) - exact).max() < 1e-3
    monkeypatch.setattr(rater_integrals, "FOUR", np.inf)
    monkeypatch.setattr(rater_integrals, "SIX", np.inf)
    monkeypatch.setattr(curvatures, "OTHER_SIXTH", np.inf)
    assert np.abs(fast.log_likelihood(rate, points) - exact).max() > 1e-3


@pytest.mark.parametrize("law", [STUDENT, LAPSES], ids=lambda law: law.name)
def test_weights_at_midpoints_are_slopes_and_curvatures_of_exact_numbers(law):
    error = np.linspace(-6.0, 6.0, 49)[None]
    spread, parameters = np.array([[0.4]]), LawParameters(np.array([3.3]), np.array([0.05]))
    rows = Rows(np.zeros(49), np.zeros(49), np.full(49, -2.0))
    lapsed = 0.0
    if law.lapses:
        at_zero = np.exp(law.log_density(np.zeros(1), parameters)) / spread
        lapsed = np.broadcast_to(parameters.lapse * lapse_density(rows) / at_zero, error.shape)
    weight, curvature = weights(law, error, parameters, lapsed)
    _, slope, bend, *_ = scaled_derivatives(law, rows, -0.4 * error, spread, parameters)
    assert_allclose(weight * error, slope, atol=1e-12)
    assert_allclose(weight * curvature, -bend, atol=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_the_search_starts_near_the_modes(law):
    """Typically within a fraction of a standard deviation, which one Newton step removes; never further than two."""
    for step, usual in ((0.0, 0.2), (1.0, 0.5)):
        observed, rate, points = table(7, 6, 4, law=law, step=step, outliers=0.03)
        given, _ = observed._given(rate, points)
        integrals = observed._integrals
        modes = integrals.modes(given, 1e-3)
        distance = np.abs(integrals._starts.near(integrals, given, single=True).a - modes.a) / modes.width
        assert np.median(distance) < usual
        assert distance.max() < 2.0


@pytest.mark.parametrize("step", [0.0, 1.0])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_tiny_errors_overflow_nowhere(law, step):
    """Powers of their inverse are beyond single precision; warnings are errors here."""
    observed, rate, points = table(3, 6, 4, law=law, step=step)
    for spread in (1e-12, 1e-6, 1e-5, 0.031):
        tiny = points._replace(varsigma=np.full_like(points.varsigma, spread))
        assert np.isfinite(observed.log_likelihood(rate, tiny)).all(), spread


def test_the_sixth_derivative_is_estimated_from_the_fourth(monkeypatch):
    """Expansions of four derivatives under Student's t: most of their error is the mean effect of the sixth."""
    errors = []
    monkeypatch.setattr(curvatures, "OTHER_SIXTH", np.inf)
    for estimated in (True, False):
        if not estimated:
            monkeypatch.setattr(rater_integrals.RaterIntegrals, "_sixth", lambda *_: 0.0)
        for seed in range(6):
            observed, rate, points = table(20 + seed, 12, 4, law=STUDENT, step=1.0)
            points = points._replace(nu=np.full_like(points.nu, 8.0))
            measure = observed._integrals.modes(observed._given(rate, points)[0], FAST.settled, True).truncation
            exact = observed.with_quadrature(FINE).log_likelihood(rate, points)
            found = observed.with_quadrature(FAST).log_likelihood(rate, points) - exact
            errors.append(found[measure < rater_integrals.FOUR])
    with_it, without = (np.concatenate(part) for part in (errors[:6], errors[6:]))
    assert with_it.size >= 10
    assert np.sqrt(np.mean(with_it**2)) < 0.6 * np.sqrt(np.mean(without**2))
    assert (without > 0.0).mean() > 0.9  # the sixth derivative is negative


def test_only_laws_with_heavy_tails_have_an_estimate(many):
    observed, given, modes, _ = many
    four = replace(modes, slopes=modes.slopes[:5])
    assert np.any(observed._integrals._sixth(given, four)) == (observed.model.law is STUDENT)
