"""The finger of a run: its named values, its way through options, draws, results and commands."""

from dataclasses import replace

import numpy as np
import pytest

from oracles.reference import reference_response
from softness_bayes import Compression, read_experiment
from softness_bayes.base.errors import InputError
from softness_bayes.model.build import build, forces_of
from softness_bayes.model.fingers import finger_of, values_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.result import Result
from softness_bayes.touch.contact import Finger
from softness_bayes.touch.scene import Discretisation
from support.command_line import HELD, call, few_ratings

SMALL = {"radius_mm": 7.5, "receptor_depth_mm": 0.55, "contact_x_mm": 11.0}
SMALLER = Finger(radius=7.5e-3, receptor_depth=0.55e-3, contact_centre=(11e-3, 10e-3))
RESOLVED = Discretisation()


def test_values_make_the_finger_they_name_and_no_others_change_it():
    assert finger_of({}) == Finger()
    assert finger_of(SMALL) == SMALLER
    assert values_of(Finger()) == {}
    assert values_of(SMALLER) == SMALL


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"depth": 0.7}, "no value 'depth' of a finger"),
        ({"radius_mm": 0.0}, "radius_mm is 0.0, expected a number from 1 to 100 mm"),
        ({"receptor_depth_mm": -0.1}, "receptor_depth_mm is -0.1"),
        ({"poisson_ratio": 0.6}, "poisson_ratio is 0.6"),
        ({"contact_x_mm": 31.0}, "contact_centre"),
        ({"pad_length_mm": 5.0}, "contact_centre"),
    ],
)
def test_what_is_no_finger_is_refused(values, said):
    with pytest.raises(InputError, match=said):
        finger_of(values)


def test_the_response_is_that_of_the_finger(tmp_path):
    """Against adaptive integration over the pad, which knows no table; the usual finger is the control."""
    few_ratings(tmp_path)
    experiment = read_experiment(tmp_path / "ratings.csv")
    options = ModelOptions(fix=HELD, discretisation=RESOLVED)
    usual, small = (build(experiment, replace(options, finger=finger)) for finger in (Finger(), SMALLER))
    assert small.scene.finger == SMALLER
    point = small.posterior.space.touch(small.posterior.space.median)
    found = small.scene.total_rate(point)
    exact = reference_response(small.scene, point, law=small.scene.firing.curve).total_rate
    np.testing.assert_allclose(found, exact, atol=1e-4 * exact.max())
    assert np.abs(usual.scene.total_rate(point) - exact).max() > 0.02 * exact.max()


def test_a_plate_presses_the_same_finger():
    """On skin that does not stiffen the force of a rigid plate grows with the root of the radius."""
    compression = Compression(("F1",), np.zeros(2, int), np.array([1e-3, 2e-3]), np.ones(2), np.arange(2))
    lines = [
        forces_of(compression, ModelOptions(finger=finger_of({"radius_mm": radius})))._line for radius in (8.0, 2.0)
    ]
    np.testing.assert_allclose(lines[0].offset - lines[1].offset, np.log(2.0))


def test_the_finger_goes_from_the_command_line_into_the_result_and_its_page(tmp_path, brief_pilot, few_pictures):
    few_ratings(tmp_path)
    held = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]
    asked = ["--data", tmp_path / "ratings.csv", *held, "--max-steps", "4", "--processes", "1", "--no-figures"]
    asked += ["--accuracy", "0.01"]
    chosen = [part for name, value in SMALL.items() for part in ("--finger", f"{name}={value}")]
    results = []
    for name, more in (("usual", []), ("small", chosen)):
        assert call("sample", *asked, *more, "--out", tmp_path / name).returncode == 3
        results.append(Result.load(tmp_path / name))
    usual, small = results
    assert (usual.finger, small.finger) == (Finger(), SMALLER)
    assert float(small.group("constant_data")["finger_radius_mm"]) == 7.5
    for name, text in (("usual", "--finger"), ("small", "--finger receptor_depth_mm=0.55")):
        call("report", tmp_path / name)
        page = (tmp_path / name / "report.html").read_text(encoding="utf-8")
        assert (text in page) == (name == "small")
    rates = [result.group("predictions")["total_rate"].values for result in results]
    assert not np.allclose(*rates, rtol=0.01)
    peak = [result.predict(result.fabrics, result.loads)["peak_stress_kpa"].to_numpy() for result in results]
    assert (peak[1] > peak[0]).all()  # shallower receptors feel more
