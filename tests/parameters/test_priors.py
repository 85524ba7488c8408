"""Priors against SciPy's frozen laws and by quadrature; their written form."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import (
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Signed,
    Truncated,
    Uniform,
    in_short,
)
from softness_bayes.parameters.priors import LAWS, parse_prior


def truncated_lognormal(median, sd, bound):
    """Density by SciPy, the truncation written out independently of the code under test."""
    law = stats.lognorm(sd, scale=median)
    low, high = median * (1 - bound), median * (1 + bound)
    mass = law.cdf(high) - law.cdf(low)
    return lambda x: np.where((x >= low) & (x <= high), law.pdf(x) / mass, 0.0)


CASES = [
    (LogNormal(100, 0.5), stats.lognorm(0.5, scale=100).pdf),
    (LogNormal(0.1, 1), stats.lognorm(1, scale=0.1).pdf),
    (LogNormal(1.05, 0.03, 0.1), truncated_lognormal(1.05, 0.03, 0.1)),
    (LogNormal(2, 0.5, 0.2), truncated_lognormal(2, 0.5, 0.2)),
    (HalfNormal(0.5), stats.halfnorm(scale=0.5).pdf),
    (Normal(-1, 3), stats.norm(-1, 3).pdf),
    (Uniform(1, 3), stats.uniform(1, 2).pdf),
    (LogUniform(0.5, 8), stats.loguniform(0.5, 8).pdf),
    (Signed(LogNormal(1, 0.3)), lambda x: 0.5 * stats.lognorm(0.3).pdf(np.abs(x))),
    (Truncated(Normal(2, 1.5), 1.0, 4.0), stats.truncnorm(-1 / 1.5, 2 / 1.5, 2, 1.5).pdf),
]
IDS = [str(prior) for prior, _ in CASES]


@pytest.mark.parametrize(("prior", "density"), CASES, ids=IDS)
def test_density_is_scipys(prior, density):
    x = np.concatenate([np.linspace(-5, 5, 1001), np.geomspace(1e-3, 1e3, 1001)])
    inside = density(x) > 1e-250
    expected = np.log(density(x)[inside])
    np.testing.assert_allclose(prior.log_density(x)[inside], expected, rtol=1e-11, atol=1e-11)
    far = (x < prior.support[0]) | (x > prior.support[1])
    assert np.all(prior.log_density(x)[far] == -np.inf)


@pytest.mark.parametrize(("prior", "density"), CASES, ids=IDS)
def test_density_integrates_to_one(prior, density):
    low, high = prior.quantile(1e-14), prior.quantile(1 - 1e-14)
    points = np.unique(prior.quantile(np.linspace(0.01, 0.99, 21)))
    total, _ = integrate.quad(lambda x: np.exp(prior.log_density(x)), low, high, points=points, limit=500)
    assert total == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize(("prior", "density"), CASES, ids=IDS)
def test_quantile_inverts_cumulative_and_draws_follow_it(prior, density):
    p = np.linspace(0.001, 0.999, 101)
    np.testing.assert_allclose(prior.cumulative(prior.quantile(p)), p, atol=1e-12)
    draws = prior.draw(np.random.default_rng(5), (40, 100))
    assert draws.shape == (40, 100)
    assert np.all(np.isfinite(prior.log_density(draws)))
    assert stats.kstest(draws.ravel(), prior.cumulative).pvalue > 1e-3
    # negative control: the same draws do not follow a law eight per cent away
    assert stats.kstest(draws.ravel() * 1.08 + 0.05, prior.cumulative).pvalue < 1e-3
    assert prior.cumulative(np.array([-1e9, 1e9])) == pytest.approx([0, 1])


@pytest.mark.parametrize("prior", [case[0] for case in CASES[:-1]], ids=IDS[:-1])
def test_written_form_reads_back(prior):
    assert parse_prior(str(prior)) == prior


def test_written_form_is_the_documented_one():
    assert str(LogNormal(100, 0.5)) == "lognormal(100,0.5)"
    # people read four digits; what machines read keeps them all
    precise = Normal(2.995732273553991, 3.0)
    assert in_short(precise) == "normal(2.996,3)"
    assert parse_prior(str(precise)) == precise
    assert in_short(LogNormal(1.05, 0.03, 0.1)) == str(LogNormal(1.05, 0.03, 0.1))
    assert str(LogNormal(1.05, 0.03, 0.1)) == "lognormal(1.05,0.03,0.1)"
    assert parse_prior(" LogNormal( 1e2 , .5 ) ") == LogNormal(100, 0.5)
    assert set(LAWS) == {"lognormal", "halfnormal", "normal", "uniform", "loguniform"}


def test_extremes_give_minus_infinity_not_warnings():
    law = LogNormal(100, 0.5)
    assert np.all(law.log_density([0.0, -1.0, np.inf]) == -np.inf)
    assert np.isfinite(law.log_density([1e-300, 1e300])).all()
    assert Normal(0, 1e-200).log_density(1.0) == -np.inf


@pytest.mark.parametrize(
    "text",
    [
        "",
        "lognormal",
        "lognormal()",
        "lognormal(100)",
        "lognormal(100,0.5,0.1,2)",
        "lognormal(-1,0.5)",
        "lognormal(1,0)",
        "lognormal(1,0.1,1.5)",
        "normal(0,nan)",
        "normal(0,inf)",
        "uniform(2,1)",
        "cauchy(0,1)",
        "halfnormal(one)",
        "normal(0,1); import os",
    ],
)
def test_wrong_forms_are_refused_with_what_was_expected(text):
    with pytest.raises(InputError, match="expected"):
        parse_prior(text)


def test_a_missing_normalisation_would_be_noticed():
    """Negative control: the two faults of the field, sigma not squared and a missing log sigma."""
    x = np.geomspace(10, 1000, 50)
    oracle = stats.lognorm(0.5, scale=100).logpdf(x)
    law = LogNormal(100, 0.5).log_density(x)
    assert not np.allclose(law + math.log(0.5), oracle, atol=1e-3)
    assert not np.allclose(LogNormal(100, 0.25).log_density(x), oracle, atol=1e-3)
