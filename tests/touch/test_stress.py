from __future__ import annotations

import itertools
import json
import math

import mpmath
import numpy as np
import pytest

from softness_bayes.touch.contact import Finger, hertz_force
from softness_bayes.touch.readings import ALTERNATIVES
from softness_bayes.touch.stress import (
    ATTENUATED,
    AXISYMMETRIC,
    HERTZ,
    LINE,
    PRINCIPAL,
    PRINTED_KERNEL,
    PRINTED_PRESSURE,
    Component,
    stress,
    unit_stress,
)
from support.paths import REFERENCE

KERNELS = list(ALTERNATIVES["stress_kernel"].values())


def ids(values):
    return ["-".join(part.name for part in value) if isinstance(value, tuple) else value.name for value in values]


def component(index):
    """A reading that picks one of (sigma_x, sigma_z, tau_xz)."""
    return Component("one", lambda *stresses: stresses[index], needs_plane=True, far_power=None)


def johnson(x, z, a):
    """Stresses (sigma_x, sigma_z, tau_xz), compression positive, under a line contact with the pressure
    sqrt(1 - s²/a²): the closed form of Johnson (1985), section 4.5."""
    above = a**2 - x**2 + z**2
    larger = np.sqrt(0.5 * (np.hypot(above, 2 * x * z) + np.abs(above)))
    # m n = x z gives the smaller one without cancellation
    m, n = np.where(above > 0, larger, x * z / larger), np.where(above > 0, x * z / larger, larger)
    ratio = (z**2 + n**2) / (m**2 + n**2)
    return (m * (1 + ratio) - 2 * z) / a, m * (1 - ratio) / a, n * (m**2 - z**2) / (m**2 + n**2) / a


def exact_unit_stress(rho, z, a, decay, kernel):
    """Vertical stress in extended precision, from the integrals of model.md 5; adaptive around every scale."""
    with mpmath.workdps(20):
        rho, z, a, decay = (mpmath.mpf(float(v)) for v in (rho, z, a, decay))
        away = mpmath.sqrt(rho**2 + z**2) if kernel is PRINTED_KERNEL else rho

        def line(s):
            return 2 * z**3 / mpmath.pi / ((away - s) ** 2 + z**2) ** 2

        def ring(s):
            # the angle's integral of 1/d^5 in closed form, d² = rho² + s² + z² - 2 rho s cos
            near, far = (rho - s) ** 2 + z**2, (rho + s) ** 2 + z**2
            e, k = mpmath.ellipe(1 - near / far), mpmath.ellipk(1 - near / far)
            angle = 4 * (2 * (near + far) * e - near * k) / (3 * near**2 * far ** mpmath.mpf(1.5))
            return 3 * z**3 / (2 * mpmath.pi) * s * angle

        influence = line if kernel.two_sided else ring

        def integrand(phi):  # s = a sin(phi) removes the edges' square root
            share = a * mpmath.cos(phi) ** 2 * mpmath.exp(-decay * mpmath.sin(phi) ** 2)
            return share * influence(a * mpmath.sin(phi))

        scales = [z * 5**k for k in range(-1, 12)] + [a / mpmath.sqrt(1 + decay) * k for k in (1, 3, 8)]
        cuts = {c + sign * scale for c in (away, 0) for scale in (0, *scales) for sign in (1, -1)} | {a}
        lower = -a if kernel.two_sided else mpmath.mpf(0)
        inside = [lower, *sorted(cut for cut in cuts if lower < cut <= a)]
        return float(mpmath.quad(integrand, [mpmath.asin(s / a) for s in inside], method="gauss-legendre"))


def test_agrees_with_thirty_digit_reference():
    rows = json.loads((REFERENCE / "mechanics.json").read_text())["rows"]
    for row in rows:
        finger = Finger(radius=row["R"], poisson_ratio=row["nu_skin"], receptor_depth=row["z"])
        pressure = ALTERNATIVES["pressure"][row["pressure"]]
        kernel = ALTERNATIVES["stress_kernel"][row["kernel"]]
        found = stress(row["rho"], row["E_star"], row["contact_radius"], finger, pressure, kernel)
        assert found == pytest.approx(row["sigma"], rel=1e-12)


@pytest.mark.parametrize("depth", [1e-6, 1e-4, 0.7e-3, 1e-2])
def test_line_contact_has_johnsons_closed_form(depth, rng):
    a = 10 ** rng.uniform(-5, -1.5, (40, 1))
    rho = np.concatenate([np.zeros((40, 1)), a * rng.uniform(0, 3, (40, 12)), a], axis=1)
    sigma_x, sigma_z, tau = johnson(rho, depth, a)
    scale = np.abs(sigma_x) + np.abs(sigma_z) + np.abs(tau) + 1e-30
    for index, exact in enumerate((sigma_x, sigma_z, tau)):
        found = unit_stress(rho, depth, a, 0.0, LINE, component(index))
        # Johnson's form cancels like (depth / rho)^-3 far away
        np.testing.assert_allclose(found / scale, exact / scale, atol=1e-9)
    found = unit_stress(rho, depth, a, 0.0, LINE, PRINCIPAL)
    tensor = np.moveaxis(np.array([[sigma_x, tau], [tau, sigma_z]]), (0, 1), (-2, -1))
    np.testing.assert_allclose(found, np.linalg.eigvalsh(tensor)[..., -1], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("kernel", [LINE, PRINTED_KERNEL], ids=ids([LINE, PRINTED_KERNEL]))
def test_principal_stress_is_the_largest_eigenvalue(kernel, rng):
    rho, a, decay = rng.uniform(0, 0.02, 200), rng.uniform(1e-4, 2e-2, 200), 10 ** rng.uniform(-3, 3, 200)
    x, z, xz = (unit_stress(rho, 0.7e-3, a, decay, kernel, component(index)) for index in range(3))
    tensor = np.moveaxis(np.array([[x, xz], [xz, z]]), (0, 1), (-2, -1))
    largest = np.linalg.eigvalsh(tensor)[..., -1]
    np.testing.assert_allclose(unit_stress(rho, 0.7e-3, a, decay, kernel, PRINCIPAL), largest, rtol=1e-9)
    assert (largest >= z * (1 - 1e-12)).all()


@pytest.mark.parametrize("decay", [0.0, 1.0, 50.0, 1e4])
def test_stress_carries_the_pressure(decay):
    # vertical equilibrium: at every depth the stress adds up to the load
    a, depth = 3e-3, 0.7e-3
    node, weight = np.polynomial.legendre.leggauss(500)
    bound = 60.0
    rho = depth * np.sinh(0.5 * np.arcsinh(bound / depth) * (node + 1))
    weight = weight * 0.5 * np.arcsinh(bound / depth) * np.sqrt(rho**2 + depth**2)
    s = 0.5 * a * (node + 1)
    pressure = np.sqrt(1 - (s / a) ** 2) * np.exp(-decay * (s / a) ** 2)
    ds = 0.5 * a * np.polynomial.legendre.leggauss(500)[1]
    line = weight @ unit_stress(rho, depth, a, decay, LINE)
    assert line == pytest.approx(ds @ pressure, rel=1e-7)
    rings = weight @ (unit_stress(rho, depth, a, decay, AXISYMMETRIC) * rho)
    assert rings == pytest.approx(ds @ (pressure * s), rel=1e-7)


@pytest.mark.parametrize("kernel", KERNELS, ids=ids(KERNELS))
def test_agrees_with_extended_precision_at_hard_points(kernel, rng):
    for depth, decay in itertools.product([1e-6, 1e-4, 0.7e-3, 1e-2], [0.0, 1.0, 1e3, 1e6]):
        a = 10 ** rng.uniform(-4, -1.7)
        for rho in (0.0, rng.uniform(0.5, 6) * a / math.sqrt(1 + decay), rng.uniform(0.2, 0.9) * a, a + depth):
            exact = exact_unit_stress(rho, depth, a, decay, kernel)
            found = float(unit_stress(rho, depth, a, decay, kernel))
            # Gauss's rule resolves a field against its own largest value
            largest = float(unit_stress(0.0, depth, a, decay, kernel))
            assert found == pytest.approx(exact, rel=1e-10, abs=1e-14 * largest), (depth, decay, a, rho)


def test_pressures_of_the_readings():
    finger, modulus, a = Finger(), 2e5, 3e-3
    force = hertz_force(np.array(modulus), np.array(a), finger)
    r = np.array([0.0, 1e-3, 2.9e-3, 3e-3, 4e-3])
    hertz = 2 * modulus / (np.pi * 8e-3) * np.sqrt(np.maximum(a**2 - r**2, 0))
    np.testing.assert_allclose(HERTZ(r, modulus, a, finger), hertz, rtol=1e-14)
    attenuated = hertz * np.exp(-(r**2) * force / (2.67e-3 * a))
    np.testing.assert_allclose(ATTENUATED(r, modulus, a, finger), attenuated, rtol=1e-13)
    # the paper's numbers: mm, N, MPa
    r_mm, a_mm, modulus_mpa = r * 1e3, 3.0, 0.2
    paper_force = 4 * a_mm**4 * modulus_mpa / 3
    printed = 2 * modulus_mpa / 8 * np.sqrt(np.maximum(a_mm**2 - r_mm**2, 0))
    printed = printed * np.exp(-(r_mm**2) * paper_force / (2.67 * a_mm))
    np.testing.assert_allclose(PRINTED_PRESSURE(r, modulus, a, finger), 1e6 * printed, rtol=1e-13)


def test_hertz_pressure_carries_the_force_and_attenuation_less():
    finger, modulus, a = Finger(), 2e5, 3e-3
    node, weight = np.polynomial.legendre.leggauss(400)
    phi = 0.25 * np.pi * (node + 1)
    r = a * np.sin(phi)
    ring = 2 * np.pi * r * a * np.cos(phi) * 0.25 * np.pi * weight
    force = hertz_force(np.array(modulus), np.array(a), finger)
    assert ring @ HERTZ(r, modulus, a, finger) == pytest.approx(float(force), rel=1e-12)
    assert ring @ ATTENUATED(r, modulus, a, finger) < 0.999 * force
