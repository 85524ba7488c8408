"""Rated against predicted softness of fabrics, and the softest fabric, in a small run and in made-up draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.fabric_ratings import fabric_rating_table
from softness_bayes.checking.misfit import TYPICAL
from softness_bayes.checking.softest import Softest, softest_fabrics


@pytest.fixture(scope="module")
def result(report_run):
    return report_run("ratings")


def test_the_table_agrees_with_the_ratings_and_with_the_checks(result):
    table = fabric_rating_table(result.tree)
    constant, rating = result.group("constant_data"), result.group("observed_data")["rating"].values
    fabrics, loads = constant["fabric"].values, constant["load"].values
    checks = check_table(result.tree).xs("posterior", level="law").loc["mean log rating"].set_index(["load", "fabric"])
    for (load, fabric), row in table.iterrows():
        here = (loads[constant["load_index"].values] == load) & (fabrics[constant["fabric_index"].values] == fabric)
        assert row["ratings"] == here.sum()
        assert row["rated"] == pytest.approx(np.exp(np.log(rating[here]).mean()))  # nothing is missing
        assert np.log(row["predicted"]) == pytest.approx(checks.loc[(load, fabric), "replicated"])
        assert row["predicted_low"] < row["predicted"] < row["predicted_high"]
    again = result.tables["fabric_ratings"]
    assert_allclose(again, table)


def test_a_fabric_that_is_rated_otherwise_stands_out_and_no_other_does(result):
    tree, constant = result.tree.copy(), result.group("constant_data")
    replicates = tree["posterior_predictive"].to_dataset()["rating"].values[0]
    typical = np.exp(np.log(replicates).mean(axis=0))  # ratings as the model predicts them
    one = (constant["load_index"].values == 0) & (constant["fabric_index"].values == 1)

    def differences(ratings):
        tree["observed_data"].dataset = tree["observed_data"].to_dataset().assign(rating=("rating_row", ratings))
        return fabric_rating_table(tree)["difference_sd"]

    assert differences(typical).abs().max() < 0.2
    found = differences(np.where(one, typical * 4.0, typical))
    label = (str(constant["load"].values[0]), str(constant["fabric"].values[1]))
    assert found[label] > 3.0
    assert found.drop(label).abs().max() < 1.0


def test_the_softest_is_the_highest_and_ties_share(result):
    stored = result.tree["predictions"].to_dataset()
    shape = stored[TYPICAL].shape
    # by fabric, then load; four fabrics, two loads: the third is highest under the first load, all tie under the second
    ratings = np.zeros(shape)
    ratings[..., 4] = np.where(np.arange(shape[1]) % 10 > 0, 2.0, -1.0)
    tree = result.tree.copy()
    tree["predictions"].dataset = stored.assign({TYPICAL: (stored[TYPICAL].dims, ratings)})
    fabrics = result.group("constant_data")["fabric"].values
    first, second = softest_fabrics(tree)
    share = 1.0 - np.mean(np.arange(shape[1]) % 10 == 0)
    assert first[:3] == ("2 mm", str(fabrics[2]), pytest.approx(share))
    assert first.error == pytest.approx(np.sqrt(share * (1 - share) / shape[1]))
    assert first.clear
    assert second.probability == pytest.approx(0.25)
    assert not second.clear
    assert not Softest("1 mm", "lawn", 0.52, 0.02, 3).clear
    older = replace(result, tree=tree)
    older.tree["predictions"].dataset = stored.drop_vars(TYPICAL)
    assert softest_fabrics(older.tree) == ()
