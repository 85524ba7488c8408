"""Runs on loads with errors, from the data to the files, the report and the command line."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.data import Ratings, ratings_csv
from softness_bayes.likelihood import uncertain_loads
from softness_bayes.report.cards import input_errors_of
from softness_bayes.report.page import report_page
from softness_bayes.results.result import Result
from softness_bayes.runs.run import sample
from support.command_line import FIXED, QUICK, TOUCH, call, refused
from support.paths import DATA
from support.report_runs import OPTIONS, experiment, quickly
from support.variants import errors_of_loads


def test_it_says_whether_loads_were_taken_as_exact(variant_run, report_run):
    result = variant_run("loads")
    said = result.said_of_loads()
    assert said.startswith("loads: the model includes relative errors of 0.05 to 0.1, independent for each rating")
    assert said in input_errors_of(result).remarks
    assert_allclose(result.load_cv[:4], [0.0, 0.1, 0.1, 0.05])
    plain = report_run("ratings")
    assert plain.said_of_loads().startswith("loads: treated as exact")
    assert not plain.load_cv.any()
    with quickly():
        zero = sample(experiment(), **OPTIONS, load_cv=0.0)
    assert zero.said_of_loads() == "loads: exact, as stated"
    assert_array_equal(zero.group("posterior")["b"].values, plain.group("posterior")["b"].values)


def test_the_table_keeps_its_errors(tmp_path):
    made = errors_of_loads()
    path = tmp_path / "ratings.csv"
    path.write_text(ratings_csv(made.ratings), encoding="utf-8")
    again = Ratings.read(path)
    assert_array_equal(np.sort(again.load_cv), np.sort(made.ratings.load_cv))
    assert "load_cv" not in ratings_csv(experiment().ratings)


@pytest.mark.parametrize(("cell", "most"), [("-0.1", "0.3"), ("5 kPa", "0.3"), ("40 %", "30 %")])
def test_impossible_errors_are_named(tmp_path, cell, most):
    path = tmp_path / "ratings.csv"
    path.write_text(f"fabric,force_n,load_cv,rating\nchiffon,1,,3\nchiffon,1,{cell},4\n", encoding="utf-8")
    ended = call("check", "--data", path, "--fabrics", DATA / "fabrics.csv")
    refused(ended, "ratings.csv", "row 3", "'load_cv'", f"from 0 to {most}")


@pytest.mark.parametrize(
    ("typed", "most"), [(["--load-cv", "nan"], 0.3), (["--load-cv", "0.5"], 0.3), (["--shared-load-cv", "0.2"], 0.1)]
)
def test_impossible_options_are_refused(tmp_path, typed, most):
    ended = call("sample", "--data", DATA / "ratings.csv", *typed, "--out", tmp_path / "run")
    refused(ended, f"from 0 to {most}")


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
