"""The stress fields of many loads from one table, against those of single loads and against direct integration."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, FingerBox, Force, Indentation
from softness_bayes.touch.field import StressField
from softness_bayes.touch.finger_field import FingerField, profiles
from softness_bayes.touch.load_field import LoadField, LoadTable, cut_together
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import ALTERNATIVES, Readings
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.shared_fields import MANY_LOADS
from softness_bayes.touch.stress import stress

FINGER, RANGE, MODULI = Finger(), (1e3, 1e7), np.geomspace(2e4, 2e6, 5)
ENDS = {"force": (Force(0.3), Force(1.5)), "indentation": (Indentation(0.5e-3), Indentation(3e-3))}
FORCES = [Force(float(x)) for x in np.linspace(0.3, 1.5, MANY_LOADS + 2)]
DEPTHS = [Indentation(float(x)) for x in np.linspace(0.5e-3, 3e-3, MANY_LOADS + 2)]
COARSE = Discretisation(8, 9.0, 1e-4)


@pytest.fixture(scope="module")
def tables():
    return {name: LoadTable(*ends, FINGER, Readings(), RANGE, 1e-4) for name, ends in ENDS.items()}


@pytest.fixture(scope="module")
def mixed(smooth_firing):
    """Forces, of which there are many, and two indentations, which are few."""
    return Scene(MODULI, 0.3, [*DEPTHS[:2], *FORCES], smooth_firing(), discretisation=COARSE)


@pytest.fixture
def draws(rng, paper):
    def made(size):
        return paper(
            b=1e5 * np.exp(0.5 * rng.normal(size=size)),
            m=2.0 * np.exp(0.3 * rng.normal(size=size)),
            sigma_0=9e3 * np.exp(0.4 * rng.normal(size=size)),
        )

    return made


def within(ends, places):
    values = [getattr(end, "newton", None) or end.depth for end in ends]
    return [type(ends[0])(float(x)) for x in values[0] + (values[1] - values[0]) * np.array(places)]


def felt(readings, load, profile, modulus, share, root):
    """Stress over its peak, by integration, where the profile says that it has fallen to `share`."""
    radius = load.close(modulus, FINGER).radius
    chosen = FINGER, readings.pressure, readings.stress_kernel, readings.stress_component
    peak = stress(0.0, modulus, radius, *chosen)
    distance = np.sqrt(profile.squared_distance(np.full_like(profile.peak, share**root)))
    return profile.peak[0] / peak, stress(distance[0], modulus, radius, *chosen) / peak


PRESSURES = [
    pytest.param(one, id=name, marks=[] if one is Readings().pressure else [pytest.mark.slow])
    for name, one in ALTERNATIVES["pressure"].items()
]


@pytest.mark.parametrize("pressure", PRESSURES)
@pytest.mark.parametrize("kind", ENDS)
def test_every_load_of_the_range_has_its_field(kind, pressure, rng):
    readings = Readings(pressure=pressure)
    table = LoadTable(*ENDS[kind], FINGER, readings, RANGE, 1e-4)
    assert table.reached < 2e-3
    modulus = 10 ** rng.uniform(3, 7, 6)
    for field in table.fields(within(ENDS[kind], [0.0, 0.03, 0.6, 1.0])):
        radius = field.load.close(modulus, FINGER).radius
        profile = profiles([field], [np.arange(6)], modulus[None], radius[None], FINGER)
        for share in (0.05, 0.5, 0.95):
            peak, found = felt(readings, field.load, profile, modulus, share, field.root)
            assert_allclose(peak, 1.0, atol=2e-3)
            assert_allclose(found, share, atol=6e-3)


@pytest.mark.parametrize("kind", ENDS)
def test_the_stated_error_is_that_at_the_worst_load(kind, tables):
    """Against fields of single loads that are a hundred times as close, relative to the largest of each load."""
    worst = 0.0
    for field in tables[kind].fields(within(ENDS[kind], [0.0, 0.01, 0.35, 0.8, 1.0])):
        close = StressField(field.load, FINGER, Readings(), RANGE, 1e-6)
        modulus = np.geomspace(*RANGE, 40)[None]
        radius = field.load.close(modulus, FINGER).radius
        unit = [profiles([f], [np.arange(40)], modulus, radius, FINGER).peak for f in (field, close)]
        unit /= close.readings.pressure.amplitude(modulus, radius, FINGER)
        worst = max(worst, np.abs(unit[0] - unit[1]).max() / unit[1].max())
    assert worst < 1.5 * tables[kind].reached
    assert tables[kind].reached < 1e-3


def test_the_error_follows_the_tolerance(tables):
    finer = LoadTable(*ENDS["indentation"], FINGER, Readings(), RANGE, 1e-6)
    assert finer.reached < 0.1 * tables["indentation"].reached
    fields = finer.fields(DEPTHS[:3])
    cut = cut_together(fields, 1e-3)
    assert cut[0].table.size < 0.5 * fields[0].table.size
    assert_allclose(cut[1].table, fields[1].cut(1e-3).table)
    assert cut_together(fields, 1e-7)[0] is fields[0]


def test_few_loads_have_tables_of_their_own(mixed, smooth_firing):
    assert [type(field) for field in mixed.fields[:2]] == [StressField] * 2
    assert {type(field) for field in mixed.fields[2:]} == {LoadField}
    few = Scene(MODULI, 0.3, FORCES[:MANY_LOADS], smooth_firing(), discretisation=COARSE)
    assert {type(field) for field in few.fields} == {StressField}


def test_a_scene_of_many_loads_is_the_scenes_of_few(mixed, draws, smooth_firing):
    parameters = draws(8)
    found = mixed.total_rate(parameters).reshape(8, -1, 5)
    whole = mixed.respond(parameters)
    assert_allclose(whole.total_rate.reshape(8, -1, 5), found, rtol=1e-12)
    some = [0, 1, 2, 9, len(mixed.loads) - 1]
    few = Scene(MODULI, 0.3, [mixed.loads[k] for k in some], smooth_firing(), discretisation=COARSE)
    wanted = few.respond(parameters)
    assert wanted.total_rate.max() > 100
    assert_allclose(found[:, some], wanted.total_rate.reshape(8, -1, 5), atol=1e-3 * wanted.total_rate.max())
    for one, other in zip(whole.contact, wanted.contact, strict=True):
        assert_allclose(one.reshape(8, -1, 5)[:, some].reshape(8, -1), other, rtol=1e-12)


def test_parts_and_coarser_cuts_share_the_table(mixed, draws):
    parameters = draws(5)
    whole = mixed.total_rate(parameters)
    some = np.array([3, 40, 41, 62, 99])
    assert_allclose(mixed.take(some).total_rate(parameters), whole[:, some], rtol=1e-12)
    coarse = mixed.coarser(replace(COARSE, field_tolerance=1e-3))
    assert coarse.fields[3].side is coarse.fields[4].side
    assert_allclose(coarse.total_rate(parameters), whole, atol=1e-2 * whole.max())


@pytest.mark.slow
def test_error_is_that_of_the_table(mixed, draws):
    assert mixed.field_error >= mixed.fields[5].reached
    assert (mixed.error(draws(4)) < 2e-3).all()


def test_moduli_beyond_the_table_are_computed(tables):
    field = tables["force"].fields(FORCES)[3]
    modulus = np.array([[50.0, 1e5, 1e9]])
    radius = field.load.close(modulus, FINGER).radius
    found = profiles([field], [np.arange(3)], modulus, radius, FINGER)
    wide = StressField(field.load, FINGER, Readings(), (10.0, 1e10), 1e-5)
    wanted = profiles([wide], [np.arange(3)], modulus, radius, FINGER)
    assert_allclose(found.peak, wanted.peak, rtol=2e-3)
    with pytest.raises(NumericalError, match="modulus"):
        profiles([field], [np.arange(3)], -modulus, radius, FINGER)


def test_receptors_at_the_surface_have_no_field():
    with pytest.raises(InputError, match="receptor_depth"):
        LoadTable(*ENDS["force"], Finger(receptor_depth=0.0), Readings(), RANGE, 1e-3)


@pytest.mark.parametrize("loads", [pytest.param(FORCES, marks=pytest.mark.slow), DEPTHS], ids=["force", "indentation"])
def test_fingers_that_vary_have_one_table_for_many_loads(loads, draws, smooth_firing):
    box = FingerBox((7e-3, 9e-3), (0.6e-3, 0.8e-3))
    parameters = draws(4)
    parameters = TouchParameters(**{**parameters._asdict(), "radius": np.array([7e-3, 7.7e-3, 8e-3, 9e-3])})
    many = Scene(MODULI, 0.3, loads, smooth_firing(), discretisation=COARSE, finger_box=box)
    assert {type(field) for field in many.fields} == {FingerField}
    assert all(field.table is many.fields[0].table for field in many.fields)
    some = [0, 7, len(loads) - 1]
    few = Scene(MODULI, 0.3, [loads[k] for k in some], smooth_firing(), discretisation=COARSE, finger_box=box)
    wanted = few.total_rate(parameters).reshape(4, -1, 5)
    found = many.total_rate(parameters).reshape(4, -1, 5)[:, some]
    assert_allclose(found, wanted, atol=2e-3 * wanted.max())
    coarse = many.coarser(replace(COARSE, field_tolerance=1e-3))
    assert coarse.fields[0].table is coarse.fields[1].table
    assert_allclose(coarse.total_rate(parameters).reshape(4, -1, 5)[:, some], wanted, atol=2e-2 * wanted.max())
    radius, alone = (scene.contact(parameters).radius.reshape(4, -1, 5) for scene in (many, few))
    assert_allclose(radius[:, some], alone)
