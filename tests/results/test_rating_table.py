"""Ratings that a finished run predicts, as a table: their columns, and the reasons that it gives for them."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.results import rating_table
from softness_bayes.results.fitted import Fitted, rated_among
from softness_bayes.results.rating_table import parts_of
from softness_bayes.touch.contact import Force, Indentation
from support.report_runs import CLOTH, LOADS, quickly

NAMES = ("typical_rating", "new_rater_rating", "mean_rating")
NEW = Fabrics(("gauze", "steel", "felt"), effective_modulus=np.array([1e3, 2e8, 1e5]))


@pytest.fixture(scope="module")
def result(report_run):
    return report_run("ratings")


@pytest.fixture(scope="module")
def table(result):
    with quickly():
        return result.predict(draws=100)


def test_bands_are_nested_and_widen_from_the_typical_rater_to_a_new_one(table):
    for name in NAMES:
        ends = table[[f"{name}{end}" for end in ("_low", "_low_50", "", "_high_50", "_high")]].to_numpy()
        assert (np.diff(ends, axis=1) >= 0).all(), name
        assert (ends > 0).all(), name
    width = [np.log(table[f"{name}_high"] / table[f"{name}_low"]) for name in NAMES]
    assert (width[0] < width[2]).all()
    assert (width[2] < width[1]).all()
    assert (table["raters"] == 5).all()
    assert len(table) == len(CLOTH) * len(LOADS)


def test_the_mean_is_of_as_many_raters_as_are_asked_for(result, table):
    with quickly():
        many = result.predict(draws=100, raters=200)
        again = result.predict(draws=100)
    width = [np.log(one["mean_rating_high"] / one["mean_rating_low"]) for one in (table, many)]
    assert (width[1] < width[0]).all()
    assert (many["raters"] == 200).all()
    pd.testing.assert_frame_equal(again, table)
    with quickly(), pytest.raises(InputError, match="raters is 0, expected a whole number from 1"):
        result.predict(draws=10, raters=0)


def test_many_touches_are_predicted_in_parts(result, table, monkeypatch):
    """In the same order; the forward model has the same draws, and ratings those of other new raters."""
    assert len(parts_of(result.fabrics, len(LOADS), 100)) == 1
    monkeypatch.setattr(rating_table, "ROOM", 2 * len(LOADS) * 100)
    parts = parts_of(result.fabrics, len(LOADS), 100)
    assert [len(part) for part in parts] == [2] * (len(CLOTH) // 2) + [1] * (len(CLOTH) % 2)
    with quickly():
        found = result.predict(draws=100)
    pd.testing.assert_index_equal(found.columns, table.columns)
    pd.testing.assert_index_equal(found.index, table.index)
    assert found["fabric"].tolist() == table["fabric"].tolist()
    for name in ("force_n", "e_fab_kpa", "peak_stress_kpa_low", "total_rate_hz"):
        assert_allclose(found[name], table[name], rtol=1e-6)
    for name in NAMES:
        width = np.log(table[f"{name}_high"] / table[f"{name}_low"])
        assert (np.abs(np.log(found[name] / table[name])) < 0.2 * width + 1e-9).all()


def test_what_was_rated_has_the_ratings_that_the_run_stores(result, table):
    stored = np.median(result.group("predictions")["typical_rating_of_condition"].values[0], axis=0)
    by_load = stored.reshape(len(CLOTH), len(LOADS)).T.ravel()
    order = [result.fabrics.names.index(name) for name in table["fabric"][: len(CLOTH)]]
    assert order == [*range(len(CLOTH))]
    width = table["typical_rating_high"] / table["typical_rating_low"]
    assert (np.abs(np.log(table["typical_rating"] / by_load)) < 0.5 * np.log(width) + 1e-6).all()
    assert (table["beyond_moduli"] == "").all()
    assert (table["beyond_loads"] == "").all()


def test_reasons(result):
    with quickly(), pytest.warns(UserWarning, match=r"looks wrong: E_fab of 1 of 3 fabrics \(steel"):
        table = result.predict(NEW, [Indentation(2e-3), Indentation(7.9e-3), Force(1e-3)], draws=60)
    rows = table.set_index(["fabric", "remarks"]).reset_index("remarks")
    assert rows.loc["gauze", "beyond_moduli"].tolist() == ["below"] * 3
    assert rows.loc["steel", "beyond_moduli"].tolist() == ["above"] * 3
    assert rows.loc["felt", "beyond_moduli"].tolist() == [""] * 3
    # the run had 2 mm and 1.5 N, under which fabrics yielded by more or by less
    assert table["beyond_loads"].tolist()[3:] == ["above"] * 3 + ["below"] * 3
    radius = np.sqrt(8.0 * 7.9)
    assert_allclose(table["p_beyond_half_radius"][3:6], float(radius > 4.0))
    assert_allclose(table["p_beyond_radius"][3:6], 0.0)
    assert all("R/2, where Hertz's geometry is questionable, in 100 %" in words for words in table["remarks"][3:6])
    silent = table["total_rate_hz_high"] == 0
    assert silent.any()
    assert (table["p_silent"][silent] >= 0.95).all()
    assert table["remarks"][silent].str.startswith("no receptor fires in").all()
    # whatever is silent has the same rating
    quiet = table.loc[table["p_silent"] == 1.0, "typical_rating"]
    assert_allclose(quiet, quiet.iloc[0], rtol=1e-12)
    assert "E_fab above the rated range (20 to 400 kPa)" in rows.loc["steel", "remarks"].iloc[0]
    assert "load below the rated range (" in table["remarks"].iloc[-1]


def test_equal_responses_have_equal_limits(result):
    """Silent fabrics have one response: what is drawn for new raters is shared, and is as if drawn for each."""
    soft = Fabrics(("lint", "fluff", "down", "felt"), effective_modulus=np.array([1.0, 2.0, 3.0, 1e5]))
    with quickly():
        with pytest.warns(UserWarning, match="looks wrong: E_fab of 3 of 4 fabrics"):
            found = result.predict(soft, [Indentation(1e-4), Force(1e-3)], draws=60)
        with pytest.warns(UserWarning, match="looks wrong: E_fab of 1 of 1 fabric"):
            alone = result.predict(soft.take(("lint",)), [Indentation(1e-4)], draws=60)
    silent = found[found["p_silent"] == 1.0]
    assert len(silent) >= 6
    for name in NAMES:
        ends = [f"{name}{end}" for end in ("_low", "_low_50", "", "_high_50", "_high")]
        assert silent[ends].drop_duplicates().shape == (1, 5), name
        assert_allclose(alone[ends].iloc[0], silent[ends].iloc[0], rtol=0.15)
    assert found["new_rater_rating_low"].nunique() == len(found) - len(silent) + 1


def test_values_may_be_set(result, tmp_path):
    """Every draw is one point then: no limits of the chain, and the ratings' are those of their level and of raters."""
    b = result.values(100)["b"]
    with quickly():
        plain, low, high = (result.predict(draws=100, values=values) for values in (None, {"b": b.min()}, {"b": 2000}))
        assert (plain["total_rate_hz_low"] < plain["total_rate_hz_high"]).any()
        assert_allclose(low["total_rate_hz_low"], low["total_rate_hz_high"])
        assert (low["e_skin_kpa"] < high["e_skin_kpa"]).all()
        assert (low["new_rater_rating_low"] < low["typical_rating_low"]).all()
        # at the medians themselves it is the middle of the posterior's own prediction
        at = result.predict(draws=100, values={"b": float(np.median(b))})
        inside = (at["e_skin_kpa"] >= plain["e_skin_kpa_low"]) & (at["e_skin_kpa"] <= plain["e_skin_kpa_high"])
        assert inside.all()
        with pytest.raises(InputError, match="m cannot be set: expected a parameter that the run sampled, one of b, "):
            result.predict(draws=10, values={"m": 2.0})
        with pytest.raises(InputError, match="values: expected a mapping"):
            result.predict(draws=10, values=[2.0])
        with pytest.raises(InputError, match="b is -1"):
            result.predict(draws=10, values={"b": -1.0})


def test_fabrics_with_errors_are_less_certain(result):
    given = Fabrics(("felt", "lint"), effective_modulus=np.array([1e5, 1e5]), effective_modulus_cv=np.array([0, 0.5]))
    with quickly():
        table = result.predict(given, [Force(1.5)], draws=200)
        fitted = Fitted(result, 100)
    width = np.log(table["typical_rating_high"] / table["typical_rating_low"])
    assert width[1] > 1.1 * width[0]
    assert_allclose(table["e_fab_kpa"], 100.0, rtol=0.2)
    assert_allclose(table.loc[0, ["e_fab_kpa_low", "e_fab_kpa_high"]].astype(float), 100.0)
    assert table["e_fab_kpa_low"][1] < 60
    assert table["e_fab_kpa_high"][1] > 150
    drawn = fitted.modulus(np.random.default_rng(1), given)
    assert_allclose(drawn[:, 0], 1e5)
    assert 0.3 < np.log(drawn[:, 1]).std() < 0.65
    # one of the same name is the rated one only if its modulus is the same
    names = CLOTH.names[1:3]
    other = Fabrics(names, effective_modulus=CLOTH.effective_modulus[1:3] * [1.0, 1.1])
    assert rated_among(result, other).tolist() == [result.fabrics.names.index(names[0]), -1]


def test_z_scores(report_run):
    with quickly():
        table = report_run("z-scores").predict(draws=40)
    assert (table["typical_rating_low"] < 0).any()
    assert (table["mean_rating_low"] <= table["mean_rating"]).all()


def test_two_touches_apart_by_the_weber_fraction_are_ordered_three_times_in_four(result, table):
    """At one point of the parameters; two touches that differ by little are scaled to the fraction."""
    fitted = Fitted(result, 16, {"gamma": 1.2})
    scene = fitted.scene(result.fabrics, result.loads)
    known = fitted.posterior.rating_parameters(fitted.theta[:1])
    x = [
        np.log(scene.total_rate(fitted.touch, ratio * scene.fabric_modulus)[0] / scene.n_receptors + known.eps)
        for ratio in (0.97, 1.0, 1.03)
    ]
    found = rating_table.weber_fraction(fitted, scene, scene.total_rate(fitted.touch), None)
    finite = np.isfinite(found["weber_fraction"])
    assert finite.any()
    steps = np.log1p(found["weber_fraction"][finite]) / np.log(1.03 / 0.97)
    apart = known.gamma * np.abs(x[2] - x[0])[finite] * steps
    assert_allclose(norm.cdf(apart / (np.sqrt(2.0) * known.varsigma)), 0.75, atol=0.01)
    # where the response hardly changes, no fabric within reach is told apart
    flat = 1.2 * np.abs(x[2] - x[0]) / np.log(1.03 / 0.97) * np.log(rating_table.OUT_OF_REACH)
    assert_array_equal(finite, flat > rating_table.TOLD_APART * known.varsigma)
    assert (table["weber_fraction_low"] <= table["weber_fraction"]).all()
    assert (table["weber_fraction"] <= table["weber_fraction_high"]).all()
