from __future__ import annotations

import math

import numpy as np
import pytest

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.contact import Finger, Force, Indentation, Load
from softness_bayes.touch.field import StressField
from softness_bayes.touch.inversion import Inversion
from softness_bayes.touch.neuron.polynomials import clenshaw, monomials
from softness_bayes.touch.readings import ALTERNATIVES, NAMED_READINGS, Readings
from softness_bayes.touch.several_fields import OF_SIZE, SeveralFields, profiles
from softness_bayes.touch.stress import ATTENUATED, HERTZ, stress

FINGER = Finger()
RANGE = (1e3, 1e7)
READINGS = [
    Readings(pressure=pressure, stress_kernel=kernel, stress_component=component)
    for pressure in ALTERNATIVES["pressure"].values()
    for kernel in ALTERNATIVES["stress_kernel"].values()
    for component in ALTERNATIVES["stress_component"].values()
    if kernel.two_sided or not component.needs_plane
]
DEFAULT_LOADS = [Indentation(1e-4), Indentation(3e-3), Force(1.0)]


def reading_id(readings):
    return "-".join(readings.names[place] for place in ("pressure", "stress_kernel", "stress_component"))


def takes_long(load, readings):
    """The table that needs most nodes; `test_every_table_says_how_good_it_is` makes it at a larger tolerance."""
    return isinstance(load, Indentation) and reading_id(readings) == "printed-printed-principal"


def profile_of(field, modulus, finger=FINGER):
    radius = field.load.close(modulus, finger).radius
    return profiles([field], [np.arange(modulus.size)], modulus[None], radius[None])


def worst_error(field, modulus, finger=FINGER):
    """Largest error of the stress that the table says is felt at a distance, against the peak; and of the peak."""
    profile = profile_of(field, modulus, finger)
    farthest = math.hypot(18e-3, 10e-3)
    fraction = np.linspace(0.003, 1.0, 60)[:, None, None]
    y = np.broadcast_to(profile.y_least + (1 - profile.y_least) * fraction**2, (60, 1, modulus.size))
    distance = np.sqrt(profile.squared_distance(y))[:, 0]
    r, radius = field.readings, field.load.close(modulus, finger).radius
    readings = (r.pressure, r.stress_kernel, r.stress_component)
    peak = stress(0.0, modulus, radius, finger, *readings)
    felt = stress(distance, modulus, radius, finger, *readings) / peak
    on_pad = distance <= farthest
    error = np.abs(felt - (y[:, 0] ** (1 / field.root)))[on_pad]
    return error.max(), np.abs(profile.peak[0] / peak - 1).max()


@pytest.mark.parametrize(
    ("load", "readings"),
    [
        pytest.param(load, readings, marks=[pytest.mark.slow] if takes_long(load, readings) else [])
        for load in (Indentation(2e-3), Force(1.0))
        for readings in READINGS
    ],
    ids=lambda one: str(one) if isinstance(one, Load) else reading_id(one),
)
def test_table_answers_like_the_field_itself(load, readings, rng):
    field = StressField(load, FINGER, readings, RANGE, 1e-6)
    felt, peak = worst_error(field, 10 ** rng.uniform(3, 7, 12))
    assert felt < 2e-4
    assert peak < 2e-6


@pytest.mark.parametrize("load", DEFAULT_LOADS, ids=str)
def test_tolerance_is_what_the_table_keeps(load, rng):
    modulus = 10 ** rng.uniform(3, 7, 30)
    for tolerance, allowed in ((1e-4, 5e-3), (1e-8, 1e-6)):
        field = StressField(load, FINGER, Readings(), RANGE, tolerance)
        felt, peak = worst_error(field, modulus)
        assert felt < allowed
        assert peak < 3 * tolerance
    assert field.reached < 2e-6


@pytest.mark.parametrize("readings", READINGS, ids=reading_id)
def test_every_table_says_how_good_it_is(readings, rng):
    """The measured error is the stated one, at points that the table has not seen."""
    field = StressField(Indentation(2e-3), FINGER, readings, RANGE, 3e-6)
    assert field.reached < 3e-5
    modulus = 10 ** rng.uniform(3, 7, 5)
    x = rng.uniform(-1, 1, 20)
    rows, exact = field.exact_rows(modulus), np.array([field.load.close(modulus, FINGER).radius])
    size = field.size(modulus, exact[0])
    profile = profile_of(field, modulus)
    at = np.broadcast_to(x[:, None], (20, 5))
    found = clenshaw(profile.shape[:, 0], at) / size
    wanted = clenshaw(rows[:, 1:].T, at)
    largest = np.abs(rows[:, 1:]).sum(axis=1).max()
    assert np.abs(found - wanted).max() < 3 * field.reached * max(largest, 1.0)


def test_the_inverse_is_exact_next_to_the_axis():
    """With the printed kernel the slope changes by orders of magnitude there, and a search with a fixed slope fails."""
    field = StressField(Force(3.0), FINGER, NAMED_READINGS["printed"], RANGE, 1e-7)
    assert field.reached < 1e-6
    modulus = np.geomspace(1e3, 1e7, 5)
    radius = Force(3.0).close(modulus, FINGER).radius
    decay = field.readings.pressure.decay(modulus, radius, FINGER)
    x = 1.0 - np.geomspace(1e-4, 1e-1, 6)
    inversion = Inversion(FINGER.receptor_depth, 0.02, field.readings, 1e-7)
    peak, shape = inversion.values(radius, decay, x, field.y_least)
    y = 0.5 * (1.0 + field.y_least) + 0.5 * (1.0 - field.y_least) * x
    rho = np.sqrt(shape * inversion.size(radius, decay)[:, None] * (1.0 - y) / y)
    found = (inversion.unit(rho, radius[:, None], decay[:, None]) / peak[:, None]) ** inversion.root
    np.testing.assert_allclose((1.0 - found) / (1.0 - y), 1.0, atol=1e-4)


def test_a_table_with_too_few_nodes_says_so(monkeypatch):
    readings = Readings().override({"stress_kernel": "printed", "stress_component": "principal", "pressure": "printed"})
    monkeypatch.setattr("softness_bayes.touch.field.SHAPE_NODES", (41,))
    field = StressField(Indentation(3e-3), FINGER, readings, RANGE, 3e-6)
    assert field.reached > 1e-4


@pytest.mark.parametrize("load", [Indentation(3e-3), Force(1.0)], ids=str)
def test_outside_its_range_the_table_is_not_used(load):
    field = StressField(load, FINGER, Readings(), RANGE, 1e-6)
    felt, peak = worst_error(field, np.array([1e-2, 1.0, 100.0, 3e8, 1e12]))
    assert felt < 1e-3
    assert peak < 2e-5


@pytest.mark.parametrize("depth", [1e-5, 1e-4, 0.5e-3, 1e-2])
@pytest.mark.parametrize("pressure", [ATTENUATED, HERTZ], ids=lambda pressure: pressure.name)
def test_every_depth(depth, pressure, rng):
    finger = Finger(receptor_depth=depth)
    for load in (Indentation(2e-3), Force(1.0)):
        field = StressField(load, finger, Readings(pressure=pressure), RANGE, 1e-6)
        felt, peak = worst_error(field, 10 ** rng.uniform(3, 7, 8), finger)
        assert felt < 1e-3
        assert peak < 2e-6


def test_receptors_at_the_surface_have_no_field():
    with pytest.raises(InputError, match="receptor_depth"):
        StressField(Indentation(1e-3), Finger(receptor_depth=0.0), Readings(), RANGE, 1e-6)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_a_modulus_that_is_none_is_refused(bad):
    field = StressField(Indentation(1e-3), FINGER, Readings(), RANGE, 1e-4)
    moduli = np.array([[1e5, bad]])
    with pytest.raises(NumericalError, match="modulus"):
        profiles([field], [np.arange(2)], moduli, np.full((1, 2), 3e-3))


def test_loads_side_by_side_are_the_loads_alone():
    fields = [StressField(load, FINGER, Readings(), RANGE, 1e-6) for load in (Indentation(1e-3), Force(1.0))]
    modulus = np.array([1e4, 2e5, 3e5, 5e6])
    columns = [np.array([0, 3]), np.array([1, 2])]
    radius = np.empty((1, 4))
    for field, where in zip(fields, columns, strict=True):
        radius[0, where] = field.load.close(modulus[where], FINGER).radius
    together = profiles(fields, columns, modulus[None], radius)
    y = np.full((1, 4), 0.7)
    for field, where in zip(fields, columns, strict=True):
        alone = profile_of(field, modulus[where])
        np.testing.assert_allclose(together.peak[:, where], alone.peak, rtol=1e-14)
        distance = together.squared_distance(y)[:, where]
        np.testing.assert_allclose(distance, alone.squared_distance(y[:, where]), rtol=1e-13)


@pytest.mark.parametrize(("tolerance", "powers"), [(1e-3, True), (1e-7, False)])
def test_beyond_the_table_the_fast_form_is_exact_too(tolerance, powers):
    loads = Indentation(2e-3), Force(0.5)
    fields = [StressField(load, FINGER, Readings(), (1e4, 1e6), tolerance) for load in loads]
    columns = [np.array([0]), np.array([1])]
    fast = SeveralFields(fields, columns, fast=True)
    covering = SeveralFields([StressField(load, FINGER, Readings(), (1e4, 2e9), 1e-7) for load in loads], columns)
    assert fast.powers == powers
    modulus = np.repeat([[3e6], [3e7], [1e9]], 2, axis=1)
    assert not fast.covers(modulus)
    assert covering.covers(modulus)
    radius = np.stack([load.close(modulus[:, k], FINGER).radius for k, load in enumerate(loads)], axis=1)
    found, exact = (several.at(modulus, radius).whole() for several in (fast, covering))
    np.testing.assert_allclose(found.peak, exact.peak, rtol=1e-5)
    y = np.broadcast_to(np.linspace(0.6, 0.99, 20)[:, None, None], (20, 3, 2))
    wanted = exact.squared_distance(y)
    # both have as many orders as their tolerances leave
    np.testing.assert_allclose(found.squared_distance(y), wanted, rtol=0, atol=10.0 * tolerance * wanted.max())


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-6])
def test_series_of_q_itself_lose_little_of_the_tolerance_where_the_patch_is_small_too(tolerance, rng):
    loads = Indentation(3e-3), Force(0.5)
    fields = [StressField(load, FINGER, Readings(), RANGE, tolerance) for load in loads]
    columns = [np.array([0]), np.array([1])]
    whole, plain = (SeveralFields(fields, columns, fast=fast) for fast in (True, False))
    assert whole.with_size
    assert not plain.with_size
    assert all(one.shape[1] >= of.shape[1] for one, of in zip(whole.series, plain.series, strict=True))
    modulus = np.exp(rng.uniform(*np.log(RANGE), (300, 2)))
    radius = np.stack([load.close(modulus[:, k], FINGER).radius for k, load in enumerate(loads)], axis=1)
    found, exact = (several.at(modulus, radius).whole() for several in (whole, plain))
    size = np.stack([field.size(modulus[:, k], radius[:, k]) for k, field in enumerate(fields)], axis=1)
    assert size.max() > 5.0 * size.min()
    y = np.broadcast_to(0.5 + 0.5 * np.linspace(0.0, 0.999, 20)[:, None, None], (20, 300, 2))
    error = np.abs(found.squared_distance(y) - exact.squared_distance(y)) / (size * (1.0 / y - 1.0))
    assert error.max() < OF_SIZE * tolerance
    assert error.max() > 1e-4 * tolerance  # it is another series


@pytest.mark.parametrize(("reach", "tolerance", "powers"), [((1e-6, 1e9), 1e-4, True), ((1e-9, 1e9), 1e-5, False)])
def test_a_range_in_which_that_would_cost_more_keeps_the_size_apart(reach, tolerance, powers):
    far = StressField(Force(1.0), FINGER, Readings(), reach, tolerance)
    several = SeveralFields([far], [np.array([0])], fast=True)
    assert not several.with_size
    assert several.powers == powers
    modulus = np.geomspace(10.0 * reach[0], 0.1 * reach[1], 50)[:, None]
    radius = far.load.close(modulus, FINGER).radius
    found = several.at(modulus, radius).whole()
    exact = SeveralFields([far], [np.array([0])]).at(modulus, radius).whole()
    y = np.broadcast_to(np.maximum(0.6, exact.y_least), (1, 50, 1))
    np.testing.assert_allclose(found.squared_distance(y), exact.squared_distance(y), rtol=1e-12)


@pytest.mark.parametrize(
    ("tolerance", "of_y", "of_places"), [(1e-4, True, True), (1e-5, True, False), (1e-7, False, False)]
)
def test_series_are_in_powers_as_far_as_that_loses_no_digits(tolerance, of_y, of_places, rng):
    fields = [
        StressField(load, FINGER, Readings(), RANGE, tolerance) for load in (Indentation(1e-3), Indentation(3e-3))
    ]
    columns = [np.array([0, 2]), np.array([1])]
    inside, plain = (SeveralFields(fields, columns, fast=fast) for fast in (True, False))
    assert inside.powers == of_y
    assert (inside.polynomials is monomials) == of_places
    modulus = np.exp(rng.uniform(*np.log(RANGE), (200, 3)))
    radius = np.stack([fields[k].load.close(modulus[:, j], FINGER).radius for j, k in enumerate((0, 1, 0))], axis=1)
    found, exact = (several.at(modulus, radius).whole() for several in (inside, plain))
    y = exact.y_least + (1.0 - exact.y_least) * np.linspace(0.0, 1.0, 30)[:, None, None]
    y = np.broadcast_to(y, (30, 200, 3))
    error = np.abs(found.squared_distance(y) - exact.squared_distance(y)) / exact.squared_distance(y).max(axis=0)
    assert error.max() < 1e-2 * tolerance
