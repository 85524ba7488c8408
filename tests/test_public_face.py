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
    "a radius in words": (lambda: sb.Finger("8"), r"finger: radius: expected numbers in m"),
    "one fabric's name": (lambda: sb.Fabrics("felt", effective_modulus=3.0), r"fabrics: names: expected a sequence"),
    "a fabric's modulus": (lambda: sb.Fabrics(("felt",), effective_modulus="soft"), r"effective_modulus: expected num"),
    "a path as experiment": (lambda: sb.sample("ratings.csv"), r"data: expected an Experiment, as read_exp"),
    "a dictionary as model": (lambda: sb.sample(experiment(), {"fix": {}}), r"model: expected ModelOptions, such as"),
    "a dictionary as run": (lambda: sb.sample(experiment(), run={"seed": 1}), r"run: expected RunOptions, such as"),
    "a list of fixed": (lambda: sb.ModelOptions(fix=["b"]), r"fix: expected a mapping from names to numbers"),
    "a fixed word": (lambda: sb.parameter_space(fix={"b": "80"}), r"b is '80', expected a number"),
    "readings of options": (lambda: sb.ModelOptions(readings="printed"), r"readings: expected Readings, such as NAMED"),
    "direction": (lambda: sb.ModelOptions(direction="rises"), r"direction: expected RISES, FALLS, FREE or None"),
    "scale": (lambda: sb.ModelOptions(scale="slider"), r"scale: expected a Scale, such as SLIDER"),
    "errors": (lambda: sb.ModelOptions(errors="student"), r"errors: expected NORMAL, STUDENT, LAPSES or None"),
    "finger": (lambda: sb.ModelOptions(finger=8e-3), r"finger: expected a Finger, such as Finger\("),
    "individual": (lambda: sb.ModelOptions(individual="b"), r"individual: expected a tuple of names, such as \('b',\)"),
    "modulus_cv": (lambda: sb.ModelOptions(modulus_cv="10%"), r"modulus_cv is '10%', expected"),
    "accuracy": (lambda: sb.ModelOptions(accuracy="high"), r"accuracy is 'high', expected a number from 1e-06"),
    "noise": (lambda: sb.ModelOptions(noise="none"), r"noise is 'none', expected a number from 0"),
    "slider": (lambda: sb.ModelOptions(slider_ends=3), r"slider_ends: expected two numbers"),
    "discretisation": (lambda: sb.ModelOptions(discretisation=1e-3), r"discretisation: expected a Discretisation"),
    "steps": (lambda: sb.RunOptions(max_steps="many"), r"max_steps is 'many', expected a whole number from 1"),
    "half a step": (lambda: sb.RunOptions(min_steps=1.5), r"min_steps is 1.5, expected a whole number from 0"),
    "seed": (lambda: sb.RunOptions(seed="a"), r"seed is 'a', expected a whole number from 0"),
    "processes": (lambda: sb.RunOptions(processes="all"), r"processes is 'all', expected a whole number from 1"),
    "seconds": (lambda: sb.RunOptions(max_seconds="10m"), r"max_seconds: expected a number of seconds"),
    "a table that is a number": (lambda: sb.read_experiment(3), r"expected the path of a table or a pandas DataFrame"),
    "columns": (lambda: sb.read_experiment("x.csv", columns=["rating"]), r"columns: expected a mapping, as in"),
    "a result's place": (lambda: sb.Result.load(3), r"directory: expected a path, got 3 \(int\)"),
    "loads of a simulation": (lambda: sb.simulate_ratings(RNG, CLOTH, [2e-3], values()), r"loads: expected Inden"),
    "a seed as generator": (lambda: sb.simulate_ratings(3, CLOTH, ONE, values()), r"rng: expected a generator"),
    "values of a simulation": (lambda: sb.simulate_ratings(RNG, CLOTH, ONE, [1, 2]), r"values: expected a mapping"),
    "fabrics of a simulation": (lambda: sb.simulate_ratings(RNG, "felt", ONE, values()), r"fabrics: expected Fabrics"),
    "a generator of forces": (lambda: sb.simulate_compression(3, values()), r"rng: expected a generator"),
    "values of forces": (
        lambda: sb.simulate_compression(RNG, values()),
        r"values: no tau_b, expected all that usual_v",
    ),
    "a load of a contact": (lambda: sb.solve_contact(1e5, 0.3, 2e-3, 1e5, 2.0), r"load: expected Indentation"),
    "a list of parameters": (lambda: sb.touch_parameters([80]), r"values: expected a mapping, as in usual_values"),
    "too few parameters": (lambda: sb.touch_parameters({"b": 80}), r"values: no m, expected all that usual_values"),
    "readings of values": (lambda: sb.usual_values("printed"), r"readings: expected Readings, such as Readings\(\)"),
    "a current in words": (lambda: sb.firing_rate("10"), r"current: expected numbers, got '10' \(str\)"),
    "channels": (lambda: sb.rheobase(3), r"channels: expected Channels, as in PAPER_CHANNELS"),
    "channels of a curve": (lambda: sb.FixedChannels(3), r"channels: expected Channels, as in PAPER_CHANNELS"),
    "a place in words": (lambda: sb.stress("a", 1e5, 1e-3), r"rho: expected numbers, got 'a'"),
    "a median in words": (lambda: sb.LogNormal("a", 1), r"lognormal: median is a, expected"),
    "no scale": (lambda: sb.HalfNormal(None), r"halfnormal: scale is None, expected"),
    "a prior that is a number": (lambda: sb.parameter_space(priors={"b": 3}), r"prior of b: 3 has no 'median'"),
    "a list of results": (lambda: sb.compare([None, None]), r"results: expected a mapping, as in \{'hertz': result"),
    "results by place": (
        lambda: sb.compare({"a": "x", "b": "y"}),
        r"results: a: expected a Result, as returned by sample",
    ),
    "readings of claims": (lambda: sb.evaluate_claims("mended"), r"readings: expected a mapping"),
    "draws of claims": (lambda: sb.evaluate_claims(draws="x"), r"number of draws is 'x', expected a whole number"),
    "ratings to build": (lambda: sb.build(experiment().ratings), r"experiment: expected an Experiment"),
    "ratings to sample": (lambda: sb.sample(experiment().ratings), r"data: expected an Experiment"),
    "readings to override": (lambda: sb.Readings().override("hertz"), r"readings: expected a mapping, as in"),
    "a reading by name": (lambda: sb.Readings(pressure="hertz"), r"pressure is 'hertz', expected a Pressure of"),
    "a style's place": (lambda: sb.Style.read(3), r"path: expected a path, got 3"),
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
