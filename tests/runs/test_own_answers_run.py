"""Runs whose raters have exponents and noise of their own, from the options to the files and the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.checking.checks import NOISE
from softness_bayes.checking.individual import POPULATION
from softness_bayes.checking.sentences import residual_sentences
from softness_bayes.errors import InputError
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.scales import STANDARDISED
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.laws import HalfNormal
from softness_bayes.report.page import report_page
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.results.result import Result
from softness_bayes.runs.run import sample
from support.command_line import call
from support.paths import DATA
from support.report_runs import OPTIONS, experiment, quickly

OWN = ("gamma", "varsigma")


@pytest.fixture(scope="module")
def result(few_pictures):
    with quickly():
        return sample(experiment(), **OPTIONS | {"max_steps": 20}, individual=OWN)


def test_a_result_holds_the_raters_exponents_and_noise(result):
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


def test_its_checks_and_its_error_are_said(result):
    findings = result.provenance.findings
    exponents, noise, *_ = residual_sentences(findings, ())
    assert "more than the model allows" in exponents
    assert "more than the model allows" in noise
    table = result.tables["predictive_checks"]
    assert_allclose(table.loc[("posterior", "participants' own noise"), "p_value"], findings[NOISE].p_value)
    # the nodes' error is part of the exactness check
    assert result.provenance.errors.exactness_sd < 0.05
    assert "--individual gamma,varsigma" in report_page(result)


def test_its_model_comes_back_from_the_file(result, tmp_path):
    result.save(tmp_path / "run")
    again = Result.load(tmp_path / "run")
    assert_allclose(again.answers["median"], result.answers["median"])
    assert options_of(again).individual == OWN
    assert ModelOptions.from_record(options_of(again).record()).individual == OWN
    with quickly():
        one = build(experiment_of(again), options_of(again)).posterior
        other = build(experiment(), options_of(result)).posterior
        theta = one.space.draw_prior(np.random.default_rng(0), 3)
        assert_allclose(one.log_likelihood(theta), other.log_likelihood(theta), rtol=1e-8)
        table = again.predict(draws=20)
    assert (table["new_rater_rating_high"] > table["typical_rating_high"]).all()


def test_spreads_of_nothing_give_the_usual_likelihood():
    plain = ModelOptions(fix=OPTIONS["fix"])
    none = {**plain.fix, "tau_gamma": 0.0, "tau_varsigma": 0.0}
    with quickly():
        alike = build(experiment(), replace(plain, fix=none, individual=OWN)).posterior
        usual = build(experiment(), plain).posterior
        theta = usual.space.draw_prior(np.random.default_rng(2), 20)
        assert_allclose(alike.log_likelihood(theta), usual.log_likelihood(theta), rtol=0, atol=1e-8)


def with_zeros():
    """The experiment in whole numbers, a twentieth of them 0."""
    made = experiment()
    rating = np.where(made.ratings.rating < np.quantile(made.ratings.rating, 0.05), 0.0, made.ratings.rating)
    return made._replace(ratings=replace(made.ratings, rating=np.round(rating)))


COMBINED = {"errors": STUDENT, "individual": ("gamma",), "priors": {"omega": HalfNormal(0.3)}}


def test_they_combine_with_zeros_heavy_tails_and_deviations_of_fabrics():
    with quickly():
        model = build(with_zeros(), ModelOptions(fix=OPTIONS["fix"], **COMBINED))
        posterior = model.posterior
        assert "ratings of 0 are censored" in model.interpretation.note
        assert {"tau_gamma", "omega", "nu"} <= {*posterior.names}
        theta = posterior.space.draw_prior(np.random.default_rng(2), 3)
        assert np.isfinite(posterior.log_likelihood(theta)).all()


def test_what_cannot_be_combined_is_refused():
    made = experiment()
    alone = np.zeros_like(made.ratings.participant)
    one = made._replace(ratings=replace(made.ratings, participants=made.ratings.participants[:1], participant=alone))
    with quickly():
        for of, options, message in (
            (one, {}, "one participant only, whose exponents cannot be distinguished from the typical one's"),
            (made, {"load_cv": 0.05}, "own exponents and errors of loads .* cannot be combined"),
            (
                experiment(standardised=True),
                {"scale": STANDARDISED},
                "own exponents or noise are modelled for magnitude and slider ratings, not for standardised ratings",
            ),
        ):
            with pytest.raises(InputError, match=message):
                build(of, ModelOptions(fix=OPTIONS["fix"], individual=("gamma",), **options))
    with pytest.raises(InputError, match=r"own fingers .* and their own answers .* cannot be combined"):
        ModelOptions(individual=("b", "gamma"))
    with pytest.raises(InputError, match="tau_gamma: the model of these data has no such parameter"), quickly():
        build(made, ModelOptions(fix={**OPTIONS["fix"], "tau_gamma": 0.3}))


def test_simulated_raters_have_their_own(tmp_path):
    out = tmp_path / "made"
    words = ["--fabrics", str(DATA / "fabrics.csv"), "--force-n", "1", "--out", str(out), "--seed", "3"]
    made = call("simulate", *words, "--set", "tau_gamma=0.3", "--set", "tau_varsigma=0.5")
    assert made.returncode == 0, made.stderr
    truth = json.loads((out / "truth.json").read_text())["truth"]
    assert (truth["tau_gamma"], truth["tau_varsigma"]) == (0.3, 0.5)
    assert truth["omega"] == 0.0
    other = call("simulate", *words, "--force", "--set", "tau_gamma=0.3", "--errors", "student", "--resolution", "1")
    assert other.returncode == 0, other.stderr
    refused = call("simulate", *words, "--force", "--set", "tau_gamma=0.3", "--ratings", "ranks")
    assert refused.returncode == 2
    assert "modelled for magnitude and slider ratings, not for ranks ratings" in refused.stderr
