"""The two checks that catch most faults: the log density against independent code, and a run without data."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats

from softness_bayes.errors import NumericalError
from softness_bayes.inference.autocorrelation import autocorrelation_time
from softness_bayes.inference.coordinates import Bent
from softness_bayes.inference.design import Design
from softness_bayes.inference.observation import LogRatings
from softness_bayes.inference.parameters import parameter_space
from softness_bayes.inference.posterior import Posterior
from softness_bayes.inference.sampling import Settings, sample_until
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.reference import reference_response
from softness_bayes.touch.scene import Discretisation, FixedChannels, Scene

FIRING = FixedChannels()
PRIORS = {  # written down again, from model.md 10
    "b": stats.lognorm(0.5, scale=100),
    "m": stats.lognorm(0.3, scale=2),
    "alpha": stats.lognorm(0.1, scale=20.3),
    "beta": stats.lognorm(0.3, scale=0.6),
    "sigma_0": stats.lognorm(0.4, scale=9),
    "gamma": stats.lognorm(0.3, scale=1),
    "tau": stats.halfnorm(scale=1),
    "varsigma": stats.halfnorm(scale=0.5),
}


@pytest.fixture(scope="module")
def posterior():
    """Five participants, three fabrics under two loads, two ratings missing."""
    fine = Discretisation(30, 22.0, 1e-8)
    scene = Scene([3e4, 2e5, 2e6], 0.3, (Indentation(1.5e-3), Force(0.8)), FIRING, discretisation=fine)
    participant, condition = (index.ravel()[2:] for index in np.indices((5, 6)))
    ratings = np.exp(np.random.default_rng(0).normal(2.5, 0.8, participant.size))
    space = replace(parameter_space(), bent={"alpha": Bent(18.0, 0.3)})
    return Posterior(space, scene, LogRatings(ratings, Design(condition, participant, scene.fabric, 5)))


def written_again(posterior, theta):
    """Log prior + log likelihood at one point: radial quadrature, and the normal law of all log ratings at once."""
    value = dict(zip(posterior.names, theta, strict=True))
    log_prior = sum(PRIORS[name].logpdf(x) for name, x in value.items())
    touch = posterior.space.touch(theta)
    rate = reference_response(posterior.scene, touch, law=FIRING.curve).total_rate
    design = posterior.observation.design
    x = np.log(rate / posterior.scene.n_receptors + 0.1)[design.condition]
    same = design.participant[:, None] == design.participant
    n = design.n_rows
    covariance = 9.0 * np.ones((n, n)) + value["tau"] ** 2 * same + value["varsigma"] ** 2 * np.eye(n)
    y = np.log(posterior.observation.ratings)
    law = stats.multivariate_normal(np.log(20) + value["gamma"] * (x - x.mean()), covariance)
    return log_prior + law.logpdf(y) - y.sum()


def test_log_density_agrees_with_independent_code(posterior):
    theta = posterior.space.draw_prior(np.random.default_rng(5), 12)
    z = posterior.space.coordinates(theta)
    exact = np.array([written_again(posterior, point) for point in theta])
    found = posterior(z) - posterior.space.log_jacobian(z)
    np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-4)


@dataclass(frozen=True)
class Nothing:
    """No data."""

    def log_likelihood(self, mean_rate, parameters):
        """Return 0."""
        return np.zeros(np.shape(parameters.gamma))


def test_a_run_without_data_returns_the_prior(posterior):
    """Negative control: the same draws do not pass for a prior whose width is wrong by a fifth."""
    scene = Scene([2e5], 0.3, (Indentation(2e-3),), FIRING, discretisation=Discretisation(4, 6.0, 1e-3))
    empty = Posterior(posterior.space, scene, Nothing())
    settings = Settings(ensembles=2, walkers=40, max_steps=1500, round_steps=500, processes=1)
    chains = sample_until(empty, settings, seed=3).chains
    draws = empty.natural(chains.coordinates)[:, 100:]
    tau = autocorrelation_time(np.moveaxis(draws, -1, 1)).max()
    thinned = draws[:, :: max(int(tau), 1)].reshape(-1, draws.shape[-1])
    for k, name in enumerate(empty.names):
        assert stats.kstest(thinned[:, k], PRIORS[name].cdf).pvalue > 1e-3, name
    assert stats.kstest(thinned[:, 0], stats.lognorm(0.6, scale=100).cdf).pvalue < 1e-6


def test_what_is_not_a_number_names_the_point(posterior):
    @dataclass(frozen=True)
    class Broken:
        def log_likelihood(self, mean_rate, parameters):
            return np.full(np.shape(parameters.gamma), np.nan)

    broken = Posterior(posterior.space, posterior.scene, Broken())
    with pytest.raises(NumericalError, match=r"nan at b=100"):
        broken(posterior.space.coordinates(posterior.space.median)[None])


def test_outside_the_priors_there_is_no_likelihood_to_ask_for(posterior):
    far = posterior.space.coordinates(posterior.space.median)[None] + 50.0
    assert posterior(far) == -np.inf
