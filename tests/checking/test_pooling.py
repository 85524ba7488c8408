"""Populations by importance weights, against closed forms and a joint grid; weights that fail are refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, LogNormal, Normal
from softness_bayes.checking.pooling import LIMITS, Pooled, PopulationPrior, Separate
from softness_bayes.parameters.coordinates import HalfLine, coordinate_for

PRIOR = PopulationPrior(Normal(0.0, 2.0), HalfNormal(1.0), coordinate_for((-np.inf, np.inf)))
SEEN = {"A": (0.9, 0.3), "B": (0.1, 0.5), "C": (1.6, 0.4), "D": (0.4, 0.25), "E": (1.2, 0.6)}
"""What is measured of each table, and its standard error."""
DRAWS = 2000


def separate(rng, seen, error, prior=PRIOR.mean, draws=DRAWS):
    """Draws of a normal posterior, as many effective ones."""
    precision = error**-2 + prior.sd**-2
    centre = (seen * error**-2 + prior.mean * prior.sd**-2) / precision
    x = centre + rng.standard_normal(draws) / np.sqrt(precision)
    return Separate(x, prior.log_density(x), float(draws))


def tables(rng, seen=SEEN, **given):
    return {name: separate(rng, *one, **given) for name, one in seen.items()}


def closed_form(seen, population=PRIOR):
    """Posterior of mean and spread on a fine grid, the tables' parameters integrated out; and shrunken tables."""
    y, error = np.array([*seen.values()]).T
    mean, spread = np.linspace(-4, 5, 181), (np.arange(160) + 0.5) / 160 * 4
    mu, tau = np.meshgrid(mean, spread, indexing="ij")
    log_density = population.mean.log_density(mu) + population.spread.log_density(tau)
    log_density = log_density + sum(norm.logpdf(a, mu, np.hypot(tau, e)) for a, e in zip(y, error, strict=True))
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    x = np.linspace(-1, 3, 161)
    cdf = {}
    for name, (a, e) in seen.items():
        precision = e**-2 + tau**-2
        centre = (a * e**-2 + mu * tau**-2) / precision
        some = weight > 1e-6
        each = norm.cdf(x[:, None], centre[some], precision[some] ** -0.5)
        cdf[name] = each @ weight[some] / weight[some].sum()
    shrunken = {name: np.interp(LIMITS, c, x) for name, c in cdf.items()}
    return mean, weight.sum(axis=1), spread, weight.sum(axis=0), shrunken


def quantiles(values, weight):
    return np.interp(LIMITS, np.cumsum(weight) - 0.5 * weight, values)


def test_a_linear_gaussian_population(rng):
    """Within four of its own Monte-Carlo errors of the closed form, and these errors are small."""
    found = Pooled(tables(rng), PRIOR)
    mean, of_mean, spread, of_spread, shrunken = closed_form(SEEN)
    assert found.fault == ""
    assert found.mean_mcse < 0.1 * found.mean_sd
    assert found.spread_mcse < 0.1 * found.spread_sd
    np.testing.assert_allclose(found.mean, quantiles(mean, of_mean), atol=6 * found.mean_mcse)
    np.testing.assert_allclose(found.spread, quantiles(spread, of_spread), atol=8 * found.spread_mcse)
    for name, one in found.tables.items():
        np.testing.assert_allclose(one.shrunken, shrunken[name], atol=0.05)
        assert np.ptp(one.shrunken) < np.ptp(one.separate)


def test_stated_errors_are_those_of_repetitions():
    """The mean over new draws of the same posteriors scatters as the Monte-Carlo error says."""
    few = dict([*SEEN.items()][:3])
    found = [Pooled(tables(np.random.default_rng(k), few, draws=300), PRIOR) for k in range(12)]
    scatter = np.std([one.mean[1] for one in found], ddof=1)
    assert 0.5 < scatter / np.mean([one.mean_mcse for one in found]) < 2.0


def test_a_joint_grid_of_two_tables(rng):
    """Likelihoods that are not normal, on a positive scale: against the joint density of all four unknowns."""
    scale, mean, spread = HalfLine(), LogNormal(100.0, 0.5), HalfNormal(0.5)

    def log_likelihood(z, place, skew):  # a skewed one, of z = ln b
        return -np.logaddexp((z - place) / 0.1, -(z - place) / (0.1 * skew))

    shapes = {"A": (4.3, 2.0), "B": (4.9, 0.7)}
    z = np.linspace(2.0, 7.0, 160)
    drawn = {}
    for name, shape in shapes.items():
        fine = np.linspace(2.0, 7.0, 20_001)
        density = np.exp(log_likelihood(fine, *shape) + mean.log_density(np.exp(fine)) + fine)
        cdf = np.cumsum(density) / density.sum()
        x = np.interp(rng.random(DRAWS), cdf, fine)
        drawn[name] = Separate(x, mean.log_density(np.exp(x)) + x, float(DRAWS))
    found = Pooled(drawn, PopulationPrior(mean, spread, scale))
    assert found.fault == ""

    tau = (np.arange(60) + 0.5) / 60 * 2.0
    mu = np.linspace(2.5, 6.5, 80)
    at_mu = mean.log_density(np.exp(mu)) + mu
    of_x = norm.pdf(z[None, None], mu[:, None, None], tau[None, :, None])
    first, second = (np.exp(log_likelihood(z, *shape)) for shape in shapes.values())
    joint = np.einsum(
        "m,t,mtx,mty->mtxy", np.exp(at_mu), np.exp(spread.log_density(tau)), (of_x * first)[..., ::2],
        (of_x * second)[..., ::2], optimize=True,
    )  # fmt: skip
    joint /= joint.sum()
    np.testing.assert_allclose(found.mean, quantiles(mu, joint.sum(axis=(1, 2, 3))), atol=0.03)
    np.testing.assert_allclose(found.spread, quantiles(tau, joint.sum(axis=(0, 2, 3))), atol=0.05)
    np.testing.assert_allclose(found.tables["A"].shrunken, quantiles(z[::2], joint.sum(axis=(0, 1, 3))), atol=0.03)
    np.testing.assert_allclose(found.tables["B"].shrunken, quantiles(z[::2], joint.sum(axis=(0, 1, 2))), atol=0.03)


def test_precise_tables_are_not_lost_between_cells(rng):
    """Of a wide prior, in which a coarse cell is many times as wide as what the tables say."""
    prior = PopulationPrior(Normal(0.0, 50.0), HalfNormal(20.0), coordinate_for((-np.inf, np.inf)))
    seen = {f"P{k}": (3.7 + 0.01 * np.cos(k), 0.01) for k in range(12)}
    found = Pooled(tables(rng, seen, prior=prior.mean, draws=400), prior)
    assert found.fault == ""
    assert found.mean[1] == pytest.approx(3.7, abs=0.01)
    assert found.spread[2] < 0.02


def test_a_further_table_varies_more_than_the_mean(rng):
    found = Pooled(tables(rng, draws=400), PRIOR)
    assert np.ptp(found.new) > 1.5 * np.ptp(found.mean)
    assert found.new[1] == pytest.approx(found.mean[1], abs=0.1)


# negative controls


def test_a_prior_that_hides_the_population_is_refused(rng):
    """Many weak tables agree on a place that the separate prior hardly lets any of them reach."""
    narrow = Normal(0.0, 0.5)
    weak = {f"P{k}": (4.0, 0.8) for k in range(12)}
    drawn = tables(rng, weak, prior=narrow, draws=1000)
    found = Pooled(drawn, PopulationPrior(Normal(0.0, 5.0), HalfNormal(1.0), coordinate_for((-np.inf, np.inf))))
    assert found.failing
    assert "fail" in found.fault
    assert "wider prior" in found.fault
    wide = Pooled(
        tables(rng, weak, prior=Normal(0.0, 5.0), draws=1000),
        PopulationPrior(Normal(0.0, 5.0), HalfNormal(1.0), coordinate_for((-np.inf, np.inf))),
    )
    assert wide.fault == ""


def test_draws_far_apart_are_refused(rng):
    """No spread that the prior allows reaches from one to the other."""
    far = {"A": (0.0, 1e-3), "B": (1e3, 1e-3)}
    wide = Normal(0.0, 1e4)
    found = Pooled(
        tables(rng, far, prior=wide), PopulationPrior(wide, HalfNormal(0.1), coordinate_for((-np.inf, np.inf)))
    )
    assert found.fault


def test_few_effective_draws_are_refused(rng):
    """Of chains that hardly moved, however many draws they have."""
    drawn = {name: one._replace(effective=20.0) for name, one in tables(rng, draws=400).items()}
    assert Pooled(drawn, PRIOR).failing == [*SEEN]


def test_one_table_is_no_population(rng):
    with pytest.raises(InputError, match="at least 2"):
        Pooled(tables(rng, {"A": (0.0, 1.0)}), PRIOR)
