"""Samplers of other families on the same posterior: nested sampling by dynesty, and importance sampling."""

import numpy as np
import pytest

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
    return posterior.natural(chains.kept(verdict.burn_in, 20_000).coordinates).reshape(-1, len(posterior.names))


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
