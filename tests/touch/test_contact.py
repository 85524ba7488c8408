from __future__ import annotations

import json
import math

import mpmath
import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.touch.contact import (
    DISPLACEMENT,
    PLATE_LENGTH,
    PLATE_RIGIDITY,
    PRINTED_RIGIDITY,
    STRAIN,
    Finger,
    Force,
    Indentation,
    hertz_force,
    solve_contact,
)
from support.paths import REFERENCE

FINGER = Finger()
DISPLACEMENTS = [STRAIN, DISPLACEMENT]
LOADS = [Indentation(1e-6), Indentation(1e-3), Indentation(2e-2), Force(1e-6), Force(1.0), Force(100.0)]


def ids(values):
    return [getattr(value, "name", str(value)) for value in values]


def exact_skin_modulus(fabric, poisson, load, b, m, finger, displacement):
    """E_skin by bisection of ln E in 50 digits, written from model.md 2-3 and not from the code."""
    with mpmath.workdps(50):
        skin_part = 1 - mpmath.mpf(finger.poisson_ratio) ** 2
        fabric_part = (1 - mpmath.mpf(poisson) ** 2) / mpmath.mpf(fabric)
        radius = mpmath.mpf(finger.radius)

        def compression(modulus):
            reduced = 1 / (skin_part / modulus + fabric_part)
            if isinstance(load, Indentation):
                a = mpmath.sqrt(radius * load.depth)
            else:
                a = mpmath.cbrt(3 * radius * load.newton / (4 * reduced))
            closing = a if displacement is STRAIN else a**2
            return skin_part / modulus * reduced / (2 * radius * a) * (2 * a * closing)

        low = mpmath.log(mpmath.mpf(b))
        high = low + m * compression(mpmath.mpf(b))
        for _ in range(160):
            middle = (low + high) / 2
            rises = middle - mpmath.log(mpmath.mpf(b)) < m * compression(mpmath.exp(middle))
            low, high = (middle, high) if rises else (low, middle)
        return float(mpmath.exp(low))


def test_agrees_with_thirty_digit_reference():
    rows = json.loads((REFERENCE / "mechanics.json").read_text())["rows"]
    assert any(row["hard"] for row in rows)
    for row in rows:
        finger = Finger(radius=row["R"], poisson_ratio=row["nu_skin"])
        held = Indentation(row["indentation"]) if row["control"] == "indentation" else Force(row["force"])
        found = solve_contact(row["E_fab"], row["nu_fab"], held, row["b"], row["m"], finger)
        for name, key in [
            ("skin_modulus", "E_skin"),
            ("reduced_modulus", "E_star"),
            ("radius", "contact_radius"),
            ("indentation", "indentation"),
            ("force", "force"),
        ]:
            assert getattr(found, name) == pytest.approx(row[key], rel=1e-9), name


@pytest.mark.parametrize("displacement", DISPLACEMENTS, ids=ids(DISPLACEMENTS))
@pytest.mark.parametrize("control", [Indentation, Force])
@pytest.mark.parametrize("count", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_skin_modulus_over_all_orders_of_magnitude(count, control, displacement, rng):
    for _ in range(count):
        fabric, b = 10 ** rng.uniform(-2, 12), 10 ** rng.uniform(1, 7)
        poisson, finger = rng.uniform(-0.5, 0.5), Finger(poisson_ratio=rng.uniform(0, 0.5))
        load = control(10 ** (rng.uniform(-6, -1.5) if control is Indentation else rng.uniform(-6, 2)))
        softest = solve_contact(fabric, poisson, load, b, 0.0, finger, displacement)
        largest = softest.radius**displacement.power / finger.radius
        m = 10 ** rng.uniform(-2, math.log10(60)) / largest  # m times the rigid compression, up to 60
        found = solve_contact(fabric, poisson, load, b, m, finger, displacement)
        exact = exact_skin_modulus(fabric, poisson, load, b, m, finger, displacement)
        assert found.skin_modulus == pytest.approx(exact, rel=1e-11)


def of_any_size(kind, value):
    """A load that no fingertip is held at: the identities hold there too."""
    load = object.__new__(kind)
    object.__setattr__(load, "depth" if kind is Indentation else "newton", float(value))
    return load


@pytest.mark.parametrize("displacement", DISPLACEMENTS, ids=ids(DISPLACEMENTS))
@pytest.mark.parametrize("load", LOADS, ids=ids(LOADS))
class TestIdentities:
    fabric = np.geomspace(1e-2, 1e12, 57)
    b = 1e5

    def test_skin_that_does_not_stiffen(self, load, displacement):
        found = solve_contact(self.fabric, 0.3, load, self.b, 0.0, FINGER, displacement)
        np.testing.assert_allclose(found.skin_modulus, self.b, rtol=1e-14)

    def test_load_is_held_and_hertz_closes(self, load, displacement):
        found = solve_contact(self.fabric, 0.3, load, self.b, 2.0, FINGER, displacement)
        held = found.indentation if isinstance(load, Indentation) else found.force
        value = load.depth if isinstance(load, Indentation) else load.newton
        np.testing.assert_allclose(held, value, rtol=1e-14)
        np.testing.assert_allclose(found.radius**2, FINGER.radius * found.indentation, rtol=1e-13)
        np.testing.assert_allclose(found.force, hertz_force(found.reduced_modulus, found.radius, FINGER), rtol=1e-13)

    def test_force_undoes_indentation(self, load, displacement):
        one = solve_contact(self.fabric, 0.3, load, self.b, 2.0, FINGER, displacement)
        for k in range(0, self.fabric.size, 8):
            held = isinstance(load, Indentation)
            other = of_any_size(Force, one.force[k]) if held else of_any_size(Indentation, one.indentation[k])
            two = solve_contact(self.fabric[k], 0.3, other, self.b, 2.0, FINGER, displacement)
            for name in one._fields:
                assert getattr(two, name) == pytest.approx(getattr(one, name)[k], rel=1e-9), name


def test_paper_force_at_one_millimetre():
    # with the priors' medians, one newton at one millimetre (model.md 10)
    assert solve_contact(1e9, 0.3, Indentation(1e-3), 1e5, 2.0).force == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(("reading", "denominator"), [(PRINTED_RIGIDITY, 1 - 0.3), (PLATE_RIGIDITY, 1 - 0.09)])
def test_rigidity_of_a_fabric(reading, denominator):
    rigidity = reading.rigidity(np.array(20e6), np.array(0.5e-3), np.array(0.3))
    assert rigidity == pytest.approx(20e6 * 0.5e-3**3 / (12 * denominator), rel=1e-14)
    # a rigidity in N mm is read as a modulus in MPa
    assert rigidity / PLATE_LENGTH**3 * 1e-6 == pytest.approx(rigidity * 1e3, rel=1e-14)


@pytest.mark.parametrize(
    "bad",
    [
        *({name: value} for name in ("fabric_modulus", "b", "m") for value in (-1.0, math.nan, math.inf)),
        *({name: 0.0} for name in ("fabric_modulus", "b")),
        *({"fabric_poisson": value} for value in (-1.0, 0.51, 1.0, math.nan)),
    ],
    ids=str,
)
def test_contact_refuses_what_is_not_positive_and_finite(bad):
    usual = {"fabric_modulus": 1e5, "fabric_poisson": 0.3, "b": 1e5, "m": 2.0}
    with pytest.raises(InputError):
        solve_contact(load=Indentation(1e-3), **{**usual, **bad})
