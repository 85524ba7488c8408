"""The page of commands and files names what runs of every kind leave, all of it and nothing else."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure

from softness_bayes import arviz_bridge, errors
from softness_bayes.checking.ranks import DRAWS, Replicate
from softness_bayes.checkpoints.manifest import FORMAT
from softness_bayes.cli import VERBS, bench, claims, main, rank
from softness_bayes.cli.compare import COMPARISON
from softness_bayes.cli.interrupts import SIGNALS
from softness_bayes.cli.report import REPORT
from softness_bayes.data import LABELS, NUMBERS
from softness_bayes.files.asked import ASKED
from softness_bayes.files.listing import LISTING
from softness_bayes.files.run_files import CHECKPOINT, FILES, RUNS
from softness_bayes.likelihood.directions import FREE
from softness_bayes.likelihood.own_answers import OWN_ANSWERS
from softness_bayes.model import individual
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulated_forces import simulate_compression
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.priors import HalfNormal
from softness_bayes.plotting.data import data_of
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.results.result import Result
from softness_bayes.results.result_file import SCHEMA
from softness_bayes.runs import calibrated, calibration_files, study
from softness_bayes.runs.comparison import compare
from softness_bayes.runs.drawing import FIRST_FIGURES, RUN_FIGURES
from softness_bayes.runs.run import sample
from softness_bayes.sampler.moves import MANY_DIMENSIONS, MANY_DIMENSIONS_MOVES, MOVES
from softness_bayes.touch.finger_grid import SPREAD_OF
from softness_bayes.touch.readings import MENDED
from support.pages import headings, in_the_code, numbers, paragraphs, plain, sections, table, tables
from support.paths import DATA, ROOT
from support.report_runs import HELD, OPTIONS, cells_run, experiment, quickly

PAGE = "files.md"
STANDS_FOR = {
    "parameter": "|".join([*EVERY_PARAMETER, "mu", "c0", "c1"]),
    "number": "[0-9]{7}",
    "place": "[a-z_]+",
    "library": "[a-z_]+",
    "column": "[a-z_]+",
    "quantity": "[a-z_]+",
}
"""What the placeholders of the page stand for."""


class Run(NamedTuple):
    """A finished run, its file as it is on the disk, and whether it is of ratings and of compression data."""

    result: Result
    tree: xr.DataTree
    marks: frozenset[str]


def pattern(name):
    return re.compile(re.sub(r"\\{(\w+)\\}", lambda found: f"(?:{STANDS_FOR[found[1]]})", re.escape(name)))


def require_same(present, named):
    """Assert that every name that is there matches one of the page's, and every one of the page's is there."""
    assert not [name for name in present if not any(pattern(one).fullmatch(name) for one in named)]
    assert not [one for one in named if not any(pattern(one).fullmatch(name) for name in present)]


def run_of(result, directory, marks):
    result.save(directory)
    return Run(Result.load(directory), arviz_bridge.read_netcdf(directory / FILES[0]), frozenset(marks))


def call(*typed):
    """Run the command line in this process; its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["softness-bayes", *map(str, typed)])
        with pytest.raises(SystemExit) as end:
            main([*map(str, typed)])
    return end.value.code


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """A run on ratings and forces, with effects of fabrics, and errors of the moduli of two fabrics and of a load."""
    made = simulate_compression(np.random.default_rng(4), usual_values(MENDED, n_fingers=4), fingers=4)
    held = HELD | {"tau_b": 0.3, "tau_m": 0.5, "varsigma_f": 0.1}  # few parameters make a quick run
    options = OPTIONS | {"fix": held, "priors": {"omega": HalfNormal(0.5)}}
    with quickly():
        rated = experiment()
        fabrics = replace(rated.fabrics, effective_modulus_cv=np.array([0.1, 0.2, np.nan, np.nan]))
        ages = {"age": tuple(f"0{k}" for k in range(len(rated.ratings.participants)))}
        ratings = replace(rated.ratings, load_cv=np.where(rated.ratings.load == 0, 0.05, np.nan), covariates=ages)
        given = rated._replace(ratings=ratings, fabrics=fabrics, compression=made.compression)
        result = sample(given, **options)
    return run_of(result, tmp_path_factory.mktemp("everything"), "rc")


@pytest.fixture(scope="module")
def z_scores(tmp_path_factory, report_run):
    return run_of(report_run("z-scores"), tmp_path_factory.mktemp("z"), "r")


@pytest.fixture(scope="module")
def own_fingers(tmp_path_factory):
    """A run whose raters differ in everything that can differ, over a coarse grid of coarse responses."""
    with quickly(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(individual, "NODES", {3: dict.fromkeys(SPREAD_OF, 3)})
        for name in ("RESPONSE_NODES", "SKIN_NODES", "FINER_RESPONSE_NODES", "FINER_SKIN_NODES"):
            patch.setattr(individual, name, 8)
        rated = experiment()
        sexes = {"sex": ("f",) * len(rated.ratings.participants)}
        rated = rated._replace(ratings=replace(rated.ratings, covariates=sexes))
        result = sample(rated, **OPTIONS | {"max_steps": 10}, individual=tuple(SPREAD_OF))
    assert set(result.tables["rater_fingers"]["sex"]) == {"f", ""}
    return run_of(result, tmp_path_factory.mktemp("fingers"), "r")


@pytest.fixture(scope="module")
def own_answers(tmp_path_factory):
    """A run whose raters have exponents and noise of their own."""
    with quickly():
        result = sample(experiment(), **OPTIONS | {"max_steps": 10}, individual=tuple(OWN_ANSWERS))
    return run_of(result, tmp_path_factory.mktemp("answers"), "r")


@pytest.fixture(scope="module")
def grids(tmp_path_factory):
    """A run on whole numbers and zeros, whose table says so, in either direction, with noise on the membranes."""
    with quickly():
        rated = experiment(participants=3)
        whole = np.maximum(np.round(rated.ratings.rating / 4.0), 0.0)
        ratings = replace(rated.ratings, rating=whole, resolution=np.ones(whole.size), lists=rated.ratings.participant)
        result = sample(rated._replace(ratings=ratings), **OPTIONS | {"max_steps": 10, "direction": FREE, "noise": 1.0})
    return run_of(result, tmp_path_factory.mktemp("grids"), "r")


@pytest.fixture(scope="module")
def cells(once, tmp_path_factory):
    return run_of(once("cells-run", cells_run), tmp_path_factory.mktemp("cells"), "r")


@pytest.fixture(scope="module")
def directory(tmp_path_factory, brief_pilot):
    """What the command line leaves of a run on forces alone."""
    home = tmp_path_factory.mktemp("forces") / "run"
    short = ["--max-steps", "20", "--no-figures", "--processes", "1"]
    assert call("sample", "--compression", DATA / "compression.csv", *short, "--out", home) == 3
    return home


@pytest.fixture(scope="module")
def runs(everything, z_scores, own_fingers, own_answers, grids, cells, directory):
    forces = Run(Result.load(directory), arviz_bridge.read_netcdf(directory / FILES[0]), frozenset("c"))
    return everything, z_scores, own_fingers, own_answers, grids, cells, forces


def column(rows, title) -> list[str]:
    return [plain(row[title]) for row in rows]


def mark_of(text):
    """Return the mark of a row, if it has one: what data it needs."""
    found = re.match(r"\*([rc])\*", text)
    return {found[1]} if found else set()


# commands and exit codes


def test_sections_are_numbered_in_order():
    assert [*headings(PAGE)] == [str(k) for k in range(1, 13)]


def test_columns_that_are_read():
    rows = {plain(row["column"]): row for row in table(PAGE, "1", "column")}
    assert {*rows} == {*LABELS, *NUMBERS}
    for name, known in NUMBERS.items():
        assert rows[name]["unit"] == known.unit


def test_commands():
    assert column(table(PAGE, "2", "command"), "command") == [*VERBS]


def test_files_of_commands(tmp_path):
    rows = {
        plain(row["command"]): re.findall(r"`([^`]+)`", row["what it writes"]) for row in table(PAGE, "2", "command")
    }
    touch = ["--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2"]
    assert call("simulate", *touch, "--participants", 2, "--fingers", 2, "--out", tmp_path / "made") == 0
    assert {*rows["simulate"], LISTING} == {path.name for path in (tmp_path / "made").iterdir()}
    truth = json.loads((tmp_path / "made" / "truth.json").read_text())
    assert {*truth} == {*column(table(PAGE, "11", "key"), "key")}
    assert {*rows["claims"]} == {*claims.MADE}
    assert {*rows["bench"]} == {*bench.MADE}
    assert rows["compare"] == [COMPARISON]
    assert rows["rank"] == [*rank.MADE, rank.AGREEMENT, "--against"]
    assert rows["report"] == [REPORT]
    assert {*rows["study"]} == {*study.MADE, f"{RUNS}/", ASKED}
    kept = {calibrated.RANKS, calibrated.COVERAGE, calibrated.VERDICT, f"{calibrated.FIGURE}.png", ASKED}
    kept |= {calibration_files.MANIFEST, f"{calibration_files.REPLICATES}/", calibration_files.EARLIER, "--from"}
    assert {*rows["calibrate"]} == kept


def test_exit_codes():
    known = {
        error.exit_code
        for error in vars(errors).values()
        if isinstance(error, type) and error.__module__ == errors.__name__
    }
    known.remove(errors.SoftnessError.exit_code)  # that of no error itself
    known |= {0, *(128 + number for number in SIGNALS)}
    said = [int(row["code"]) for row in table(PAGE, "3", "code")]
    assert said == sorted(known)
    (listed,) = re.findall(r"Exit codes: ([^.]+)\.", " ".join(main.__doc__.split()))
    assert [int(code) for code in re.findall(r"\b\d+\b", listed)] == said


# files of a run


def test_files_of_a_run(directory):
    said = column(table(PAGE, "4", "file"), "file")
    assert {*said} == {*FILES, f"{CHECKPOINT}/", "figures/", LISTING}
    assert {f"{path.name}{'/' * path.is_dir()}" for path in directory.iterdir()} <= {*said}


def test_figures():
    assert column(table(PAGE, "4", "figure"), "figure") == [*FIGURES]
    (said,) = (part for part in paragraphs(sections(PAGE)["4"]) if part.startswith("A run draws "))
    run, first = said.split("A first look draws ")
    assert {*re.findall(r"`(\w+)`", run.split(", as far as")[0])} == {*RUN_FIGURES}
    assert {*re.findall(r"`(\w+)`", first)} == {*FIRST_FIGURES}


def test_data_of_figures():
    title = "column of a figure's data"
    assert column(table(PAGE, "4", title), title) == [*data_of(Figure()).columns]


def test_checkpoint(directory):
    require_same({path.name for path in (directory / CHECKPOINT).iterdir()}, column(table(PAGE, "8", "file"), "file"))
    assert f"**format {FORMAT}**" in sections(PAGE)["8"]


# posterior.nc


def test_groups(runs):
    rows = {plain(row["group"]): row["what it holds"] for row in table(PAGE, "5", "group", "what it holds")}
    for run in runs:
        assert {*run.tree.children} <= {*rows}
        needed = {group for group, text in rows.items() if mark_of(text) <= run.marks}
        assert {*run.tree.children} == needed
    assert f"**schema {SCHEMA}**" in sections(PAGE)["5"]


def test_variables_with_their_dimensions(runs):
    groups = {plain(row["group"]): mark_of(row["what it holds"]) for row in table(PAGE, "5", "group", "what it holds")}
    rows = table(PAGE, "5", "group", "variable")
    met = set()
    for run in runs:
        for group, child in run.tree.children.items():
            for name, variable in child.to_dataset().data_vars.items():
                where = f"{name} of {group}"
                found = [
                    k
                    for k, row in enumerate(rows)
                    if plain(row["group"]) == group and pattern(plain(row["variable"])).fullmatch(str(name))
                ]
                # mu and c0, c1 have rows of their own
                k = min(found, key=lambda k: "{" in rows[k]["variable"], default=None)
                assert k is not None, where
                met.add(k)
                further = tuple(dim for dim in variable.dims if dim not in arviz_bridge.SAMPLE_DIMS)
                assert further == tuple(re.findall(r"`(\w+)`", rows[k]["further dimensions"])), where
                assert mark_of(rows[k]["what it is"]) | groups[group] <= run.marks, where
    assert [row for k, row in enumerate(rows) if k not in met] == []


def test_units_of_variables(everything):
    """Where the page gives a unit in brackets, the file has it."""
    for row in table(PAGE, "5", "group", "variable"):
        stored = everything.tree[plain(row["group"])].to_dataset()
        unit = re.search(r"\[([^\]]+)\]", row["what it is"])
        if unit is not None and plain(row["variable"]) in stored:
            expected = {"spikes/s": "Hz"}.get(unit[1], unit[1])
            assert stored[plain(row["variable"])].attrs["units"] == expected, row


def test_coordinates(runs):
    (said,) = re.findall(r"^Coordinates: (.+?)\n\n", sections(PAGE)["5"], re.M | re.S)
    named = {*re.findall(r"`(\w+)`", said), "ensemble", "posterior_chain", "posterior_draw", "chain", "draw"}
    found = {str(name) for run in runs for child in run.tree.children.values() for name in child.to_dataset().coords}
    assert found | {"load_group"} == named  # these runs have few loads


def test_attributes(runs):
    rows = {plain(row["attribute"]): row["what it says"] for row in table(PAGE, "6", "attribute")}
    require_same({name for run in runs for name in run.tree.attrs}, [*rows])
    for run in runs:
        named = [name for name, text in rows.items() if mark_of(text) <= run.marks]
        assert [name for name in run.tree.attrs if not any(pattern(one).fullmatch(name) for one in named)] == []


# tables


def rows_after(start):
    """Return the first column of the table of section 7 that follows a paragraph."""
    (found,) = [t.rows for t in tables(PAGE) if t.section == "7" and t.lead.startswith(start)]
    return [plain(row[next(iter(row))]) for row in found]


@pytest.mark.parametrize("name", ["summary", "directions", "predictive_checks", "fabric_ratings"])
def test_tables_of_a_run(name, runs):
    for run in runs:
        if name in ("predictive_checks", "fabric_ratings") and "r" not in run.marks:
            assert name not in run.result.tables
            continue
        kept = run.result.summary() if name == "summary" else run.result.tables[name]
        require_same({str(title) for title in kept.reset_index().columns}, rows_after(f"`{name}`"))


def test_raters_have_their_covariates(everything, z_scores):
    found = everything.result.tables["raters"]
    assert [*found.reset_index().columns, "{covariate}"] == [*rows_after("`raters`")[:-1], "age", "{covariate}"]
    assert found["age"].tolist()[:2] == ["00", "01"]
    assert (found["effect_low"] < found["effect"]).all()
    assert (found["effect"] < found["effect_high"]).all()
    assert found["ratings"].sum() == everything.tree["observed_data"]["rating"].size
    assert "raters" not in z_scores.result.tables


def test_quantities_of_the_checks(everything, cells):
    kept = [run.result.tables["predictive_checks"].reset_index() for run in (everything, cells)]
    assert {name for table in kept for name in table["quantity"]} == {*rows_after("Its quantities")}


def test_turning_points(everything):
    named = column(table(PAGE, "10", "column"), "column")
    columns = {*everything.result.inflection().reset_index().columns}
    require_same(columns, named)
    plainly = {name for name in named if "{" not in name} - {"load"}
    assert columns == {"load", *plainly, *(f"{name}_mcse" for name in plainly)}


def columns_of(start) -> list[str]:
    """Return the first column of the table of other commands that is led by some words."""
    (found,) = [t.rows for t in tables(PAGE) if t.section == "11" and t.lead.startswith(start)]
    return column(found, "column")


def test_predictions(everything):
    touched, rated = columns_of("`predict`"), columns_of("From a posterior, ratings follow")
    with quickly():
        columns = [*everything.result.predict(draws=8).columns]
    ends = ("_low", "_high", "_low_50", "_high_50")
    assert [name for name in columns if not name.endswith(ends)] == [*touched, *rated]
    limits = {f"{name}{end}" for name in touched[1:-1] for end in ends[:2]}
    assert {*columns} - {*touched, *rated} == limits | {f"{name}{end}" for name in rated[:3] for end in ends}


def test_rankings(everything):
    with quickly():
        found = everything.result.rank(draws=8)
    observed = {name: float(k) for k, name in enumerate(everything.result.fabrics.names)}
    tables_of = {
        rank.ORDER: found.table,
        rank.PLACES: found.place_table,
        rank.PAIRS: found.pair_table,
        rank.AGREEMENT: found.against(observed),
    }
    for name, made in tables_of.items():
        assert [*made.columns] == columns_of(f"`{name}` of `rank`"), name


def test_targets(everything):
    named = columns_of("`target`, one row per load and solution")
    found = set()
    with quickly():
        for given in ({"tensile_modulus": 5e6}, {"thickness": 1e-3}):
            found |= {*everything.result.target(20.0, **given, draws=8).table.columns}
    limited = named[named.index("e_fab_kpa") : -1]
    ends = ("_low", "_high", "_low_50", "_high_50")
    assert found == {*named} | {f"{name}{end}" for name in limited for end in ends}


def test_comparison(everything):
    found = compare({"one": everything.result, "two": everything.result})
    assert [*found.table.reset_index().columns] == columns_of("`compare`")


def test_claims():
    kept = pd.read_csv(ROOT / "notebooks" / "results" / "claims" / "claims.csv", nrows=1)
    assert [*kept.columns] == columns_of("`claims.csv`")


def test_calibration(rng):
    made = {
        k: Replicate(("b", "mu"), (int(rng.integers(DRAWS)), int(rng.integers(DRAWS))), (1.0, 2.0), 10, 2.0, True)
        for k in range(20)
    }
    found: Any = calibrated.Calibrated(made)
    (said,) = re.findall(r"^`ranks\.csv` of .+?\n\n", sections(PAGE)["11"], re.M | re.S)
    ranks, _, coverage = said.partition("`coverage.csv`")
    names = {*re.findall(r"`([a-z_]+)`", ranks)} - {"calibrate"}
    assert {*found.ranks().reset_index().columns} == {*names, "b", "mu", "true_b", "true_mu"}
    assert [*found.coverage().columns] == re.findall(r"`(\w+)`", coverage)


# words


@pytest.mark.parametrize(
    ("path", "cell"),
    [(plain(r["in the code"]), r["value"]) for t in tables(PAGE) for r in t.rows if "in the code" in r],
)
def test_constants(path, cell):
    assert numbers(cell) == [in_the_code(path)]


def test_proposals():
    rows = table(PAGE, "9", "proposal")
    for column, moves in {"up to 20 parameters": MOVES, "more": MANY_DIMENSIONS_MOVES}.items():
        told = {plain(row["proposal"]): float(row[column]) for row in rows if row[column] != "–"}
        assert told == {repr(one): share for one, share in moves}


def test_the_number_of_parameters_from_which_other_proposals_are_used():
    assert f"up to {MANY_DIMENSIONS} parameters" in sections(PAGE)["9"]
