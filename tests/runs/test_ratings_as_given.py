"""Runs on ratings as people give them: grids, zeros, heavy tails, and their comparison."""

from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.errors import InputError
from softness_bayes.likelihood.error_laws import NORMAL, STUDENT
from softness_bayes.likelihood.scales import FREE, RANKS
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.results.result import Result
from softness_bayes.runs.comparison import compare
from softness_bayes.runs.run import sample
from support.report_runs import OPTIONS, experiment, quickly

BRIEF = OPTIONS | {"max_steps": 6}


@pytest.fixture(scope="module")
def given():
    """Whole numbers from 0 on, one of them ten times too large."""
    rated = experiment(participants=3)
    whole = np.maximum(np.round(rated.ratings.rating / 6.0), 0.0)
    whole[3] *= 10.0
    whole[5] = 0.0
    return rated._replace(ratings=replace(rated.ratings, rating=whole, resolution=np.ones(whole.size)))


@pytest.fixture(scope="module")
def results(given):
    with quickly():
        laws = {law.name: sample(given, **BRIEF, errors=law, direction=FREE) for law in (NORMAL, STUDENT)}
        exact = given._replace(ratings=replace(given.ratings, rating=given.ratings.rating + 1.0, resolution=None))
        return laws | {"exact": sample(exact, **BRIEF, errors=NORMAL, resolution=0.0)}


def test_ratings_are_kept_as_filed_and_as_they_are_understood(results, given, tmp_path):
    result = results["student"]
    constant = result.group("constant_data")
    assert (result.group("observed_data")["rating"].values == given.ratings.rating).all()
    assert "rating_as_filed" not in constant  # of ranks and answers to pairs
    zero = given.ratings.rating == 0
    assert zero.any()
    assert (constant["rating_value"].values == np.where(zero, 0.25, given.ratings.rating)).all()
    assert (constant["rating_low"].values[zero] == 0).all()
    assert (constant["rating_high"].values[zero] == 0.5).all()
    again = result.group("posterior_predictive")["rating"].values
    assert np.isclose(again % 1, 0.0).mean() + np.isclose(again, 0.25).mean() == 1.0
    result.save(tmp_path / "run")
    loaded = Result.load(tmp_path / "run")
    assert (experiment_of(loaded).ratings.rating == given.ratings.rating).all()
    assert options_of(loaded).errors is STUDENT
    assert options_of(loaded).direction is FREE
    assert "zero" not in loaded.provenance.rating_model.rating_note
    assert "of 0 are censored: they count as numbers below" in loaded.provenance.rating_model.rating_note


def test_laws_are_compared_on_the_same_probabilities(results):
    """Interval probabilities of both laws; densities of exact numbers are refused beside them."""
    laws = {name: results[name] for name in ("normal", "student")}
    table = compare(laws).table
    assert {*table.index} == {*laws}
    assert "errors=student" in table.loc["student", "model"]
    assert np.isfinite(table["elpd"]).all()
    assert np.isfinite(compare(laws, "participant").table["elpd"]).all()
    with pytest.raises(InputError, match="fitted to other data than normal"):
        compare({"normal": results["normal"], "exact": results["exact"]})


def test_orders_go_through_a_run(given, tmp_path):
    """Places of the fabrics of each load, with lists that the table names."""
    ratings = given.ratings
    lists = 10 * ratings.participant + ratings.load
    ordered = given._replace(ratings=replace(ratings, lists=lists, resolution=None))
    with quickly():
        fix = {name: value for name, value in OPTIONS["fix"].items() if name != "tau"}
        result = sample(ordered, **BRIEF | {"fix": fix}, scale=RANKS)
    assert "varsigma" in result.group("posterior")
    assert "tau" not in result.group("posterior")
    assert result.provenance.rating_model.rating_errors == "gumbel"
    assert "places in" in result.provenance.rating_model.rating_note
    result.save(tmp_path / "run")
    loaded = Result.load(tmp_path / "run")
    compared = compare({"run": result, "again": loaded})
    assert (compared.table["units"] == np.unique(lists).size).all()
    assert compared.table["elpd_diff"].abs().max() < 1e-6
    assert "holding out each list" in compared.sentence
    again = experiment_of(loaded).ratings
    assert (again.lists == lists).all()
    assert (again.rating == ratings.rating).all()
    assert options_of(loaded).scale is RANKS
    pit = loaded.group("constant_data")["loo_pit"].values
    assert ((pit >= 0.0) & (pit <= 1.0)).all()
