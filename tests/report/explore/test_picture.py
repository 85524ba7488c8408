"""Pictures of a state against the forward model and against the command that they show."""

from __future__ import annotations

import csv
import io
import shlex
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, LogNormal, Normal, Uniform
from softness_bayes.base.ranges import Range
from softness_bayes.data import Fabrics
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.prediction import OtherTouches
from softness_bayes.model.scenes import firing_of, touch_parameters, usual_values
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.report.charts import chart_data
from softness_bayes.report.explore.picture import picture
from softness_bayes.report.explore.subject import of_priors, of_run, span_of
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.result import Result
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED, NAMED_READINGS
from support.command_line import call
from support.report_runs import quickly

TOLERANCE = 5e-4
"""Relative difference of rates from the exact curve of held channels and the finer scene that `predict` may choose."""


def moved(subject, **values):
    start = subject.start
    return replace(start, values={**start.values, **values})


def repeated(command, folder):
    """Run the lines that a page shows; return the row of the prediction."""
    table, predict = map(shlex.split, command.splitlines())
    assert table[:2] == ["printf", "%s\\n"]
    assert table[-2] == ">"
    (folder / table[-1]).write_text("".join(f"{row}\n" for row in table[2:-2]))
    assert predict[0] == "softness-bayes"
    done = call(*predict[1:], cwd=folder)
    assert done.returncode == 0, done.stderr
    (row,) = csv.DictReader(io.StringIO(done.stdout))
    return row


def same(chosen, row, tolerance=TOLERANCE):
    for name, value in chosen.items():
        if name != "typical_rating":
            told = float(row[name]) if row[name] else np.nan
            assert_allclose(told, value, rtol=tolerance, err_msg=name)


# ranges


def test_spans_hold_the_central_98_percent_and_the_start():
    span = span_of(PARAMETERS["b"], 100.0)
    assert_allclose(np.log([span.low / 100, span.high / 100]), np.array([-1, 1]) * 0.5 * 2.3263, rtol=1e-4)
    assert (span.logarithmic, span.unit) == (True, "kPa")
    assert span.value(span.place(37.125)) == pytest.approx(37.125, rel=1e-4)
    assert span_of(PARAMETERS["b"], 1000.0).high == 1000.0
    assert span_of(replace(PARAMETERS["alpha"], range=Range(1e-6, 60.0), prior=LogNormal(50, 0.5)), 50.0).high == 60.0
    linear = span_of(replace(PARAMETERS["b"], prior=Uniform(10.0, 20.0)), 15.0)
    assert (linear.logarithmic, linear.low, linear.high) == (False, 10.1, 19.9)
    assert not span_of(replace(PARAMETERS["tau"], prior=HalfNormal(1)), 0.7).logarithmic


# the model


def test_the_curve_is_that_of_the_forward_model(of_medians):
    state = replace(moved(of_medians, b=60.0, sigma_0=7.0), load=1)
    found = picture(of_medians, state)
    parameters = touch_parameters(usual_values(MENDED, given={"b": 60.0, "sigma_0": 7.0}))
    exact = of_medians.curves.fired_by(firing_of(usual_values(MENDED), MENDED.membrane))
    rate = exact.total_rate(parameters).reshape(found.rate.shape)
    assert_allclose(found.rate, rate, atol=2e-4 * rate.max())
    # at the turning point the curve is highest
    top = found.modulus[found.rate[1].argmax()]
    assert found.turn[1] == pytest.approx(top, rel=0.06)
    assert f"turns over at E_fab = {found.turn[1]:.4g} kPa" in found.sentences[0]
    # the diamond is on the curve, but for the fabric's own Poisson ratio
    on_curve = np.interp(np.log(120.0), np.log(found.modulus), found.rate[1])
    assert found.chosen["total_rate_hz"] == pytest.approx(on_curve, rel=0.02)


def test_receptors_of_the_pad_sum_to_the_total_rate_on_average(of_medians):
    found = picture(of_medians, of_medians.start)
    expected = found.chosen["responding"]
    assert (found.receptors > 0).sum() == pytest.approx(expected, abs=5 * np.sqrt(expected))
    assert found.firing[0] == found.firing.max()
    assert found.stress[0] == pytest.approx(found.chosen["peak_stress_kpa"], rel=1e-3)


def test_a_modulus_of_its_own_is_where_the_curve_is(of_medians):
    state = replace(of_medians.start, fabric=None, modulus_kpa=float(picture(of_medians, of_medians.start).modulus[80]))
    found = picture(of_medians, state)
    assert found.chosen["total_rate_hz"] == pytest.approx(found.rate[state.load, 80], rel=1e-4)
    named = replace(of_medians.start, fabric=1)
    assert picture(of_medians, named).chosen["e_fab_kpa"] == 120.0


def test_silence_and_reach_are_said_in_words(of_medians):
    silent = picture(of_medians, replace(moved(of_medians, sigma_0=22.0), load=0, fabric=0))
    assert silent.chosen["total_rate_hz"] == 0
    assert any("No receptor fires under this fabric" in one for one in silent.sentences)
    assert "no receptor fires at any modulus" in silent.sentences[0] or "turn" in silent.sentences[0]
    dead = of_priors(of_medians.fabrics, (Indentation(2e-3),), ModelOptions(fix={"alpha": 5.0}))
    found = picture(dead, dead.start)
    assert found.sentences[0] == "Indentation 2 mm: no receptor fires at any modulus."
    assert not (found.receptors > 0).any()
    assert np.isnan(found.turn).all()
    deep = picture(of_medians, moved(of_medians))
    assert any("questionable" in one or "meaningless" in one for one in deep.sentences)
    fine = picture(of_medians, replace(moved(of_medians), load=0, fabric=2))
    assert len(fine.sentences) == 1  # no word of reach where there is none


# the command


@pytest.mark.parametrize(("load", "fabric"), [(0, 1), (2, None), (1, 0)])
def test_the_command_repeats_the_numbers(of_medians, tmp_path, load, fabric):
    state = replace(moved(of_medians, b=61.37, beta=0.71, sigma_0=6.2), load=load, fabric=fabric, modulus_kpa=217.3)
    found = picture(of_medians, state)
    row = repeated(found.command, tmp_path)
    same(found.chosen, row)
    assert row["fabric"] == ("explored" if fabric is None else of_medians.fabrics.names[fabric])
    # a control: of another state it does not
    with pytest.raises(AssertionError):
        same(picture(of_medians, moved(of_medians, b=80.0)).chosen, row)


def test_the_command_repeats_readings_and_fingers(tmp_path):
    """Channels that are held have their own rate curve, so that the numbers are those of `predict`."""
    held = {name: value for name, value in usual_values(MENDED).items() if name.startswith("c_")}
    hertz = replace(NAMED_READINGS["hertz"], membrane=MENDED.membrane)
    priors = {"receptor_depth": Normal(0.6, 0.05)}
    options = ModelOptions(readings=hertz, prior_set="in-vivo", priors=priors, fix=held)
    felt = Fabrics(("a 'felt'",), effective_modulus=np.array([5e4]))
    subject = of_priors(felt, (Indentation(2e-3),), options)
    assert [span.name for span in subject.spans] == ["b", "m", "alpha", "beta", "sigma_0", "receptor_depth"]
    found = picture(subject, moved(subject, receptor_depth=0.55, sigma_0=4.0))
    same(found.chosen, repeated(found.command, tmp_path), 2e-4)


def test_the_command_repeats_the_numbers_of_a_run(result, tmp_path):
    result.save(tmp_path / "run")
    with quickly():
        subject = of_run(Result.load(tmp_path / "run"))
        for state in (moved(subject, b=70.0), replace(subject.start, load=0, fabric=None, modulus_kpa=150.0)):
            found = picture(subject, state)
            row = repeated(found.command, tmp_path)
            same(found.chosen, row)
            # the same draws of the ratings' level
            assert float(row["typical_rating"]) == pytest.approx(found.chosen["typical_rating"], rel=1e-3)
        with pytest.raises(AssertionError):
            same(picture(subject, moved(subject, b=90.0)).chosen, row)


# runs


def test_a_run_brings_its_own(of_ratings, result):
    assert of_ratings.loads == result.loads
    assert of_ratings.fabrics.names == result.fabrics.names
    assert [span.name for span in of_ratings.spans] == ["b", "alpha", "sigma_0", "gamma"]
    for span in of_ratings.spans:
        draws = result.values(400)[span.name]
        assert span.start == pytest.approx(np.median(draws), rel=1e-4)
    assert of_ratings.rated.charts == chart_data(result)["e_fab"]
    found = picture(of_ratings, of_ratings.start)
    assert_allclose(found.modulus, result.curves().modulus / 1e3, rtol=1e-6)


def test_the_typical_rating_is_that_of_the_fit(of_ratings, result):
    """Against the level drawn anew, at the same point, many times."""
    state = moved(of_ratings, sigma_0=8.0, gamma=1.2)
    found = picture(of_ratings, state)
    fitted = Fitted(result, 400)
    values = of_ratings.values(state)
    theta = np.tile([values[name] for name in fitted.posterior.names], (400, 1))
    touches = OtherTouches(fitted.posterior, of_ratings.touches, None)
    ratings = touches.ratings(np.random.default_rng(3), theta).typical
    at = (of_ratings.touches.fabric == state.fabric) & (of_ratings.touches.load == state.load)
    spread = np.log(ratings[:, at]).std()
    assert np.log(found.chosen["typical_rating"]) == pytest.approx(np.log(np.median(ratings[:, at])), abs=0.3 * spread)
    # on the curve, which is that of the median Poisson ratio
    on_curve = np.interp(np.log(found.chosen["e_fab_kpa"]), np.log(found.modulus), found.rating[state.load])
    assert found.chosen["typical_rating"] == pytest.approx(on_curve, rel=1e-2)


def test_what_is_beyond_the_rated_moduli_is_said(of_ratings):
    assert "outside the rated range" in " ".join(
        picture(of_ratings, replace(of_ratings.start, fabric=None, modulus_kpa=3000.0)).sentences
    )
    assert "outside the rated range" not in " ".join(picture(of_ratings, replace(of_ratings.start, fabric=0)).sentences)


def test_a_run_without_ratings_is_refused(report_run):
    with pytest.raises(InputError, match="without ratings"):
        of_run(report_run("skin"))
