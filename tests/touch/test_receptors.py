from __future__ import annotations

import itertools

import mpmath
import numpy as np
import pytest

from softness_bayes.touch.contact import Finger
from softness_bayes.touch.readings import ALTERNATIVES
from softness_bayes.touch.receptors import (
    CONSISTENT,
    PRINTED_DENSITY,
    ReceptorCount,
    receptor_current,
    receptors_within,
)

DENSITIES = list(ALTERNATIVES["receptor_density"].values())
CENTRES = {
    "paper": (12e-3, 10e-3),
    "inside": (3e-3, 17.2e-3),
    "distal edge": (0.0, 10e-3),
    "proximal edge": (30e-3, 4e-3),
    "side": (20e-3, 20e-3),
    "corner": (0.0, 0.0),
    "far corner": (30e-3, 20e-3),
    "almost an edge": (1e-6, 10e-3),
    "near an edge": (0.3e-3, 10.1e-3),
    "almost a corner": (29.99e-3, 1e-7),
}


@pytest.fixture(params=CENTRES, ids=list(CENTRES))
def finger(request):
    return Finger(contact_centre=CENTRES[request.param])


def brute_force(distance, finger, density):
    """Receptors within a distance: the disc's chords across the pad, summed along it by the trapezium rule in
    an angle that removes the ends' square root. The chord's kinks limit it to about 1e-6."""
    x, y = finger.contact_centre
    ends = np.clip([-x / max(distance, 1e-30), (finger.pad_length - x) / max(distance, 1e-30)], -1, 1)
    psi = np.linspace(*np.arcsin(ends), 200_001)
    along, half_chord = x + distance * np.sin(psi), distance * np.cos(psi)
    chord = np.minimum(y + half_chord, finger.pad_width) - np.maximum(y - half_chord, 0)
    return np.trapezoid(density.at(along) * chord * half_chord, psi)


def test_densities_of_the_paper():
    # the largest, smallest and mean density per square centimetre, and the number of receptors (model.md 8)
    x = np.linspace(0, 30e-3, 100_001)
    consistent, printed = CONSISTENT.at(x) * 1e-4, PRINTED_DENSITY.at(x) * 1e-4
    assert consistent[0] == pytest.approx(70.225, abs=1e-12)
    assert CONSISTENT.at(np.array(1.0)) * 1e-4 == pytest.approx(7.95, abs=1e-12)
    assert np.trapezoid(consistent, x) / 30e-3 == pytest.approx(41.605, abs=0.01)
    assert printed[0] == pytest.approx(70.225, abs=0.02)
    assert np.trapezoid(printed, x) / 30e-3 == pytest.approx(22.0, abs=0.05)
    assert (np.diff(consistent) < 0).all()


@pytest.mark.parametrize("density", DENSITIES, ids=lambda density: density.name)
def test_receptors_within_a_distance(finger, density):
    distances = np.array([0.0, 1e-7, 0.2e-3, 1e-3, 4e-3, 9.9e-3, 10.1e-3, 14e-3, 19e-3, 23e-3, 33e-3, 40e-3])
    found = receptors_within(distances, finger, density)
    brute = [brute_force(distance, finger, density) for distance in distances]
    np.testing.assert_allclose(found, brute, atol=2e-5)
    assert found[0] == 0


@pytest.mark.parametrize("density", DENSITIES, ids=lambda density: density.name)
def test_polynomials_of_the_count(finger, density):
    count = ReceptorCount(finger, density)
    starts = np.concatenate([[0.0], count.kinks[:-1]])
    for interval, (start, end) in enumerate(zip(starts, count.kinks, strict=True)):
        distance = start + (end - start) * np.concatenate([[0, 1e-12, 1e-6], np.linspace(1e-3, 1, 400)])
        found = count(distance**2, interval)
        np.testing.assert_allclose(found, receptors_within(distance, finger, density), atol=2e-5)
    assert count.total == pytest.approx(float(receptors_within(1.0, finger, density)), rel=1e-13)


def test_current_against_its_formula(rng):
    sigma, sigma_0, beta = rng.uniform(0, 3e4, 50), rng.uniform(5e3, 15e3, 50), rng.uniform(1e-4, 1e-3, 50)
    formula = 20.3 / (1 + np.exp(beta * (sigma_0 - sigma)))
    np.testing.assert_allclose(receptor_current(sigma, 20.3, beta, sigma_0), formula, rtol=1e-12)
    assert receptor_current(9e3, 20.3, 0.6e-3, 9e3) == 20.3 / 2
    # at any finite stress and steepness, without a warning
    for stress, threshold, steep in itertools.product((-1e308, 0.0, 1e308), (-1e308, 9e3, 1e308), (1e-308, 1.0, 1e308)):
        with mpmath.workdps(60):
            u = mpmath.mpf(steep) * (mpmath.mpf(stress) - mpmath.mpf(threshold))
            exact = 20.3 / (1 + mpmath.exp(-u)) if abs(u) < 1e6 else 20.3 * (u > 0)
        assert float(receptor_current(stress, 20.3, steep, threshold)) == pytest.approx(float(exact), abs=2e-11)
