"""Wrong kinds of arguments at the public face are named, with what was expected."""

import re

import numpy as np
import pytest
import xarray as xr

import softness_bayes as sb
from support.report_runs import CLOTH, experiment

RNG, ONE = np.random.default_rng(1), [sb.Force(1.0)]


def scene(**changed):
    given = {"fabric_modulus": [1e5], "fabric_poisson": 0.3, "loads": ONE, "firing": None} | changed
    return sb.Scene(**given)


def values():
    return sb.usual_values(sb.Readings())


WRONG = {
    "a load that is a number": (lambda: scene(loads=[2e-3]), r"loads: expected Indentation\(depth \[m\]\) or Force\("),
    "one load": (lambda: scene(loads=sb.Force(1)), r"loads: expected a sequence of Indentation"),
    "no firing": (scene, r"firing: expected a source of rate curves, such as FixedChannels\(\), got None"),
    "a finger that is a number": (lambda: scene(firing=Curves(), finger=8e-3), r"finger: expected a Finger"),
    "readings by name": (lambda: scene(firing=Curves(), readings="printed"), r"readings: expected Readings"),
    "a modulus in words": (
        lambda: scene(firing=Curves(), fabric_modulus=["soft"]),
        r"fabric_modulus: expected numbers",
    ),
    "a force in words": (lambda: sb.Force("1 N"), r"force is '1 N', expected a number from 1e-09 to 1000 N"),
    "no indentation": (lambda: sb.Indentation(None), r"indentation is None, expected a number from"),
    "a path as experiment": (lambda: sb.sample("ratings.csv"), r"data: expected an Experiment, as read_exp"),
    "a dictionary as model": (lambda: sb.sample(experiment(), {"fix": {}}), r"model: expected ModelOptions, such as"),
    "a list of fixed": (lambda: sb.ModelOptions(fix=["b"]), r"fix: expected a mapping from names to numbers"),
    "a fixed word": (lambda: sb.parameter_space(fix={"b": "80"}), r"b is '80', expected a number"),
    "direction": (lambda: sb.ModelOptions(direction="rises"), r"direction: expected RISES, FALLS, FREE or None"),
    "scale": (lambda: sb.ModelOptions(scale="slider"), r"scale: expected a Scale, such as SLIDER"),
    "modulus_cv": (lambda: sb.ModelOptions(modulus_cv="10%"), r"modulus_cv is '10%', expected"),
    "slider": (lambda: sb.ModelOptions(slider_ends=3), r"slider_ends: expected two numbers"),
    "discretisation": (lambda: sb.ModelOptions(discretisation=1e-3), r"discretisation: expected a Discretisation"),
    "steps": (lambda: sb.RunOptions(max_steps="many"), r"max_steps is 'many', expected a whole number from 1"),
    "seconds": (lambda: sb.RunOptions(max_seconds="10m"), r"max_seconds: expected a number of seconds"),
    "a table that is a number": (lambda: sb.read_experiment(3), r"expected the path of a table or a pandas DataFrame"),
    "columns": (lambda: sb.read_experiment("x.csv", columns=["rating"]), r"columns: expected a mapping, as in"),
    "a result's place": (lambda: sb.Result.load(3), r"directory: expected a path, got 3 \(int\)"),
    "a seed as generator": (lambda: sb.simulate_ratings(3, CLOTH, ONE, values()), r"rng: expected a generator"),
    "values of forces": (
        lambda: sb.simulate_compression(RNG, values()),
        r"values: no tau_b, expected all that usual_v",
    ),
    "too few parameters": (lambda: sb.touch_parameters({"b": 80}), r"values: no m, expected all that usual_values"),
    "a current in words": (lambda: sb.firing_rate("10"), r"current: expected numbers, got '10' \(str\)"),
    "channels": (lambda: sb.rheobase(3), r"channels: expected Channels, as in PAPER_CHANNELS"),
    "a median in words": (lambda: sb.LogNormal("a", 1), r"lognormal: median is a, expected"),
    "a prior that is a number": (lambda: sb.parameter_space(priors={"b": 3}), r"prior of b: 3 has no 'median'"),
    "a list of results": (lambda: sb.compare([None, None]), r"results: expected a mapping, as in \{'hertz': result"),
    "readings of claims": (lambda: sb.evaluate_claims("mended"), r"readings: expected a mapping"),
    "draws of claims": (lambda: sb.evaluate_claims(draws="x"), r"number of draws is 'x', expected a whole number"),
    "readings to override": (lambda: sb.Readings().override("hertz"), r"readings: expected a mapping, as in"),
    "a reading by name": (lambda: sb.Readings(pressure="hertz"), r"pressure is 'hertz', expected a Pressure of"),
}


class Curves:
    """A source of rate curves that is never asked."""

    curves = None


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_kind_is_named_with_what_was_expected(case):
    call, told = WRONG[case]
    with pytest.raises(sb.InputError) as refused:
        call()
    assert re.search(told, str(refused.value)), str(refused.value)


def test_wrong_kinds_in_questions_to_a_result_are_named(report_run):
    result = report_run("ratings")
    wrong = {
        "loads: expected Indentation": lambda: result.predict(loads=[2e-3]),
        "loads: expected a sequence": lambda: result.predict(loads=sb.Force(1)),
        "fabrics: expected Fabrics": lambda: result.rank(fabrics=["felt"]),
        "rating: expected a number": lambda: result.target("soft"),
        "loads: expected Indentation(": lambda: result.target(40, loads=[1]),
        "style: expected a Style": lambda: result.plot.prior(style="big"),
        "figure is 3, expected a Drawing": lambda: result.plot(3),
    }
    for told, call in wrong.items():
        with pytest.raises(sb.InputError, match=re.escape(told)):
            call()


def test_no_variable_of_a_result_hides_a_method_of_xarray(report_run):
    for name, group in report_run("ratings").tree.children.items():
        assert not hasattr(xr.DataTree, name)
        for variable in group.data_vars:
            assert not hasattr(xr.Dataset, str(variable)), f"{name}/{variable}"
