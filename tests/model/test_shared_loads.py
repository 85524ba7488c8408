"""Loads whose error all ratings share: the line in it against sums over the factors, and what a run makes of it."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import logsumexp

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.errors import InputError
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import RatingModel, spreads_of
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.scales import STANDARDISED
from softness_bayes.likelihood.shared_loads import SharedLoads
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import scaled, scene_of, touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.results.exact import exact_log_likelihood
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation

COARSE = Discretisation(10, 10.0, 1e-5)
LOADS = (Indentation(2e-3), Force(1.5))
CLOTH = Fabrics(("a", "b", "c"), effective_modulus=np.array([40.0, 160.0, 500.0]) * 1e3)
FREE = ("gamma", "varsigma")


def made(loads=LOADS, given=None, **changed):
    values = usual_values(MENDED, given=given)
    simulation = simulate_ratings(
        np.random.default_rng(3), CLOTH, loads, values, participants=4, discretisation=COARSE, **changed
    )
    return Experiment(simulation.ratings, CLOTH, ())


def options(**changed):
    usual = usual_values(MENDED)
    held = {name: usual[name] for name in PARAMETERS if name not in FREE and name != "omega"}
    return ModelOptions(**{"fix": held, "discretisation": COARSE, **changed})


def over_factors(experiment, posterior, theta, cv):
    """Log density by a dense sum over both loads' factors, the scene compiled for each load that they may be."""
    sd, z = np.sqrt(np.log1p(cv**2)), np.linspace(-4.8, 4.8, 25)
    conditions, held = experiment.ratings.conditions, usual_values(MENDED)
    loads = tuple(scaled(load, float(np.exp(sd * step))) for load in experiment.ratings.loads for step in z)
    every = scene_of(experiment.fabrics, loads, held, MENDED, discretisation=COARSE)
    rate = (every.total_rate(touch_parameters(held)) / every.n_receptors).reshape(2, z.size, -1)
    plain = build(experiment, options()).posterior.observation
    found = []
    for point in theta:
        p = posterior.rating_parameters(point)
        stated = rate[conditions.load, z.size // 2, conditions.fabric]
        terms = np.empty((z.size, z.size))
        for i, j in np.ndindex(terms.shape):
            held_at = rate[conditions.load, np.array([i, j])[conditions.load], conditions.fabric]
            density = plain._effects.log_density(plain.drive_at(held_at, stated, p), spreads_of(p))
            terms[i, j] = density - 0.5 * (z[i] ** 2 + z[j] ** 2)
        found.append(logsumexp(terms) - 2.0 * logsumexp(-0.5 * z**2) - np.log(plain.values).sum())
    return np.array(found)


def test_where_the_response_is_a_line_the_reference_is_the_closed_form():
    design, load = Design(np.tile(np.arange(4), 3), np.repeat(np.arange(3), 4), np.arange(4), 3), [0, 0, 1, 1]
    ratings = np.exp(np.random.default_rng(0).normal(3.0, 0.4, 12))
    line = SharedLoads.of(RatingModel().observe(ratings, design), 0.05, load)
    p, level, lean = (
        RatingParameters(1.0, 0.5, 0.3, 0.0, 0.0),
        np.array([1.0, 2.0, 0.5, 1.5]),
        np.array([0.2, 0.1, 0.3, -0.2]),
    )
    found = []
    for observed in (line, line.finer()):
        nodes = np.array([0.0, *observed.load_errors.nodes])
        found.append(observed.log_likelihood(np.exp(level + nodes[:, None] * lean).ravel(), p))
    # its vectors are spread by a normal law that ends at four standard deviations, and weighted
    assert_allclose(found[0], found[1], rtol=0, atol=1e-5)
    bent = np.exp(level + nodes[:, None] * lean + 0.1 * nodes[:, None] ** 2 * lean).ravel()
    assert abs(line.finer().log_likelihood(bent, p) - found[0]) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("cv", "line"), [(0.05, 0.15), (0.01, 0.01)])
def test_the_line_and_its_reference_agree_with_sums_over_both_factors(cv, line):
    experiment = made()
    posterior = build(experiment, options(shared_load_cv=cv)).posterior
    theta = posterior.space.draw_prior(np.random.default_rng(1), 6)
    theta = theta[posterior.rating_parameters(theta).varsigma > 0.05][:4]
    expected = over_factors(experiment, posterior, theta, cv)
    assert_allclose(posterior.log_likelihood(theta), expected, rtol=0, atol=line)
    # what the exactness check compares with knows the response as it is
    assert_allclose(exact_log_likelihood(posterior, theta), expected, rtol=0, atol=0.02)
    ignored = build(experiment, options()).posterior.log_likelihood(theta)
    assert np.abs(ignored - expected).max() > 3.0 * np.abs(posterior.log_likelihood(theta) - expected).max()


def test_vanishing_errors_give_the_likelihood_of_exact_loads():
    experiment, theta = made(), np.array([[1.0, 0.3], [0.7, 0.5]])
    known = build(experiment, options()).posterior
    nearly = build(experiment, options(shared_load_cv=1e-8)).posterior
    assert_allclose(nearly.log_likelihood(theta), known.log_likelihood(theta), rtol=0, atol=1e-8)
    for none in (None, 0.0):
        same = build(experiment, options(shared_load_cv=none)).posterior
        assert_array_equal(same.log_likelihood(theta), known.log_likelihood(theta))
    again = pickle.loads(pickle.dumps(nearly))
    assert_allclose(again.log_likelihood(theta), nearly.log_likelihood(theta), rtol=1e-12)


def test_a_load_that_was_off_is_found_out():
    """Ratings under 2 mm that was 2.1 mm: the factor's posterior moves there, and draws of it follow the line."""
    quiet = {"varsigma": 0.02}
    experiment, off = (made((Indentation(1.5e-3), Indentation(load)), quiet) for load in (2e-3, 2.1e-3))
    experiment = experiment._replace(ratings=replace(experiment.ratings, rating=off.ratings.rating))
    posterior = build(experiment, options(shared_load_cv=0.05)).posterior
    theta = np.tile([usual_values(MENDED)["gamma"], 0.02], (4000, 1))
    rate, p = posterior.mean_rate(theta), posterior.rating_parameters(theta)
    effects = posterior.observation.draw_effects(np.random.default_rng(0), rate, p)
    assert effects.load.shape == (4000, 2)
    apart = effects.load[:, 1] - effects.load[:, 0]
    # log(2.1 / 2) in standard deviations of the log load; the level of all ratings is free
    assert abs(apart.mean() - np.log(1.05) / np.sqrt(np.log1p(0.05**2))) < 2.5 * apart.std()
    assert apart.mean() > 0.3


def test_what_cannot_be_combined_is_refused():
    for changed, message in (
        ({"shared_load_cv": 0.11}, "shared_load_cv"),
        ({"shared_load_cv": -0.1}, "shared_load_cv"),
    ):
        with pytest.raises(InputError, match=message):
            options(**changed)
    with pytest.raises(InputError, match=r"cannot be combined.*state the larger one"):
        build(made(), options(shared_load_cv=0.05, load_cv=0.05))
    with pytest.raises(InputError, match="cannot be combined"):
        build(made(), options(shared_load_cv=0.05, individual=("b",)))
    with pytest.raises(InputError, match=r"shared_load_cv.* not modelled for standardised ratings"):
        build(made(scale=STANDARDISED), ModelOptions(shared_load_cv=0.05, scale=STANDARDISED, discretisation=COARSE))


def test_the_record_keeps_it():
    asked = options(shared_load_cv=0.03)
    assert ModelOptions.from_record(asked.record()).shared_load_cv == 0.03
    assert asked.choices()["shared_load_cv"] == "0.03"
    assert "shared_load_cv" not in options().choices()
