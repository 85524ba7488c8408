"""Rankings of a finished run: tables, the figure by its artists, the command line and the observed order."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.data.lists import read_order
from softness_bayes.report.conclusion import conclude, facts_of
from softness_bayes.results.ranking import REASONS
from softness_bayes.results.rating_table import cautions
from softness_bayes.runs.run import sample
from support.command_line import call, refused
from support.paths import ROOT
from support.report_runs import CLOTH, LOADS, OPTIONS, converged, experiment, quickly

REAL = ROOT / ".." / "shared" / "data" / "fabric_bending_618_drapetester.csv"

NEW = Fabrics(tuple("abcdef"), effective_modulus=np.array([10.0, 20.0, 2e5, 3e5, 2e5, 4e4]))


@pytest.fixture(scope="module")
def result(report_run):
    return report_run("ratings")


@pytest.fixture(scope="module")
def ranking(result):
    with quickly():
        return result.rank(NEW, LOADS, draws=100)


@pytest.fixture(scope="module")
def saved(result, tmp_path_factory):
    """The run on the disk."""
    home = tmp_path_factory.mktemp("saved") / "run"
    result.save(home)
    return home


def artist(figure, gid):
    return next(found for found in figure.findobj() if found.get_gid() == gid)


def test_the_order_is_that_of_the_predicted_ratings(result, ranking):
    with quickly():
        predicted = result.predict(NEW, LOADS, draws=100)
    table = ranking.table
    assert len(table) == 2 * len(NEW)
    for load, rows in table.groupby("load"):
        assert rows["order"].tolist() == [*range(1, 7)]
        assert (np.diff(rows["place"]) >= 0).all()
        assert rows["place"].sum() == pytest.approx(21)
        pressed = predicted["indentation_mm"].sub(2).abs() < 1e-9
        at = predicted[pressed if load == "2 mm" else ~pressed].set_index("fabric")
        # the run's rating is that of predict, up to what each draws given the data
        assert_allclose(rows["typical_rating"], at["typical_rating"][rows["fabric"]], rtol=0.3)
        assert_allclose(rows["p_silent"], at["p_silent"][rows["fabric"]])


def test_fabrics_of_one_response_tie(ranking):
    for load, rows in ranking.table.set_index("fabric").groupby("load"):
        assert rows.loc["c", "tie"] == rows.loc["e", "tie"] != "", load
        assert rows.loc["a", "tie"] == rows.loc["b", "tie"] != "", load  # both silent
        assert rows.loc["a", "p_silent"] == 1.0
        assert rows.loc["d", "tie"] == ""
        assert_allclose(rows.loc["c", "place"], rows.loc["e", "place"])
        assert "no receptor fires in 100 % of the draws" in rows.loc["a", "remarks"]


def test_probabilities_are_shares_of_draws_counted_one_by_one(ranking):
    """Each draw's ratings sorted and compared by hand; ratings that differ by rounding alone are equal."""
    for load, typical in ranking.typical.items():
        draws = [[float(f"{rating:.9g}") for rating in draw] for draw in typical.tolist()]
        table = ranking.pair_table.set_index("load").loc[str(load)]
        for row in table.itertuples():
            first, second = NEW.names.index(row.fabric), NEW.names.index(row.other)
            counted = [sum(sign * (draw[first] - draw[second]) > 0 for draw in draws) for sign in (1, -1)]
            assert_allclose([row.p_softer, row.p_harder], np.array(counted) / len(draws), err_msg=str(row))
        places = dict.fromkeys(NEW.names, 0.0)
        for draw in draws:
            order = sorted(draw, reverse=True)
            for name, rating in zip(NEW.names, draw, strict=True):
                places[name] += order.index(rating) + 1 + (order.count(rating) - 1) / 2
        told = ranking.table[ranking.table["load"] == str(load)].set_index("fabric")["place"]
        assert_allclose(told[[*NEW.names]], np.array([*places.values()]) / len(draws))
        rows = ranking.table[ranking.table["load"] == str(load)]
        following = table.set_index(["fabric", "other"])["p_softer"]
        said = [following[pair] for pair in zip(rows["fabric"][:-1], rows["fabric"][1:], strict=True)]
        assert_allclose(rows["p_softer_than_next"][:-1], said)
    place = ranking.place_table.pivot_table("probability", ["load", "fabric"], "place").fillna(0.0)
    assert_allclose(place.sum(axis=1), 1.0)
    assert_allclose(place.groupby("load").sum(), 1.0)


def test_too_many_fabrics_are_refused(result):
    many = Fabrics(tuple(map(str, range(2001))), effective_modulus=np.full(2001, 1e4))
    with pytest.raises(InputError, match="number of fabrics is 2001, expected a whole number from 1 to 2000"):
        result.rank(many)


def test_agreement_is_that_of_the_fabrics_in_both(ranking):
    order = ranking.table["fabric"][: len(NEW)]
    observed = {name: float(at) for at, name in enumerate(order)} | {"another": 99.0}
    found = ranking.against(observed)
    assert found["measure"].tolist() == ["spearman", "kendall"] * 2
    assert (found["fabrics"] == 6).all()
    assert (found["value"][:2] > 0.8).all()
    assert (found["low"] <= found["high"]).all()
    opposite = ranking.against({name: -rank for name, rank in observed.items()})
    assert_allclose(opposite["value"], -found["value"])
    with pytest.raises(InputError, match=r"0 fabrics with observed ranks \(0 distinct\); expected 3"):
        ranking.against({"x": 1.0})


def test_the_figure_shows_places_ratings_ties_and_silence(ranking):
    figure = ranking.figure()
    rows = ranking.table.iloc[:6]
    cells = artist(figure, "places/2 mm")
    probability = np.zeros((6, 6))
    for row in ranking.place_table[ranking.place_table["load"] == "2 mm"].itertuples():
        probability[rows["fabric"].tolist().index(row.fabric), row.place - 1] = row.probability
    assert_allclose(np.asarray(cells.get_array()), np.sqrt(probability))
    names = [label.get_text() for label in cells.axes.get_yticklabels()]
    assert names == rows["fabric"].tolist()
    frames = [found for found in figure.findobj() if (found.get_gid() or "").startswith("ties/2 mm")]
    assert len(frames) == 2
    assert sorted(frame.get_width() for frame in frames) == sorted(rows["tie"][rows["tie"] != ""].value_counts())
    quiet = artist(figure, "silent/2 mm")
    assert_allclose(quiet.get_xdata(), rows.loc[rows["p_silent"] >= 0.5, "typical_rating"])
    heard = artist(figure, "rating/2 mm")
    assert_allclose(heard.get_xdata(), rows.loc[rows["p_silent"] < 0.5, "typical_rating"])
    ends = np.array([line[:, 0] for line in artist(figure, "band90/2 mm").get_segments()])
    assert_allclose(ends, rows[["typical_rating_low", "typical_rating_high"]])


def test_observed_orders_are_read(tmp_path):
    path = tmp_path / "seen.csv"
    path.write_text("fabric,rank\nlawn,1\ndrill,3\nlawn,2\n")
    assert read_order(path) == {"lawn": 1.5, "drill": 3.0}
    path.write_text("Fabric;Rating\nlawn;1,5\ndrill;3\n")
    assert read_order(path) == {"lawn": -1.5, "drill": -3.0}
    for text, message in (
        ("fabric,thickness_mm\nlawn,1\n", "expected a column 'rank' or a column 'rating'"),
        ("fabric,rank,rating\nlawn,1,2\n", "but not both"),
        ("fabric,rank\nlawn,\n", "row 2, column 'rank': is empty"),
        ("fabric,rank\nlawn,0\n", "row 2, column 'rank': expected a finite number above 0"),
        ("rank\n1\n", "fabric"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_order(path)


def test_bad_input_is_refused(report_run, saved, tmp_path):
    report_run("skin").save(tmp_path / "skin")
    (tmp_path / "two.csv").write_text("fabric,rank\nlawn,1\ngauze,2\n")
    out = ["--out", tmp_path / "new"]
    with quickly():
        refused(call("rank", tmp_path / "skin", *out), "a run without ratings")
        refused(call("rank", saved, *out, "--column", "fabric=cloth"), "--column applies to the fabric table")
        refused(call("rank", saved, *out, "--against", tmp_path / "two.csv"), "2 fabrics with observed ranks")
    assert not (tmp_path / "new").exists()


def test_rated_fabrics_stand_beside_people_s_means_and_others_under_a_verdict(result):
    with quickly():
        own, other = result.rank(draws=100), result.rank(NEW, LOADS, draws=100)
    means = result.tables["fabric_ratings"]["people"]
    table = own.table.set_index(["load", "fabric"])
    assert_allclose(table["people"], means[table.index], rtol=1e-6)
    assert own.cautions == ()
    assert set(own.pair_table["because"]) <= {"people's own ratings", "neither order is 95 % sure"}
    assert other.table["people"].isna().all()
    decided = other.pair_table[other.pair_table["verdict"] != "cannot decide"]
    assert set(decided["because"]) <= {"the chain"}
    assert not {*"ab"} & {*decided["fabric"], *decided["other"]}  # silent
    assert " of 30 pairs of fabrics are decided" in other.sentence
    assert other.sentence.split(" of 30")[0].split()[-1] == str(len(decided))


def test_simulated_ratings_and_a_rising_scale_are_not_carried_to_cloth_in_silence(result):
    simulated = replace(result, tree=result.tree.copy())
    simulated.tree.attrs["simulated"] = True
    assert any("simulated" in said for said in cautions(simulated, NEW))
    assert not any("simulated" in said for said in cautions(result, NEW))
    assert cautions(simulated, result.fabrics) == []  # the same fabrics, whatever made the ratings
    table = result.tables["fabric_ratings"].copy()
    for sign, warned in ((1.0, True), (-1.0, False)):
        table["rated"] = 10.0 + sign * table["e_fab_kpa"].rank()
        turned = replace(result, tables={**dict(result.tables.items()), "fabric_ratings": table})
        assert any("stiffer fabrics were rated higher" in said for said in cautions(turned, NEW)) == warned


FALLING = np.array([0.7, 1.5, 0.25, 0.45])
"""Factors by which people's ratings fall steadily with the moduli of `CLOTH`, as a power law does."""


@pytest.fixture(scope="module")
def falling():
    """A run on ratings that fall steadily with stiffness, which no chain with a threshold repeats."""
    made, rng = experiment(), np.random.default_rng(2)
    log = np.log(40.0 * FALLING)[made.ratings.fabric] + 0.1 * rng.standard_normal(len(made.ratings))
    with quickly():
        return converged(sample(made._replace(ratings=replace(made.ratings, rating=np.exp(log))), **OPTIONS))


def test_on_a_falling_law_people_s_order_comes_first_and_rank_decides_what_they_decided(falling):
    names = [CLOTH.names[k] for k in np.argsort(-FALLING)]
    first, *_ = conclude(facts_of(falling)).lines
    assert first.startswith(f"People:    {names[0]} is the highest rated at ")
    with quickly():
        ranked = falling.rank(draws=60)
    pairs = ranked.pair_table
    by_people = pairs[pairs["because"] == "people's own ratings"]
    assert len(by_people) == 12  # all six pairs under both loads
    place = {name: k for k, name in enumerate(names)}
    for row in by_people.itertuples():
        assert (row.verdict == "rated higher") == (place[row.fabric] < place[row.other])
    assert ranked.sentence.startswith("12 of 12 pairs of fabrics are decided (12 by people's own ratings)")


@pytest.mark.skipif(not REAL.is_file(), reason="the table is not there")
def test_of_real_fabrics_that_nobody_rated_the_pairs_that_cannot_be_decided_are_said(falling):
    """Every thirtieth of 618: most are softer than any rated one, silent or alike; every pair has one verdict."""
    rigidity = pd.read_csv(REAL)["bending_warp_N_m"].to_numpy()[::30]
    cloth = Fabrics(tuple(f"cloth {k}" for k in range(rigidity.size)), bending_rigidity=rigidity)
    with quickly():
        ranked = falling.rank(cloth, LOADS, draws=60)
    pairs, total = ranked.pair_table, rigidity.size * (rigidity.size - 1)
    assert len(pairs) == total
    undecided = pairs["verdict"] == "cannot decide"
    assert undecided.mean() > 0.5
    assert f"{(~undecided).sum()} of {total} pairs of fabrics" in ranked.sentence
    assert set(pairs["because"][undecided]) <= {*REASONS[2:]}
    assert not (pairs["because"] == "people's own ratings").any()  # nobody rated them
