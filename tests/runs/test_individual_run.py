"""Runs whose raters have fingers of their own, from the options to the files and the command line."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from softness_bayes.checking.checks import SKINS
from softness_bayes.checking.individual import POPULATION
from softness_bayes.experiments.understanding import warnings
from softness_bayes.model.build import ExperimentModel, build, people_notes
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.finger_grid import FingerGrid
from softness_bayes.touch.fingers import FingerFamily
from softness_bayes.touch.scene import Discretisation
from support.report_runs import OPTIONS, experiment, quickly
from support.variants import pressed_too


def test_a_result_holds_the_raters_fingers(variant_run):
    result = variant_run("own fingers")
    posterior = result.group("posterior")
    people = posterior["participant"].values.astype(str)
    drawn = posterior["rater_log_b"].values
    assert drawn.shape[-1] == people.size == 5
    table = result.fingers
    assert [*table.loc[(slice(None), "b"), :].index.get_level_values("participant")] == [POPULATION, *people]
    own = posterior["b"].values[..., None] * np.exp(drawn)
    assert_allclose(table.loc[(people[2], "b"), "median"], np.median(own[..., 2]))
    assert (table["low"] < table["median"]).all()
    assert (table["median"] < table["high"]).all()
    assert "tau_b" in result.summary().index
    assert any(
        "b of single raters" in line and "plate forces are available for 2 of 5 raters" in line
        for line in result.learnt()
    )
    assert [*table["pressed"]] == [False, False, False, True, False, True]
    assert np.isfinite(result.provenance.findings[SKINS].p_value)


def test_two_raters_and_two_fabrics_agree_with_quadrature():
    """The likelihood against dense normal laws over a product of fine grids, the scene asked for each finger."""
    whole = experiment()
    with quickly():
        # so fine that the responses of the two ways agree better than their integrals
        fine = Discretisation(16, 14.0, 1e-8)
        options = ModelOptions(fix={**OPTIONS["fix"], "tau_b": 0.2}, individual=("b",), discretisation=fine)
        model = build(whole, options)
        posterior, design = model.posterior, ExperimentModel(whole, ModelOptions()).design
        few = (design.participant < 2) & (design.fabric[design.condition] < 2)
        posterior = posterior.with_term(posterior.observation.without(~few))
        grid = FingerGrid({"b": 169}, reach=7.0)
        posterior = posterior.with_scene(model.scene, None, FingerFamily(model.scene, grid, 48, 30))
        theta = posterior.space.draw_prior(np.random.default_rng(1), 40)
        theta = theta[np.argsort(posterior.log_likelihood(theta))[-3:]]
        found = posterior.log_likelihood(theta)
        x = np.linspace(-7.0, 7.0, 401)
        log_w, ratings = -0.5 * x**2 - logsumexp(-0.5 * x**2), np.log(whole.ratings.rating[few])
        person, condition = design.participant[few], design.condition[few]
        for k, point in enumerate(theta):
            p, touch = posterior.rating_parameters(point), posterior.space.touch(point)
            typical = np.log(posterior.mean_rate(point) + p.eps) @ design.weight
            rows = type(touch)(*(np.broadcast_to(value, x.size) for value in touch))
            rate = model.scene.total_rate(rows._replace(b=rows.b * np.exp(p.tau_b * x))) / model.scene.n_receptors
            drive = posterior.observation.model.direction.sign * p.gamma * (np.log(rate + p.eps) - typical)
            same = person[:, None] == person
            law = multivariate_normal(cov=9.0 + p.tau**2 * same + p.varsigma**2 * np.eye(person.size))
            mean = np.where(person == 0, drive[:, None, condition], drive[None, :, condition])
            dense = law.logpdf(ratings - np.log(20.0) - mean) + log_w[:, None] + log_w
            assert_allclose(found[k], logsumexp(dense) - ratings.sum(), rtol=0, atol=1e-6)
        # the usual reach leaves out 6e-5 of the fingers of each rater
        usual = posterior.with_scene(model.scene, None, FingerFamily(model.scene, FingerGrid({"b": 97}), 48, 30))
        assert_allclose(usual.log_likelihood(theta), found, rtol=0, atol=2e-4)


def test_the_notes_say_who_was_pressed():
    whole, alike = pressed_too(), ModelOptions(individual=("b",))
    assert not any("pressed" in note for note in people_notes(experiment(), alike))
    assert "rated and pressed (2 of 5 raters); each is one person" in people_notes(whole, alike)[-1]
    assert "without --individual b all raters have the typical finger" in people_notes(whole, ModelOptions())[-1]
    said = warnings(ExperimentModel(whole, ModelOptions()))
    assert any("2 of 5 raters" in line for line in said)
    others = replace(whole.compression, participants=("F1", "F2", "F3", "F4"))
    assert "treated as different people" in people_notes(whole._replace(compression=others), alike)[-1]
