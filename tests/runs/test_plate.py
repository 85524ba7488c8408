"""Compression data from their file to a result: alone, beside ratings, simulated and real."""

import dataclasses
import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import kstest

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal
from softness_bayes.checking.sentences import plate_sentence
from softness_bayes.data import Compression, Experiment, Fabrics
from softness_bayes.likelihood.contract import NO_RESPONSE
from softness_bayes.model.build import build, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression, simulate_ratings
from softness_bayes.plotting.figures import figures_of
from softness_bayes.results.result import Result
from softness_bayes.runs.run import WIDE, sample
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.command_line import call, refused
from support.paths import DATA

GULATI = "fingerpad_force_displacement_gulati.csv"
SUBJECTS = {"participant": "subject", "indentation_mm": "displacement_mm", "force_n": "force_N"}
SAMPLED = ("b", "m", "tau_b", "tau_m", "varsigma_f")


pytestmark = pytest.mark.usefixtures("short_pilot")


# the file


@pytest.fixture
def table(tmp_path):
    def write(text):
        path = tmp_path / "press.csv"
        path.write_text(text)
        return path

    return write


def test_rows_are_read_and_those_of_no_force_dropped(table):
    text = "participant,indentation_mm,force_n\nP2,0,0\nP2,1,0.2\nP10,1.5,0.5\nP2,2,0\nP10,2,\n"
    read = Compression.read(table(text))
    assert read.participants == ("P2", "P10")
    assert_array_equal(read.participant, [0, 1])
    assert_allclose(read.indentation, [1e-3, 1.5e-3])
    assert_allclose(read.force, [0.2, 0.5])
    assert_array_equal(read.rows, [3, 4])
    assert (read.n_zero, len(read)) == (2, 2)
    assert len(read.digest) == 64
    assert any("2 rows with a force of 0 are left out" in note for note in read.notes)
    assert any("1 force is missing" in note for note in read.notes)


def test_only_rows_of_a_flat_plate_count_without_names_those_of_one_finger(table):
    text = "indentor,indentation_mm,force_n\nFlat_Plate,1,0.2\npoint,1,9\n"
    read = Compression.read(table(text))
    assert_allclose(read.force, [0.2])
    assert any("1 of 2 rows has another indentor than a flat plate" in note for note in read.notes)
    assert read.participants == ("finger",)
    assert any("no column 'participant': all forces are treated as those of one finger" in note for note in read.notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("participant,indentation_mm,force_n\nA,1,-0.2\n", r"press\.csv: row 2, column 'force_n'.*got '-0\.2'"),
        ("participant,indentation_mm,force_n\nA,0,0.2\n", r"row 2, column 'indentation_mm'.*got '0'"),
        ("participant,indentation_mm,force_n\nA,,0.2\n", r"row 2, column 'indentation_mm'.*got ''"),
        ("participant,indentation_mm,force_n\nA,1,soft\n", r"column 'force_n'.*got 'soft'"),
        ("participant,indentation_mm,force_n\nA,0,0\n", "no row with a force above 0"),
        ("participant,force_n\nA,1\n", "no column 'indentation_mm'"),
    ],
)
def test_rows_that_cannot_be_used_are_named(table, text, message):
    with pytest.raises(InputError, match=message):
        Compression.read(table(text))


# simulated fingers


def test_simulated_fingers_follow_the_model():
    values = usual_values(MENDED, "in-vivo", {"tau_b": 0.3, "tau_m": 0.5, "varsigma_f": 0.1}, n_fingers=3000)
    made = simulate_compression(np.random.default_rng(2), values, fingers=3000)
    force = np.log(made.compression.force.reshape(3000, 4))
    u = np.sqrt(8e-3 * np.array([0.5e-3, 1e-3, 1.5e-3, 2e-3])) / 8e-3
    mean = np.log(4 * 7.5e3 * (8e-3 * u) ** 3 / (3 * 8e-3 * (1 - 0.48**2))) + 3.9 * u
    covariance = 0.09 + 0.25 * np.outer(u, u) + 0.01 * np.eye(4)
    whitened = (force - mean) @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    assert kstest(whitened.ravel(), "norm").pvalue > 1e-3
    assert made.log_b_effect.std() == pytest.approx(0.3, rel=0.06)
    with pytest.raises(InputError, match="number of fingers is 0, expected a whole number from 1"):
        simulate_compression(np.random.default_rng(2), values, fingers=0)


# alone


@pytest.fixture(scope="module")
def shipped():
    return Compression.read(DATA / "compression.csv")


@pytest.fixture(scope="module")
def result(shipped):
    return sample(shipped, max_steps=300, processes=1, seed=1)


def test_the_shipped_forces_give_back_what_they_were_made_from(result):
    truth = json.loads((DATA / "truth.json").read_text())["truth"]
    table = result.summary()
    assert table.index.tolist() == list(SAMPLED)
    for name in SAMPLED:
        assert abs(table.loc[name, "mean"] - truth[name]) < 3 * table.loc[name, "sd"], name
    # with a narrow view of the skin: forces do say what it is
    assert table.loc["b", "sd"] < 0.25 * truth["b"]
    assert table.loc["m", "sd"] < 0.15 * truth["m"]


def test_groups_of_a_run_on_forces_alone(result, shipped):
    posterior, rows = result.group("posterior"), len(shipped)
    assert posterior["finger"].values.tolist() == [f"F{k}" for k in range(1, 9)]
    assert posterior["b"].attrs["units"] == "kPa"
    for group in ("posterior_predictive", "prior_predictive"):
        assert result.group(group)["plate_force_n"].shape == (1, 500, rows)
    assert_array_equal(result.group("observed_data")["plate_force_n"], shipped.force)
    found = result.attributes
    assert (found["digest_compression"], found["zero_forces"]) == (shipped.digest, 0)
    assert found["prior_b"] == "lognormal(30,1)"
    said = plate_sentence(result.provenance.plate)
    assert "steeper than Hertz's 1.5" in said
    assert "little power" in said


def test_what_needs_ratings_says_so(result):
    for ask in (lambda: result.loads, result.curves, result.inflection, result.inflections):
        with pytest.raises(InputError, match="without ratings"):
            ask()
    assert figures_of(result) == ["corner", "prior", "trace", "rank", "compression"]
    assert result.values(20)["b"].shape == (20,)


def test_stored_densities_are_those_of_the_model(result, shipped):
    posterior = build_skin(shipped, WIDE).posterior
    assert posterior.names == SAMPLED
    theta = np.stack([result.group("posterior")[name].values[3, ::50] for name in SAMPLED], axis=-1)
    stored = result.group("log_likelihood_joint")["compression"].values[3, ::50]
    assert_allclose(posterior.log_likelihood(theta), stored, rtol=1e-7)


def test_one_finger_has_no_spread_and_a_plate_knows_no_current(shipped):
    one = shipped.participant == 0
    arrays = {name: getattr(shipped, name)[one] for name in ("participant", "indentation", "force", "rows")}
    alone = dataclasses.replace(shipped, participants=("F1",), **arrays)
    posterior = build_skin(alone, WIDE).posterior
    assert posterior.names == ("b", "m", "varsigma_f")
    assert (posterior.space.held["tau_b"], posterior.space.held["tau_m"]) == (0.0, 0.0)
    with pytest.raises(InputError, match="tau_b cannot be sampled, because there is only one finger"):
        build_skin(alone, dataclasses.replace(WIDE, priors={"tau_b": LogNormal(0.1, 1)}))
    with pytest.raises(InputError, match="gamma: the model of these data has no such parameter"):
        build_skin(shipped, dataclasses.replace(WIDE, fix={"gamma": 1.0}))


@pytest.mark.parametrize(
    ("displacement", "b", "m"), [("printed", (5, 10), (3.4, 4.4)), ("displacement", (11, 20), (560, 700))]
)
def test_human_fingerpads(shared, displacement, b, m):
    """Gulati's four subjects, about 0.16 N at 1 mm: model.md 10 has the skin that they suggest."""
    data = Compression.read(shared / "data" / GULATI, columns=SUBJECTS)
    assert (len(data), data.n_zero, len(data.participants)) == (16, 4, 4)
    readings = MENDED.override({"skin_displacement": displacement})
    found = sample(data, WIDE, readings=readings, max_steps=300, processes=1)
    table = found.summary()
    assert b[0] < table.loc["b", "mean"] < b[1]
    assert m[0] < table.loc["m", "mean"] < m[1]
    assert 2.1 < found.attributes["force_exponent"] < 2.3
    assert found.attributes["force_exponent_low"] > 1.5
    assert found.attributes["force_p_value"] > 0.05
    typical = found.group("predictions").isel(chain=0)["typical_force_n"].interp(plate_indentation_mm=1.0)
    assert float(typical.median()) == pytest.approx(0.16, rel=0.2)


# beside ratings

CLOTH = Fabrics(("felt", "lawn", "drill"), effective_modulus=np.array([8e4, 2e5, 4e5]))


@pytest.fixture(scope="module")
def joint():
    values = usual_values(MENDED, given={"sigma_0": 7.0, "varsigma": 0.2})
    rng = np.random.default_rng(3)
    ratings = simulate_ratings(rng, CLOTH, (Indentation(2e-3),), values, participants=4).ratings
    fingers = usual_values(MENDED, given={"tau_b": 0.2, "tau_m": 0.2, "varsigma_f": 0.05}, n_fingers=5)
    return Experiment(ratings, CLOTH, (), simulate_compression(rng, fingers, fingers=5).compression)


def test_the_joint_likelihood_is_the_sum_of_both(joint):
    both, alone = (
        build(joint, ModelOptions(discretisation=Discretisation())).posterior,
        build(joint._replace(compression=None), ModelOptions(discretisation=Discretisation())).posterior,
    )
    assert both.names == (*alone.names, "tau_b", "tau_m", "varsigma_f")
    theta = both.space.draw_prior(np.random.default_rng(1), 10)
    forces = both.compression.log_likelihood(NO_RESPONSE, both.parameters_of(both.compression, theta))
    assert_allclose(both.log_likelihood(theta), alone.log_likelihood(theta[:, :-3]) + forces, rtol=1e-12)
    assert forces.std() > 1


def test_a_joint_run_holds_both(variant_run):
    found = variant_run("own fingers")
    assert {"participant_effect", "m_effect", "mu"} <= {*found.group("posterior").data_vars}
    assert {*found.group("log_likelihood_joint").data_vars} == {"ratings_and_compression"}
    assert {"rating", "plate_force_n"} <= {*found.group("posterior_predictive").data_vars}
    assert figures_of(found)[-1] == "compression"
    assert "response" in figures_of(found)
    assert "force_exponent" in found.attributes


# the command line


def test_a_run_from_the_command_line(tmp_path):
    done = call(
        *("sample", "--compression", DATA / "compression.csv", "--max-steps", "60", "--processes", "1"),
        *("--fix", "tau_m=0.3", "--out", tmp_path / "skin", "--verbose"),
    )
    assert done.returncode == 3, done.stderr
    assert "note: without ratings the default is --priors wide" in done.stderr
    assert re.search(r"force grows as indentation to the power 1\.\d\d", done.stdout)
    assert "turns over" not in done.stdout
    held = Result.load(tmp_path / "skin").group("constant_data")
    assert float(held["tau_m"]) == 0.3
    names = {path.stem for path in (tmp_path / "skin" / "figures").glob("[a-z]*")}
    assert names == {"corner", "compression"}
    refused(
        call("predict", "--fabrics", DATA / "fabrics.csv", "--force-n", "1", "--posterior", tmp_path / "skin"),
        "a run without ratings cannot predict ratings",
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no data: give ratings with --data"),
        (["--compression", "nowhere.csv"], "nowhere.csv"),
        (["--compression", DATA / "compression.csv", "--force-n", "1"], "--force-n needs ratings"),
        (
            ["--compression", DATA / "compression.csv", "--fix", "alpha=20"],
            "alpha: the model of these data has no such",
        ),
        (["--data", DATA / "ratings.csv", "--fix", "tau_b=1"], "tau_b: the model of these data has no such"),
    ],
)
def test_sample_refuses(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    done = call("sample", *arguments)
    refused(done, message)
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []
