"""Runs on ratings as people give them: grids, zeros, heavy tails, orders."""

import numpy as np
import pytest

from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import FREE
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.result import Result
from softness_bayes.runs.comparison import compare
from softness_bayes.runs.run import sample
from support.report_runs import OPTIONS, quickly
from support.variants import orders, whole_numbers


@pytest.fixture(scope="module")
def given():
    with quickly():  # as the run has them
        return whole_numbers()


def test_ratings_are_kept_as_filed_and_as_they_are_understood(given):
    with quickly():
        result = sample(given, **OPTIONS | {"max_steps": 4}, errors=NORMAL, direction=FREE)
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
    assert "zero" not in result.provenance.rating_model.rating_note


def test_orders_go_through_a_run(variant_run, tmp_path):
    """Places of the fabrics of each load, with lists that the table names."""
    with quickly():
        result, lists = variant_run("orders"), orders().ratings.lists
    assert "tau" not in result.group("posterior")
    assert result.provenance.rating_model.rating_errors == "gumbel"
    result.save(tmp_path / "run")
    loaded = Result.load(tmp_path / "run")
    compared = compare({"run": result, "again": loaded})
    assert (compared.table["units"] == np.unique(lists).size).all()
    assert compared.table["elpd_diff"].abs().max() < 1e-6
    assert "holding out each list" in compared.sentence
    assert (experiment_of(loaded).ratings.lists == lists).all()
    pit = loaded.group("constant_data")["loo_pit"].values
    assert ((pit >= 0.0) & (pit <= 1.0)).all()
