"""Studies: separate runs that go on where they were, populations as a joint grid has them, tables that are named."""

from __future__ import annotations

import os
import shutil
import time

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from softness_bayes.base.errors import InputError, LockedError, NotConvergedError, NumericalError
from softness_bayes.base.files.lock import Lock
from softness_bayes.base.files.run_files import CHECKPOINT, POSTERIOR, RUNS
from softness_bayes.base.laws import HalfNormal, LogNormal, Uniform
from softness_bayes.checking.pooling import LIMITS
from softness_bayes.cli.study import require_complete
from softness_bayes.data.lists import Listed, list_tables
from softness_bayes.model.build import build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression
from softness_bayes.parameters.declared import PRIOR_SETS
from softness_bayes.results.result import Result
from softness_bayes.runs import table_fits
from softness_bayes.runs.batch import ASKED, LOCK, write_asked
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.population import pool_results, population_of
from softness_bayes.runs.run import sample
from softness_bayes.runs.study import MADE, Study, study
from softness_bayes.runs.table_fits import CONVERGED, REFUSED, UNCONVERGED, TableOutcome, seed_of
from softness_bayes.touch.contact import STRAIN
from softness_bayes.touch.readings import MENDED
from support.command_line import FIXED, call, few_ratings, refused
from support.report_runs import quickly

TRUE = {"A": 60.0, "B": 90.0, "C": 150.0}
OPTIONS = ModelOptions(fix={"m": 2.0, "tau_b": 0.3, "tau_m": 0.5, "varsigma_f": 0.1}, prior_set="wide")
LIMITED = {"max_steps": 2000, "processes": 1, "seed": 4}


def table(b, seed):
    """Forces on four fingers: no run is cheaper."""
    values = usual_values(MENDED, given={"b": b}, n_fingers=4)
    return simulate_compression(np.random.default_rng(seed), values, fingers=4).compression


TABLES = {name: table(b, k) for k, (name, b) in enumerate(TRUE.items())}
PRIOR = PRIOR_SETS["wide"][STRAIN]["b"]


@pytest.fixture(scope="module", autouse=True)
def brief():
    with quickly():
        yield


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    found = study(TABLES, tmp_path_factory.mktemp("study"), OPTIONS, **LIMITED)
    found.save()
    return found


def test_every_table_is_an_ordinary_run(done):
    assert done.named(CONVERGED) == [*TABLES]
    again = sample(TABLES["B"], OPTIONS, max_steps=2000, processes=1, seed=seed_of(4, "B"))
    kept = Result.load(done.directory / RUNS / "B")
    np.testing.assert_array_equal(kept.group("posterior")["b"].values, again.group("posterior")["b"].values)


def test_the_population_is_that_of_a_joint_grid(done):
    """Likelihoods of b themselves, on a grid of b, mean and spread."""
    prior = population_of("b", PRIOR)
    z = np.linspace(2.0, 7.0, 300)
    mean, spread = np.linspace(1.0, 7.0, 160), (np.arange(100) + 0.5) / 100 * 3.5
    of_z = norm.pdf(z, mean[:, None, None], spread[:, None])
    log_density = norm.logpdf(mean, np.log(PRIOR.median), PRIOR.sd_log)[:, None] + prior.spread.log_density(spread)
    for one in TABLES.values():
        likelihood = build_skin(one, OPTIONS).posterior.log_likelihood(np.exp(z)[:, None])
        log_density = log_density + np.log(np.maximum(of_z @ np.exp(likelihood - likelihood.max()), 1e-300))
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    found = done.populations["b"].pooled
    assert found.fault == ""

    def quantiles(values, share):
        return np.interp(LIMITS, np.cumsum(share) - 0.5 * share, values)

    np.testing.assert_allclose(found.mean, quantiles(mean, weight.sum(axis=1)), atol=0.04)
    np.testing.assert_allclose(found.spread, quantiles(spread, weight.sum(axis=0)), atol=0.05)


def test_tables_figure_and_report(done):
    individual, population = (pd.read_csv(done.directory / name) for name in ("individual.csv", "population.csv"))
    assert individual["table"].tolist() == [*TABLES]
    widths = [np.log(individual[f"{kind}_high"] / individual[f"{kind}_low"]) for kind in ("separate", "shrunken")]
    assert (widths[1] < widths[0] + 0.05).all()
    row = population.iloc[0]
    assert row["median_low"] < row["median"] < row["median_high"]
    assert row["further_low"] < row["median_low"]
    said = (done.directory / "study.md").read_text()
    assert f"population median {row['median']:.4g} kPa" in said
    assert {path.name for path in done.directory.iterdir()} >= {*MADE, RUNS}
    axes = done.figure().axes[0]
    drawn = {line.get_gid(): line for line in axes.lines}
    np.testing.assert_allclose(drawn["shrunken/b/middle"].get_xdata(), individual["shrunken"])
    np.testing.assert_allclose(drawn["population/b/middle"].get_xdata(), row["median"])


def test_a_finished_study_runs_nothing_again(done, monkeypatch):
    monkeypatch.setattr(table_fits, "sample_kept", None)
    again = study(TABLES, done.directory, OPTIONS, **LIMITED)
    assert again.population.equals(done.population)


def test_a_study_goes_on_where_it_was(done, tmp_path, monkeypatch):
    """Killed within the second table; the others are done."""
    for name in "AC":
        shutil.copytree(done.directory / RUNS / name, tmp_path / RUNS / name)
    keep, steps = Checkpoint.keep, []

    def kill(self, state, *more):
        keep(self, state, *more)
        steps.append(state.steps)
        if self.directory.name == "B" and state.steps >= 200:
            raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "keep", kill)
    with pytest.raises(KeyboardInterrupt):
        study(TABLES, tmp_path, OPTIONS, **LIMITED)
    monkeypatch.setattr(Checkpoint, "keep", keep)
    found = study(TABLES, tmp_path, OPTIONS, **LIMITED)
    assert found.population.equals(done.population)


def test_a_table_of_another_study_is_named(done):
    """The others go on, from what there is."""
    found = study({**TABLES, "B": TABLES["A"]}, done.directory, OPTIONS, **LIMITED)
    assert found.named(REFUSED) == ["B"]
    assert "compression data" in found.outcomes[1].said
    assert len(found.populations["b"].pooled.tables) == 2


def test_tables_that_have_not_converged_are_not_pooled(tmp_path):
    found = study(TABLES, tmp_path, OPTIONS, max_steps=20, processes=1)
    assert found.named(UNCONVERGED) == [*TABLES]
    assert found.populations == {}
    assert "nothing is pooled" in found.report()
    assert {path.name for path in found.save()} == {"tables.csv", "study.md"}


def test_what_cannot_be_pooled(done, tmp_path):
    results = {name: Result.load(done.directory / RUNS / name) for name in TABLES}
    with pytest.raises(InputError, match="m is not sampled in A"):
        pool_results(results, ["m"])
    with pytest.raises(InputError, match="no parameter 'c'"):
        study(TABLES, tmp_path, pool=["c"])
    with pytest.raises(InputError, match="a prior for the spread of m is given"):
        pool_results(results, ["b"], {"m": HalfNormal(1.0)})
    with pytest.raises(InputError, match="values below 0"):
        pool_results(results, ["b"], {"b": Uniform(-1.0, 1.0)})
    other = sample(TABLES["A"], OPTIONS, priors={"b": LogNormal(50, 1.0)}, max_steps=20, processes=1)
    with pytest.raises(InputError, match=r"lognormal\(30,1\) in A and lognormal\(50,1\) in D"):
        pool_results({**results, "D": other})


def test_status_of_a_study(done):
    said = call("status", done.directory).stdout
    assert "3 runs ended (3 converged), 0 running, 0 interrupted, 0 not begun\n" in said
    assert "B: it has ended and its results are written" in said
    write_asked(done.directory, 5, 1)
    try:
        assert "0 interrupted, 2 not begun" in call("status", done.directory).stdout
        end = time.time() - 4.0  # two of three ended since the call, within four seconds
        os.utime(done.directory / ASKED, (end, end))
        for name, when in (("A", end - 1.0), ("B", end + 2.0), ("C", end + 4.0)):
            os.utime(done.directory / RUNS / name / POSTERIOR, (when, when))
        home = done.directory / RUNS / "C" / CHECKPOINT
        with Lock(home / LOCK):
            assert "2 runs ended (2 converged), 1 running, 0 interrupted, 2 not begun; about 6 s to go" in (
                call("status", done.directory).stdout
            )
    finally:
        write_asked(done.directory, 3, 0)


def test_a_study_under_way_is_not_disturbed(done):
    with Lock(done.directory / LOCK), pytest.raises(LockedError):
        study(TABLES, done.directory, OPTIONS, **LIMITED)


# the list of tables


def test_a_folder_of_tables(tmp_path):
    for name in ("P02.csv", "P01.csv", "fabrics.csv", "compression.csv", ".hidden.csv", "notes.pdf"):
        (tmp_path / name).write_text("")
    for name in ("site/ratings.csv", "one/P01.csv", "empty/notes.pdf"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    assert [one.name for one in list_tables(tmp_path)] == ["P01", "P02", "site"]
    with pytest.raises(InputError, match="no table in this folder"):
        list_tables(tmp_path / "empty")
    refused(call("study", tmp_path / "one"), "P01", "at least two")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("table,ratings\nA,a.csv\n", "column 'ratings'"),
        ("table,data\nA,a.csv\nB,\n", "row 3, column 'data'"),
        ("table,data\nA,a.csv\na,b.csv\n", "'a' is listed twice"),
        ("table,data\n../A,a.csv\n", "expected a name of letters"),
    ],
)
def test_a_file_that_names_tables_wrongly(tmp_path, text, said):
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        list_tables(tmp_path / "list.csv")


def test_a_file_that_names_tables(tmp_path):
    (tmp_path / "list.csv").write_text("table;data;fabrics\nA;x/a.csv;\n;b.csv;cloth.csv\n")
    expected = [Listed("A", tmp_path / "x/a.csv"), Listed("b", tmp_path / "b.csv", tmp_path / "cloth.csv")]
    assert list_tables(tmp_path / "list.csv") == expected


# the command


def test_a_folder_with_a_bad_table(tmp_path):
    """It is named, the others go on, and the run of each can be continued by itself."""
    tables, out = tmp_path / "tables", tmp_path / "out"
    tables.mkdir()
    few_ratings(tables)
    (tables / "ratings.csv").rename(tables / "P01.csv")
    (tables / "P03.csv").write_text("participant,fabric,indentation_mm,rating\nA,nothing,2,soft\n")
    asked = [*FIXED, "--max-steps", 20, "--processes", 1, "--accuracy", 0.01, "--pool", "gamma"]
    found = call("study", tables, *asked, "--out", out)
    assert found.returncode == 2
    assert "1 of 2 tables was refused (P03)" in found.stderr
    assert "P03: refused" in found.stdout
    assert "1 table was refused (P03)" in call("status", out).stdout
    kept = pd.read_csv(out / "tables.csv").set_index("table")
    assert kept["outcome"].to_dict() == {"P01": UNCONVERGED, "P03": REFUSED}
    assert "rating" in kept.loc["P03", "said"]
    again = call("resume", out / RUNS / "P01", "--more-steps", 10, "--no-figures")
    assert again.returncode == 3, again.stderr


@pytest.mark.parametrize(
    ("outcomes", "error"),
    [((CONVERGED, REFUSED, UNCONVERGED), InputError), ((CONVERGED, UNCONVERGED), NotConvergedError)],
)
def test_exit_codes(outcomes, error, tmp_path):
    tables = tuple(TableOutcome(f"P{k}", one, "") for k, one in enumerate(outcomes))
    with pytest.raises(error):
        require_complete(Study(tables, {}, tmp_path))


def test_a_population_whose_weights_fail_is_refused(done, tmp_path):
    """Negative control: a spread that cannot reach from one table to the next."""
    results = {name: Result.load(done.directory / RUNS / name) for name in TABLES}
    narrow = pool_results(results, ["b"], {"b": HalfNormal(1e-3)})
    assert narrow["b"].sentence().startswith("b: not pooled: ")
    found = Study((), narrow, tmp_path)
    assert found.population["median"].isna().all()
    with pytest.raises(NumericalError, match="not pooled: b"):
        require_complete(found)
