"""A user's own readings, prior laws and figures pass through whole runs; what cannot is refused before they begin."""

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint

import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.priors import parse_prior
from softness_bayes.report.tables import repetition
from softness_bayes.results.result import Result
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.run import sample
from softness_bayes.sampler import sampling
from softness_bayes.touch.readings import Readings, alternative
from softness_bayes.touch.stress import HERTZ
from support import own_values
from support.command_line import call, few_ratings, refused
from support.own_values import LEAKY, MILD, Gamma
from support.report_runs import OPTIONS, experiment, quickly

OWN = "support.own_values"
NAMED = {"pressure": f"{OWN}:MILD", "stress_kernel": f"{OWN}:OWN_LINE"}


def inner(*numbers):
    class Inner(Gamma):
        pass

    return Inner(*numbers)


FREE = {name: value for name, value in OPTIONS["fix"].items() if name != "m"}


@pytest.fixture(scope="module")
def own_run(tmp_path_factory):
    """A run in Python with one's own pressure, kernel and priors, which is kept and saved."""
    out = tmp_path_factory.mktemp("own") / "out"
    asked = ModelOptions(
        readings=Readings(pressure=MILD, stress_kernel=own_values.OWN_LINE),
        priors={"m": Gamma(4, 2), "b": "lognormal(80,0.4)"},
    )
    assert asked.priors["b"] == LogNormal(80, 0.4)
    with quickly(), Checkpoint.create(out) as checkpoint:
        sample(experiment(), asked, checkpoint=checkpoint, **OPTIONS | {"fix": FREE, "max_steps": 4}).save(out)
    return out


def test_a_run_with_values_of_ones_own_is_saved_and_read(own_run):
    result = Result.load(own_run)
    assert (result.readings.pressure, result.readings.stress_kernel) == (MILD, own_values.OWN_LINE)
    assert result.provenance.priors["m"] == Gamma(4, 2)
    assert NAMED["pressure"] in result.readings.label
    assert len(result.plot(own_values.b_sorted).axes) == 1
    with pytest.raises(InputError, match=r"\(custom\) fails: KeyError: 'nothing'"):
        result.plot(own_values.failing)
    with pytest.raises(InputError, match="expected a Drawing, or a function"):
        result.plot(f"{OWN}:NOT_A_FIGURE")
    (again,) = repetition(result).commands
    assert f"--reading pressure={NAMED['pressure']}" in again
    assert f"--prior 'm={OWN}:Gamma(4,2)'" in again


def test_later_commands_take_values_of_ones_own(own_run, few_pictures):
    with quickly():
        fabrics = own_run.parent / "fabrics.csv"
        fabrics.write_text("fabric,effective_modulus_kpa\nfelt,30\n")
        done = call("predict", "--posterior", own_run, "--fabrics", fabrics, "--force-n", "1")
        assert done.returncode == 0, done.stderr
        assert NAMED["pressure"] in done.stdout
        page = own_run.parent / "page.html"
        done = call("report", own_run, "--out", page, "--figure", f"{OWN}:b_sorted")
        assert done.returncode == 0, done.stderr
        assert "Skin modulus in the order of its draws" in page.read_text(encoding="utf-8")


def test_a_run_with_values_of_ones_own_is_continued(own_run):
    asked = ModelOptions(readings=Result.load(own_run).readings, priors={"m": Gamma(4, 2), "b": "lognormal(80,0.4)"})
    options = OPTIONS | {"fix": FREE, "max_steps": 6}
    with quickly(), Checkpoint.open(own_run) as checkpoint:
        assert sample(experiment(), asked, checkpoint=checkpoint, **options).provenance.ending.steps == 6
    other = replace(asked, priors={**asked.priors, "m": Gamma(4, 3)})
    with quickly(), Checkpoint.open(own_run) as checkpoint, pytest.raises(InputError, match="prior of m"):
        sample(experiment(), other, checkpoint=checkpoint, **options)


@pytest.fixture(scope="module")
def modelled_run(tmp_path_factory):
    """A run on an observation model of one's own."""
    out = tmp_path_factory.mktemp("modelled") / "out"
    held = {name: value for name, value in OPTIONS["fix"].items() if name not in ("tau", "eps")}
    options = OPTIONS | {"fix": held, "max_steps": 4, "scale": own_values.AGREEMENT}
    with quickly():
        sample(experiment(standardised=True), **options).save(out)
    return out


def test_an_observation_model_of_ones_own_passes_through_later_commands(modelled_run):
    result = Result.load(modelled_run)
    assert result.scale == own_values.AGREEMENT
    fabrics = modelled_run.parent / "fabrics.csv"
    fabrics.write_text("fabric,effective_modulus_kpa\nfelt,30\n")
    done = call("predict", "--posterior", modelled_run, "--fabrics", fabrics, "--force-n", "1")
    assert done.returncode == 0, done.stderr
    assert "typical_rating" in done.stdout
    assert f"--ratings {OWN}:AGREEMENT" in repetition(result).commands[0]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"readings": Readings(pressure=replace(HERTZ, name="other"))}, r"pressure 'other' cannot be stored"),
        ({"priors": {"b": own_values.Unnormalised(4, 0.05)}}, r"integrates to 2\.17\d* between quantiles"),
        ({"priors": {"b": 80}}, r"prior of b: 80 has no 'median', expected a prior, such as"),
        ({"priors": {"b": inner(4, 0.05)}}, "define it at the top of a module"),
        ({"priors": [("b", "lognormal(80,0.3)")]}, r"priors: .*expected a mapping"),
        ({"priors": {"b": "lognormal(80;0.3)"}}, r"expected lognormal\(median, sd_log, \[bound\]\) with numbers"),
        ({"scale": own_values.NOT_A_MODEL}, r"the model of nothing has no 'scale', expected all that"),
        ({"scale": own_values.LACKING}, r"the model of lacking: typical fails: ZeroDivisionError: no idea"),
        ({"scale": replace(own_values.AGREEMENT, model=None)}, r"the scale 'agreement' has no 'model' of its own"),
        ({"scale": own_values.AGREEMENT, "resolution": 1.0}, r"defines its own numbers and errors"),
        ({"readings": Readings(membrane=LEAKY)}, r"channel multipliers cannot be sampled with the membrane leaky"),
    ],
)
def test_what_cannot_pass_is_refused_before_the_first_step(options, told, monkeypatch):
    monkeypatch.setattr(sampling, "walk", lambda *_: pytest.fail("the run has begun"))
    free = {name: value for name, value in OPTIONS.items() if name != "fix"}
    with pytest.raises(InputError, match=told), quickly():
        sample(experiment("scale" in options), **{**free, **options})


def test_what_cannot_draw_a_figure_is_refused_before_the_first_step(tmp_path):
    few_ratings(tmp_path)
    typed = ["sample", "--data", tmp_path / "ratings.csv", "--out", tmp_path / "out", "--figure"]
    refused(
        call(*typed, f"{OWN}:MILD"), "takes (r: 'ArrayLike', reduced_modulus:", "expected a function (result, style)"
    )
    refused(call(*typed, f"{OWN}:agreement_model"), "takes (direction), expected a function (result, style)")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("pressure=support.own_values:SEVERE", "has no 'SEVERE'"),
        ("pressure=no_such_module:MILD", "there is no module 'no_such_module'"),
        ("pressure=support.own_values:OWN_LINE", "expected a Pressure"),
        ("pressure=hertzz", "or MODULE:NAME for a custom reading"),
    ],
)
def test_readings_that_cannot_be_imported_are_named(given, told, tmp_path):
    few_ratings(tmp_path)
    refused(call("sample", "--data", tmp_path / "ratings.csv", "--reading", given, cwd=tmp_path), told)
    assert not (tmp_path / "results").exists()


def test_entry_points_of_installed_packages_have_short_names(monkeypatch):
    points = {
        "pressure": {"mild": EntryPoint("mild", f"{OWN}:MILD", "softness_bayes.pressure")},
        "priors": {"gamma": EntryPoint("gamma", f"{OWN}:Gamma", "softness_bayes.priors")},
        "figures": {"skin": EntryPoint("skin", f"{OWN}:b_sorted", "softness_bayes.figures")},
    }
    for module in list(sys.modules.values()):
        if getattr(module, "__name__", "").startswith("softness_bayes") and "installed" in vars(module):
            monkeypatch.setattr(module, "installed", lambda group: points.get(group, {}))
    assert alternative("pressure", "mild") == MILD
    # results name the value itself, which stays when the package names it anew
    assert Readings(pressure=MILD).names["pressure"] == f"{OWN}:MILD"
    assert str(parse_prior("gamma(4,0.05)")) == f"{OWN}:Gamma(4,0.05)"
    assert "mild" in call("list", "readings", "pressure").stdout
    assert "skin" in call("list", "figures").stdout
    assert "gamma" in call("list", "priors").stdout
