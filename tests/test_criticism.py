"""The table of predictive checks and its sentences, on results whose ratings are made to order."""

import dataclasses

import numpy as np
import pytest
from test_predictive import MODULUS, STEEP, layout, ratings, replicates

from softness_bayes import arviz_bridge
from softness_bayes.criticism import NEW_PARTICIPANTS, check_sentences, check_table, layout_of
from softness_bayes.inference.predictive import QUANTITIES

LAY = layout()
FLAT = np.tile([0.2, 0.5, 1.0, 2.0, 3.0, 4.0], 2)
BY_ROW = ("rating", NEW_PARTICIPANTS, "participant_index", "fabric_index", "load_index", "loo_pit")


def tree(rng, seen=STEEP, assumed=STEEP, direction="softness"):
    """The groups of a result whose model assumes some rates, with data made at others."""
    filed = ratings(rng, LAY.design, seen)
    same = replicates(rng, LAY, filed, assumed)
    new = replicates(rng, LAY, filed, assumed, new=True)
    who = LAY.design
    return arviz_bridge.to_tree(
        {
            "log_likelihood_participant": {"ratings_of_participant": np.zeros((1, 1, 15))},
            "posterior_predictive": {"rating": same[None], NEW_PARTICIPANTS: new[None]},
            "prior_predictive": {"rating": np.exp(rng.normal(3, 3, (1, 50, who.n_rows)))},
            "observed_data": {"rating": filed},
            "constant_data": {
                "effective_modulus_kpa": MODULUS[:6] * 1e-3,
                "indentation_mm": np.array([1.0, 2.0]),
                "participant_index": who.participant,
                "fabric_index": who.fabric[who.condition],
                "load_index": LAY.load[who.condition],
                "loo_pit": rng.random(who.n_rows),
            },
        },
        dims={
            "ratings_of_participant": ["participant"],
            "effective_modulus_kpa": ["fabric"],
            "indentation_mm": ["load"],
            **{name: ["rating_row"] for name in BY_ROW},
        },
        coords={"participant": [f"P{k}" for k in range(15)], "fabric": [*"abcdef"], "load": ["1 mm", "2 mm"]},
        attrs={
            "direction": direction,
            "rating_scale": "magnitude",
            **{f"{what}_{k}": 0.5 for what in ("condition", "fabric", "exponent") for k in ("p_value", "deviation")},
        },
    )


def test_the_layout_comes_back(rng):
    found = layout_of(tree(rng))
    np.testing.assert_array_equal(found.design.condition, LAY.design.condition)
    np.testing.assert_array_equal(found.design.participant, LAY.design.participant)
    np.testing.assert_array_equal(found.load, LAY.load)
    np.testing.assert_allclose(found.modulus, MODULUS)
    assert found.sign == 1
    assert layout_of(tree(rng, direction="inverse")).sign == -1


def test_the_table_has_every_quantity_under_both_laws(rng):
    table = check_table(tree(rng))
    names = {quantity.name for quantity in QUANTITIES}
    assert {*table.loc["prior"].index} == names
    assert {*table.loc["posterior"].index} == names | {
        "deviations of mean ratings",
        "fabrics' own deviations",
        "participants' own exponents",
        "LOO-PIT",
    }
    curve = table.loc[("posterior", "mean log rating")]
    assert curve[["load", "fabric"]].to_numpy().tolist() == [[x, f] for x in ("1 mm", "2 mm") for f in "abcdef"]
    assert (curve["participants"] == "same").all()
    assert table.loc[("posterior", "spread of participants"), "participants"] == "new"
    assert (table.loc["prior"]["participants"] == "new").all()
    assert ((curve["low"] < curve["replicated"]) & (curve["replicated"] < curve["high"])).all()


def test_a_model_that_turns_over_reproduces_ratings_that_do(rng):
    inflection, others = check_sentences(check_table(tree(rng)))
    assert "\n" not in inflection
    assert inflection.count(": yes, ratings turn over at") == 2
    assert "nothing else" in others


@pytest.mark.parametrize(("seen", "assumed"), [(STEEP, FLAT), (FLAT, STEEP)])
def test_a_model_that_is_wrong_about_the_turn_is_told_so(rng, seen, assumed):
    inflection, others = check_sentences(check_table(tree(rng, seen, assumed)))
    assert inflection.count(": no, ratings") == 2
    assert ("turn over at" if seen is STEEP else "show no clear turn") in inflection
    assert "mean log rating" in others


def test_deviations_are_named(rng):
    groups = tree(rng)
    groups.attrs["exponent_p_value"] = 0.001
    groups["constant_data"]["loo_pit"][:] = 0.5
    _, others = check_sentences(check_table(groups))
    assert "participants' own exponents" in others
    assert "LOO-PIT" in others
    assert "fabrics" not in others


def test_two_fabrics_are_not_judged(rng):
    few = dataclasses.replace(LAY, load=np.arange(12) // 2)
    groups = tree(rng)
    groups["constant_data"]["load_index"][:] = few.load[LAY.design.condition]
    groups["constant_data"]["fabric_index"][:] = LAY.design.condition % 2
    groups["constant_data"] = (
        groups["constant_data"]
        .to_dataset()
        .drop_vars(["load", "indentation_mm"])
        .assign_coords(load=[f"{k} mm" for k in range(6)])
    )
    assert "not judged" in check_sentences(check_table(groups))[0]
