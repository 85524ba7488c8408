"""Moduli that are not known exactly: their laws, the response at other moduli, and the posterior that integrates them.

The oracle of the last is quadrature over moduli, mean and participants, with a scene compiled for each pair of moduli.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal, LogUniform
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import fabric_moduli, scene_of, touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.declared import MODULUS_SCALE, PARAMETERS, UNKNOWN_MODULUS
from softness_bayes.touch.contact import PRINTED_RIGIDITY, Force, Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation

FINE = Discretisation(16, 14.0, 1e-8)
LOADS = (Indentation(2e-3), Force(1.5))
KPA = 1e3


def fabrics(**errors):
    names = ("a", "b", "c")
    return Fabrics(names, effective_modulus=np.array([40.0, 160.0, 500.0]) * KPA, **errors)


def made(cloth, participants=4, seed=3):
    values = usual_values(MENDED)
    return simulate_ratings(np.random.default_rng(seed), cloth, LOADS, values, participants=participants).ratings


def held(*free):
    usual = usual_values(MENDED)
    return {name: usual[name] for name in PARAMETERS if name not in free and name != "omega"}


# laws


def test_errors_of_what_was_measured_become_those_of_the_modulus():
    cloth = Fabrics(
        ("plain", "tensile", "both", "rigidity", "bracket", "unknown"),
        effective_modulus=np.array([2e4, np.nan, np.nan, np.nan, np.nan, np.nan]),
        effective_modulus_cv=np.array([0.2, *[np.nan] * 5]),
        tensile_modulus=np.array([np.nan, 1e7, 1e7, np.nan, np.nan, np.nan]),
        thickness=np.array([np.nan, 3e-4, 3e-4, np.nan, np.nan, np.nan]),
        tensile_modulus_cv=np.array([np.nan, 0.1, 0.1, np.nan, np.nan, np.nan]),
        thickness_cv=np.array([np.nan, np.nan, 0.05, np.nan, np.nan, np.nan]),
        bending_rigidity=np.array([*[np.nan] * 3, 1e-5, np.nan, np.nan]),
        effective_modulus_low=np.array([*[np.nan] * 4, 1e4, np.nan]),
        effective_modulus_high=np.array([*[np.nan] * 4, 9e4, np.nan]),
    )
    found = fabric_moduli(cloth, PRINTED_RIGIDITY, cv=0.3)
    tensile = 1e7 * 3e-4**3 / (12 * 0.7) / 1e-9

    def log_sd(cv):
        return np.sqrt(np.log(1 + cv**2))

    expected = [
        LogNormal(20.0, log_sd(0.2)),
        LogNormal(tensile / KPA, log_sd(0.1)),
        LogNormal(tensile / KPA, np.hypot(log_sd(0.1), 3 * log_sd(0.05))),
        LogNormal(1e4 / KPA, log_sd(0.3)),
        LogUniform(10.0, 90.0),
        UNKNOWN_MODULUS,
    ]
    for law, wanted in zip(found.laws, expected, strict=True):
        assert type(law) is type(wanted)
        assert_allclose([law.median, law.quantile(0.1)], [wanted.median, wanted.quantile(0.1)], rtol=1e-12)
    assert_allclose(found.middle[4], np.sqrt(10.0 * 90.0) * KPA)
    # the coefficient of variation that was given is that of the law
    drawn = found.laws[0].draw(np.random.default_rng(0), 200_000)
    assert_allclose(drawn.std() / drawn.mean(), 0.2, rtol=0.01)


def test_without_errors_all_moduli_are_known():
    for cv in (None, 0.0):
        found = fabric_moduli(fabrics(), PRINTED_RIGIDITY, cv)
        assert found.known
    assert fabric_moduli(fabrics(effective_modulus_cv=np.zeros(3)), PRINTED_RIGIDITY, 0.2).known
    assert fabric_moduli(fabrics(), PRINTED_RIGIDITY, 0.2).uncertain == (0, 1, 2)


# one error of all moduli


@pytest.mark.parametrize("of_each", [None, 0.1])
@pytest.mark.parametrize("batch", ["", "ABA"])
def test_an_error_that_moduli_share_is_one_factor_of_each_batch(of_each, batch):
    """The posterior at factors is that of moduli multiplied by them, with or without errors of each."""
    cloth, free = fabrics(batch=tuple(batch)), ("b", "sigma_0", "gamma")
    scales = [MODULUS_SCALE, f"{MODULUS_SCALE}_2"][: len({*batch}) or 1]
    factors = np.array([1.2, 0.9, 1.2] if batch else 3 * [1.2])
    ratings = made(cloth)
    options = ModelOptions(fix=held(*free), shared_modulus_cv=0.15, modulus_cv=of_each, discretisation=FINE)
    posterior = build(Experiment(ratings, cloth, ()), options).posterior
    names = posterior.names
    assert [name for name in names if "modulus" not in name] == [*free]
    laws = {p.name: p.prior for p in posterior.space.sampled if MODULUS_SCALE in p.name}
    assert [*laws] == scales
    for law in laws.values():
        drawn = law.draw(np.random.default_rng(0), 200_000)
        assert_allclose(drawn.std() / drawn.mean(), 0.15, rtol=0.01)
    at = dict(zip(free, posterior.space.median, strict=False)) | dict(zip(scales, factors, strict=False))
    theta = np.array([at.get(name, p.prior.median) for name, p in zip(names, posterior.space.sampled, strict=True)])
    higher = fabrics()
    object.__setattr__(higher, "effective_modulus", factors * higher.effective_modulus)
    stated = ModelOptions(fix=held(*free), modulus_cv=of_each, discretisation=FINE)
    other = build(Experiment(ratings, higher, ()), stated).posterior
    same = np.array([at.get(name, p.prior.median) for name, p in zip(other.names, other.space.sampled, strict=True)])
    assert_allclose(posterior.log_likelihood(theta), other.log_likelihood(same), atol=1e-4)
    # negative control: the stated moduli give another density
    theta[names.index(MODULUS_SCALE)] = 1.0
    assert abs(posterior.log_likelihood(theta) - other.log_likelihood(same)) > 0.05


def test_log_moduli_of_a_batch_are_correlated_and_those_of_others_are_not():
    """The prior, summed over the factors, is the normal law with the covariance of shared and own errors."""
    cloth, free = fabrics(batch=("A", "B", "A")), ("b",)
    options = ModelOptions(fix=held(*free), shared_modulus_cv=0.3, modulus_cv=0.2, discretisation=FINE)
    space = build(Experiment(made(cloth), cloth, ()), options).posterior.space
    own, shared = np.log1p(0.2**2), np.log1p(0.3**2)
    covariance = np.diag(np.full(3, own)) + shared * np.array([[1, 0, 1], [0, 1, 0], [1, 0, 1]])
    place = [space.names.index(name) for name in (MODULUS_SCALE, f"{MODULUS_SCALE}_2")]
    log, step = np.linspace(-1.8, 1.8, 121, retstep=True)
    first, second = np.exp(np.meshgrid(log, log, indexing="ij"))
    for shift in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.4], [0.4, 0.1, -0.4]):
        true = np.log(cloth.effective_modulus / KPA) + shift
        theta = np.tile(space.median, (*first.shape, 1))
        theta[..., place[0]], theta[..., place[1]] = first, second
        theta[..., -3:] = np.exp(true) / np.stack([first, second, first], axis=-1)
        assert_allclose(space.modulus(theta) / KPA, np.broadcast_to(np.exp(true), theta[..., -3:].shape))
        joint = space.log_prior(theta)[..., [*place, -3, -2, -1]] + np.log(theta[..., [*place, -3, -2, -1]])
        found = logsumexp(joint.sum(axis=-1)) + 2 * np.log(step)
        assert found == pytest.approx(multivariate_normal.logpdf(shift, cov=covariance), abs=1e-6)
    # negative control: errors that all fabrics share, or none do, have other densities
    for other in (own * np.eye(3) + shared, (own + shared) * np.eye(3)):
        assert abs(multivariate_normal.logpdf(shift, cov=other) - found) > 0.3


def test_a_batch_may_be_exact_and_too_many_are_refused():
    cloth = fabrics(batch=("A", "B", "A"))
    options = ModelOptions(fix=held("b"), priors={f"{MODULUS_SCALE}_2": LogNormal(1, 0.1)}, discretisation=FINE)
    space = build(Experiment(made(cloth), cloth, ()), options).posterior.space
    assert space.names == ("b", f"{MODULUS_SCALE}_2")
    assert_allclose(space.modulus(np.array([80.0, 1.5])), cloth.effective_modulus * [1.0, 1.5, 1.0])
    with pytest.raises(InputError, match="modulus_scale_3: the model of these data has no such parameter"):
        build(Experiment(made(cloth), cloth, ()), replace(options, priors={f"{MODULUS_SCALE}_3": LogNormal(1, 0.1)}))
    many = Fabrics(tuple("abcdefghij"), effective_modulus=np.geomspace(4e4, 5e5, 10), batch=tuple("abcdefghij"))
    with pytest.raises(InputError, match="10 batches of moduli with an error each, expected at most 9"):
        build(Experiment(made(many), many, ()), ModelOptions(fix=held("b"), shared_modulus_cv=0.1, discretisation=FINE))
    with pytest.raises(InputError, match="2 batches of 3 fabrics"):
        fabrics(batch=("A", "B"))


def test_the_factor_of_all_moduli_is_no_fixed_value():
    cloth = fabrics()
    with pytest.raises(InputError, match="modulus_scale cannot be fixed: multiply the moduli"):
        build(Experiment(made(cloth), cloth, ()), ModelOptions(fix={MODULUS_SCALE: 1.2}, discretisation=FINE))


# the response at other moduli


def test_a_scene_answers_for_other_moduli_as_one_that_is_compiled_for_them():
    values = usual_values(MENDED)
    scene = scene_of(fabrics(), LOADS, values, MENDED, discretisation=FINE)
    moduli = np.array([[60.0, 150.0, 420.0], [35.0, 260.0, 501.0]]) * KPA
    found = scene.total_rate(touch_parameters(values), moduli)
    every = scene.respond(touch_parameters(values), moduli)
    for one, rate, contact in zip(moduli, found, every.contact.force, strict=True):
        other = scene_of(replace(fabrics(), effective_modulus=one), LOADS, values, MENDED, discretisation=FINE)
        exact = other.respond(touch_parameters(values))
        assert exact.total_rate.max() > 0
        assert_allclose(rate, exact.total_rate, atol=1e-5 * exact.total_rate.max())
        assert_allclose(contact, exact.contact.force, rtol=1e-12)
    assert_allclose(every.total_rate, found, rtol=1e-12)
    # a negative control: the moduli matter
    assert np.abs(found[0] - found[1]).max() > 0.01 * found.max()
    # the reference of the numerical error is of these moduli too
    assert_allclose(scene.refined().total_rate(touch_parameters(values), moduli), found, atol=1e-4 * found.max())
    assert (scene.error(touch_parameters(values), moduli) < 1e-4).all()


# the posterior


def nodes_of(law, size=8):
    """Nodes and weights of a log-normal law: Gauss-Hermite in the logarithm."""
    x, weight = np.polynomial.hermite_e.hermegauss(size)
    return law.median * np.exp(law.sd_log * x), weight / weight.sum()


def test_two_fabrics_and_two_raters_agree_with_quadrature():
    values, errors = usual_values(MENDED), np.array([0.3, 0.2])
    cloth = Fabrics(("a", "b"), effective_modulus=np.array([90.0, 300.0]) * KPA, effective_modulus_cv=errors)
    ratings = simulate_ratings(np.random.default_rng(5), cloth, LOADS[:1], values, participants=2).ratings
    experiment = Experiment(ratings, cloth, ())
    options = ModelOptions(fix=held("gamma") | {"tau": 0.4, "varsigma": 0.3}, discretisation=FINE)
    posterior = build(experiment, options).posterior
    laws = [p.prior for p in posterior.space.sampled[1:]]
    assert posterior.names == ("gamma", "fabric_modulus[a]", "fabric_modulus[b]")
    (first, weight_a), (second, weight_b) = (nodes_of(law) for law in laws)
    grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
    weight = np.log(weight_a)[:, None] + np.log(weight_b)
    model, design = posterior.observation.model, posterior.observation.design
    log = np.log(experiment.ratings.rating)
    for gamma in (0.7, 1.3):
        theta = np.concatenate([np.full((*grid.shape[:2], 1), gamma), grid], axis=-1)
        evidence = logsumexp(posterior.log_likelihood(theta) + weight)
        # another way: a scene of all nodes as fabrics, then sums over the mean and the raters on grids
        cloth = Fabrics(tuple(map(str, range(2 * first.size))), effective_modulus=np.append(first, second) * KPA)
        values = held() | {"gamma": gamma}
        scene = scene_of(cloth, experiment.ratings.loads, values, MENDED, discretisation=FINE)
        rate = scene.total_rate(touch_parameters(values)) / scene.n_receptors
        total = []
        for i, j in np.ndindex(first.size, second.size):
            drive = np.log(rate[[i, first.size + j]] + 0.1)
            drive = gamma * (drive - drive @ design.weight)
            residual = log - drive[design.condition]
            total.append(_raters(residual, design.participant, 0.4, 0.3, model) + weight[i, j])
        assert abs(logsumexp(total) - log.sum() - evidence) < 1e-6


def _raters(residual, participant, tau, varsigma, model):
    """Log density of residuals, mean and raters' levels summed over fine grids."""
    mu = np.linspace(residual.mean() - 4.0, residual.mean() + 4.0, 401)
    level = np.linspace(-4.0, 4.0, 401)
    step = (mu[1] - mu[0], level[1] - level[0])
    density = norm.logpdf(mu, np.log(model.centre), model.spread)
    for one in range(participant.max() + 1):
        own = residual[participant == one]
        inner = norm.logpdf(level, 0.0, tau) + norm.logpdf(own[:, None, None] - mu[:, None] - level, 0.0, varsigma).sum(
            axis=0
        )
        density = density + logsumexp(inner, axis=1) + np.log(step[1])
    return logsumexp(density) + np.log(step[0])


def test_vanishing_errors_give_the_likelihood_of_known_moduli():
    cloth = fabrics()
    ratings = made(cloth)
    options = ModelOptions(fix=held("b", "gamma"), discretisation=FINE)
    known = build(Experiment(ratings, cloth, ()), options).posterior
    nearly = build(Experiment(ratings, cloth, ()), replace(options, modulus_cv=1e-5)).posterior
    theta = known.space.draw_prior(np.random.default_rng(1), 20)
    at = np.concatenate([theta, np.tile(nearly.space.median[2:], (20, 1))], axis=-1)
    assert_allclose(nearly.log_likelihood(at), known.log_likelihood(theta), rtol=0, atol=1e-8)
    # and within the laws it moves by no more than they allow
    drawn = nearly.space.draw_prior(np.random.default_rng(1), 20)
    drawn[:, :2] = theta
    assert_allclose(nearly.log_likelihood(drawn), known.log_likelihood(theta), rtol=0, atol=0.02)
