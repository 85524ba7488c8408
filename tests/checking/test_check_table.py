"""The table of predictive checks and its sentences, on results whose ratings are made to order."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from softness_bayes.checking.check_table import adjusted, check_table
from softness_bayes.checking.checks import EXPONENTS
from softness_bayes.checking.layout import layout_of
from softness_bayes.checking.provenance import Finding, Findings, attributes_of
from softness_bayes.checking.quantities import FALL, PLACE, QUANTITIES, TURNS_OVER, Reproduction, turns_reproduced
from softness_bayes.checking.sentences import check_sentences, turn_sentence
from softness_bayes.parameters.declared import FABRIC_MODULUS
from support.made_ratings import LAY, MODULUS, SHALLOW, STEEP, tree

FLAT = np.tile([0.2, 0.5, 1.0, 2.0, 3.0, 4.0], 2)


def test_moduli_that_are_sampled_stand_where_the_ratings_put_them(rng):
    """A bracket's middle may stand on the other side of the turning point: a fall among such middles is none."""
    drawn = xr.Dataset(
        {FABRIC_MODULUS: (("chain", "draw", "uncertain_fabric"), [[[7.0, 90.0], [9.0, 70.0], [8.0, 80.0]]])},
        coords={"uncertain_fabric": ["e", "b"]},
    )
    known = tree(rng)
    known["posterior"] = xr.DataTree(drawn)
    found = layout_of(known)
    fabric = LAY.design.fabric
    np.testing.assert_allclose(found.modulus[fabric == 4], 8e3)
    np.testing.assert_allclose(found.modulus[fabric == 1], 80e3)
    np.testing.assert_allclose(found.modulus[~np.isin(fabric, [1, 4])], MODULUS[~np.isin(fabric, [1, 4])])
    assert [layout_of(tree(rng, direction=f"{way}-with-firing")).sign for way in ("rises", "falls")] == [1, -1]


def test_the_table_has_every_quantity_under_both_laws(rng):
    table = check_table(tree(rng))
    names = {quantity.name for quantity in QUANTITIES}
    assert {*table.loc["prior"].index} == names
    assert {*table.loc["posterior"].index} == names | {
        "deviations of mean ratings",
        "fabrics' own deviations",
        "participants' own exponents",
        "deviations along the response's slope",
        "LOO-PIT",
        FALL,
    }
    falls = table.loc[("posterior", FALL)]
    assert ((falls["power"] > 0) & (falls["power_mcse"] < 0.06)).all()
    assert table.drop(index=("posterior", FALL))["power"].isna().all()
    curve = table.loc[("posterior", "mean log rating")]
    assert curve[["load", "fabric"]].to_numpy().tolist() == [[x, f] for x in ("1 mm", "2 mm") for f in "abcdef"]
    assert (curve["participants"] == "same").all()
    assert (table.loc["posterior"].loc[["spread of participants"], "participants"] == "new").all()
    assert (table.loc["prior"]["participants"] == "new").all()
    assert ((curve["low"] < curve["replicated"]) & (curve["replicated"] < curve["high"])).all()


def test_a_model_that_turns_over_reproduces_ratings_that_do():
    # in 14 of 40 data sets of the model no number deviates by chance; this is the first
    head, *loads, others = check_sentences(check_table(tree(np.random.default_rng(4))))
    assert "reproduce the turning point (maximum)?" in head
    assert "at least 80 % of simulated tables" in head
    assert [load.split(": yes; the ratings turn over at")[0] for load in loads] == ["1 mm", "2 mm"]
    assert all("% of simulated tables" in load.partition("would fail in ")[2] for load in loads)
    assert "reproduces all other" in others


@pytest.mark.parametrize(("seen", "assumed"), [(STEEP, FLAT), (FLAT, STEEP)])
def test_a_model_that_is_wrong_about_the_turn_is_told_so(rng, seen, assumed):
    _, *loads, others = check_sentences(check_table(tree(rng, seen, assumed)))
    assert [": no; the ratings" in load for load in loads] == [True, True]
    assert ("turn over at" if seen is STEEP else "show no clear turn") in loads[0]
    assert "mean log rating" in others


def test_without_power_nothing_is_said_to_be_reproduced(rng):
    """A response that cannot turn, and one that hardly does."""
    for rates, words in ((FLAT, "does not fall within the range of the fabrics"), (SHALLOW, "% of simulated tables")):
        table = check_table(tree(rng, rates, rates))
        _, *loads, _ = check_sentences(table)
        assert all(
            ": not shown by the ratings; the ratings show no clear turning point" in load and words in load
            for load in loads
        )
        assert [one.reproduced for one in turns_reproduced(table)] == [None, None]


def test_of_many_loads_some_fail_by_chance(rng):
    table = check_table(tree(rng))
    one = table[table["load"] == "1 mm"]
    _, counts, *loads, _ = check_sentences(pd.concat([one.assign(load=f"{k} mm") for k in range(40)]))
    assert counts.startswith("of 40 loads: yes ")
    assert counts.endswith("(for a correct model, at most about 2 would be no by chance); 12 of them:")
    assert len(loads) == 12


def test_deviations_are_named(rng):
    groups = tree(rng)
    groups.attrs |= attributes_of(Findings((Finding(EXPONENTS, 0.001, 0.5),)))
    groups["constant_data"]["loo_pit"][:] = 0.5
    *_, others = check_sentences(check_table(groups))
    assert "participants' own exponents" in others
    assert "LOO-PIT" in others
    assert "fabrics" not in others


def test_p_values_are_adjusted_by_holm_s_method():
    """Two quantities of one and of two rows, and the turning points of two loads apart from them, by hand."""
    rows = [("a", "all", 0.02), ("b", "1 mm", 0.04), ("b", "2 mm", 0.5), (EXPONENTS, "all", 0.9)]
    rows += [(FALL, "1 mm", 0.02), (FALL, "2 mm", 0.99), (TURNS_OVER, "1 mm", 0.0), (PLACE, "1 mm", 0.0)]
    table = pd.DataFrame(rows, columns=["quantity", "load", "p_joint"]).assign(law="posterior")
    assert adjusted(table)[:6].to_list() == pytest.approx([0.06, 0.08, 1.0, 0.9, 0.04, 0.99])
    assert adjusted(table)[6:].isna().all()
    assert adjusted(table.assign(law="prior")).isna().all()


@pytest.mark.parametrize(("laboratories", "most"), [(20, 0.25), pytest.param(200, 0.14, marks=pytest.mark.slow)])
def test_a_correct_model_rarely_fails_any_check(rng, laboratories, most):
    """5 % for the turning points and 5 % for all others; unadjusted, about every second table would (the control).

    The bars are two standard errors above 10 %.
    """
    alarms = []
    for _ in range(laboratories):
        checks = check_table(tree(rng)).loc["posterior"]
        plain = 1.0 - (2.0 * checks["p_value"] - 1.0).abs()
        alarms.append([bool((checks["p_adjusted"] < 0.05).any()), bool((plain < 0.05).any())])
    share = np.mean(alarms, axis=0)
    assert share[0] <= most
    assert share[1] > 0.5


@pytest.mark.parametrize(
    ("observed", "low", "high", "said"),
    [
        (0.8, 0.4, 1.6, "they fall by 0.8 times the predicted fall (simulated tables: 0.4 to 1.6)"),
        (-0.5, -1.0, 3.0, "they rise by 0.5 times"),
        (-42.0, -60.0, 70.0, "too small to compare with noise"),
    ],
)
def test_a_fall_is_a_multiple_of_the_predicted_one_only_where_that_means_something(observed, low, high, said):
    turns = pd.Series({"observed": 0.0, "replicated": 0.1})
    beyond = pd.Series(
        {"observed": observed, "replicated": 1.0, "low": low, "high": high, "power": 0.9, "power_mcse": 0.01}
    )
    one = Reproduction("1 mm", True, {TURNS_OVER: turns, PLACE: beyond, FALL: beyond})
    assert said in turn_sentence(one)
