"""Quadrature rules of the population integral, made for its integrands (model.md 8).

The integrand is the gain dnu/du of the rate, which a parameter vector determines, times the number M of receptors
within a patch, which differs between conditions and costs most. In u the number M is so smooth that a polynomial
through a few nodes replaces it. The gain needs more nodes, but it is evaluated less often:

    ∫ M gain du  ≈  sum_j M(u_j) ∫ L_j gain du,    L_j the Lagrange polynomials of the nodes u_j

The integrals of L_j gain use Gauss's rule in t = sqrt(u), in which the gain has no singularity. With the nodes u_j the
rule is Gauss's for a typical gain.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

RISE = 0.75
"""Power of 1 - exp(-u) to which a typical rate is proportional: firing rates grow faster than the root of the current
above the rheobase, whose power is 0.5."""

FINE = 200
"""Points at which a typical gain is integrated."""


class Rule(NamedTuple):
    """One rule, over a range of u scaled to [0, 1]."""

    nodes: Array
    """Nodes at which M is evaluated, shape (nodes,); the first is 0."""
    weights: Array
    """Weights of M at each node are these times the gains in u at the squared `gain_nodes`, shape (nodes, gains)."""


@lru_cache(maxsize=64)
def gain_nodes(gains: int) -> tuple[Array, Array]:
    """Return nodes and weights of Gauss's rule in t, scaled to [0, 1]; they are not to be written to."""
    x, weight = legendre.leggauss(gains)
    node, weight = 0.5 * (x + 1.0), 0.5 * weight
    node.flags.writeable = weight.flags.writeable = False
    return node, weight


def to_peak(nodes: int, gains: int) -> Rule:
    """Return the rule from the onset to the peak, where M falls to 0 in proportion to the remaining u.

    M divided by the remaining u is interpolated, and the gain is taken as even.
    """
    t, weight = gain_nodes(gains)
    fine, of_fine = gain_nodes(FINE)
    at = np.append(0.0, _zeros(nodes - 1, fine**2, of_fine * fine**2 * (1.0 - fine**2)))
    left = (1.0 - t**2) / (1.0 - at[:, None])
    return Rule(at, _lagrange(at, t**2) * left * (2.0 * t * weight))


def to_saturation(nodes: int, gains: int, extent: float) -> Rule:
    """Return the rule over u from 0 to `extent`, the last node; a typical rate is (1 - exp(-u)) to the power `RISE`."""
    t, weight = gain_nodes(gains)
    fine, of_fine = gain_nodes(FINE)
    lost = -np.expm1(-extent * fine**2)
    typical = of_fine * fine * (1.0 - lost) * lost ** (RISE - 1.0)
    inside = _zeros(nodes - 2, fine**2, typical * fine**2 * (1.0 - fine**2))
    at = np.concatenate([[0.0], inside, [1.0]])
    return Rule(at, _lagrange(at, t**2) * (2.0 * t * weight))


def _zeros(degree: int, points: Array, weight: Array) -> Array:
    """Return the zeros of the orthogonal polynomial of some degree for a discrete measure on [0, 1], increasing.

    They are the eigenvalues of multiplication by the argument, among the polynomials of lower degree.
    """
    if not degree:
        return np.empty(0)
    basis, _ = np.linalg.qr(np.sqrt(weight)[:, None] * chebyshev.chebvander(2.0 * points - 1.0, degree - 1))
    return np.linalg.eigvalsh(basis.T @ (points[:, None] * basis))


def _lagrange(nodes: Array, at: Array) -> Array:
    """Return the values of every node's Lagrange polynomial, shape (nodes, points)."""
    own = np.eye(nodes.size, dtype=bool)
    apart = np.where(own, 1.0, nodes[:, None] - nodes)
    shares = np.where(own[..., None], 1.0, (at - nodes[:, None]) / apart[..., None])
    return np.asarray(shares.prod(axis=1))
