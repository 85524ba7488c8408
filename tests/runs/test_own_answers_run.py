"""Runs whose raters have exponents and noise of their own, from the options to the files and the command line."""

import json
from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from softness_bayes.base.laws import HalfNormal
from softness_bayes.checking.checks import NOISE
from softness_bayes.checking.individual import POPULATION
from softness_bayes.checking.sentences import residual_sentences
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from support.command_line import call, refused
from support.paths import DATA
from support.report_runs import COARSE, OPTIONS, experiment, quickly

OWN = ("gamma", "varsigma")


def test_a_result_holds_the_raters_exponents_and_noise(variant_run):
    result = variant_run("own answers")
    posterior, table = result.group("posterior"), result.answers
    people = posterior["participant"].values.astype(str)
    assert result.fingers is None
    for name in OWN:
        own = posterior[name].values[..., None] * np.exp(posterior[f"rater_log_{name}"].values)
        rows = table.loc[(slice(None), name), :]
        assert [*rows.index.get_level_values("participant")] == [POPULATION, *people]
        assert_allclose(table.loc[(people[2], name), "median"], np.median(own[..., 2]))
        assert any(f"{name} of single raters" in line for line in result.learnt())
        assert f"tau_{name}" in result.summary().index
    assert (table["low"] < table["median"]).all()
    assert (table["median"] < table["high"]).all()


def test_its_checks_and_its_error_are_said(variant_run):
    result = variant_run("own answers")
    findings = result.provenance.findings
    exponents, noise, *_ = residual_sentences(findings, ())
    assert "more than the model allows" in exponents
    assert "more than the model allows" in noise
    table = result.tables["predictive_checks"]
    assert_allclose(table.loc[("posterior", "participants' own noise"), "p_value"], findings[NOISE].p_value)
    # the nodes' error is part of the exactness check
    assert result.provenance.errors.exactness_sd < 0.05


def with_zeros():
    """The experiment in whole numbers, a twentieth of them 0."""
    made = experiment(participants=2)
    rating = np.where(made.ratings.rating < np.quantile(made.ratings.rating, 0.05), 0.0, made.ratings.rating)
    return made._replace(ratings=replace(made.ratings, rating=np.round(rating)))


COMBINED = {"errors": STUDENT, "individual": ("gamma",), "priors": {"omega": HalfNormal(0.3)}}


def test_they_combine_with_zeros_heavy_tails_and_deviations_of_fabrics():
    with quickly():
        model = build(with_zeros(), ModelOptions(fix=OPTIONS["fix"], discretisation=COARSE, **COMBINED))
        posterior = model.posterior
        assert "ratings of 0 are censored" in model.interpretation.note
        assert {"tau_gamma", "omega", "nu"} <= {*posterior.names}
        theta = posterior.space.draw_prior(np.random.default_rng(2), 1)
        assert np.isfinite(posterior.log_likelihood(theta)).all()


def test_simulated_raters_have_their_own(tmp_path):
    out = tmp_path / "made"
    words = ["--fabrics", str(DATA / "fabrics.csv"), "--force-n", "1", "--out", str(out), "--seed", "3"]
    made = call("simulate", *words, "--set", "tau_gamma=0.3", "--set", "tau_varsigma=0.5")
    assert made.returncode == 0, made.stderr
    truth = json.loads((out / "truth.json").read_text())["truth"]
    assert (truth["tau_gamma"], truth["tau_varsigma"]) == (0.3, 0.5)
    assert truth["omega"] == 0.0
    wrong = call("simulate", *words, "--force", "--set", "tau_gamma=0.3", "--ratings", "ranks")
    refused(wrong, "modelled for magnitude and slider ratings, not for ranks ratings")
