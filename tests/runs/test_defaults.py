"""One set of defaults: the command line's options are those of the dataclasses, and both faces draw the same."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from softness_bayes import read_experiment, sample
from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal
from softness_bayes.cli import main
from softness_bayes.cli.options import command
from softness_bayes.likelihood.error_laws import LAPSES
from softness_bayes.likelihood.scales import FALLS, SLIDER
from softness_bayes.model import build as building
from softness_bayes.model.fingers import finger_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import DataFiles, Request, RunOptions
from softness_bayes.touch.readings import CLASSICAL
from softness_bayes.touch.scene import Discretisation
from support.command_line import HELD, few_ratings
from support.report_runs import quickly

EVERY = (ModelOptions, RunOptions, DataFiles)

OTHERS: dict[str, object] = {
    "fix": {"m": 2.0},
    "priors": {"b": LogNormal(100.0, 0.5)},
    "prior_set": "in-vivo",
    "readings": CLASSICAL.override({"membrane": "printed"}),
    "direction": FALLS,
    "finger": finger_of({"receptor_depth_mm": 0.6, "radius_mm": 7.0}),
    "modulus_cv": 0.15,
    "shared_modulus_cv": 0.125,
    "unknown_modulus": LogNormal(50.0, 1.0),
    "load_cv": 0.05,
    "shared_load_cv": 1 / 30,
    "shared": ("b", "m"),
    "individual": ("b", "sigma_0"),
    "errors": LAPSES,
    "resolution": 0.5,
    "slider_ends": (0.0, 100.0),
    "n_categories": 7,
    "guess": 0.25,
    "accuracy": 2e-4,
    "scale": SLIDER,
    "noise": 0.25,
    "exact_reweight": True,
    "drift": True,
    "max_steps": 123,
    "quick": True,
    "max_seconds": 90.0,
    "processes": 3,
    "steps_per_tau": 30.0,
    "seed": 99,
    "data": Path("r.csv"),
    "compression": Path("c.csv"),
    "afferents": Path("n.csv"),
    "fabrics": Path("f.csv"),
    "columns": {"rating": "softness"},
    "decimal": {"ratings": ",", "fabrics": "."},
    "indentation_mm": 2.0,
    "force_n": 1.5,
    "load": "free",
    "round_load": 0.05,
    "drop_zeros": True,
    "wide": True,
}
"""For every option that the command line has, a value that is not its default."""

FLAGGED = [(kind, name) for kind in EVERY for name, one in kind.declared.items() if one.flag]


def typed(kind, *words):
    """Return the options of a class that a command with these words receives."""
    received = []

    def receive(*, it: kind) -> None:
        """Receive."""
        received.append(it)

    command(receive).main([*words], standalone_mode=False)
    return received[0]


@pytest.mark.parametrize("kind", EVERY)
def test_a_command_without_options_has_the_defaults_of_python(kind):
    assert typed(kind) == kind()
    assert OTHERS.keys() == {name for _, name in FLAGGED}


@pytest.mark.parametrize(("kind", "name"), FLAGGED, ids=[name for _, name in FLAGGED])
def test_an_option_is_the_same_in_python_on_the_command_line_and_in_a_record(kind, name):
    """What is written is read back, so that the command which repeats a run is that of the run."""
    options = kind(**{name: OTHERS[name]})
    assert options != kind()
    assert typed(kind, *options.words()) == options
    assert kind.from_record(json.loads(json.dumps(options.record()))) == options
    assert options.changed().keys() == {name}
    assert name in kind.__doc__


@pytest.mark.parametrize("kind", EVERY)
def test_a_record_that_lacks_an_option_or_has_an_unknown_one_is_refused(kind):
    record = kind().record()
    first = next(iter(record))
    for wrong in (record | {"colour": 1}, {name: value for name, value in record.items() if name != first}):
        with pytest.raises(InputError, match="options of a run that this version cannot read"):
            kind.from_record(wrong)


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
    asked, choose = [], building.evidence_of
    with quickly(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(building, "evidence_of", lambda *given: asked.append(1) or choose(*given))
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


def test_an_unknown_option_is_refused():
    with pytest.raises(TypeError, match=r"no option 'max_step'; expected one of fix, priors, .*max_steps"):
        Request(ModelOptions(), RunOptions()).with_options(max_step=3)


def test_single_options_go_where_they_belong():
    asked = Request(ModelOptions(noise=1.0), RunOptions(seed=2)).with_options(fix={"m": 2.0}, max_steps=5)
    assert asked == (ModelOptions(noise=1.0, fix={"m": 2.0}), RunOptions(seed=2, max_steps=5))
