"""Every reading of every place answers to the same contract, alone and in the named sets."""

from __future__ import annotations

import itertools
from dataclasses import fields

import numpy as np
import pytest

from oracles.reference import reference_response
from softness_bayes.base.errors import InputError
from softness_bayes.model.scenes import touch_parameters, usual_values
from softness_bayes.touch.contact import Finger, Force, Indentation, solve_contact
from softness_bayes.touch.readings import ALTERNATIVES, MENDED, NAMED_READINGS, Readings
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.stress import stress

PLACES = [field.name for field in fields(Readings)]
SINGLE = [
    MENDED.override({place: name})
    for place, names in ALTERNATIVES.items()
    for name in names
    # a scene takes its firing from outside: membranes have a contract of their own
    if place != "membrane" and MENDED.names[place] != name
]
EVERY = list(dict.fromkeys([*NAMED_READINGS.values(), *SINGLE]))
FABRICS = np.array([2e3, 6e4, 3e5, 1e6])
LOADS = (Indentation(1.5e-3), Force(1.0))


def label(readings):
    return readings.label.replace(", ", "-")


@pytest.fixture(scope="module", params=EVERY, ids=label)
def scene(request, smooth_firing):
    return Scene(FABRICS, 0.3, LOADS, smooth_firing(), readings=request.param)


@pytest.fixture
def parameters(scene):
    return touch_parameters(usual_values(scene.readings, given={"sigma_0": 6.0}))


def drawn(parameters, rng):
    """A draw about a point: twice or half the skin, a half more or less of the transduction."""
    spread = {"b": 0.5, "m": 0.2, "beta": 0.3, "sigma_0": 0.3, "alpha": 0.05}
    return parameters._replace(
        **{name: getattr(parameters, name) * np.exp(sd * rng.normal()) for name, sd in spread.items()}
    )


# the tables


def test_a_place_for_every_field_and_the_default_first():
    assert [*ALTERNATIVES] == PLACES
    for place, names in ALTERNATIVES.items():
        assert next(iter(names.values())) is getattr(Readings(), place)
        assert all(value.name == name for name, value in names.items())
        assert len({id(value) for value in names.values()}) == len(names) > 1


def test_every_combination_composes_or_says_why():
    refused = 0
    for choice in itertools.product(*ALTERNATIVES.values()):
        chosen = dict(zip(ALTERNATIVES, choice, strict=True))
        if chosen["stress_kernel"] == "axisymmetric" and chosen["stress_component"] == "principal":
            with pytest.raises(InputError, match="axisymmetric"):
                MENDED.override(chosen)
            refused += 1
        else:
            assert MENDED.override(chosen).names == chosen
    assert refused == 2 * 2 * 3 * 3 * 2


# every reading, in a scene


def test_response_by_adaptive_integration(scene, parameters, rng):
    one = drawn(parameters, rng)
    found, exact = scene.respond(one), reference_response(scene, one, scene.firing.curve, rtol=1e-6)
    np.testing.assert_allclose(found.total_rate, exact.total_rate, atol=2e-4 * max(exact.total_rate.max(), 1))
    np.testing.assert_allclose(found.peak_stress, exact.peak_stress, rtol=1e-5)


def test_transduction_is_monotone(scene, parameters):
    """More current, or a lower threshold, never makes a receptor fire less, whatever it is pressed by."""
    for name, values in (("alpha", np.linspace(17, 30, 14)), ("sigma_0", np.geomspace(2e4, 1e3, 14))):
        rate = scene.total_rate(parameters._replace(**{name: values}))
        assert (np.diff(rate, axis=0) >= -2e-4 * rate.max()).all(), name
        assert rate[-1].max() > rate[0].max(), name


@pytest.mark.parametrize("readings", EVERY, ids=label)
@pytest.mark.parametrize("load", LOADS, ids=str)
def test_rigid_and_limp_fabrics(readings, load):
    """Past any skin a fabric's modulus no longer counts; a fabric of no modulus is all there is to E_star."""
    values = touch_parameters(usual_values(readings))
    fabric = np.array([1e-2, 1.0, 1e12, 1e14])
    found = solve_contact(fabric, 0.3, load, values.b, values.m, displacement=readings.skin_displacement)
    laws = readings.pressure, readings.stress_kernel, readings.stress_component
    peak = stress(0.0, found.reduced_modulus, found.radius, Finger(), *laws)
    assert (peak > 0).all()
    assert peak[2] == pytest.approx(peak[3], rel=1e-5)
    np.testing.assert_allclose(found.reduced_modulus[:2], fabric[:2] / (1 - 0.3**2), rtol=1e-4)
    if isinstance(load, Indentation):  # proportional to E_star, while the pressure is too weak to be attenuated
        assert peak[1] / peak[0] == pytest.approx(100, rel=1e-3)


def test_stress_has_the_units_of_a_modulus(scene, parameters):
    """Where the pressure has no force of its own (its decay is 0), and only there, ratios of stresses are all."""
    factor = 3.7
    other = Scene(factor * FABRICS, 0.3, LOADS[:1], scene.firing, readings=scene.readings)
    scaled = parameters._replace(
        b=factor * parameters.b, sigma_0=factor * parameters.sigma_0, beta=parameters.beta / factor
    )
    rate = scene.take(np.arange(FABRICS.size)).total_rate(parameters)
    difference = np.abs(other.total_rate(scaled) - rate).max() / rate.max()
    assert difference < 2e-4 if scene.readings.pressure.name == "hertz" else difference > 2e-2
