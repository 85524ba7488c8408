"""Runs on loads with errors, from the data to the files, the report and the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.checking.checks import ALONG, FABRICS
from softness_bayes.data import Experiment, Ratings, ratings_csv
from softness_bayes.likelihood import uncertain_loads
from softness_bayes.model.build import build
from softness_bayes.report.cards import input_errors_of
from softness_bayes.report.page import report_page
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.results.result import Result
from softness_bayes.runs.run import sample
from support.command_line import FIXED, QUICK, TOUCH, call, refused
from support.paths import DATA
from support.report_runs import OPTIONS, experiment, quickly


def rated() -> Experiment:
    """Ratings of which every third has no error of its own, and the first an exact load."""
    made = experiment()
    cv = np.where(np.arange(len(made.ratings)) % 3, 0.1, np.nan)
    cv[0] = 0.0
    return made._replace(ratings=replace(made.ratings, load_cv=cv))


@pytest.fixture(scope="module")
def result(few_pictures):
    with quickly():
        return sample(rated(), **OPTIONS, load_cv=0.05)


def test_data_and_model_come_back_from_the_file(result, tmp_path):
    result.save(tmp_path / "run")
    again = Result.load(tmp_path / "run")
    assert_array_equal(again.group("constant_data")["load_cv"].values, rated().ratings.load_cv)
    assert options_of(again).load_cv == 0.05
    with quickly():
        one, other = (build(each, options_of(again)).posterior for each in (experiment_of(again), rated()))
    theta = np.stack([again.values(20)[name] for name in one.names], axis=-1)
    assert_allclose(one.log_likelihood(theta), other.log_likelihood(theta), rtol=1e-9)
    kept = again.group("log_likelihood_joint")["ratings"].values.T.ravel()
    whole = np.stack([again.values()[name] for name in one.names], axis=-1)
    assert_allclose(one.log_likelihood(whole), kept, rtol=1e-6)


def test_it_predicts_ratings(result):
    with quickly():
        table = result.predict(draws=20)
    assert (table["new_rater_rating_high"] > table["typical_rating_high"]).all()


def test_replicates_are_spread_as_the_model_says(result):
    """Replicated ratings given the draws' effects scatter by more than varsigma where the response has a slope."""
    assert np.isfinite(result.group("posterior_predictive")["rating"].values).all()
    assert np.isfinite(result.group("log_likelihood")["rating"].values).all()
    assert np.isfinite(result.provenance.findings[FABRICS].p_value)
    assert np.isfinite(result.provenance.findings[ALONG].p_value)


def test_it_says_whether_loads_were_taken_as_exact(result, report_run):
    said = result.said_of_loads()
    assert said.startswith("loads: the model includes relative errors of 0.05 to 0.1, independent for each rating")
    assert said in input_errors_of(result).remarks
    assert "relative errors of 0.05 to 0.1" in report_page(result)
    assert_allclose(result.load_cv[:4], [0.0, 0.1, 0.1, 0.05])
    plain = report_run("ratings")
    assert plain.said_of_loads().startswith("loads: treated as exact")
    assert not plain.load_cv.any()
    with quickly():
        zero = sample(experiment(), **OPTIONS, load_cv=0.0)
    assert zero.said_of_loads() == "loads: exact, as stated"
    assert_array_equal(zero.group("posterior")["b"].values, plain.group("posterior")["b"].values)


def test_the_table_keeps_its_errors(tmp_path):
    made = rated()
    path = tmp_path / "ratings.csv"
    path.write_text(ratings_csv(made.ratings), encoding="utf-8")
    again = Ratings.read(path)
    assert_array_equal(np.sort(again.load_cv), np.sort(made.ratings.load_cv))
    assert "load_cv" not in ratings_csv(experiment().ratings)


@pytest.mark.parametrize(
    ("cell", "most"), [("-0.1", "0.3"), ("5 kPa", "0.3"), ("0.4", "0.3"), ("inf", "0.3"), ("40 %", "30 %")]
)
def test_impossible_errors_are_named(tmp_path, cell, most):
    path = tmp_path / "ratings.csv"
    path.write_text(f"fabric,force_n,load_cv,rating\nchiffon,1,,3\nchiffon,1,{cell},4\n", encoding="utf-8")
    ended = call("check", "--data", path, "--fabrics", DATA / "fabrics.csv")
    refused(ended, "ratings.csv", "row 3", "'load_cv'", f"from 0 to {most}")


@pytest.mark.parametrize("typed", ["-1", "nan", "0.5"])
def test_impossible_options_are_refused(tmp_path, typed):
    ended = call("sample", "--data", DATA / "ratings.csv", "--load-cv", typed, "--out", tmp_path / "run")
    assert ended.returncode == 2
    assert "from 0 to 0.3" in ended.stderr


def test_the_command_line_simulates_samples_and_resumes(tmp_path, brief_pilot, monkeypatch):
    home = tmp_path / "run"
    ended = call("simulate", *TOUCH, "--participants", "3", "--load-cv", "0.1", "--out", tmp_path / "made")
    assert ended.returncode == 0
    assert json.loads((tmp_path / "made" / "truth.json").read_text())["load_cv"] == 0.1
    data = tmp_path / "made" / "ratings.csv"
    monkeypatch.setattr(uncertain_loads, "FINE_KNOTS", (-2.0, -1.0, 0.0, 1.0, 2.0))  # as brief runs have them
    ended = call("sample", "--data", data, "--load-cv", "0.05", *QUICK, *FIXED, "--out", home, "--verbose")
    assert ended.returncode == 3
    assert "loads: the model includes relative errors of 0.1," in ended.stdout
    assert "--load-cv 0.05" in report_page(Result.load(home))
    more = call("resume", home, "--more-steps", "20")
    assert more.returncode == 3
    assert Result.load(home).provenance.ending.steps == 40


def test_a_shared_error_that_is_too_large_is_refused(tmp_path):
    ended = call("sample", "--data", DATA / "ratings.csv", "--shared-load-cv", "0.2", "--out", tmp_path / "run")
    assert ended.returncode == 2
    assert "from 0 to 0.1" in ended.stderr
