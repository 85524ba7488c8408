"""Inputs whose errors vanish: the likelihood is that of exact inputs, up to a constant."""

import numpy as np
import pytest

from softness_bayes.base.laws import Normal
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from support.report_runs import COARSE, HELD, experiment, quickly

FIXED = {**HELD, "alpha": 40.0}
NAMES = ("b", "sigma_0", "gamma", "varsigma")
"""Sampled parameters."""

NO_SPREAD = {"tau_b": 0.0, "tau_sigma": 0.0}
LIMITS = {
    "moduli": {"modulus_cv": 1e-6},
    "single loads": {"load_cv": 1e-6},
    "shared loads": {"shared_load_cv": 1e-6},
    "finger": {"priors": {"radius": Normal(8.0, 1e-4), "receptor_depth": Normal(0.7, 1e-5)}},
    "fingers of their own": {"individual": ("b",), "fix": FIXED | {"tau_b": 0.0}},
    "answers of their own": {
        "individual": ("gamma", "varsigma"),
        "fix": FIXED | {"tau_gamma": 0.0, "tau_varsigma": 0.0},
    },
    "two quantities of a finger": {"individual": ("b", "sigma_0"), "fix": FIXED | NO_SPREAD},
}
"""Options whose errors almost vanish."""

ERRORS = {"load_cv": 0.3}, {"shared_load_cv": 0.1}, {"individual": ("b",), "fix": FIXED | {"tau_b": 0.6}}
"""Options of real errors, of which the comparison must say so."""


def options_of(changed):
    return ModelOptions(**{"fix": FIXED, "discretisation": COARSE} | changed)


def log_likelihoods(changed):
    """Log-likelihoods at parameters of `NAMES` about those of the ratings, and latent inputs at their medians."""
    with quickly():
        posterior = build(experiment(), options_of(changed)).posterior
        values, rng = posterior.space.values(posterior.space.median), np.random.default_rng(3)
        for name, usual in zip(NAMES, (100.0, 7.0, 0.8, 0.2), strict=True):
            values[name] = usual * np.exp(0.2 * rng.standard_normal(30))
        theta = np.stack(np.broadcast_arrays(*(values[name] for name in posterior.names)), axis=-1)
        return posterior.log_likelihood(theta)


@pytest.mark.parametrize("name", LIMITS)
def test_errors_that_vanish_leave_the_likelihood(name):
    """Up to a constant, which no posterior feels."""
    assert (log_likelihoods(LIMITS[name]) - log_likelihoods({})).std() < 0.02


@pytest.mark.parametrize("changed", ERRORS, ids=lambda changed: next(iter(changed)))
def test_errors_that_do_not_vanish_change_it(changed):
    assert (log_likelihoods(changed) - log_likelihoods({})).std() > 0.5
