"""Samplers of other families on the same posterior: nested sampling by dynesty, and importance sampling."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from softness_bayes.data import Experiment
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
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


@pytest.fixture(scope="module")
def default():
    """The posterior of all eight parameters under the default priors, for ratings of a small scene."""
    scene, rng = CalibrationScene(), np.random.default_rng(20261121)
    values = usual_values(MENDED, given={"alpha": 21.5})
    made = simulate_ratings(rng, scene.fabrics, scene.loads, values, participants=scene.participants)
    posterior = build(
        Experiment(made.ratings, scene.fabrics, ()), ModelOptions(discretisation=Discretisation(8, 9.0, 1e-5))
    ).posterior
    return posterior, ensembles(posterior, 4)


@pytest.mark.slow
def test_importance_sampling_agrees_on_the_whole_chain(rng, default):
    posterior, ours = default
    exact, effective = weighted(posterior, ours, rng, 60_000)
    assert effective > 15_000
    assert apart(ours, exact).max() < 0.04, dict(zip(posterior.names, apart(ours, exact).round(3), strict=True))


@pytest.mark.slow
def test_nested_sampling_agrees_on_the_whole_chain(rng, default):
    """Within its own error: random walks of eight dimensions leave it a few times that of the ensembles."""
    posterior, ours = default
    theirs = nested(posterior, rng, 500, "rwalk")
    found = dict(zip(posterior.names, apart(ours, theirs).round(3), strict=True))
    assert max(found.values()) < 0.13, found
    # what such errors leave visible: half a standard deviation moves a normal distribution by 0.2, less than they allow
    assert apart(ours + 0.75 * ours.std(axis=0), theirs).min() > 0.13
