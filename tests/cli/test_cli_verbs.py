"""The verbs that compute: what they write, what they refuse, and how they end; `sample` by subprocess elsewhere."""

import io
import json
import re
import shlex
import sys

import numpy as np
import pandas as pd
import pytest

from softness_bayes.plotting import figures
from softness_bayes.results.assembly import Stage
from softness_bayes.results.result import Result
from softness_bayes.runs.drawing import RUN_FORMATS
from softness_bayes.touch.readings import MENDED
from support.command_line import FIXED, HELD, QUICK, TOUCH, call, refused, run
from support.paths import DATA, ROOT

# predict


PRINTED = 5e-5
"""Relative error of numbers that are printed, to five digits."""


def predicted(*arguments, by=call):
    done = by("predict", *TOUCH, *arguments)
    assert done.returncode == 0, done.stderr
    return pd.read_csv(io.StringIO(done.stdout))


def test_predict_prints_a_table_of_the_medians_and_of_what_is_set():
    usual, stiffer = predicted("--set", "sigma_0=5", by=run), predicted("--set", "sigma_0=5", "--set", "b=200")
    truth = pd.read_csv(DATA / "fabrics.csv")
    assert usual["fabric"].tolist() == stiffer["fabric"].tolist() == truth["fabric"].tolist()
    assert (usual["indentation_mm"] == 2).all()
    assert (stiffer["e_skin_kpa"] > usual["e_skin_kpa"]).all()
    # printed reading of the rigidity: E_ten h^3 / (12 (1 - nu)), l = 1 mm
    modulus = truth.tensile_modulus_mpa * truth.thickness_mm**3 / (12 * (1 - truth.poisson_ratio)) * 1e3
    np.testing.assert_allclose(usual["e_fab_kpa"], modulus, rtol=PRINTED)


# simulate


def test_simulate_makes_the_data_byte_for_byte(tmp_path):
    text = (DATA / "README.md").read_text(encoding="utf-8").replace("\\\n", " ")
    (command,) = re.findall(r"^softness-bayes simulate .*$", text, re.MULTILINE)
    arguments = shlex.split(command)[1:]
    assert arguments[-2:] == ["--out", "again"]
    done = call(*arguments[:-1], tmp_path, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    names = ["compression.csv", "fabrics.csv", "ratings.csv", "truth.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [".softness-bayes.json", *names]
    for name in names:
        assert (tmp_path / name).read_bytes() == (DATA / name).read_bytes(), name


def test_simulate_says_what_the_ratings_were_made_from(tmp_path):
    arguments = [*TOUCH, "--participants", "3", "--set", "b=70", "--typical-rating", "50", "--seed", "4"]
    done = call("simulate", *arguments, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    story = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert story["truth"]["b"] == 70
    assert story["truth"]["mu"] == pytest.approx(np.log(50))
    assert story["seed"] == 4
    assert story["readings"] == MENDED.names
    table = predicted("--set", "b=70")
    assert [*story["total_rate"]] == ["2 mm"]
    np.testing.assert_allclose(list(story["total_rate"]["2 mm"].values()), table["total_rate_hz"], rtol=PRINTED)
    ratings = pd.read_csv(tmp_path / "ratings.csv")
    assert len(ratings) == 3 * 12
    assert ratings["rating"].gt(0).all()


# sample


@pytest.fixture(scope="module")
def alone(tmp_path_factory, brief_pilot):
    """The shipped ratings without a fabric table, and --max-steps too small to converge."""
    directory = tmp_path_factory.mktemp("alone")
    words = ["sample", "--data", DATA / "ratings.csv", *FIXED, *QUICK]
    ending = ["--reading", "pressure=hertz", "--prior", "gamma=lognormal(1.1,0.2)", "--seed", "2", "--verbose"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["softness-bayes", *map(str, [*words, *ending])])
        return directory, call(*words, *ending, cwd=directory)


def test_a_run_that_has_not_converged_ends_with_3_and_its_files(alone):
    directory, done = alone
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    written = {path.name for path in (directory / "results").iterdir()}
    tables = ("summary", "directions", "predictive_checks", "fabric_ratings", "modulus_errors", "ruler")
    assert written == {".softness-bayes.json", "checkpoint", "posterior.nc", *(f"{name}.csv" for name in tables)}
    stages = [line for line in done.stderr.splitlines() if line.startswith("after sampling, ")]
    assert stages == [*map(str, Stage)][:-1]  # without figures
    assert "Warning" not in done.stderr
    assert "Not converged after 20 steps" in done.stdout
    assert "not converged" in done.stderr


def test_the_posterior_of_a_run_predicts(alone):
    directory, _ = alone
    done = call("predict", *TOUCH, "--posterior", directory / "results", "--out", directory / "table.csv")
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(directory / "table.csv")
    assert {"total_rate_hz", "total_rate_hz_low", "total_rate_hz_high"} <= {*table}
    # the whole chain was held: there is no width
    np.testing.assert_allclose(table["total_rate_hz_low"], table["total_rate_hz_high"], rtol=1e-9)
    hertz = [part for name, value in HELD.items() for part in ("--set", f"{name}={value}")]
    plain = predicted(*hertz, "--reading", "pressure=hertz")
    # the table says the readings of the run, whatever the defaults are
    assert (table["readings"] == "mended, pressure=hertz").all()
    np.testing.assert_allclose(table["total_rate_hz"], plain["total_rate_hz"], rtol=PRINTED)
    assert table["total_rate_hz"].max() != float(f"{table['total_rate_hz'].max():.5g}")  # a file has all digits


def test_a_directory_in_use_is_refused_and_survives_bad_input(alone):
    directory, _ = alone
    held = {path: path.read_bytes() for path in (directory / "results").rglob("*.*") if path.is_file()}
    again = ["sample", "--data", DATA / "ratings.csv", *FIXED, *QUICK]
    refused(call(*again, cwd=directory), "results: is not empty", "--force")
    # --force with a fault elsewhere leaves the earlier result alone
    refused(call(*again, "--force", "--prior", "bee=halfnormal(1)", cwd=directory), "bee")
    assert {path: path.read_bytes() for path in (directory / "results").rglob("*.*") if path.is_file()} == held


def test_an_effect_per_fabric_from_end_to_end(tmp_path, brief_pilot, monkeypatch):
    """With --fabrics, --force-n in place of a load column, figures, --force, and omega freed."""
    ratings = pd.read_csv(DATA / "ratings.csv", dtype=str)
    few = ratings[(ratings["indentation_mm"] == "3") & ratings["participant"].isin(["P01", "P02", "P03"])]
    few[["participant", "fabric", "rating"]].rename(columns={"rating": "softness"}).to_csv(
        tmp_path / "few.csv", index=False, sep=";"
    )
    (tmp_path / "out").mkdir()
    few_figures = ("response", "rating", "corner", "touch")  # every figure is drawn elsewhere
    monkeypatch.setattr(figures, "FIGURES", {name: figures.FIGURES[name] for name in few_figures})
    done = call(
        *["sample", "--data", tmp_path / "few.csv", "--fabrics", DATA / "fabrics.csv", *FIXED],
        *["--column", "rating=softness", "--force-n", "1.2", "--prior", "omega=halfnormal(0.5)"],
        *[*QUICK[:-1], "--seed", "1", "--figure", "touch", "--out", tmp_path / "out"],
    )
    assert done.returncode == 3, done.stderr
    result = Result.load(tmp_path / "out")
    assert result.table.index.tolist() == ["gamma", "varsigma", "omega", "mu"]
    posterior = result.group("posterior")
    assert posterior["fabric_effect"].dims == ("chain", "draw", "fabric")
    assert posterior["fabric"].values.tolist() == pd.read_csv(DATA / "fabrics.csv")["fabric"].tolist()
    assert result.attributes["prior_omega"] == "halfnormal(0.5)"
    assert [str(load) for load in result.loads] == ["1.2 N"]
    drawn = {path.name for path in (tmp_path / "out" / "figures").iterdir() if path.stat().st_size > 1000}
    assert drawn - {".softness-bayes.json"} == {f"{name}.{suffix}" for name in few_figures for suffix in RUN_FORMATS}
