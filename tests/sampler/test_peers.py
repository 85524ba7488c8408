"""Samplers of other families on the same posterior: nested sampling by dynesty, and importance sampling."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.sampling import Settings, sample_until
from support.fake_scene import fake_posterior


def nested(posterior, rng, live, walk):
    """Equally weighted draws in natural units, from the priors' quantiles and the likelihood alone."""
    dynesty = pytest.importorskip("dynesty")
    priors = [parameter.prior for parameter in posterior.space.sampled]

    def transform(u):
        return np.array([float(prior.quantile(x)) for prior, x in zip(priors, u, strict=True)])

    def log_likelihood(theta):
        return float(posterior.log_likelihood(theta[None])[0])

    sampler = dynesty.NestedSampler(log_likelihood, transform, len(priors), nlive=live, rstate=rng, sample=walk)
    sampler.run_nested(print_progress=False, dlogz=0.05)
    results = sampler.results
    return results.samples[rng.choice(len(results.samples), 4000, p=results.importance_weights())]


def ensembles(posterior, ensembles=2):
    chains, verdict = sample_until(posterior, Settings(ensembles=ensembles, processes=1), 2)
    assert verdict.converged
    return posterior.natural(chains.kept(verdict.burn_in, 250).coordinates).reshape(-1, len(posterior.names))


def apart(one, other):
    """Largest difference of two samples' distribution functions, for each parameter."""
    found = []
    for a, b in zip(one.T, other.T, strict=True):
        at = np.sort(np.concatenate([a, b]))
        shares = [np.searchsorted(np.sort(x), at, side="right") / x.size for x in (a, b)]
        found.append(np.abs(shares[0] - shares[1]).max())
    return np.array(found)


def test_nested_sampling_agrees_on_the_rating_model(rng):
    held = {"b": 100.0, "m": 2.0, "alpha": 20.3, "beta": 0.6, "sigma_0": 9.0, "tau": 0.5}
    posterior = fake_posterior(fix=held)
    ours, theirs = ensembles(posterior), nested(posterior, rng, 200, "unif")
    assert apart(ours, theirs).max() < 0.1
    # negative control: a posterior wider by a third, and one moved by a third of its width
    mean, sd = theirs.mean(axis=0), theirs.std(axis=0)
    assert apart(ours, mean + 4 / 3 * (theirs - mean)).max() > 0.05
    assert (apart(ours, theirs + sd / 3) > 0.1).all()


def weighted(posterior, draws, rng, size):
    """Draws of the posterior by importance sampling from a wide t law about others; their effective number.

    The law is bent like the draws, or a single far point might have most of the weight.
    """
    z = posterior.space.coordinates(draws)
    bent = TriangularMap.fit(z, len(z) / 10.0)
    y = bent.inverse(z)
    law = multivariate_t(y.mean(axis=0), 1.2 * np.cov(y.T), df=5, seed=rng)
    proposed = law.rvs(size)
    points = bent.forward(proposed)
    density = np.concatenate([posterior(part) for part in np.array_split(points, max(1, size // 1000))])
    log_weight = density - law.logpdf(proposed)
    weights = np.exp(log_weight - log_weight.max())
    weights /= weights.sum()
    return posterior.natural(points)[rng.choice(size, 8000, p=weights)], 1 / (weights**2).sum()


def test_importance_sampling_agrees_on_the_rating_model(rng):
    posterior = fake_posterior(fix={"b": 100.0, "m": 2.0, "alpha": 20.3, "beta": 0.6, "sigma_0": 9.0})
    ours = ensembles(posterior)
    exact, effective = weighted(posterior, ours, rng, 20_000)
    assert effective > 2000
    assert apart(ours, exact).max() < 0.05
    # negative control: where the proposal lies must not decide the answer, and a wrong answer is seen
    moved = ours + 0.5 * ours.std(axis=0)
    again, effective = weighted(posterior, moved, rng, 20_000)
    assert effective > 1000
    assert apart(exact, again).max() < 0.06
    assert apart(moved, exact).min() > 0.1
