"""People's own answers on the command line: tables of names and ratings, with and without moduli."""

import json

import pytest

from support.command_line import call, refused
from support.paths import SHARED
from support.report_runs import quickly

HARDNESS = SHARED / "data" / "hardness_magnitude_16materials_cleland2024.csv"
NAMES = "fabric,participant,softness\n" + "".join(
    f"{fabric},{who},{number + k}\n"
    for fabric, number in (("felt", 10), ("lawn", 3), ("silk", 30))
    for k, who in enumerate("abc")
)


@pytest.fixture
def home(tmp_path):
    (tmp_path / "ratings.csv").write_text(NAMES)
    return tmp_path


def test_names_and_ratings_end_with_what_people_said_and_what_to_measure(home):
    done = call("check", "--data", "ratings.csv", "--column", "rating=softness", cwd=home)
    assert done.returncode == 0, done.stderr
    first, answer, *rest = done.stdout.splitlines()
    assert first.startswith("What do people say?")
    assert answer.startswith("silk is the softest (probability >99 %)")
    assert "    felt,LOW,HIGH" in rest
    assert " mm" not in answer  # no load is made up


def test_the_answer_is_json_on_demand(home):
    done = call("check", "--json", "--data", "ratings.csv", cwd=home)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told.keys() == {"schema", "source", "people", "needed", "notes"}
    assert [row["fabric"] for row in told["people"]] == ["silk", "felt", "lawn"]
    assert any("LOW" in line for line in told["needed"])


def test_a_run_of_such_a_table_is_refused_and_points_to_the_answer(home):
    done = call("sample", "--data", "ratings.csv", "--column", "rating=softness", "--out", "run", cwd=home)
    assert done.returncode == 2
    assert "the fabrics have no properties" in done.stderr
    assert "'softness-bayes check' shows it" in done.stderr
    assert not (home / "run").exists()


def test_empty_moduli_are_unknown_ones(home):
    """The issue's ranks of tissues without moduli: every cell of the column is empty."""
    (home / "fabrics.csv").write_text("fabric,effective_modulus_kpa\nfelt,\nlawn,\nsilk,\n")
    done = call("check", "--data", "ratings.csv", "--column", "rating=softness", cwd=home)
    assert done.returncode == 0, done.stderr
    assert "silk is the softest" in done.stdout


def test_faults_of_the_ratings_are_found_all_the_same(home):
    """The control: a table of names whose ratings are wrong is refused as before."""
    (home / "ratings.csv").write_text(NAMES.replace("silk,b,31", "silk,b,much"))
    done = call("check", "--data", "ratings.csv", "--column", "rating=softness", cwd=home)
    assert done.returncode == 2
    assert "much" in done.stderr
    assert "What do people say?" not in done.stdout


def test_with_moduli_people_come_first_and_stand_in_the_json(home):
    (home / "fabrics.csv").write_text("fabric,effective_modulus_kpa\nfelt,100\nlawn,300\nsilk,30\n")
    data = ("check", "--data", "ratings.csv", "--column", "rating=softness", "--force-n", "1")
    done = call(*data, cwd=home)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1].startswith("silk is the softest at 1 N (probability >99 %)")
    people = json.loads(call(*data, "--json", cwd=home).stdout)["people"]
    assert [row["fabric"] for row in people] == ["silk", "felt", "lawn"]
    assert people[0]["people_low"] < people[0]["people"] < people[0]["people_high"]


@pytest.mark.skipif(not HARDNESS.is_file(), reason="the table is not there")
def test_the_real_hardness_table_goes_through_with_names_alone(tmp_path):
    done = call("check", "--data", HARDNESS, "--column", "rating=hardness_rating", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "the hardest is Garden deck tile" in done.stdout
    assert "softest" not in done.stdout


PAIRS = ("check", "--data", "ratings.csv", "--ratings", "pairs", "--force-n", "1")


@pytest.fixture
def compared(tmp_path):
    """A directory with pairs against a reference, some of them of a fabric with itself."""
    fabrics = {f"F{k}": 40.0 * 1.25**k for k in range(9)}
    rows = [f"{name},F4,{int((k + t) % 9 > k)}\n" for k, name in enumerate(fabrics) for t in range(9) if k != 4]
    rows += ["F4,F4,1\n"] * 9 + ["F4,F4,0\n"]
    (tmp_path / "ratings.csv").write_text("fabric,fabric_2,rating\n" + "".join(rows))
    cloth = "".join(f"{name},{value}\n" for name, value in fabrics.items())
    (tmp_path / "fabrics.csv").write_text("fabric,effective_modulus_kpa\n" + cloth)
    return tmp_path


def test_pairs_with_a_reference_have_thresholds_and_catch_trials(compared):
    """Catch trials are kept as information, pairs are counted once, and a guess rate may be known."""
    done = call(*PAIRS, "--guess", "1/3", cwd=compared)
    assert done.returncode == 0, done.stderr
    assert "against F4 at 1 N (72 pairs): judged equal at E_fab" in done.stdout
    assert "guess rate 0.333 (0.333 to 0.333)" in done.stdout
    assert "10 catch trials (a fabric with itself)" in done.stdout
    assert "the first one in 9 of 10 (90 % interval 67 to 98 %)" in done.stdout
    assert "72 comparisons of two fabrics" in done.stdout
    wrong = call(*PAIRS, "--guess", "often", cwd=compared)
    refused(wrong, "expected a rate from 0 to 0.9, such as 1/3, or free, got 'often'")
    (compared / "ratings.csv").write_text("fabric,fabric_2,rating\nF4,F4,1\n")
    assert "expected two different fabrics" in call(*PAIRS, cwd=compared).stderr


@pytest.mark.slow
def test_a_run_of_pairs_computes_people_s_means_in_another_process(compared):
    brief = ("--guess", "1/3", "--max-steps", 6, "--processes", 2, "--out", "run")
    with quickly():
        run = call("sample", *PAIRS[1:], *brief, cwd=compared)
    assert "72 comparisons of 9 fabrics" in run.stdout, run.stderr
    assert "0.333" in (compared / "run/thresholds.csv").read_text()
