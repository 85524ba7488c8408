"""`check --design`, `--json` and `--figure`, and what looks wrong in a table."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from softness_bayes.cli import main
from softness_bayes.data import Experiment, Fabrics, Ratings, fabrics_csv, ratings_csv
from softness_bayes.touch.contact import Force, Indentation

LOADS = Indentation(1e-3), Indentation(2.5e-3)
MODULI = np.geomspace(2e4, 4e6, 6)
FABRICS = tuple(f"F{k}" for k in range(6))


def experiment(people=6, loads=LOADS, sd=0.2, seed=1):
    rng = np.random.default_rng(seed)
    mean = 2.0 + 0.3 * np.arange(6)[None, :, None] + rng.normal(0, 0.5, (people, 1, 1))
    rating = np.exp(mean + rng.normal(0, sd, (people, 6, len(loads))))
    table = Ratings.crossed(tuple(f"P{k}" for k in range(people)), FABRICS, loads, rating)
    return Experiment(table, Fabrics(FABRICS, effective_modulus=MODULI), ())


def check(tmp_path, given, *arguments):
    (tmp_path / "ratings.csv").write_text(ratings_csv(given.ratings), encoding="utf-8")
    (tmp_path / "fabrics.csv").write_text(fabrics_csv(given.fabrics), encoding="utf-8")
    return CliRunner().invoke(main, ["check", "--data", str(tmp_path / "ratings.csv"), *arguments])


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    found = tmp_path_factory.mktemp("design")
    done = check(found, experiment(), "--design", "--json", "--figure", str(found / "design.png"))
    return done, found


def test_json_holds_everything_that_was_understood(told):
    done, directory = told
    every = json.loads(done.stdout)
    assert every["schema"] == 1
    assert every["ratings"]["count"] == 72
    assert [one["name"] for one in every["fabrics"]] == list(FABRICS)
    assert every["fabrics"][0]["e_fab_kpa"] == pytest.approx(20.0)
    assert every["loads"] == [
        {"kind": "indentation", "value": 1.0, "unit": "mm", "ratings": 36},
        {"kind": "indentation", "value": 2.5, "unit": "mm", "ratings": 36},
    ]
    assert every["conditions"] == {
        "rated": 12,
        "possible": 12,
        "by_participants": 72,
        "possible_by_participants": 72,
        "repeats": 0,
    }
    assert every["model"]["direction"] == "rises-with-firing"
    assert every["source"] == str(directory / "ratings.csv")


def test_design_says_what_ratings_will_tell(told):
    design = json.loads(told[0].stdout)["design"]
    assert design["truths"] == 16
    for low, middle, high in design["sd_ratio"].values():
        assert 0 < low <= middle <= high < 2
    assert design["sd_ratio"]["varsigma"][1] < 0.4 < design["sd_ratio"]["c_Na"][1]
    assert [one["load"] for one in design["turning_points"]] == ["1 mm", "2.5 mm"]
    gains = [one["bits"] for one in design["others"]]
    assert gains == sorted(gains, reverse=True)
    assert {one["further_ratings"] for one in design["others"]} == {72, 36}


def test_figure_is_drawn_and_never_over_another_file(told, tmp_path):
    _, directory = told
    assert (directory / "design.png").read_bytes()[:4] == b"\x89PNG"
    taken = tmp_path / "mine.pdf"
    taken.write_text("mine")
    done = check(tmp_path, experiment(), "--figure", str(taken))
    assert (done.exit_code, "mine.pdf" in done.stderr) == (2, True)
    assert taken.read_text() == "mine"
    done = check(tmp_path, experiment(), "--figure", str(tmp_path / "design.docx"))
    assert (done.exit_code, "expected a name that ends in one of .png" in done.stderr) == (2, True)


def test_design_of_forces_alone_is_refused(tmp_path):
    (tmp_path / "plate.csv").write_text("participant,indentation_mm,force_n\nP1,1,0.2\nP1,2,0.9\n", encoding="utf-8")
    done = CliRunner().invoke(main, ["check", "--compression", str(tmp_path / "plate.csv"), "--design"])
    assert (done.exit_code, "--design, --cost and --figure need ratings" in done.stderr) == (2, True)
    told = CliRunner().invoke(main, ["check", "--compression", str(tmp_path / "plate.csv"), "--json"])
    assert json.loads(told.stdout)["forces"]["count"] == 2


def notes(tmp_path, given, *arguments):
    lines = check(tmp_path, given, *arguments).stdout.splitlines()
    return [line for line in lines if line.startswith("note: ") and "found beside the ratings" not in line]


def turned(table, rating):
    own = table.participant == 3
    rating[own] = 100.0 / rating[own]


def constant(table, rating):
    rating[table.participant == 2] = 5.0


def stopped(_, rating):
    rating[:] = np.minimum(rating, np.quantile(rating, 0.7))


def tied(_, rating):
    rating[:] = np.where(rating > np.median(rating), 20.0, 10.0)


def ending(share, end):
    def stop(_, rating):
        rating *= end / np.quantile(rating, 1.0 - share)
        rating[:] = np.minimum(rating, end)

    return stop


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (turned, "P3 rates against all others"),
        (constant, "all ratings of P2 are equal"),
        (stopped, "the largest of all, by"),
        (tied, "are ties"),
        (ending(0.05, 100.0), "the scale may end there; if so, use --ratings slider --slider 0,100"),
        (ending(0.05, 87.0), ""),  # no scale ends there
        (ending(0.002, 100.0), ""),  # a single large rating
        (lambda *_: None, ""),
    ],
)
def test_what_looks_wrong_is_remarked_and_nothing_else(tmp_path, change, said):
    given = experiment(sd=0.2 if change in (turned, constant, tied) else 0.4)
    rating = given.ratings.rating.copy()
    change(given.ratings, rating)
    found = notes(tmp_path, given._replace(ratings=replace(given.ratings, rating=rating)))
    assert any(said in note for note in found) == bool(said)
    assert said or not found


FORCES = tuple(Force(x) for x in (0.495, 0.5, 0.505, 0.99, 1.0, 1.03))


def test_loads_a_hair_apart_are_remarked_and_rounded_on_request(tmp_path):
    given = experiment(loads=FORCES)
    found = notes(tmp_path, given)
    assert any("6 different forces form 3 groups" in note for note in found)
    done = check(tmp_path, given, "--round-load", "0.25")
    assert "loads         0.5 N (108 ratings), 1 N (108 ratings)" in done.stdout
    assert "loads rounded to multiples of 0.25: 6 became 2: 0.5 N from 0.495 N, 0.5 N, 0.505 N; 1 N from" in done.stdout
