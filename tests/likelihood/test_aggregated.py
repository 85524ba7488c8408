"""Means and standard deviations of n raters, against the law of their single ratings."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2, kstest

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.aggregated import AggregatedModel, RaterSpreads, SpreadModel
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.scales import FALLS

N, FABRICS, CELLS = 7, np.array([0, 0, 1, 1, 2]), 5
ONE_PANEL = Design(np.arange(CELLS), np.zeros(CELLS, int), FABRICS, 1)
EACH = Design(np.tile(np.arange(CELLS), N), np.repeat(np.arange(N), CELLS), FABRICS, N)
NONE = np.empty((1, 0))


def points(rng, size):
    draw = {name: rng.uniform(0.2, 1.2, size) for name in ("gamma", "tau", "varsigma", "omega", "eps")}
    return Parameters(**draw), rng.gamma(1.0, 20.0, (size, CELLS))


def table(rng, people=N, cells=CELLS, tau=0.6, varsigma=0.4):
    """Log ratings of raters with scales of their own, shape (people, cells)."""
    return 2.0 + tau * rng.normal(size=(people, 1)) + varsigma * rng.normal(size=(people, cells))


@pytest.mark.parametrize("omega", [0.0, 0.4])
def test_means_and_deviations_make_the_law_of_single_ratings(omega, rng):
    """For a full table the density of all ratings is that of the means, times that of the deviations from them.

    The deviations are n - 1 independent normal vectors of the cells, whose covariance knows tau and varsigma alone:
    so nothing that ratings say of the response, gamma, mu or omega is lost in the means.
    """
    log = table(rng)
    p, rate = points(rng, 40)
    p = p.replace(omega=np.full(40, omega) * p.omega)
    single = RatingModel(FALLS).observe(np.exp(log).ravel(), EACH).log_likelihood(rate, p)
    means = AggregatedModel(FALLS, raters=N).observe(np.exp(log.mean(axis=0)), ONE_PANEL).log_likelihood(rate, p)
    left = log - log.mean(axis=0)
    between = p.varsigma**2 + CELLS * p.tau**2
    squares = (left.mean(axis=1) ** 2).sum() * CELLS
    rest = (left**2).sum() - squares
    determinant = (CELLS - 1) * np.log(p.varsigma**2) + np.log(between)
    deviations = -0.5 * ((N - 1) * determinant + squares / between + rest / p.varsigma**2)
    lost = single - means - deviations
    assert np.ptp(single) > 10.0
    assert_allclose(lost, lost[0], atol=1e-8 * np.abs(single).max())


@pytest.mark.parametrize("raters", [2, 12, 300, *(pytest.param(raters, marks=pytest.mark.slow) for raters in (3, 60))])
def test_simulated_raters_have_the_law(raters, rng):
    """Standard deviations of simulated single ratings, whose cells share the raters, lie uniformly in it."""
    p = Parameters(tau=np.array([0.6]), varsigma=np.array([0.4]))
    design = Design([0, 1, 2], [0, 0, 0], [0, 1, 2], 1)
    places = []
    for _ in range(150):
        s = table(rng, raters, 3).std(axis=0, ddof=1)
        places.append(RaterSpreads(s, design, SpreadModel(raters)).left_out(NONE, p).below[0])
    assert (np.array(places) > 0).all()
    for column in np.array(places).T:
        assert kstest(column, "uniform").pvalue > 1e-4
    # cells without common raters are refused by the same comparison
    if raters == 12:
        apart = [
            RaterSpreads([table(rng, raters, 1).std(ddof=1) for _ in range(3)], design, SpreadModel(raters))
            .left_out(NONE, p)
            .below[0]
            for _ in range(150)
        ]
        assert min(kstest(column, "uniform").pvalue for column in np.array(apart).T) < 1e-2


def test_no_spread_of_scales_leaves_chi_squares(rng):
    """tau = 0 is no special case: the cells are independent."""
    design = Design([0, 1, 2], [0, 0, 0], [0, 1, 2], 1)
    s = np.array([0.3, 0.5, 0.4])
    p = Parameters(tau=np.array([0.0]), varsigma=np.array([0.4]))
    found = RaterSpreads(s, design, SpreadModel(10)).log_likelihood(NONE, p)
    expected = (chi2.logpdf(9 * s * s / 0.16, 9) + np.log(2 * 9 * s / 0.16)).sum()
    assert_allclose(found, expected, atol=1e-8)


def test_what_is_no_standard_deviation_is_refused():
    one = Design([0], [0], [0], 1)
    for values, raters, said in (([0.0], 5, "not a positive"), ([0.1], 1, "expected at least 2"), ([], 5, "shape")):
        with pytest.raises(InputError, match=said):
            RaterSpreads(values, one, SpreadModel(raters))
