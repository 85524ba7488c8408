"""A run on means of n raters with their standard deviations, from end to end."""

import numpy as np
import pytest

from softness_bayes.checking.check_table import doubts
from softness_bayes.checking.checks import DEVIATIONS, EXPONENTS
from softness_bayes.checking.sentences import residual_sentences
from softness_bayes.likelihood.scales import AGGREGATED
from softness_bayes.model.build import raters_told
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.results.result import Result
from softness_bayes.touch.readings import MENDED
from support.command_line import call
from support.report_runs import CLOTH, LOADS
from support.variants import RATERS


@pytest.fixture(scope="module")
def run(variant_run, tmp_path_factory):
    directory = tmp_path_factory.mktemp("cells") / "run"
    variant_run("cells").save(directory)
    return directory


def test_standard_deviations_tell_of_both_spreads(run):
    """20 raters and eight cells: tau is known to about a fifth; the prior alone says a factor of two."""
    table = Result.load(run).summary()
    assert 0.5 < table.loc["tau", "mean"] < 1.1
    assert table.loc["tau", "sd"] < 0.25
    assert abs(table.loc["varsigma", "mean"] - 0.2) < 5 * table.loc["varsigma", "sd"]
    assert table.loc["varsigma", "sd"] < 0.08


def test_they_are_checked(run):
    """The right model is not accused, and one panel's exponents are not compared."""
    result = Result.load(run)
    findings, table = result.provenance.findings, result.tables["predictive_checks"]
    said = " ".join(residual_sentences(findings, doubts(table)))
    assert "spreads: the cells' standard deviations differ no more than they should" in said
    row = table.loc[("posterior", "standard deviations of cells"), "p_value"]
    assert float(np.ravel(row)[0]) == findings[DEVIATIONS].p_value > 0.05
    assert np.isnan(findings[EXPONENTS].p_value)
    assert "exponents cannot be compared" in said
    assert "no evidence" not in " ".join(residual_sentences(findings, ()))


def test_without_them_the_spread_of_scales_is_held():
    """Means alone do not tell tau from mu: it is held, and the rest is as it was."""
    made = simulate_ratings(
        np.random.default_rng(1), CLOTH, LOADS, usual_values(MENDED), participants=9, scale=AGGREGATED
    ).ratings
    told = raters_told(made)
    assert told == 9
    object.__setattr__(made, "cells", made.cells._replace(geometric_sd=None))
    assert raters_told(made) == 1


def test_the_verbs_take_a_run_on_cells(run, few_pictures, tmp_path):
    assert call("report", run).returncode == 0
    touch = ["--fabrics", tmp_path / "cloth.csv", "--force-n", "1"]
    (tmp_path / "cloth.csv").write_text("fabric,effective_modulus_kpa\nfelt,30\nwool,77\n")
    done = call("predict", "--posterior", run, *touch)
    assert done.returncode == 0, done.stderr
    header, felt, _ = done.stdout.splitlines()
    row = dict(zip(header.split(","), felt.split(","), strict=False))
    # by default the mean of as many raters as each cell has, which is known better than one rater's number
    assert row["raters"] == str(RATERS)
    one, mean = (np.log(float(row[f"{k}_high"]) / float(row[f"{k}_low"])) for k in ("new_rater_rating", "mean_rating"))
    assert one > 2 * mean
    assert call("rank", run, "--force-n", "1").returncode == 0
