"""The first hour: an example that runs, templates to start from, and errors that end with a command that works."""

import os
import shlex
import shutil
import subprocess
import sys

import pytest

from softness_bayes.cli import start
from softness_bayes.cli.start import EXAMPLE
from softness_bayes.data import read_experiment
from softness_bayes.results.result import Result
from support.command_line import HELD, call, few_ratings, refused
from support.paths import ROOT
from support.report_runs import quickly

BRIEF = {**start.HELD, **{name: HELD[name] for name in ("b", "sigma_0", "tau")}}


def test_templates_are_read_as_they_are_and_say_that_they_are_examples(tmp_path):
    home = tmp_path / "my study"
    done = call("new", home)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in home.iterdir() if not path.name.startswith(".")} == {*EXAMPLE}
    assert "EXAMPLE" in done.stdout
    experiment = read_experiment(home / "ratings.csv", home / "fabrics.csv")
    assert len(experiment.ratings) == 96
    assert all("example" in name for name in (*experiment.ratings.participants, *experiment.fabrics.names))
    for name in EXAMPLE:
        assert "EXAMPLE" in (home / name).read_text(encoding="utf-8"), name
    compile((home / "analysis.py").read_text(encoding="utf-8"), "analysis.py", "exec")
    # nothing is replaced, be it edited or not
    (home / "ratings.csv").write_text("mine")
    (home / "fabrics.csv").unlink()
    before = {path.name: path.read_bytes() for path in home.iterdir()}
    for verb in ("new", "demo"):
        refused(call(verb, home), "ratings.csv", "exists and would be overwritten; choose another directory")
    assert {path.name: path.read_bytes() for path in home.iterdir()} == before


def test_every_command_of_the_shell_script_is_one(tmp_path):
    call("new", tmp_path)
    script = (tmp_path / "analysis.sh").read_text(encoding="utf-8")
    commands = [line.split() for line in script.splitlines() if line.startswith("softness-bayes ")]
    assert [words[1] for words in commands] == ["check", "sample", "report", "predict", "rank", "target"]
    for _, verb, *words in commands:
        said = call(verb, "--help").stdout
        assert all(word in said for word in words if word.startswith("--"))


def test_the_demo_goes_from_tables_to_a_report_and_owns_up_to_too_few_steps(tmp_path, few_pictures, monkeypatch):
    monkeypatch.setattr(start, "HELD", BRIEF)
    monkeypatch.setattr(start, "STEPS", 4)
    with quickly():
        done = call("demo", "demo", "--processes", "1", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "not converged after 4 steps" in done.stderr
    result = Result.load(tmp_path / "demo" / "results")
    assert result.provenance.ending.steps == 4
    page = (tmp_path / "demo" / "results" / "report.html").read_text(encoding="utf-8")
    assert start.TITLE in page
    assert "Not converged" in page
    assert done.stdout.startswith(start.TITLE)
    assert "this was an EXAMPLE" in done.stdout
    assert "$ softness-bayes sample --data demo/ratings.csv" in done.stdout
    refused(call("demo", "demo", cwd=tmp_path), "results exists")


@pytest.mark.slow
def test_the_demo_converges(tmp_path):
    program = "from softness_bayes.cli import main; main(prog_name='softness-bayes')"
    done = subprocess.run(
        [sys.executable, "-c", program, "demo"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Converged after" in done.stdout
    assert (tmp_path / "softness-demo" / "results" / "report.html").exists()


BEGINNERS = {
    ("sample",): "softness-bayes sample --data ratings.csv --out results",
    ("sample", "ratings.csv"): "softness-bayes sample --data ratings.csv",
    ("sample", "--dat", "x"): "softness-bayes sample --data ratings.csv --out results",
    ("sample", "--data", "bare.csv"): ("softness-bayes sample --data bare.csv --fabrics cloth.csv --load free"),
    ("sample", "--data", "ratings.csv", "--out", "full"): "softness-bayes sample --data ratings.csv --out full-2",
    ("report",): "softness-bayes sample --data ratings.csv --out results",
    ("plot", "full"): "softness-bayes sample --data ratings.csv --out full-2",
    ("status", "full"): "softness-bayes sample --data ratings.csv --out full-2",
    ("predict",): "softness-bayes sample --data ratings.csv --out results",
    ("predict", "--fabrics", "cloth.csv"): "softness-bayes predict --fabrics cloth.csv --indentation-mm 2",
    ("target", "full"): "softness-bayes sample --data ratings.csv --out results",
    ("new",): "softness-bayes new my-study",
    ("simulate",): "softness-bayes simulate --fabrics cloth.csv --indentation-mm 2 --out simulated",
    ("check", "--data", "marks.csv"): "softness-bayes check --data marks.csv --decimal ,",
    ("check", "--data", "means.csv"): "softness-bayes check --data means.csv --ratings aggregated",
}


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A directory with a table of ratings, one without loads, a table of fabrics, and a directory of somebody's."""
    home = tmp_path_factory.mktemp("desk")
    few_ratings(home)
    (home / "bare.csv").write_text("participant,fabric,rating\nP1,felt,3\nP1,lawn,4\n")
    (home / "cloth.csv").write_text("fabric,effective_modulus_kpa\nfelt,30\nlawn,80\n")
    ends = "effective_modulus_kpa\n"
    (home / "marks.csv").write_text(f"fabric;force_n;rating;{ends}a;1;1,234;30\nb;1;1,300;80\n")
    (home / "means.csv").write_text(f"fabric,force_n,geometric_mean,n,{ends}a,1,5,9,30\nb,1,7,9,80\n")
    (home / "five.csv").write_text(f"fabric,force_n,rating,{ends}a,1,five,30\nb,1,7,80\n")
    (home / "hard.csv").write_text("participant,fabric,place,hardness_rating\nP1,felt,left,3\nP1,lawn,right,4\n")
    (home / "full").mkdir()
    (home / "full" / "notes.txt").write_text("mine")
    return home


@pytest.mark.parametrize("typed", BEGINNERS, ids=" ".join)
def test_a_beginners_error_ends_with_a_command_that_works(typed, desk, tmp_path):
    done = call(*typed, cwd=desk)
    refused(done)
    assert done.stderr.rstrip().splitlines()[-1] == f"try: {BEGINNERS[typed]}"
    # the command works, on a copy of the desk; what `sample` takes is read by `check`, without the wait
    home = shutil.copytree(desk, tmp_path / "desk")
    _, verb, *words = shlex.split(BEGINNERS[typed])
    if verb == "sample":
        verb = "check"
        words = words[: words.index("--out")] if "--out" in words else words
    done = call(verb, *words, cwd=home)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("table", ["hard.csv", "five.csv"])
def test_an_error_that_no_command_cures_ends_with_itself(table, desk):
    done = call("check", "--data", table, cwd=desk)
    refused(done)
    assert "try:" not in done.stderr


def test_without_a_table_or_a_run_the_advice_is_what_makes_one(tmp_path):
    for verb, made in (("sample", "new my-study"), ("report", "demo"), ("simulate", "new my-study")):
        assert call(verb, cwd=tmp_path).stderr.rstrip().splitlines()[-1] == f"try: softness-bayes {made}"
    (tmp_path / "my-study").mkdir()
    assert call("sample", cwd=tmp_path).stderr.rstrip().splitlines()[-1] == "try: softness-bayes new my-study-2"


def test_a_table_of_another_kind_is_given_its_own_option(tmp_path):
    (tmp_path / "pressed.csv").write_text("participant,displacement_mm,force_N\nP1,1,0.5\nP1,2,1.5\n")
    (tmp_path / "cloth.csv").write_text("fabric,effective_modulus_kpa\nfelt,30\nlawn,80\n")

    def advised(name):
        done = call("check", "--data", name, cwd=tmp_path)
        refused(done)
        return done.stderr.rstrip().splitlines()[-1].removeprefix("try: softness-bayes ")

    assert advised("pressed.csv") == "check --compression pressed.csv"
    assert advised("cloth.csv") == "new my-study"  # nothing to go with it
    (tmp_path / "mine.csv").write_text("participant,fabric,force_n,rating\nP1,felt,1,3\nP1,lawn,1,4\n")
    assert advised("cloth.csv") == "check --data mine.csv --fabrics cloth.csv"
    for name in ("pressed.csv", "cloth.csv"):
        assert call(*shlex.split(advised(name)), cwd=tmp_path).returncode == 0
    # fabrics that are not those of the table are not advised
    (tmp_path / "other.csv").write_text("participant,fabric,force_n,hardness_rating\nP1,mat,1,3\nP1,rug,1,4\n")
    assert "cloth.csv" not in advised("other.csv")


def test_runs_that_are_there_are_named(tmp_path):
    for name in ("b run", "results"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "posterior.nc").write_bytes(b"")
    said = call("compare", cwd=tmp_path).stderr.rstrip().splitlines()[-1]
    assert said == "try: softness-bayes compare results 'b run'"
    # a run that was typed is the one that is meant
    said = call("target", "b run", cwd=tmp_path).stderr.rstrip().splitlines()[-1]
    assert said == "try: softness-bayes target 'b run' --rating 20 --force-n 1"
    (tmp_path / "cloth.csv").write_text("fabric,effective_modulus_kpa\nfelt,30\n")
    said = call("predict", "--posterior", "b run", "--force-n", "1", cwd=tmp_path).stderr.rstrip().splitlines()[-1]
    assert said == "try: softness-bayes predict --posterior 'b run' --fabrics cloth.csv --force-n 1"
    said = call("resume", "b run", "--max-steps", "30", cwd=tmp_path).stderr.rstrip().splitlines()[-1]
    assert said == "try: softness-bayes resume 'b run'"


CLOTH = "fabric,effective_modulus_kpa,poisson_ratio\nm1,9,0.3\nm2,50,0.3\nm3,400,0.3\n"


def test_a_column_that_may_hold_the_load_is_named_not_passed_over(tmp_path):
    """The advice names the column, and does not give every row one load in its place."""
    cells = [(p, f, d) for p in range(3) for f in (1, 2, 3) for d in (1, 2)]
    rows = "\n".join(f"s{p},m{f},{d},{3 + p + 7 * f * d / (f + 2)}" for p, f, d in cells)
    (tmp_path / "r.csv").write_text(f"subject,material,Indentation,softness\n{rows}\n")
    (tmp_path / "fabrics.csv").write_text(CLOTH)
    asked = ["check", "--data", tmp_path / "r.csv"]
    done = call(*asked)
    refused(done, "no load column", "--column indentation_mm=Indentation")
    assert "--indentation-mm 2" not in done.stderr.splitlines()[-1]
    assert "1 mm" in call(*asked, "--column", "indentation_mm=Indentation").stdout
    assert "'Indentation' may contain loads but is not read" in call(*asked, "--indentation-mm", "2").stdout
