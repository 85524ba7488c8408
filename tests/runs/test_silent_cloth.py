"""Cloth that hardly makes receptors fire under the default priors: it is sampled, and its silence is said."""

import numpy as np
import pytest

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.sampler.starts import find_optimum
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation

REAL = np.array([1e3, 4e3, 1.2e4, 4e4, 1.1e5])
"""E_fab [Pa] between the 5 and 95 % quantiles of real cloth."""

CLOTH = {
    "four fabrics under one load": (np.geomspace(3e3, 6e5, 4), (2e-3,)),
    "real cloth, pressed firmly": (REAL, (1e-3, 2e-3, 3e-3)),
    "real cloth, pressed lightly": (REAL, (1e-3,)),
    "a single fabric": (REAL[2:3], (2e-3,)),
}


def experiment(modulus, depths, seed=0):
    names = tuple(f"f{k}" for k in range(len(modulus)))
    fabrics = Fabrics(names, effective_modulus=np.asarray(modulus))
    loads, rng = tuple(Indentation(depth) for depth in depths), np.random.default_rng(seed)
    made = simulate_ratings(rng, fabrics, loads, usual_values(MENDED), participants=8)
    return Experiment(made.ratings, fabrics, ())


@pytest.mark.parametrize(
    "name",
    [
        "real cloth, pressed lightly",
        "a single fabric",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("four fabrics under one load", "real cloth, pressed firmly")
        ),
    ],
)
def test_walkers_find_a_place_to_start(name):
    posterior = build(experiment(*CLOTH[name]), ModelOptions(discretisation=Discretisation())).posterior
    plain = posterior.mean_rate(posterior.space.draw_prior(np.random.default_rng(0), 500))
    assert (plain == 0).mean() > 0.5
    z = posterior.draw_start(np.random.default_rng(1), 32)
    rate = posterior.mean_rate(posterior.natural(z))
    assert ((rate > 0).sum(axis=-1) >= min(3, rate.shape[-1])).all()
    start = posterior(z)
    assert np.isfinite(start).all()
    assert find_optimum(posterior, np.random.default_rng(2)).log_density > start.max()
