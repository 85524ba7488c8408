"""Rated and predicted means by another way, and fits of ratings that were turned upside down."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from softness_bayes.base.files.run_files import RULER
from softness_bayes.checking.agreement import TYPICAL, HighestRated, fabric_rating_table, highest_rated
from softness_bayes.checking.check_table import check_table
from softness_bayes.cli.running import print_result
from softness_bayes.data.oddities import few_raters_sentence
from softness_bayes.likelihood.scales import FALLS, RISES
from softness_bayes.people.free_means import FreeMeans
from softness_bayes.report import page
from softness_bayes.report.cards import Standing, cards
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.fitted import options_of
from softness_bayes.runs.run import sample
from support import report_runs
from support.report_runs import OPTIONS, converged, quickly


def test_few_raters_are_warned_of():
    assert few_raters_sentence(3).startswith("only 3 raters: how much people differ (tau) rests on its prior")
    assert few_raters_sentence(6) == ""
    # the 90 % interval of a standard deviation of n numbers
    low, high = np.sqrt([5, 4] / chi2.ppf([[0.95], [0.05]], [5, 4]))
    assert (high / low)[0] < 3.2 < (high / low)[1]


# runs on ratings turned upside down: 400 / rating


@pytest.fixture(scope="module")
def upside_down():
    made = report_runs.experiment()
    turned = made._replace(ratings=replace(made.ratings, rating=400.0 / made.ratings.rating))
    with quickly():
        return {
            "forced": converged(sample(turned, **OPTIONS | {"direction": RISES})),
            "left to the data": converged(sample(turned, **OPTIONS)),
        }


@pytest.fixture
def plain(monkeypatch):
    """Draw no figure of a page."""
    monkeypatch.setattr(
        page, "picture", lambda _, name: page.Picture(name, "data:image/png;base64,", name, name, "learnt")
    )


def test_a_readout_against_its_data_says_so_first_and_is_never_green(upside_down, plain, capsys, tmp_path):
    result = upside_down["forced"]
    found = cards(result)
    assert found[0].standing is Standing.BAD
    assert found[0].answer == "No: wrong direction of the ratings"
    assert (
        found[0].details[0].startswith("The direction contradicts the data: with --direction rises-with-firing the pr")
    )
    assert not any(finding.standing is Standing.GOOD for finding in found)
    assert "This fit has failed." in page.report_page(result)
    assert "the fit failed: the direction contradicts" in result._repr_html_().partition("Converged")[0]
    print_result(result, tmp_path)
    first, *_, trust, learnt, following = capsys.readouterr().out.splitlines()
    assert first.startswith("the fit failed: the direction contradicts the data")
    assert trust.startswith("Trust it?  No: ")
    assert "nothing about skin or receptors" in learnt
    assert "--direction falls-with-firing" in following


def test_left_to_the_data_the_same_table_fits(upside_down, plain, capsys, tmp_path):
    result = upside_down["left to the data"]
    found = result.attributes
    assert (found["direction"], found["direction_asked"], found["firing_rises"]) == ("falls-with-firing", 0, 1.0)
    assert found["direction_note"].startswith("--direction falls-with-firing was chosen from the data")
    assert (options_of(result).direction, "direction" in options_of(result).decided) == (FALLS, True)
    assert result.faults == []
    assert result.tables[RULER]["value"]["share"] > 0.8
    follows = next(finding for finding in cards(result) if "follow" in finding.question)
    assert follows.standing is not Standing.BAD
    assert "has failed" not in page.report_page(result)
    print_result(result, tmp_path)
    out = capsys.readouterr().out
    assert "the fit failed" not in out
    assert found["verdict"] in out.splitlines()


# rated and predicted


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
    people = FreeMeans(experiment_of(result).ratings, options_of(result)).table().set_index(["load", "fabric"])
    own = ["people", "people_low", "people_high", "p_highest"]
    assert list(again) == [*table, *own]
    assert_allclose(again[[*table]], table)
    assert_allclose(again[own], people.loc[again.index, own], rtol=1e-6)
    assert again["rated"].between(again["people_low"], again["people_high"]).all()


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


def test_the_most_probable_highest_and_ties_share(result):
    stored = result.tree["predictions"].to_dataset()
    shape = stored[TYPICAL].shape
    # by fabric, then load; four fabrics, two loads: the third is highest under the first load, all tie under the second
    ratings = np.zeros(shape)
    ratings[..., 4] = np.where(np.arange(shape[1]) % 10 > 0, 2.0, -1.0)
    tree = result.tree.copy()
    tree["predictions"].dataset = stored.assign({TYPICAL: (stored[TYPICAL].dims, ratings)})
    fabrics = result.group("constant_data")["fabric"].values
    first, second = highest_rated(tree)
    share = 1.0 - np.mean(np.arange(shape[1]) % 10 == 0)
    assert first[:3] == ("2 mm", str(fabrics[2]), pytest.approx(share))
    assert first.error == pytest.approx(np.sqrt(share * (1 - share) / shape[1]))
    assert first.clear
    assert second.probability == pytest.approx(0.25)
    assert not second.clear
    assert not HighestRated("1 mm", "lawn", 0.52, 0.02, 3).clear
