"""Whether a fit follows its ratings: numbers by another way, upside-down fits, and fits that must not be accused."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose
from scipy.stats import chi2, f

from softness_bayes.checking.agreement import TYPICAL, HighestRated, explain, fabric_rating_table, fit_of, highest_rated
from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.sentences import fit_faults, fit_sentence
from softness_bayes.cli.summary import print_result
from softness_bayes.data.oddities import few_raters_sentence
from softness_bayes.likelihood.directions import FALLS, RISES
from softness_bayes.likelihood.layout import Layout
from softness_bayes.people.free_means import free_means
from softness_bayes.report import page
from softness_bayes.report.cards import Standing, agreement_card, cards
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.runs.run import sample
from support import report_runs
from support.made_ratings import LAY, PLAIN, STEEP, ratings, tree
from support.report_runs import OPTIONS, converged, quickly

LOG_RATE = np.log(STEEP + 0.1)
LEVEL = 0.05


def explained(rng, seen, predicted, participants=15, layout=None):
    lay = layout or LAY
    fit = lay.fit(ratings(rng, lay.design, seen))
    return explain(lay, fit, np.atleast_2d(predicted))


def test_the_test_of_differences_is_the_analysis_of_variance(rng):
    """A whole table under one load, by sums of squares."""
    one = LAY.load == 0
    keep = one[LAY.design.condition]
    design = replace(
        LAY.design, condition=LAY.design.condition[keep], participant=LAY.design.participant[keep],
        fabric=LAY.design.fabric[one],
    )  # fmt: skip
    lay = Layout(design, LAY.modulus[one], LAY.load[one])
    filed = ratings(rng, design, STEEP[:6])
    found, whole = explain(lay, lay.fit(filed), np.zeros((1, 6)))
    table = np.log(filed)[np.lexsort((design.condition, design.participant))].reshape(15, 6)
    mean, own = table.mean(axis=0), table.mean(axis=1, keepdims=True)
    between, within = 15 * ((mean - mean.mean()) ** 2).sum() / 5, ((table - own - mean + mean.mean()) ** 2).sum() / 70
    assert found.p_value == pytest.approx(f.sf(between / within, 5, 70), rel=1e-6)
    assert found.spread == pytest.approx(np.sqrt((between - within) / 15), rel=1e-9)
    assert found == whole
    assert found.share == pytest.approx(0.0, abs=0.2)  # a constant explains nothing


@pytest.mark.parametrize(
    ("predicted", "share", "flat"),
    [(LOG_RATE, 1.0, False), (0.5 * LOG_RATE, 0.75, False), (0.0 * LOG_RATE, 0.0, True), (-LOG_RATE, -3.0, True)],
)
def test_shares_of_predictions_right_half_flat_and_upside_down(rng, predicted, share, flat):
    """A prediction c times the truth leaves (1 - c)² of its variance."""
    for one in explained(rng, STEEP, PLAIN.gamma * predicted):
        assert one.share == pytest.approx(share, abs=0.25 * (2.0 - share))
        assert one.flat is flat


def test_a_flat_line_through_flat_ratings_is_no_fault(rng):
    level = np.ones(12)
    found = [explained(rng, level, np.zeros(12))[-1] for _ in range(60)]
    assert not any(one.flat for one in found)
    assert np.mean([one.p_value < LEVEL for one in found]) < LEVEL + 3 * np.sqrt(LEVEL / 60)


def test_a_constant_of_a_load_or_a_draw_does_not_count(rng):
    draws = LOG_RATE + 5.0 * LAY.load + np.array([[0.0], [7.0]])
    state = rng.bit_generator.state
    one = explained(rng, STEEP, draws)
    rng.bit_generator.state = state
    other = explained(rng, STEEP, LOG_RATE)
    assert_allclose([e.share for e in one], [e.share for e in other])


def test_what_would_have_been_seen_is_seen(rng):
    """Differences of the size that is named are found about half the time, twice as large ones nearly always."""
    visible = explained(rng, np.ones(12), np.zeros(12))[-1].visible
    x = np.tile(np.linspace(-1, 1, 6), 2)
    x /= np.sqrt((x**2).mean() * 12 / 10)
    shares = []
    for factor in (1.0, 2.0):
        rate = np.exp(factor * visible / PLAIN.gamma * x) - 0.1 + 1.0
        drive = PLAIN.gamma * np.log(rate + 0.1)
        scale = factor * visible / np.sqrt(((drive - drive.mean()) ** 2).sum() / 10)
        rate = np.exp(scale * (np.log(rate + 0.1) - np.log(rate + 0.1).mean())) - 0.1
        shares.append(np.mean([explained(rng, rate, np.zeros(12))[-1].p_value < 1e-3 for _ in range(40)]))
    assert 0.2 < shares[0] < 0.8
    assert shares[1] > 0.95


def with_typical(groups, log_rating):
    """These groups with a prediction of every condition."""
    by_fabric = np.lexsort((LAY.load, LAY.design.fabric))
    values = np.broadcast_to(np.exp(log_rating)[by_fabric], (1, 3, 12))
    groups["predictions"] = groups["prior_predictive"]
    groups["predictions"].dataset = xr.Dataset({TYPICAL: (("chain", "draw", "condition"), values)})
    groups["posterior"] = groups["prior_predictive"]  # no omega in it
    return groups


def test_a_right_model_is_not_accused(rng):
    fit = fit_of(with_typical(tree(rng), PLAIN.gamma * LOG_RATE))
    assert fit_faults(fit) == []
    assert fit.explained[-1].share == pytest.approx(1.0, abs=0.05)
    assert fit_sentence(fit).startswith("the response explains ")


def test_as_many_free_moduli_as_means_are_no_test(rng):
    fit = fit_of(with_typical(tree(rng), PLAIN.gamma * LOG_RATE))
    assert (fit.free_moduli, fit.means) == (0, 12)
    free = fit._replace(free_moduli=12)
    assert "tests nothing: 12 moduli are free to follow 12 mean ratings" in fit_sentence(free)
    assert agreement_card(free).answer == "Not judged"
    # negative control: fewer are a test
    assert fit_sentence(fit._replace(free_moduli=6)).startswith("the response explains ")


def test_few_raters_are_warned_of():
    assert few_raters_sentence(3).startswith("only 3 raters: how much people differ (tau) rests on its prior")
    assert few_raters_sentence(6) == ""
    # the 90 % interval of a standard deviation of n numbers
    low, high = np.sqrt([5, 4] / chi2.ppf([[0.95], [0.05]], [5, 4]))
    assert (high / low)[0] < 3.2 < (high / low)[1]


def test_a_flat_model_is(rng):
    (fault,) = fit_faults(fit_of(with_typical(tree(rng), np.zeros(12))))
    assert fault.startswith("the prediction is flat although the ratings differ: at 1 mm it explains")
    assert "; at 2 mm it explains" in fault


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
    monkeypatch.setattr(page, "picture", lambda _, name: page.Picture(name, "data:image/png;base64,", name))


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
    fit = fit_of(result.tree)
    assert fit_faults(fit) == []
    assert fit.explained[-1].share > 0.8
    follows = next(finding for finding in cards(result) if "follow" in finding.question)
    assert (follows.answer, follows.standing) == ("Yes", Standing.GOOD)
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
    people = free_means(experiment_of(result).ratings, options_of(result)).table().set_index(["load", "fabric"])
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
