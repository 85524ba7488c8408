"""Rules of the population integral: exact for polynomials times any resolved gain, and better than the former ones."""

import numpy as np
import pytest
from scipy.integrate import quad

from softness_bayes.touch.population import RISE, gain_nodes, to_peak, to_saturation

EXTENT = 6.0


def gain(u):
    """A gain in u = t² that is no polynomial in t, with the fall of a saturating rate and a root at the onset."""
    t = np.sqrt(u)
    return np.exp(-u) * (1.0 + 0.5 * np.cos(2.0 * t)) / (2.0 * t)


def by_rule(rule, count, extent, gains):
    t, _ = gain_nodes(gains)
    return extent * (rule.weights @ gain(extent * t**2)) @ count(extent * rule.nodes)


def exactly(count, extent):
    return quad(lambda t: 2.0 * t * gain(t**2) * count(t**2), 0.0, np.sqrt(extent), epsabs=1e-13, epsrel=1e-13)[0]


@pytest.mark.parametrize("nodes", [3, 5, 8])
def test_polynomials_of_the_nodes_are_exact_whatever_the_gain(nodes, rng):
    saturation, peak = to_saturation(nodes, 30, EXTENT), to_peak(nodes, 30)
    polynomial = np.polynomial.Polynomial(rng.normal(size=nodes))
    assert by_rule(saturation, polynomial, EXTENT, 30) == pytest.approx(exactly(polynomial, EXTENT), rel=1e-11)
    falling = polynomial * np.polynomial.Polynomial([EXTENT, -1.0])
    assert by_rule(peak, falling, EXTENT, 30) == pytest.approx(exactly(falling, EXTENT), rel=1e-11)
    # of a higher degree than the nodes determine: not exact for this gain
    beyond = np.polynomial.Polynomial([0.0] * (2 * nodes + 2) + [1.0])
    assert by_rule(saturation, beyond, 1.0, 30) != pytest.approx(exactly(beyond, 1.0), rel=1e-6)


@pytest.mark.parametrize("nodes", [3, 5, 8])
def test_gauss_for_the_typical_gain(nodes):
    """Twice as many degrees are exact for the gain that the nodes were made for."""

    def typical(u):
        return RISE * np.exp(-u) * (-np.expm1(-u)) ** (RISE - 1.0)

    rule, (t, weight) = to_saturation(nodes, 400, EXTENT), gain_nodes(400)
    weights = EXTENT * rule.weights @ typical(EXTENT * t**2)
    for degree in range(2 * nodes - 2):
        wanted = EXTENT * (2.0 * t * weight * typical(EXTENT * t**2)) @ t ** (2 * degree)
        assert weights @ rule.nodes**degree == pytest.approx(wanted, rel=1e-9)
