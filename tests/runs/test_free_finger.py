"""Runs in which the finger's radius and the receptors' depth are sampled, from the options to the files."""

import numpy as np
from numpy.testing import assert_allclose

from softness_bayes.base.laws import Normal, Uniform
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_checks import exact_log_likelihood
from softness_bayes.touch.scene import Discretisation
from support.report_runs import HELD, experiment

LAWS = {"radius": Normal(8, 0.5), "receptor_depth": Uniform(0.5, 0.9)}


def test_predictions_use_the_sampled_values(variant_run):
    result = variant_run("finger")
    assert result.group("posterior")["radius"].attrs["units"] == "mm"
    table = result.predict(draws=2000)
    held = table["indentation_mm"].to_numpy() == 2.0
    # under a held indentation the contact radius is sqrt(R delta), which nothing else widens
    assert (table["contact_radius_mm_high"] - table["contact_radius_mm_low"])[held].min() > 0.1
    radius = np.median(result.values()["radius"])
    assert_allclose(table["contact_radius_mm"][held], np.sqrt(2.0 * radius), rtol=5e-3)


def test_the_exactness_check_has_the_fingers_of_the_draws(rng):
    free = build(experiment(), ModelOptions(fix=HELD, discretisation=Discretisation(8, 9.0, 1e-4), priors=LAWS))
    posterior = free.posterior
    theta = np.repeat(posterior.space.median[None], 4, axis=0)
    theta[:, -2:] = [[7.4, 0.55], [8.6, 0.85], [8.0, 0.7], [7.0, 0.88]]
    exact = exact_log_likelihood(posterior, theta)
    assert np.ptp(exact) > 0.5
    assert_allclose(posterior.log_likelihood(theta), exact, atol=0.05)
