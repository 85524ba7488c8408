"""Probabilities of intervals by quadrature, from densities inside and their derivatives at both ends.

The derivatives at the ends are needed anyway for the derivatives of the probability with respect to the expectation.
The n inner points are the roots of the Jacobi polynomial for the weight (1 - x²)⁴. The rule is then exact for
polynomials of degree 2n + 7: a Gauss rule with two fixed nodes of multiplicity four (Stancu and Stroud, Math. Comp. 17,
384, 1963). It is faster than distribution functions; for Student's t it takes a quarter of the time.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.special import roots_jacobi

from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.pieces import blocks

FloatArray = NDArray[np.float64]

ORDERS = 4
"""Number of derivatives used at each end, including the density itself."""


class IntervalLimits(NamedTuple):
    """Limits of the intervals for which a given number of inner points is accurate to 1e-7."""

    inside: int
    """Number of points inside the interval."""
    widest: float
    """Width of the widest interval, in the smooth length of the law."""
    steepest: float
    """Largest change of the log density over the interval at the slope of either end."""


REACHES = (
    IntervalLimits(0, 0.55, 1.0),
    IntervalLimits(1, 1.1, 2.5),
    IntervalLimits(2, 1.7, 4.5),
    IntervalLimits(4, 2.8, 10.0),
    IntervalLimits(6, 4.0, 13.0),
    IntervalLimits(8, 5.0, 16.0),
)

LEAST = 1e-250
"""Smallest probability that the rule computes, relative to the density at 0; below it, digits may be lost."""


class Served(NamedTuple):
    """Probabilities of intervals divided by the density at 0, and a mask of rows where the rule is accurate."""

    probability: FloatArray
    """Shape (..., rows)."""
    slopes: tuple[FloatArray, ...]
    """Its first derivatives with respect to the expectation, in units of the spread, each (..., rows)."""
    good: NDArray[np.bool_]
    """True for rows in which the rule is accurate at all points, shape (rows,)."""


def by_rule(
    law: ErrorLaw,
    middle: FloatArray,
    half: FloatArray,
    narrowest: float,
    parameters: Any,
    least: float = LEAST,
    more: int = 0,
) -> Served:
    """Return the probabilities of intervals of errors, (..., rows), in units of the errors' spread.

    The arrays may have single precision; so have the results then.

    Parameters
    ----------
    law
        Law of the errors.
    middle, half
        Middles and half-widths of the intervals.
    narrowest
        Width below which differences of densities lose precision.
    parameters
        Parameters of the law, of batch shape (...).
    least
        Smallest probability, relative to the density at 0, that counts as accurate.
    more
        Number of derivatives beyond the fourth, 0 or 2.
    """
    longest = 2.0 * float((half / law.smooth(parameters)).max())
    steepest = law.steepest(parameters, float((np.abs(middle) + half).max())) * 2.0 * float(half.max())
    # a few rows that need another method take longer than more points for all
    reach = next((one for one in REACHES if one.widest >= longest and one.steepest >= steepest), REACHES[-1])
    points, weights, at_ends = rule(reach.inside)
    ends = np.stack([middle - half, middle + half])
    together = law.ends(ends, parameters, ORDERS - 1 + more)
    low, high = ([part[k] for part in together] for k in (0, 1))
    slopes = [one - other if k % 2 else other - one for k, (other, one) in enumerate(zip(low, high, strict=True))]
    f0, s0, b0, _ = low[:ORDERS]
    f1, s1, b1, _ = high[:ORDERS]
    _, rise, _, turn = slopes[:ORDERS]
    a0, a1, a2, a3 = at_ends.tolist()  # Python's numbers leave single precision as it is
    inner = (-a3 * turn) * half
    inner += a2 * (b0 + b1)
    inner *= half
    inner -= a1 * rise
    inner *= half
    inner += a0 * (f0 + f1)
    # points of few rows are evaluated together: each operation takes a minimum of time
    points, weights = points.reshape(-1, *(1,) * middle.ndim).astype(middle.dtype), weights.astype(middle.dtype)
    for some in blocks(reach.inside, middle.size):
        inner += np.tensordot(weights[some], law.kernel(middle + points[some] * half, parameters), 1)
    inner *= half
    wrong = (half < 0.5 * narrowest) | ~(inner > least)
    if longest > reach.widest:
        wrong |= half > 0.5 * reach.widest * law.smooth(parameters)
    if steepest > reach.steepest:
        steep = 0.5 * reach.steepest
        wrong |= (np.abs(s0) * half > steep * f0) | (np.abs(s1) * half > steep * f1)
    return Served(inner, tuple(slopes), ~in_any_draw(wrong))


def in_any_draw(rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return True for rows that are True in any draw, (..., rows) to (rows,)."""
    return np.asarray(rows.reshape(-1, rows.shape[-1]).any(axis=0))


@cache
def rule(inside: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return inner points in (-1, 1), their weights, and the weights of derivatives at -1 (at 1: alternating signs)."""
    points = roots_jacobi(inside, ORDERS, ORDERS)[0] if inside else np.zeros(0)
    size = 2 * ORDERS + inside + inside % 2
    basis = np.eye(size)
    rows = []
    for j in range(ORDERS):
        ends = legendre.legval(np.array([-1.0, 1.0]), legendre.legder(basis, j, axis=0) if j else basis)
        rows.append(ends[:, 0] + (-1.0) ** j * ends[:, 1])
    matrix = np.array([*rows, *legendre.legval(points, basis).T])
    # odd polynomials vanish by symmetry; points at +x and -x have equal weights
    pairs = (inside + 1) // 2
    if inside:
        matrix = np.concatenate([matrix[:ORDERS], matrix[ORDERS : ORDERS + pairs] + matrix[: -pairs - 1 : -1]])
    weights = np.linalg.solve(matrix[:, ::2].T, 2.0 * np.eye(size // 2)[0])
    half = weights[ORDERS:]
    half[-1:] *= 2.0 if inside % 2 else 1.0  # the midpoint has no mirror image
    return points, np.concatenate([half, half[: inside // 2][::-1]]), weights[:ORDERS]
