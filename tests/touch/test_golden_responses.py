"""Responses of a dozen scenes, kept from adaptive integration over the pad (`reference_response`, tolerance 1e-9).

The numbers were made once by the program that this one replaced, with exact rate curves of the scene's own firing.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softness_bayes.touch.accuracy import PRESETS
from softness_bayes.touch.contact import Finger, FingerBox, Force, Indentation
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, HODGKIN_HUXLEY
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import NAMED_READINGS, Readings, readings_named
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.stress import Pressure, hertz_force

KEPT = json.loads((Path(__file__).parent / "golden_responses.json").read_text())
MODULI, POISSON = np.geomspace(1e3, 5e6, 12), np.linspace(0.2, 0.4, 12)
BOX = FingerBox((5e-3, 12e-3), (0.5e-3, 0.9e-3))
USER = Pressure(
    "user",
    lambda modulus, a, finger: 2.0 * modulus * a / (np.pi * finger.radius),
    lambda modulus, a, finger: np.log1p(hertz_force(modulus, a, finger) * a / 2e-3),
)
PRINCIPAL = readings_named("mended", {"stress_component": "principal", "skin_displacement": "displacement"})


def depths(*millimetres):
    return [Indentation(1e-3 * depth) for depth in millimetres]


def forces(*newtons):
    return [Force(newton) for newton in newtons]


CASES = {
    "main": {"loads": depths(1, 2, 3)},
    "free": {"loads": depths(1, 2, 3), "surface": CONNOR_STEVENS},
    "forces": {"loads": forces(0.3, 1, 2)},
    "mixed": {"loads": depths(0.5, 2) + forces(0.5, 5)},
    "hertz": {"loads": [*depths(1, 3), Force(1)], "readings": NAMED_READINGS["hertz"]},
    "lineprincipal": {"loads": [*depths(1, 2), Force(0.5)], "readings": PRINCIPAL},
    "printedstress": {
        "loads": [*depths(1, 2), Force(1)],
        "readings": replace(NAMED_READINGS["printed"], membrane=CONNOR_STEVENS),
    },
    "hh": {
        "loads": depths(1, 3),
        "readings": readings_named("mended", {"membrane": "hodgkin-huxley"}),
        "surface": HODGKIN_HUXLEY,
    },
    "fingI": {"loads": depths(1, 2, 3), "finger_box": BOX},
    "fingF": {"loads": forces(0.3, 1, 2), "finger_box": BOX},
    "user": {"loads": [*forces(0.3, 1), Indentation(2e-3)], "readings": Readings(pressure=USER)},
    "shallow": {"loads": depths(1, 2, 3), "finger": Finger(receptor_depth=0.2e-3, contact_centre=(3e-3, 5e-3))},
}
SLOW = {"printedstress", "fingI", "fingF", "shallow", "lineprincipal", "mixed"}
WORST = {"printedstress": 3e-3, "hh": 1e-3}
"""Errors of the coarsest preset that exceed 5e-4 of the peak: the choice of an accuracy then takes a finer one."""


def scene_of(case, discretisation):
    given = dict(CASES[case])
    surface = given.pop("surface", None)
    firing = FixedChannels() if surface is None else FiringSurface.load(surface)
    return Scene(MODULI, POISSON, firing=firing, discretisation=discretisation, **given)


@pytest.mark.parametrize("case", [pytest.param(c, marks=[pytest.mark.slow] * (c in SLOW)) for c in CASES])
def test_responses_are_those_of_adaptive_integration(case):
    kept = KEPT[case]
    parameters = TouchParameters(**{name: np.array(values) for name, values in kept["parameters"].items()})
    exact = np.array(kept["total_rate"])
    peak = exact.max(axis=1, keepdims=True)
    assert (peak > 10).any()
    for preset, allowed in zip(PRESETS, (WORST.get(case, 5e-4), 5e-5), strict=False):
        found = scene_of(case, preset).total_rate(parameters)
        assert (np.abs(found - exact) <= allowed * np.maximum(peak, 1.0)).all()


def test_the_finest_preset_is_within_a_millionth():
    kept = KEPT["main"]
    parameters = TouchParameters(**{name: np.array(values) for name, values in kept["parameters"].items()})
    exact = np.array(kept["total_rate"])
    found = scene_of("main", PRESETS[2]).total_rate(parameters)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-6 * exact.max())
