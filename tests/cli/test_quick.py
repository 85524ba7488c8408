"""A first look, `sample --quick`: labelled as such wherever it is seen, and upgraded to the draws of a full run."""

import io

import numpy as np
import pandas as pd
import pytest

from softness_bayes.plotting.figures import FIGURES
from softness_bayes.plotting.figures import FIRST_LOOK as LABEL
from softness_bayes.report.page import report_page
from softness_bayes.report.tables import repetition
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs.drawing import FIRST_FIGURES
from softness_bayes.runs.saved import read_status
from softness_bayes.sampler.sampling import FIRST_LOOK
from support.command_line import FIXED, call, few_ratings, refused
from support.report_runs import LOOK, quickly

ASKED = [*FIXED, "--seed", "3", "--accuracy", "0.01", "--max-steps", "80", "--processes", "1"]


@pytest.fixture(scope="module")
def looked(tmp_path_factory):
    """A directory with data, a first look in it, and what that printed."""
    directory = tmp_path_factory.mktemp("quick")
    few_ratings(directory)
    with quickly():
        done = call("sample", "--data", "ratings.csv", "--out", "out", *ASKED, "--quick", cwd=directory)
    return directory, done


@pytest.fixture(scope="module")
def result(looked):
    return Result.load(looked[0] / "out")


def test_it_ends_well_and_says_what_it_is(looked, result):
    directory, done = looked
    assert done.returncode == 0, done.stderr
    assert f"A first look (quick), no result. Not converged after {LOOK} steps" in done.stdout
    assert "Next:      'softness-bayes resume out' continues to the full run" in done.stdout
    assert (result.attributes["quick"], result.attributes["converged"]) == (1, 0)
    assert result.provenance.ending.steps == LOOK < FIRST_LOOK == 200
    assert np.isnan(result.group("sample_stats")["exact_difference"].values).all()
    assert read_status(directory / "out").quick
    assert "a first look (--quick)" in call("status", directory / "out").stdout


def test_its_figures_are_few_and_each_is_labelled(looked, result):
    drawn = {path.stem for path in (looked[0] / "out" / "figures").glob("*.png")}
    assert drawn == {*FIRST_FIGURES} - {"compression", "recorded"}  # there are ratings alone
    for name in ("rating", "corner"):  # one of those, and one drawn later
        assert FIGURES[name](result).get_suptitle() == LABEL  # for which the layout makes room


def test_its_report_is_labelled_and_repeats_it(result):
    page = report_page(result)
    assert "This is a first look" in page
    assert ">nan<" not in page
    assert "--quick" in repetition(result).commands[0]


@pytest.mark.parametrize("asked", [("rank", "out", "--out", "order"), ("target", "out", "--rating", "5")])
def test_answers_from_it_are_called_preliminary(looked, asked):
    directory, _ = looked
    done = call(*asked, cwd=directory)
    assert done.returncode == 0, done.stderr
    assert "a first look (--quick), whose chains have not converged; all numbers below are preliminary" in done.stderr
    tables = [pd.read_csv(path) for path in (directory / "order").glob("*.csv")] if "order" in asked else []
    tables += [pd.read_csv(io.StringIO(done.stdout))] if "target" in asked else []
    assert tables
    assert all(table["preliminary"].all() for table in tables)


def test_resume_goes_on_to_the_very_result_of_a_full_run(looked):
    directory, _ = looked
    with quickly():
        whole = call("sample", "--data", "ratings.csv", "--out", "whole", *ASKED, "--no-figures", cwd=directory)
        again = call("resume", "out", "--no-figures", cwd=directory)
    assert again.returncode == whole.returncode, again.stderr
    one, other = (Result.load(directory / name) for name in ("out", "whole"))
    assert one.provenance.ending.steps == other.provenance.ending.steps == 80
    for group in other.tree.children:
        assert one.tree[group].identical(other.tree[group]), group
    for name in ("summary.csv", "directions.csv", "predictive_checks.csv"):
        assert (directory / "out" / name).read_bytes() == (directory / "whole" / name).read_bytes()
    assert one.attributes["quick"] == 0
    assert LABEL not in [text.get_text() for text in FIGURES["rating"](one).texts]
    assert not read_status(directory / "out").quick
    assert "first look" not in again.stdout


def test_exact_weights_are_refused(looked):
    done = call("sample", "--data", "ratings.csv", "--out", "no", *ASKED, "--quick", "--exact-reweight", cwd=looked[0])
    refused(done, "a first look does not use the exact likelihood")


def test_a_first_look_walks_no_more_than_it_is_allowed():
    assert RunOptions(quick=True).settings.max_steps == FIRST_LOOK
    assert RunOptions(quick=True, max_steps=10).settings.max_steps == 10
