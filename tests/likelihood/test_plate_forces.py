"""A rigid plate on fingerpads: the limit of the contact, the dense normal law, simulated and real forces."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from softness_bayes.base.errors import InputError
from softness_bayes.checking.checks import check_exponent
from softness_bayes.likelihood.contract import NO_RESPONSE, Parameters
from softness_bayes.likelihood.plate import PLATE_PARAMETERS, CompressionForces
from softness_bayes.touch.contact import (
    DISPLACEMENT,
    STRAIN,
    Finger,
    Indentation,
    plate_force,
    plate_line,
    solve_contact,
)

DEPTHS = np.array([0.5e-3, 1e-3, 1.5e-3, 2e-3])


def skin(*values):
    return Parameters(**dict(zip(PLATE_PARAMETERS, values, strict=True)))


TYPICAL = skin(8e3, 3.8, 0.3, 0.4, 0.1)

POINTS = {
    "usual": TYPICAL,
    "alike in m": TYPICAL.replace(tau_m=0.0),
    "alike": TYPICAL.replace(tau_b=0.0, tau_m=0.0),
    "far apart": TYPICAL.replace(tau_b=3.0, tau_m=5.0),
    "small error": TYPICAL.replace(varsigma_f=1e-3),
    "another skin": skin(1e5, 2.0, 0.5, 1.0, 0.3),
}


def forces(rng, fingers=5, rows=17, displacement=STRAIN):
    """An unbalanced set of forces: some fingers have one, others none."""
    finger = rng.integers(fingers, size=rows)
    depth = rng.choice(DEPTHS, rows) * rng.uniform(0.9, 1.1, rows)
    m = {STRAIN: 3.8, DISPLACEMENT: 630.0}[displacement]
    force = plate_force(depth, 8e3, m, displacement=displacement) * np.exp(0.3 * rng.standard_normal(rows))
    return CompressionForces(depth, force, finger, fingers, displacement=displacement)


def made_of(observed, rng, point, effects):
    """Forces of fingers with these departures."""
    return observed.replicate(rng, observed.drive(NO_RESPONSE, point), point, effects)


def dense(observed, p, displacement=STRAIN):
    """Mean and covariance of the log forces, written out row by row."""
    radius = np.sqrt(8e-3 * observed.indentation)
    u = radius / 8e-3 if displacement is STRAIN else observed.indentation
    skin = p.b * np.exp(p.m * u)
    mean = np.log(4 * skin / (1 - 0.48**2) * radius**3 / (3 * 8e-3))
    same = observed.finger[:, None] == observed.finger
    covariance = same * (p.tau_b**2 + p.tau_m**2 * np.outer(u, u)) + p.varsigma_f**2 * np.eye(u.size)
    return mean, covariance


@pytest.mark.parametrize("displacement", [STRAIN, DISPLACEMENT], ids=lambda d: d.name)
def test_a_plate_is_the_limit_of_ever_stiffer_fabrics(displacement):
    m = {STRAIN: 3.8, DISPLACEMENT: 630.0}[displacement]
    error = []
    for modulus in (1e9, 1e11, 1e13):
        stiff = [solve_contact(modulus, 0.3, Indentation(d), 8e3, m, displacement=displacement).force for d in DEPTHS]
        error.append(np.abs(np.log(np.array(stiff) / plate_force(DEPTHS, 8e3, m, displacement=displacement))).max())
    assert error[2] < 1e-7
    assert_allclose(error[:2], [error[2] * 1e4, error[2] * 1e2], rtol=0.05)  # like 1 / E_fab


def test_the_force_of_the_paper():
    """model.md 10: about 0.16 N at 1 mm on skin of 7.5 kPa that stiffens with 3.9; 1 N at 1 mm on 100 kPa and 2."""
    assert plate_force(1e-3, 7.5e3, 3.9) == pytest.approx(0.16, rel=0.1)
    assert plate_force(1e-3, 1e5, 2.0) == pytest.approx(1.0, rel=0.1)
    line = plate_line(1e-3, Finger(radius=4e-3, poisson_ratio=0.0))
    assert line.slope == pytest.approx(0.5)
    assert np.exp(line.offset) == pytest.approx(4 / 3 * 0.5 * 4e-6)


@pytest.mark.parametrize("point", [*POINTS.values(), skin(16e3, 630.0, 0.3, 100.0, 0.1)], ids=[*POINTS, "displacement"])
@pytest.mark.parametrize("size", [(5, 17), (1, 4), (6, 3), (1, 1), (2, 40)])
def test_likelihood_is_the_dense_normal_law(rng, size, point):
    displacement = DISPLACEMENT if point.m > 100 else STRAIN
    observed = forces(rng, *size, displacement)
    mean, covariance = dense(observed, point, displacement)
    expected = multivariate_normal(mean, covariance).logpdf(np.log(observed.values)) - np.log(observed.values).sum()
    assert observed.log_likelihood(NO_RESPONSE, point) == pytest.approx(expected, rel=1e-7, abs=1e-7)


def balanced(rng, point, fingers=6, depths=DEPTHS):
    depth, finger = np.tile(depths, fingers), np.repeat(np.arange(fingers), len(depths))
    blank = CompressionForces(depth, np.ones(depth.size), finger, fingers)
    made = made_of(blank, rng, point, blank.new_effects(rng, point, ()))
    return CompressionForces(depth, made, finger, fingers)


def test_the_exponent_is_that_of_a_power_law():
    depth, finger = np.tile(DEPTHS, 3), np.repeat([0, 1, 2], 4)
    observed = CompressionForces(depth, 7.0 * depth**2.2, finger, 3)
    # a scale of its own for each finger changes nothing
    assert observed.exponent(observed.values * np.exp(finger)) == pytest.approx(2.2)
    assert observed.exponent(np.stack([depth**1.5, depth**3])) == pytest.approx([1.5, 3.0])
    # of skin that does not stiffen it is Hertz's; of skin that does, more by m a / (2 R)
    assert observed.exponent(plate_force(depth, 8e3, 0.0)) == pytest.approx(1.5)
    assert 2.1 < observed.exponent(plate_force(depth, 8e3, 3.8)) < 2.3
    single = CompressionForces([1e-3, 1e-3], [0.1, 0.2], [0, 1], 2)
    assert np.isnan(single.exponent(single.values))
    assert np.isnan(check_exponent(single, np.ones((3, 2)), "", 0).force_exponent)


def test_the_check_accepts_its_model_and_refuses_another(rng):
    """Replicates of fingers drawn given the forces; forces that grow linearly are not of this skin."""
    n = 400
    point = TYPICAL.each(lambda value: np.full(n, value))

    def check(observed):
        again = made_of(observed, rng, point, observed.draw_effects(rng, NO_RESPONSE, point))
        return check_exponent(observed, again, "", 0)

    found = [check(balanced(rng, TYPICAL)) for _ in range(20)]
    assert sum(one.force_p_value < 0.05 for one in found) <= 4
    assert found[0].force_exponent > 1.5
    assert found[0].forces_per_finger == 4
    right = balanced(rng, TYPICAL)
    # no noise that TYPICAL allows for explains saturation at every depth
    wrong = CompressionForces(right.indentation, 0.2 * (right.indentation / 1e-3) ** 0.3, right.finger, 6)
    assert check(wrong).force_p_value < 0.05


@pytest.mark.parametrize(
    ("depth", "force", "message"),
    [([], [], "there are no forces"), ([1e-3], [0.0], "a force is not"), ([0.0], [1.0], "an indentation is not")],
)
def test_forces_that_are_none_are_refused(depth, force, message):
    with pytest.raises(InputError, match=message):
        CompressionForces(depth, force, np.zeros(len(depth), int), 1)
