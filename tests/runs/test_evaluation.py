"""A model whose parameters are all held: evaluated and said, never sampled."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Compression, read_experiment
from softness_bayes.model.build import build, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.runs.evaluation import Evaluation
from softness_bayes.runs.run import sample
from softness_bayes.touch.scene import Discretisation
from support.command_line import HELD, call
from support.paths import DATA

EVERY = {**HELD, "gamma": 0.9, "varsigma": 0.4, "omega": 0.0, "eps": 0.1}
SKIN = {"b": 8.0, "m": 4.0, "tau_b": 0.2, "tau_m": 0.3, "varsigma_f": 0.1}


def fixed(values):
    return [part for name, value in values.items() for part in ("--fix", f"{name}={value}")]


@pytest.fixture(scope="module")
def experiment():
    return read_experiment(DATA / "ratings.csv")


def evaluated(experiment, **changed):
    return Evaluation(build(experiment, ModelOptions(fix=EVERY | changed, discretisation=Discretisation())).posterior)


def test_the_likelihood_is_that_of_a_model_with_one_free_parameter(experiment):
    held = evaluated(experiment)
    some = {name: value for name, value in EVERY.items() if name != "gamma"}
    free = build(experiment, ModelOptions(fix=some, discretisation=Discretisation())).posterior
    assert free.names == ("gamma",)
    assert held.log_likelihood == pytest.approx(free.log_likelihood(np.array([[0.9]]))[0], rel=1e-9)
    assert held.values == EVERY
    assert len(held.loads) == len(experiment.ratings.loads)
    # negative control: at another point it is another number
    assert abs(free.log_likelihood(np.array([[1.2]]))[0] - held.log_likelihood) > 1


def test_silence_is_said(experiment):
    assert "no receptor fires" in evaluated(experiment, alpha=5.0).sentences()[-1]


def test_sample_evaluates_says_so_and_writes_nothing(tmp_path):
    done = call("sample", "--data", DATA / "ratings.csv", *fixed(EVERY), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = done.stdout + done.stderr
    assert "all parameters are fixed, so there is nothing to sample" in said
    assert "log-likelihood of the data at this point: -" in said
    assert said.count("\nunder ") >= 2
    assert "nothing is written" in said
    assert not list(tmp_path.iterdir())


def test_forces_alone_are_evaluated_too(tmp_path):
    path = tmp_path / "forces.csv"
    path.write_text("participant,indentation_mm,force_n\nA,1,0.3\nA,2,1.5\nB,1,0.25\nB,2,1.2\n")
    done = call("sample", "--compression", path, *fixed(SKIN), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "log-likelihood of the data at this point: " in done.stdout
    assert "under" not in done.stdout
    forces = Compression.read(path)
    assert Evaluation(build_skin(forces, ModelOptions(fix=SKIN)).posterior).inflection is None
    with pytest.raises(InputError, match="nothing to sample"):
        sample(forces, fix=SKIN)
