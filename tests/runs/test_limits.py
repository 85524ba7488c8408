"""Inputs whose errors vanish: the posterior is that of exact inputs, up to Monte-Carlo error."""

import numpy as np
import pytest

from softness_bayes.base.laws import Normal
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.runs.run import sample
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

APART = 4.0
"""Difference of two moments, in its Monte-Carlo errors, above which posteriors differ."""


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


def apart(one, other):
    """Largest difference of moments, in its Monte-Carlo errors."""
    return np.abs((one[0] - other[0]) / np.hypot(one[1], other[1])).max()


@pytest.mark.parametrize("name", LIMITS)
def test_errors_that_vanish_leave_the_likelihood(name):
    """Up to a constant, which no posterior feels."""
    assert (log_likelihoods(LIMITS[name]) - log_likelihoods({})).std() < 0.02


@pytest.mark.parametrize("changed", ERRORS, ids=lambda changed: next(iter(changed)))
def test_errors_that_do_not_vanish_change_it(changed):
    assert (log_likelihoods(changed) - log_likelihoods({})).std() > 0.5


def run_draws(changed):
    """Draws of the logarithms of `NAMES` in a whole run, from its starts to convergence, and their effective sizes."""
    options = options_of(changed)
    given = {name: getattr(options, name) for name in {"fix": None, "discretisation": None} | changed}
    with quickly():
        result = sample(experiment(), seed=5, processes=2, max_steps=20_000, **given)
    assert result.attributes["converged"]
    drawn = result.group("posterior")
    value = np.log(np.stack([drawn[parameter].values.ravel() for parameter in NAMES]))
    return value, result.summary().loc[[*NAMES], "ess_bulk"].to_numpy()


def run_moments(drawn, reference):
    """Return means and standard deviations, each with its Monte-Carlo error.

    Draws are limited to three standard deviations of a reference.

    A lobe of the posterior at a stiff skin holds one draw in a hundred. Whether a run visits it often or rarely would
    decide about its standard deviations, and their errors do not say so.
    """
    value, effective = drawn
    middle, width = reference[0].mean(axis=1, keepdims=True), 3.0 * reference[0].std(axis=1, keepdims=True)
    value = value.clip(middle - width, middle + width)
    away, sd = value - value.mean(axis=1, keepdims=True), value.std(axis=1)
    of_sd = np.sqrt(((away**4).mean(axis=1) - sd**4) / effective) / (2.0 * sd)
    return np.concatenate([value.mean(axis=1), sd]), np.concatenate([sd / np.sqrt(effective), of_sd])


@pytest.fixture(scope="module")
def exact_run(few_pictures):
    return run_draws({})


@pytest.mark.slow
@pytest.mark.parametrize("name", LIMITS)
def test_a_run_has_the_posterior_of_exact_inputs(exact_run, name):
    assert apart(run_moments(run_draws(LIMITS[name]), exact_run), run_moments(exact_run, exact_run)) < APART


@pytest.mark.slow
def test_a_run_with_errors_has_another_posterior(exact_run):
    assert apart(run_moments(run_draws(ERRORS[0]), exact_run), run_moments(exact_run, exact_run)) > 2.0 * APART
