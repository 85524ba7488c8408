"""Loads with errors, of each rating or shared by all: their law, the likelihood that integrates them, simulated ones.

The oracle is quadrature over every rating's own load, with exact responses there, the mean and the participants. The
densities given the response, of shared errors too, are among those of `likelihood/test_golden.py`.
"""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import logsumexp
from scipy.stats import norm

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood.design import Design, LoadErrors
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.scales import STANDARDISED
from softness_bayes.likelihood.uncertain_loads import UncertainLoads
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import scaled, scene_of, touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.results.run_checks import exact_log_likelihood
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.points import rated

COARSE = Discretisation(10, 10.0, 1e-5)
LOADS = (Indentation(2e-3), Force(1.5))
CLOTH = Fabrics(("a", "b", "c"), effective_modulus=np.array([40.0, 160.0, 500.0]) * 1e3)


def made(cloth=CLOTH, participants=4, seed=3, loads=LOADS, **changed):
    values = usual_values(MENDED, given=changed.pop("given", None))
    rng = np.random.default_rng(seed)
    simulation = simulate_ratings(
        rng, cloth, loads, values, participants=participants, **{"discretisation": COARSE, **changed}
    )
    return Experiment(simulation.ratings, cloth, ())


def held(*free):
    usual = usual_values(MENDED)
    return {name: usual[name] for name in PARAMETERS if name not in free and name != "omega"}


def with_cv(experiment, load_cv):
    return experiment._replace(ratings=replace(experiment.ratings, load_cv=load_cv))


# the law and the loads that it asks for


def test_the_error_of_a_load_is_that_of_its_row_or_else_of_all():
    ratings = replace(made().ratings, load_cv=np.append([0.1, 0.0], np.full(22, np.nan)))
    assert_allclose(ratings.load_log_sd(0.05)[:3] ** 2, np.log1p([0.01, 0.0, 0.0025]))
    assert_allclose(ratings.load_log_sd()[1:], 0.0)
    drawn = np.exp(ratings.load_log_sd()[0] * np.random.default_rng(0).standard_normal(200_000))
    assert_allclose(drawn.std() / drawn.mean(), 0.1, rtol=0.01)


# the posterior


@pytest.mark.parametrize("kind", ["load_cv", "shared_load_cv"])
def test_vanishing_errors_give_the_likelihood_of_exact_loads(kind):
    own = {"priors": {"omega": HalfNormal(0.5)}} if kind == "load_cv" else {}
    options = ModelOptions(fix=held("b", "gamma", "varsigma"), discretisation=COARSE, **own)
    experiment = made()

    def posterior(cv, experiment=experiment):
        return build(experiment, replace(options, **{kind: cv})).posterior

    known = posterior(None)
    assert known.other_loads is None
    theta = known.space.draw_prior(np.random.default_rng(1), 20)
    expected, nearly = known.log_likelihood(theta), posterior(1e-8)
    assert_allclose(nearly.log_likelihood(theta), expected, rtol=0, atol=1e-8)
    again = pickle.loads(pickle.dumps(nearly))
    assert_allclose(again.log_likelihood(theta), nearly.log_likelihood(theta), rtol=1e-12)
    # errors of 0 are none at all
    assert_array_equal(posterior(0.0).log_likelihood(theta), expected)
    if kind == "load_cv":
        none = posterior(0.1, with_cv(experiment, np.zeros(24)))
        assert_array_equal(none.log_likelihood(theta), expected)
    assert np.abs(posterior(0.1).log_likelihood(theta) - expected).max() > 0.1


def oracle(posterior, experiment, cv, gamma, tau, varsigma, shift=0.0):
    """Log density of log ratings of two raters: quadrature over loads, mean and levels; `shift` of each condition."""
    node, weight = np.polynomial.hermite_e.hermegauss(15)
    log_sd, values = np.sqrt(np.log1p(cv**2)), held() | {"gamma": gamma}
    observation, design, conditions = posterior.observation, posterior.observation.design, experiment.ratings.conditions
    loads = tuple(scaled(load, float(np.exp(log_sd * step))) for load in experiment.ratings.loads for step in node)
    scene = scene_of(experiment.fabrics, loads, values, MENDED, discretisation=COARSE)
    rate = scene.total_rate(touch_parameters(values)) / scene.n_receptors
    x = np.log(rate.reshape(len(experiment.ratings.loads), node.size, -1) + values["eps"])
    x = gamma * x[conditions.load, :, conditions.fabric]
    x = x - x[:, node.size // 2] @ design.weight + np.broadcast_to(shift, len(x))[:, None]
    level = np.linspace(-7.0, 7.0, 1201)
    log = np.log(experiment.ratings.rating) - np.log(observation.model.centre)
    one = norm.logpdf(log[:, None, None] - level[:, None] - x[design.condition][:, None, :], 0.0, varsigma)
    alone = logsumexp(one, axis=-1, b=weight / weight.sum())
    total = norm.logpdf(level, 0.0, observation.model.spread)
    step = level[1] - level[0]
    of_level = norm.logpdf(level[:, None] - level, 0.0, tau)  # of mu + s given mu
    for person in range(2):
        own = alone[design.participant == person].sum(axis=0)
        total = total + np.log(np.exp(own - own.max()) @ np.exp(of_level)) + own.max() + np.log(step)
    return logsumexp(total) + np.log(step) - log.sum() - log.size * np.log(observation.model.centre)


@pytest.mark.parametrize(
    ("cv", "bound"),
    [*(pytest.param(*one, marks=pytest.mark.slow) for one in ((0.02, 0.03), (0.05, 0.12))), (0.1, 0.25)],
)
def test_two_fabrics_and_two_raters_agree_with_quadrature(cv, bound):
    cloth = Fabrics(("a", "b"), effective_modulus=np.array([90.0, 300.0]) * 1e3)
    experiment = made(cloth, participants=2, seed=5, loads=LOADS[:1], load_cv=cv, given={"varsigma": 0.05})
    options = ModelOptions(fix=held("gamma") | {"tau": 0.4, "varsigma": 0.05}, discretisation=COARSE)
    posterior = build(experiment, options).posterior
    ignored = build(with_cv(experiment, None), options).posterior
    for gamma in (0.7, 1.3):
        theta = np.array([gamma])
        expected = oracle(posterior, experiment, cv, gamma, 0.4, 0.05)
        assert abs(float(posterior.log_likelihood(theta)) - expected) < bound
        # the reference of the exactness check integrates over loads without this approximation
        assert abs(float(exact_log_likelihood(posterior, theta[None])[0]) - expected) < 1e-3
    # the last gamma is where the errors matter most
    assert abs(float(ignored.log_likelihood(theta)) - expected) > 5 * bound


def test_deviations_of_fabrics_are_averaged_over():
    """The reference with omega, against a sum over the deviations of two fabrics."""
    cloth = Fabrics(("a", "b"), effective_modulus=np.array([90.0, 300.0]) * 1e3)
    experiment = made(cloth, participants=2, seed=5, loads=LOADS[:1], load_cv=0.1, given={"varsigma": 0.05})
    fixed, omega = held("gamma") | {"tau": 0.4, "varsigma": 0.05}, 0.05
    posterior = build(experiment, ModelOptions(fix=fixed | {"omega": omega}, discretisation=COARSE)).posterior
    theta = np.array([[1.3]])
    stated, reference = posterior.log_likelihood(theta)[0], exact_log_likelihood(posterior, theta)[0]
    deviation = omega * np.linspace(-3.0, 3.0, 7)
    mass = norm.pdf(deviation, 0.0, omega)
    mass /= mass.sum()
    fabric = posterior.observation.design.fabric
    summed = logsumexp(
        [
            [oracle(posterior, experiment, 0.1, 1.3, 0.4, 0.05, np.array([a, b])[fabric]) for b in deviation]
            for a in deviation
        ],
        b=np.outer(mass, mass),
    )
    assert abs(reference - summed) < 0.03  # an average of 16 draws
    # negative control: the normal approximation
    assert abs(stated - summed) > 0.2


# simulated ones


def test_simulated_loads_err_one_by_one_through_the_whole_chain():
    few = {"tau": 1e-6, "varsigma": 1e-4}
    drawn = made(participants=400, load_cv=0.1, given=few, loads=LOADS[1:])
    ratings = drawn.ratings
    assert_array_equal(ratings.load_cv, np.full(len(ratings), 0.1))
    log = np.log(ratings.rating).reshape(400, 3)
    values = usual_values(MENDED, given=few)
    node = np.linspace(-3.5, 3.5, 701)
    loads = [scaled(LOADS[1], float(np.exp(np.sqrt(np.log1p(0.01)) * step))) for step in node[::50]]
    scene = scene_of(CLOTH, tuple(loads), values, MENDED, discretisation=COARSE)
    rate = scene.total_rate(touch_parameters(values)).reshape(len(loads), 3) / scene.n_receptors
    x = np.stack([np.interp(node, node[::50], np.log(r + values["eps"])) for r in rate.T], axis=-1)
    weight = norm.pdf(node) / norm.pdf(node).sum()
    mean = weight @ x
    sd = np.sqrt(weight @ (x - mean) ** 2)
    assert_allclose(log.std(axis=0), values["gamma"] * sd, rtol=0.1)
    assert abs(np.corrcoef(log.T)[0, 1]) < 0.2  # each rating has an error of its own
    exact = made(participants=3, seed=4)
    assert_array_equal(made(participants=3, seed=4, load_cv=0.0).ratings.rating, exact.ratings.rating)
    assert exact.ratings.load_cv is None


# errors that all ratings of a load share


def options(**changed):
    return ModelOptions(**{"fix": held("gamma", "varsigma"), "discretisation": COARSE, **changed})


def test_where_the_response_is_a_line_the_reference_is_the_closed_form():
    design, load = Design(np.tile(np.arange(4), 3), np.repeat(np.arange(3), 4), np.arange(4), 3), [0, 0, 1, 1]
    ratings = np.exp(np.random.default_rng(0).normal(3.0, 0.4, 12))
    line = UncertainLoads(ratings, design, RatingModel(), LoadErrors.of(design, 0.05, load))
    p, level, lean = (
        rated(1.0, 0.5, 0.3, 0.0, 0.0),
        np.array([1.0, 2.0, 0.5, 1.5]),
        np.array([0.2, 0.1, 0.3, -0.2]),
    )
    found = []
    for observed in (line, line.finer()):
        nodes = np.array([0.0, *observed.load_errors.further])
        found.append(observed.log_likelihood(np.exp(level + nodes[:, None] * lean).ravel(), p))
    # its vectors are spread by a normal law that ends at four standard deviations, and weighted
    assert_allclose(found[0], found[1], rtol=0, atol=1e-5)
    bent = np.exp(level + nodes[:, None] * lean + 0.1 * nodes[:, None] ** 2 * lean).ravel()
    assert abs(line.finer().log_likelihood(bent, p) - found[0]) > 1e-3


def test_a_load_that_was_off_is_found_out():
    """Ratings under 2 mm that was 2.1 mm: the factor's posterior moves there, and draws of it follow the line."""
    quiet = {"varsigma": 0.02}
    experiment, off = (made(loads=(Indentation(1.5e-3), Indentation(load)), given=quiet) for load in (2e-3, 2.1e-3))
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
