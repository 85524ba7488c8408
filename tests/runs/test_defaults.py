"""One set of defaults: the command line's options are those of the dataclasses, and both faces draw the same."""

import json

import pytest
from click.testing import CliRunner

from softness_bayes import read_experiment, sample
from softness_bayes.cli import main
from softness_bayes.cli.calibrate import command as calibrate_verb
from softness_bayes.cli.plan import command as plan_verb
from softness_bayes.cli.sample import command as sample_verb
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.model import build as building
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.fabric_moduli import UNKNOWN_MODULUS
from softness_bayes.results.request import Request, RunOptions
from softness_bayes.results.result import Result
from softness_bayes.touch.contact import Finger
from softness_bayes.touch.scene import Discretisation
from support.command_line import HELD, few_ratings
from support.report_runs import quickly

IN_WORDS = {
    "direction": ("auto", None),
    "errors": ("auto", None),
    "scale": ("magnitude", MAGNITUDE),
    "finger": ({}, Finger()),
    "unknown_modulus": (None, UNKNOWN_MODULUS),
}
"""Defaults that a word, or none, stands for at the command line, and what they are in Python."""

NAMES = {"fixed": "fix", "max_time": "max_seconds"}
"""Options whose name is another in Python."""


def faces(verb):
    """Return the defaults of a verb's options that have a counterpart in Python, both of them by name."""
    typed, here = verb.make_context(verb.name, []).params, Request()
    names = {NAMES.get(name, name): value for name, value in typed.items()}
    return {name: (value, getattr(part, name)) for name, value in names.items() for part in here if hasattr(part, name)}


def test_defaults_of_the_command_line_are_those_of_python():
    found = faces(sample_verb)
    assert {"accuracy", "noise", "max_steps", "seed", "prior_set", "processes", "exact_reweight", "fix"} <= found.keys()
    for name, (typed, python) in found.items():
        assert (typed, python) == IN_WORDS.get(name, (python, python)), name
    for verb in (plan_verb, calibrate_verb):
        for name in ("accuracy", "prior_set", "fix"):
            typed, python = faces(verb)[name]
            assert typed == python


def drawn(directory, seed):
    """Return the results of one run at the command line and of one in Python."""
    out = directory / str(seed)
    data, limits = directory / "ratings.csv", ("--max-steps", "2", "--processes", "1", "--no-figures")
    held = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]
    done = CliRunner().invoke(
        main, ["sample", "--data", str(data), *held, *limits, "--seed", str(seed), "--out", str(out)]
    )
    assert done.exit_code == 3, done.output
    return Result.load(out), sample(read_experiment(data), fix=HELD, max_steps=2, processes=1, seed=seed)


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """Runs of one seed from both faces, and how often the direction was looked for in them."""
    directory = tmp_path_factory.mktemp("faces")
    few_ratings(directory)
    asked, choose = [], building.choose_direction
    with quickly(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(building, "choose_direction", lambda *given: asked.append(1) or choose(*given))
        found = drawn(directory, 7)
    return found, len(asked)


def test_both_faces_draw_the_same(pairs):
    """Another seed gives other draws, as `test_run` shows."""
    one, other = pairs[0]
    for group in one.tree.children:
        assert one.tree[group].identical(other.tree[group]), group
    for name in ("discretisation", "accuracy", "direction", "direction_note", "direction_asked"):
        assert one.attributes[name] == other.attributes[name], name
    assert one.attributes["accuracy"] == ModelOptions().accuracy
    assert one.attributes["discretisation"] != str(Discretisation())
    command, python = (json.loads(result.attributes["options"]) for result in (one, other))
    assert command.pop("command")
    assert python.pop("command") == ""
    assert command == python


def test_the_direction_is_looked_for_once_in_a_run(pairs):
    found, looked = pairs
    assert looked == len(found)


def test_an_unknown_option_is_refused():
    with pytest.raises(TypeError, match=r"no option 'max_step'; expected one of fix, priors, .*max_steps"):
        Request().with_options(max_step=3)


def test_single_options_go_where_they_belong():
    asked = Request(ModelOptions(noise=1.0), RunOptions(seed=2)).with_options(fix={"m": 2.0}, max_steps=5)
    assert asked == (ModelOptions(noise=1.0, fix={"m": 2.0}), RunOptions(seed=2, max_steps=5))


BEFORE = """{"fix": {"m": 2.0}, "priors": {"b": "lognormal(100,0.5)"}, "readings": {"fabric_modulus": "printed",
"skin_displacement": "printed", "pressure": "attenuated", "stress_kernel": "line", "stress_component": "vertical",
"membrane": "connor-stevens", "receptor_density": "consistent"}, "direction": "rises-with-firing",
"scale": "magnitude", "discretisation": {"nodes": 8, "saturation": 9.0, "field_tolerance": 0.0001, "rate_nodes": 18},
"direction_decided": true, "prior_set": "default", "accuracy": 0.001, "noise": 0.0,
"exact_reweight": false, "max_steps": 60, "max_seconds": Infinity, "min_steps": 0, "processes": null, "seed": 4,
"command": "softness-bayes sample"}"""
"""What a run recorded before the options of model and run were told apart."""


def test_records_of_earlier_runs_read_and_come_out_as_they_were():
    record = json.loads(BEFORE)
    model, run = Request.from_record(record)
    assert model.discretisation == Discretisation(8, 9.0, 1e-4, 18)
    assert (model.kept_accuracy, model.decided) == (1e-3, {"direction", "discretisation"})
    assert (run.seed, run.max_steps, run.command) == (4, 60, "softness-bayes sample")
    assert json.loads(json.dumps(Request(model, run).record())) == record
    given = Request.from_record({**record, "accuracy": None, "direction": None, "direction_decided": False})
    assert given.model.kept_accuracy is None
    assert given.record() == {**record, "accuracy": None, "direction": None, "direction_decided": False}
