"""Posteriors that are known without sampling: on a grid in one and two dimensions, and in closed form.

The whole way is taken each time, from priors, coordinates and likelihood through starts, pilot and ensembles.
"""

import functools

import numpy as np
import pytest
from scipy import integrate
from scipy.stats import kstest, norm

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings
from softness_bayes.model.posterior import Posterior
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.sampler.sampling import Settings, sample_until
from support.fake_scene import fake_posterior

SETTINGS = Settings(ensembles=2, processes=1, pilot=(60, 60))


def held(*free):
    """Every usually sampled parameter at its prior's median but for the free ones."""
    usual = [name for name in PARAMETERS if name != "omega"]
    return {name: PARAMETERS[name].prior.median for name in usual if name not in free}


def independent_draws(posterior, seed=1):
    """Draws a tau apart of a run that has converged, shape (draws, parameters)."""
    chains, verdict = sample_until(posterior, SETTINGS, seed)
    assert verdict.converged
    kept = chains.kept(verdict.burn_in)
    apart = posterior.natural(kept.coordinates)[:, :: int(np.ceil(verdict.tau.max()))]
    return apart.reshape(-1, len(posterior.names))


def marginal(axis, density):
    """The distribution function of a density on a grid, by Simpson's rule."""
    mass = integrate.cumulative_simpson(density, x=axis, initial=0.0)
    return functools.partial(np.interp, xp=axis, fp=mass / mass[-1])


def log_density(posterior, theta):
    return posterior.log_prior(theta) + posterior.log_likelihood(theta)


def test_two_free_parameters_equal_quadrature():
    posterior = fake_posterior(fix=held("gamma", "sigma_0"))
    assert posterior.names == ("sigma_0", "gamma")
    draws = independent_draws(posterior)
    middle, width = np.log(draws).mean(axis=0), np.log(draws).std(axis=0)
    axes = [np.exp(np.linspace(m - 7 * w, m + 7 * w, 301)) for m, w in zip(middle, width, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    density = log_density(posterior, points.reshape(-1, 2)).reshape(301, 301)
    density = np.exp(density - density.max())
    for k in (0, 1):
        other = integrate.simpson(density, x=axes[1 - k], axis=1 - k)
        assert kstest(draws[:, k], marginal(axes[k], other)).pvalue > 1e-3, posterior.names[k]
    # the ridge between them, by the expectation of a product
    total = integrate.simpson(integrate.simpson(density, x=axes[1]), x=axes[0])
    product = density * points[..., 0] * points[..., 1]
    mean = integrate.simpson(integrate.simpson(product, x=axes[1]), x=axes[0]) / total
    sampled = draws.prod(axis=1)
    assert sampled.mean() == pytest.approx(mean, abs=4.5 * sampled.std() / len(draws) ** 0.5)
    correlation = np.corrcoef(np.log(draws).T)[0, 1]
    assert abs(correlation) > 0.2  # or the two would be two one-dimensional cases


class LogLinear:
    """A chain whose log response is linear in log b and log m: log(N/N_ref + eps) = 3 + A log b' + B log m'."""

    n_receptors = 250.0
    in_b, in_m = np.linspace(-1.0, 1.0, 6), np.array([0.5, -0.5, 0.3, -0.3, 0.8, 0.1])

    def total_rate(self, parameters):
        b, m = np.log(np.asarray(parameters.b) / 1e5)[..., None], np.log(np.asarray(parameters.m) / 2.0)[..., None]
        return self.n_receptors * (np.exp(3.0 + self.in_b * b + self.in_m * m) - 0.1)


def conjugate():
    """The posterior of b and m, and its normal law in log b' and log m': mean and covariance."""
    people, conditions, rng = 3, 6, np.random.default_rng(8)
    rows = np.arange(people * conditions)
    design = Design(rows % conditions, rows // conditions, np.arange(conditions), people)
    gamma, tau, varsigma = 0.8, 0.4, 0.3
    columns = gamma * np.column_stack([LogLinear.in_b, LogLinear.in_m])[design.condition]
    columns = columns - columns.mean(axis=0)
    log_rating = 2.7 + columns @ [0.3, -0.2] + 0.4 * rng.standard_normal(people)[design.participant]
    log_rating = log_rating + 0.3 * rng.standard_normal(rows.size)
    fix = held("b", "m") | {"gamma": gamma, "tau": tau, "varsigma": varsigma}
    posterior = Posterior(parameter_space(fix=fix), (LogRatings(np.exp(log_rating), design),), LogLinear())
    same = design.participant[:, None] == design.participant
    weight = np.linalg.inv(9.0 + tau**2 * same + varsigma**2 * np.eye(rows.size))
    precision = np.diag([0.5**-2, 0.3**-2]) + columns.T @ weight @ columns
    mean = np.linalg.solve(precision, columns.T @ weight @ (log_rating - np.log(20)))
    return posterior, mean, np.linalg.inv(precision)


def test_a_linear_gaussian_chain_has_the_conjugate_posterior():
    posterior, mean, covariance = conjugate()
    assert posterior.names == ("b", "m")
    draws = np.log(independent_draws(posterior) / [100.0, 2.0])
    for k in (0, 1):
        sd = covariance[k, k] ** 0.5
        assert kstest(draws[:, k], norm(mean[k], sd).cdf).pvalue > 1e-3
        assert kstest(draws[:, k], norm(mean[k] + 0.15 * sd, sd).cdf).pvalue < 1e-3
        assert kstest(draws[:, k], norm(mean[k], 1.2 * sd).cdf).pvalue < 1e-3
    found = np.cov(draws.T)
    np.testing.assert_allclose(found / covariance, 1, atol=0.25)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), (draws - mean).T)
    assert kstest(whitened.sum(axis=0) / np.sqrt(2), norm.cdf).pvalue > 1e-3


def test_the_density_of_the_linear_gaussian_chain_is_the_conjugate_one(rng):
    """Pointwise and to rounding: log density differences are those of the normal law."""
    posterior, mean, covariance = conjugate()
    logs = mean + rng.standard_normal((50, 2)) * 0.5
    z = posterior.space.coordinates(np.exp(logs) * [100.0, 2.0])
    expected = -0.5 * ((logs - mean) @ np.linalg.inv(covariance) * (logs - mean)).sum(axis=1)
    found = posterior(z)
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-8)
