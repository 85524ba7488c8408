"""Tables of stress fields against direct integration, for single loads, many loads and fingers that vary."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from oracles.reference import reference_response
from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, FingerBox, Fingertips, Force, Indentation, Load, Loads, held
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.profiles import touch_profiles
from softness_bayes.touch.readings import ALTERNATIVES, Readings
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.stress import ATTENUATED, Pressure, stress
from softness_bayes.touch.stress_fields import StressFields
from softness_bayes.touch.stress_table import MANY_LOADS, StressTable, stress_tables

FINGER, RANGE = Finger(), (1e3, 1e7)
BOX = FingerBox((6.5e-3, 10e-3), (0.5e-3, 0.9e-3))
RADIUS = np.array([*np.repeat(BOX.radius, 2), 8e-3, 7.1e-3])
DEPTH = np.array([*np.tile(BOX.receptor_depth, 2), 0.7e-3, 0.83e-3])
FINGERS = Fingertips(RADIUS[:, None], DEPTH[:, None], FINGER.poisson_ratio)
LOADS = (Indentation(1e-3), Indentation(2.5e-3), Force(0.7))
MODULI = np.geomspace(2e4, 2e6, 5)
ENDS = {"force": (Force(0.3), Force(1.5)), "indentation": (Indentation(0.5e-3), Indentation(3e-3))}
READINGS = [
    Readings(pressure=pressure, stress_kernel=kernel, stress_component=component)
    for pressure in ALTERNATIVES["pressure"].values()
    for kernel in ALTERNATIVES["stress_kernel"].values()
    for component in ALTERNATIVES["stress_component"].values()
    if kernel.two_sided or not component.needs_plane
]
ODD = Pressure("odd", ATTENUATED.amplitude, lambda modulus, a, finger: np.log1p(modulus * a**2 / finger.receptor_depth))
"""A pressure whose decay under a force is no product."""


def reading_id(readings):
    return "-".join(readings.names[place] for place in ("pressure", "stress_kernel", "stress_component"))


def takes_long(load, readings):
    """The tables that need most nodes."""
    return readings.stress_kernel.name == "printed" and readings.stress_component.needs_plane


def errors(table, load, modulus, fingers=FINGER, loads=None):
    """Largest error of the stress that the table says is felt at a distance, against the peak; and of the peak."""
    rows = fingers.radius.size if isinstance(fingers, Fingertips) else 1
    modulus = np.broadcast_to(modulus, (rows, np.size(modulus)))
    radius = np.broadcast_to(Loads(load).radius(modulus, fingers), modulus.shape)
    fields = StressFields({load: table}, [load] * modulus.shape[1], FINGER if rows > 1 else fingers)
    profile = whole(fields.at(modulus, radius, fingers))
    fraction = np.linspace(0.003, 1.0, 60)[:, None, None]
    y = np.broadcast_to(np.maximum(fraction**2, 1e-6), (60, *modulus.shape))
    distance = np.sqrt(profile.squared_distance(y))
    r = table.readings
    readings = (r.pressure, r.stress_kernel, r.stress_component)
    peak = stress(0.0, modulus, radius, fingers, *readings)
    felt = np.array([stress(rho, modulus, radius, fingers, *readings) for rho in distance]) / peak
    on_pad = distance <= math.hypot(18e-3, 10e-3)
    return np.abs(felt - y ** (1 / table.root))[on_pad].max(), np.abs(profile.peak / peak - 1).max()


def whole(fields):
    """The profile of every touch, in the shape of the batch."""
    at, profile = fields.among(np.ones(fields.peak.shape, dtype=bool), near=False)
    order = np.argsort(at)
    return profile._replace(
        peak=fields.peak, shape=profile.shape[:, order].reshape(len(profile.shape), *fields.peak.shape)
    )


@pytest.mark.parametrize(
    ("load", "readings"),
    [
        pytest.param(load, readings, marks=[pytest.mark.slow] if takes_long(load, readings) else [])
        for load in (Indentation(2e-3), Force(1.0))
        for readings in READINGS
    ],
    ids=lambda one: str(one) if isinstance(one, Load) else reading_id(one),
)
def test_a_table_of_every_reading_is_the_field(load, readings, rng):
    table = StressTable(load, load, FINGER, None, readings, RANGE, 3e-6)
    assert table.reached < 3e-5
    felt, peak = errors(table, load, 10 ** rng.uniform(3, 7, 12))
    assert felt < 5e-4
    assert peak < 6e-6


@pytest.mark.parametrize("kind", ENDS)
@pytest.mark.parametrize("pressure", ["attenuated", "hertz", "printed"])
def test_a_table_of_many_loads_is_the_field_of_each(kind, pressure, rng):
    readings = Readings().override({"pressure": pressure})
    least, greatest = ENDS[kind]
    table = StressTable(least, greatest, FINGER, None, readings, RANGE, 1e-4)
    assert table.reached < 2e-3
    for place in (0.0, 0.03, 0.6, 1.0):
        load = type(least)(held(least) + place * (held(greatest) - held(least)))
        felt, peak = errors(table, load, 10 ** rng.uniform(3, 7, 6))
        assert felt < 6e-3
        assert peak < 2e-3


@pytest.mark.parametrize("load", [Indentation(2e-3), Force(1.0)], ids=str)
@pytest.mark.parametrize("pressure", ["attenuated", "hertz"])
def test_a_table_of_fingers_is_the_field_at_the_corners_and_inside(load, pressure, rng):
    readings = Readings().override({"pressure": pressure})
    table = StressTable(load, load, FINGER, BOX, readings, RANGE, 1e-4)
    assert table.reached < 1e-3
    felt, peak = errors(table, load, 10 ** rng.uniform(3, 7, 6), FINGERS)
    assert felt < 6e-3
    assert peak < 2e-3
    thin = StressTable(load, load, FINGER, FingerBox((8e-3, 8e-3), BOX.receptor_depth), readings, RANGE, 1e-4)
    assert thin.reached < 1e-3


def test_a_table_with_too_few_nodes_says_so(monkeypatch):
    readings = Readings().override({"stress_kernel": "printed", "stress_component": "principal", "pressure": "printed"})
    monkeypatch.setattr("softness_bayes.touch.stress_table.SHAPE_NODES", (41,))
    assert StressTable(Indentation(3e-3), Indentation(3e-3), FINGER, None, readings, RANGE, 3e-6).reached > 1e-4


@pytest.mark.parametrize("load", [Indentation(3e-3), Force(1.0)], ids=str)
def test_beyond_its_range_contacts_are_computed_exactly(load):
    table = StressTable(load, load, FINGER, None, Readings(), RANGE, 1e-6)
    felt, peak = errors(table, load, np.array([1e-2, 1.0, 100.0, 3e8, 1e12]))
    assert felt < 1e-3
    assert peak < 2e-5
    odd = Fingertips(np.array([[4e-3], [20e-3], [8e-3]]), np.array([[0.3e-3], [2e-3], [0.4e-3]]), 0.48)
    table = StressTable(load, load, FINGER, BOX, Readings(), (1e4, 1e6), 1e-4)
    felt, peak = errors(table, load, np.array([1e3, 1e5, 1e8]), odd)
    assert felt < 5e-3
    assert peak < 1e-3


def test_what_has_no_field_is_refused():
    with pytest.raises(InputError, match="receptor_depth"):
        StressTable(*LOADS[:1], *LOADS[:1], Finger(receptor_depth=0.0), None, Readings(), RANGE, 1e-3)
    tables = stress_tables(LOADS[:1], FINGER, None, Readings(), RANGE, 1e-3)
    fields = StressFields(tables, 2 * LOADS[:1], FINGER)
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(NumericalError, match="modulus"):
            fields.at(np.array([[1e5, bad]]), np.full((1, 2), 3e-3), FINGER)
    for radius, depth in (((0.0, 1e-2), (1e-3, 1e-3)), ((1e-2, 8e-3), (1e-3, 1e-3)), ((8e-3, 8e-3), (0.0, np.inf))):
        with pytest.raises(InputError, match="expected a range of positive numbers"):
            FingerBox(radius, depth)


def test_a_decay_that_is_no_product_has_a_table_for_each_force_and_none_for_fingers(rng):
    readings = Readings(pressure=ODD)
    forces = [Force(float(x)) for x in np.linspace(0.3, 1.5, MANY_LOADS + 1)]
    tables = stress_tables(forces, FINGER, None, readings, (1e4, 1e6), 1e-2)
    assert len({id(table) for table in tables.values()}) == len(forces)
    felt, _ = errors(tables[forces[3]], forces[3], 10 ** rng.uniform(4, 6, 5))
    assert felt < 3e-2
    stress_tables([Indentation(2e-3)], FINGER, BOX, readings, RANGE, 1e-1)
    with pytest.raises(InputError, match=r"cannot be sampled with pressure=odd.*fix the finger"):
        stress_tables([Force(1.0)], FINGER, BOX, readings, RANGE, 1e-1)


# scenes


@pytest.fixture(scope="module")
def vectors():
    """Parameter vectors with the fingers above, all of which make receptors fire."""
    n = np.arange(RADIUS.size)
    return TouchParameters(
        1e5 * 1.1**n, 2.0 + 0.1 * n, 21.0 + 0 * n, 0.6e-3, 7e3 + 200.0 * n, 1.05, 1.16, 1.0, 1.5, RADIUS, DEPTH
    )


def single(parameters, k):
    return TouchParameters(*(np.broadcast_to(v, RADIUS.shape)[k] for v in parameters))


CLOSE = Discretisation(24, 20.0, 1e-4)


@pytest.mark.parametrize("kind", ENDS)
def test_a_scene_of_many_loads_is_the_scenes_of_few(kind, smooth_firing, paper, rng):
    least, greatest = (held(end) for end in ENDS[kind])
    make = type(ENDS[kind][0])
    loads = [Indentation(1.7e-3), *(make(float(x)) for x in np.linspace(least, greatest, MANY_LOADS + 2))]
    coarse = Discretisation(8, 9.0, 1e-4)
    many = Scene(MODULI, 0.3, loads, smooth_firing(), discretisation=coarse)
    assert len({id(many.tables[load]) for load in loads[1:]}) == 1
    parameters = paper(b=1e5 * np.exp(0.5 * rng.normal(size=8)), sigma_0=9e3 * np.exp(0.4 * rng.normal(size=8)))
    some = [0, 1, 9, len(loads) - 1]
    few = Scene(MODULI, 0.3, [loads[k] for k in some], smooth_firing(), discretisation=coarse)
    wanted = few.total_rate(parameters).reshape(8, -1, 5)
    assert wanted.max() > 100
    assert_allclose(many.total_rate(parameters).reshape(8, -1, 5)[:, some], wanted, atol=1e-3 * wanted.max())
    part = np.array([3, 40, 41, 62, 99])
    assert_allclose(many.take(part).total_rate(parameters), many.total_rate(parameters)[:, part], rtol=1e-12)
    assert (many.error(parameters) < 2e-3).all()


def test_a_vector_with_a_finger_responds_as_the_scene_of_that_finger(smooth_firing, vectors):
    scene = Scene(MODULI, 0.3, LOADS, smooth_firing(), discretisation=CLOSE, finger_box=BOX)
    rate, every, contact = scene.total_rate(vectors), scene.respond(vectors), scene.contact(vectors)
    assert_allclose(rate, every.total_rate)
    moduli = np.broadcast_to(1.2 * MODULI, (RADIUS.size, MODULI.size))
    moved = scene.total_rate(vectors, moduli)
    for k in (0, 3, 5):
        finger = Finger(radius=RADIUS[k], receptor_depth=DEPTH[k])
        one = Scene(MODULI, 0.3, LOADS, smooth_firing(), finger=finger, discretisation=CLOSE)
        own = single(vectors, k)._replace(radius=0.0, receptor_depth=0.0)
        exact = one.respond(own)
        assert exact.total_rate.max() > 100
        assert_allclose(rate[k], exact.total_rate, atol=5e-4 * exact.total_rate.max())
        assert_allclose(moved[k], one.total_rate(own, moduli[k]), atol=5e-4 * exact.total_rate.max())
        for name, values in one.contact(own)._asdict().items():
            assert_allclose(getattr(contact, name)[k], values, rtol=1e-12, err_msg=name)
        assert scene.beyond_hertz(single(vectors, k)) == one.beyond_hertz(own)
        reference = reference_response(scene, single(vectors, k), law=smooth_firing().curve).total_rate
        assert_allclose(rate[k], reference, atol=5e-4 * reference.max())


def test_details_along_the_pad_are_those_of_the_finger(smooth_firing, vectors):
    coarse, distance = Discretisation(4, 6.0, 1e-2), np.array([0.0, 1e-3, 4e-3])
    scene = Scene(MODULI[:2], 0.3, LOADS[:1], smooth_firing(), discretisation=coarse, finger_box=BOX)
    found = touch_profiles(scene, vectors, distance)
    for k in (1, 4):
        finger = Finger(radius=RADIUS[k], receptor_depth=DEPTH[k])
        one = Scene(MODULI[:2], 0.3, LOADS[:1], smooth_firing(), finger=finger, discretisation=coarse)
        own = single(vectors, k)._replace(radius=0.0, receptor_depth=0.0)
        exact = touch_profiles(one, TouchParameters(*map(np.atleast_1d, own)), distance)
        for name, values in exact._asdict().items():
            assert_allclose(getattr(found, name)[k], values[0], rtol=1e-9, atol=1e-9, err_msg=name)
