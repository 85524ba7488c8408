"""The stress field of fingers that vary, against that of one finger and against direct integration."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, FingerBox, Fingertips, Force, Indentation
from softness_bayes.touch.field import StressField
from softness_bayes.touch.finger_field import FingerField, profiles
from softness_bayes.touch.pad import touch_profiles
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import ALTERNATIVES, Readings
from softness_bayes.touch.reference import reference_response
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.several_fields import profiles as profiles_of_one_finger
from softness_bayes.touch.stress import ATTENUATED, Pressure, stress

BOX = FingerBox((6.5e-3, 10e-3), (0.5e-3, 0.9e-3))
RANGE = (1e3, 1e7)
RADIUS = np.array([*np.repeat(BOX.radius, 2), 8e-3, 7.1e-3])
DEPTH = np.array([*np.tile(BOX.receptor_depth, 2), 0.7e-3, 0.83e-3])
SOME = (0, 3, 5)
"""Two opposite corners of the box, and a finger inside: each has tables of its own to be compared with."""
FINGERS = Fingertips(RADIUS[:, None], DEPTH[:, None], Finger().poisson_ratio)
READINGS = [
    Readings(pressure=pressure, stress_kernel=kernel, stress_component=component)
    for pressure in ALTERNATIVES["pressure"].values()
    for kernel in ALTERNATIVES["stress_kernel"].values()
    for component in ALTERNATIVES["stress_component"].values()
    # the table of the printed principal stress takes five seconds: it is of the same code
    if not component.needs_plane or kernel.name == "line"
]
USUAL = Readings()


def changes(readings):
    """How many of the three readings are not the usual ones."""
    return sum(getattr(readings, k) != getattr(USUAL, k) for k in ("pressure", "stress_kernel", "stress_component"))


LOADS = (Indentation(1e-3), Indentation(2.5e-3), Force(0.7))
MODULI = np.geomspace(2e4, 2e6, 5)
FINE = Discretisation(24, 20.0, 1e-5)


def reading_id(readings):
    return "-".join(readings.names[place] for place in ("pressure", "stress_kernel", "stress_component"))


def profile_of(field, modulus, fingers=FINGERS):
    modulus = np.broadcast_to(modulus, (fingers.radius.size, np.size(modulus)))
    radius = field.load.close(modulus, fingers).radius
    return profiles([field], [np.arange(modulus.shape[1])], modulus, radius, fingers), radius


def felt_at(profile, root, share):
    """Distances [m] at which the stress has fallen to shares of its peak, shape (shares, fingers, moduli)."""
    y = np.broadcast_to((np.asarray(share) ** root)[:, None, None], (len(share), *profile.peak.shape))
    return np.sqrt(profile.squared_distance(y))


@pytest.mark.parametrize(
    "readings",
    # pressure and kernel are functions of their own: each with the usual others is among the quick tests
    [pytest.param(each, marks=[pytest.mark.slow] * (changes(each) > 1), id=reading_id(each)) for each in READINGS],
)
@pytest.mark.parametrize("load", [Indentation(2e-3), Force(1.0)], ids=str)
def test_table_is_the_field_at_the_corners_and_inside(load, readings, rng):
    field = FingerField(load, Finger(), BOX, readings, RANGE, 1e-4)
    assert field.reached < 1e-3
    modulus = 10 ** rng.uniform(3, 7, 6)
    profile, radius = profile_of(field, modulus)
    chosen = FINGERS, readings.pressure, readings.stress_kernel, readings.stress_component
    peak = stress(0.0, modulus, radius, *chosen)
    assert_allclose(profile.peak, peak, rtol=2e-3)
    share = np.array([0.05, 0.3, 0.7, 0.95])
    distance = felt_at(profile, field.root, share)
    felt = np.array([stress(rho, modulus, radius, *chosen) for rho in distance]) / peak
    assert_allclose(felt, np.broadcast_to(share[:, None, None], felt.shape), atol=6e-3)


@pytest.mark.parametrize(
    "load", [*(pytest.param(one, marks=pytest.mark.slow) for one in LOADS[:-1]), LOADS[-1]], ids=str
)
def test_family_holds_the_field_of_every_finger(load):
    """Against the tables of single fingers, which know nothing of other radii and depths."""
    field = FingerField(load, Finger(), BOX, Readings(), RANGE, 3e-6)
    modulus, share = np.geomspace(2e3, 5e6, 9), np.linspace(0.02, 0.99, 12)
    many, _ = profile_of(field, modulus)
    for k in SOME:
        finger = Finger(radius=RADIUS[k], receptor_depth=DEPTH[k])
        single = StressField(load, finger, Readings(), RANGE, 1e-7)
        radius = load.close(modulus, finger).radius[None]
        one = profiles_of_one_finger([single], [np.arange(9)], modulus[None], radius)
        assert_allclose(many.peak[k], one.peak[0], atol=2e-5 * one.peak.max())
        apart = felt_at(many, field.root, share)[:, k] - felt_at(one, field.root, share)[:, 0]
        assert np.abs(apart).max() < 2e-4 * radius.max()


def test_depth_alone_and_radius_alone_are_thin_boxes():
    thin = [
        FingerBox((8e-3, 8e-3), BOX.receptor_depth),
        FingerBox(BOX.radius, (0.7e-3, 0.7e-3)),
        FingerBox((8e-3, 8e-3), (0.7e-3, 0.7e-3)),
    ]
    wide = FingerField(Force(1.0), Finger(), BOX, Readings(), RANGE, 1e-4)
    same = Fingertips(np.array([[8e-3]]), np.array([[0.7e-3]]), 0.48)
    expected, _ = profile_of(wide, MODULI, same)
    for box in thin:
        field = FingerField(Force(1.0), Finger(), box, Readings(), RANGE, 1e-4)
        assert field.table.size < wide.table.size
        found, _ = profile_of(field, MODULI, same)
        assert_allclose(found.peak, expected.peak, rtol=1e-3)
        assert_allclose(felt_at(found, field.root, [0.1, 0.8]), felt_at(expected, wide.root, [0.1, 0.8]), rtol=1e-2)


def test_fingers_and_moduli_beyond_the_table_are_computed_exactly():
    field = FingerField(Indentation(2e-3), Finger(), BOX, Readings(), (1e4, 1e6), 1e-6)
    odd = Fingertips(np.array([[4e-3], [20e-3], [8e-3]]), np.array([[0.3e-3], [2e-3], [0.4e-3]]), 0.48)
    modulus = np.array([1e3, 1e5, 1e8])
    profile, radius = profile_of(field, modulus, odd)
    peak = stress(0.0, modulus, radius, odd)
    assert_allclose(profile.peak, peak, rtol=1e-6)
    distance = felt_at(profile, field.root, [0.1, 0.6])
    felt = np.array([stress(rho, modulus, radius, odd) for rho in distance]) / peak
    assert_allclose(felt, np.broadcast_to(np.array([0.1, 0.6])[:, None, None], felt.shape), atol=1e-4)


def test_finer_tolerances_are_kept():
    fields = [FingerField(Indentation(2e-3), Finger(), BOX, Readings(), RANGE, t) for t in (1e-3, 1e-5)]
    assert fields[1].reached < 1e-4
    assert fields[1].reached < 0.2 * fields[0].reached
    assert fields[0].cut(1e-5) is fields[0]
    short = fields[1].cut(1e-3)
    assert short.table.size < 0.5 * fields[1].table.size
    assert_allclose(profile_of(short, MODULI)[0].peak, profile_of(fields[1], MODULI)[0].peak, rtol=5e-3)


def test_a_decay_that_is_no_power_of_the_radius_is_refused_under_a_force():
    odd = Pressure("odd", ATTENUATED.amplitude, lambda modulus, a, finger: 1.0 + a / finger.receptor_depth)
    FingerField(Indentation(2e-3), Finger(), BOX, Readings(pressure=odd), RANGE, 1e-2)
    with pytest.raises(InputError, match=r"cannot be sampled with pressure=odd.*fix the finger"):
        FingerField(Force(1.0), Finger(), BOX, Readings(pressure=odd), RANGE, 1e-2)


def test_boxes_and_moduli_that_are_none_are_refused():
    for radius, depth in (((0.0, 1e-2), (1e-3, 1e-3)), ((1e-2, 8e-3), (1e-3, 1e-3)), ((8e-3, 8e-3), (0.0, np.inf))):
        with pytest.raises(InputError, match="expected a range of positive lengths"):
            FingerBox(radius, depth)
    field = FingerField(Indentation(2e-3), Finger(), BOX, Readings(), RANGE, 1e-2)
    with pytest.raises(NumericalError, match="not positive and finite"):
        profiles([field], [np.arange(1)], np.array([[np.nan]]), np.array([[1e-3]]), FINGERS.take(slice(0, 1)))


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


@pytest.mark.parametrize(
    "readings",
    [
        pytest.param(Readings(), id="strain"),
        pytest.param(
            Readings().override({"skin_displacement": "displacement"}), id="displacement", marks=pytest.mark.slow
        ),
    ],
)
def test_a_vector_with_a_finger_responds_as_the_scene_of_that_finger(readings, smooth_firing, vectors):
    if readings.skin_displacement.power == 2:
        vectors = vectors._replace(m=350.0 * vectors.m)
    scene = Scene(MODULI, 0.3, LOADS, smooth_firing(), readings=readings, discretisation=FINE, finger_box=BOX)
    rate, every, contact = scene.total_rate(vectors), scene.respond(vectors), scene.contact(vectors)
    assert_allclose(rate, every.total_rate)
    moduli = np.broadcast_to(1.2 * MODULI, (RADIUS.size, MODULI.size))
    moved = scene.total_rate(vectors, moduli)
    for k in SOME:
        finger = Finger(radius=RADIUS[k], receptor_depth=DEPTH[k])
        one = Scene(MODULI, 0.3, LOADS, smooth_firing(), readings=readings, finger=finger, discretisation=FINE)
        own = single(vectors, k)._replace(radius=0.0, receptor_depth=0.0)
        exact = one.respond(own)
        assert exact.total_rate.max() > 100
        assert_allclose(rate[k], exact.total_rate, atol=5e-5 * exact.total_rate.max())
        assert_allclose(moved[k], one.total_rate(own, moduli[k]), atol=5e-5 * exact.total_rate.max())
        for name, values in one.contact(own)._asdict().items():
            assert_allclose(getattr(contact, name)[k], values, rtol=1e-12, err_msg=name)
        assert scene.beyond_hertz(single(vectors, k)) == one.beyond_hertz(own)


def test_a_vector_without_a_finger_has_that_of_the_scene(smooth_firing, vectors):
    own = Finger(radius=7.4e-3, receptor_depth=0.65e-3)
    free, held = (
        Scene(MODULI, 0.3, LOADS, smooth_firing(), finger=own, discretisation=FINE, finger_box=box)
        for box in (BOX, None)
    )
    for radius, depth in ((0.0, 0.0), (own.radius, 0.0), (0.0, own.receptor_depth)):
        found = free.total_rate(vectors._replace(radius=radius, receptor_depth=depth))
        expected = held.total_rate(vectors._replace(radius=0.0, receptor_depth=0.0))
        assert_allclose(found, expected, atol=5e-5 * expected.max())
    contact = held.contact(vectors._replace(radius=0.0, receptor_depth=0.0))
    assert_allclose(free.stress_profile(contact).peak, held.stress_profile(contact).peak, rtol=1e-4)


def test_adaptive_integration_agrees(smooth_firing, vectors):
    scene = Scene(MODULI[::2], 0.3, LOADS[1:], smooth_firing(), discretisation=FINE, finger_box=BOX)
    rate = scene.total_rate(vectors)
    for k in (0, 3, 5):
        exact = reference_response(scene, single(vectors, k), law=smooth_firing().curve).total_rate
        assert_allclose(rate[k], exact, atol=5e-5 * exact.max())


def test_a_scene_measures_its_error_over_the_box(smooth_firing, vectors):
    scene = Scene(
        MODULI, 0.3, LOADS[1:], smooth_firing(), discretisation=replace(FINE, field_tolerance=1e-3), finger_box=BOX
    )
    fine = scene.refined()
    assert fine.finger_box == BOX
    error = scene.error(vectors)
    rate, better = scene.total_rate(vectors), fine.total_rate(vectors)
    actual = np.abs(rate - better).max(axis=-1) / better.max(axis=-1)
    assert (error >= actual).all()
    assert (error < 1e-2).all()
    assert scene.take([0, 7]).total_rate(vectors) == pytest.approx(rate[:, [0, 7]])
    assert_allclose(scene.on_grid(MODULI).total_rate(vectors), rate)


def test_many_fabrics_are_interpolated_for_every_finger(smooth_firing, vectors):
    scene = Scene(np.geomspace(1e4, 1e7, 300), 0.3, LOADS[2:], smooth_firing(), discretisation=FINE, finger_box=BOX)
    found, exact = scene.total_rate(vectors), scene.respond(vectors).total_rate
    assert_allclose(found, exact, atol=1e-4 * exact.max())


def test_details_along_the_pad_are_those_of_the_finger(smooth_firing, vectors):
    coarse = Discretisation(4, 6.0, 1e-2)
    scene = Scene(MODULI[:2], 0.3, LOADS[:1], smooth_firing(), discretisation=coarse, finger_box=BOX)
    distance = np.array([0.0, 1e-3, 4e-3])
    found = touch_profiles(scene, vectors, distance)
    for k in (1, 4):
        finger = Finger(radius=RADIUS[k], receptor_depth=DEPTH[k])
        one = Scene(MODULI[:2], 0.3, LOADS[:1], smooth_firing(), finger=finger, discretisation=coarse)
        own = single(vectors, k)._replace(radius=0.0, receptor_depth=0.0)
        exact = touch_profiles(one, TouchParameters(*map(np.atleast_1d, own)), distance)
        for name, values in exact._asdict().items():
            assert_allclose(getattr(found, name)[k], values[0], rtol=1e-9, atol=1e-9, err_msg=name)


def test_fingers_that_a_scene_does_not_have_are_refused(smooth_firing, vectors, paper):
    scene = Scene(MODULI, 0.3, LOADS[:1], smooth_firing())
    for own in ({"radius": 8e-3}, {"receptor_depth": 0.7e-3}):
        with pytest.raises(InputError, match="the scene has one finger"):
            scene.total_rate(paper(**own))
    with pytest.raises(InputError, match=r"parameters: radius is -0\.008, expected a positive number"):
        scene.total_rate(paper(radius=-8e-3))
