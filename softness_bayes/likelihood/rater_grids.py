"""Points of raters' scales given all other raters, and laws of rows and raters that are left out (model.md 9).

The points cover the law of a rater's level plus scale even without any one row. Raters with exponents or noise of their
own have several sets of points, one for each node of these (`own_left_out`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.interval_law import derivatives
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.rater_rows import RowParameters
from softness_bayes.likelihood.row_scores import below
from softness_bayes.likelihood.scale_modes import ScaleModes

FloatArray = NDArray[np.float64]
Integrals = Any
"""`rater_integrals.RaterIntegrals` or its kinds."""

REACH = 6.0
"""Extent of the points to either side of the mode, in standard deviations."""

POINTS = 41
"""Number of points."""


class Part(NamedTuple):
    """A set of points of all raters' scales, level included."""

    given: RowParameters
    """Parameters at which rows have their probabilities."""
    grid: FloatArray
    """Shape (draws, points, raters)."""
    log_weight: FloatArray
    """Log weights of the points given all other raters, same shape."""


def law_of_others(integrals: Integrals, given: RowParameters, modes: ScaleModes) -> tuple[FloatArray, FloatArray]:
    """Return points of a_p and their log weights given all other raters' rows, each (draws, points, raters).

    The level's distribution given the other raters is approximated as normal.
    """
    precision, prior = modes.shrink * modes.curvature, integrals.sd**-2.0
    rest = np.maximum(precision.sum(axis=-1, keepdims=True) - precision, 0.0) + prior
    pull = modes.shrink * modes.pull
    mean = (integrals.mean * prior + pull.sum(axis=-1, keepdims=True) - pull) / rest
    variance = 1.0 / rest + given.tau**2
    grid = points_about(integrals, given, modes.a, variance, POINTS, modes.curvature)
    law = -0.5 * (grid - mean[:, None]) ** 2 / variance[:, None] - 0.5 * np.log(2.0 * np.pi * variance)[:, None]
    return grid, law + np.log(grid[:, 1:2] - grid[:, :1])


def points_about(
    integrals: Integrals,
    given: RowParameters,
    a: FloatArray,
    variance: FloatArray,
    count: int,
    curvature: FloatArray | None = None,
) -> FloatArray:
    """Return points of a_p that cover its law even without any one row, (draws, count, raters).

    Parameters
    ----------
    integrals, given
        The rows.
    a, variance
        The most probable a_p, and its variance given all other raters, each (draws, raters).
    count
        Number of points.
    curvature
        Minus the second derivative of each rater's log density at a; by default the sum over those of its rows that are
        concave.
    """
    rows = derivatives(integrals.law, given.rows, given.drive + a[:, integrals.rater], given.spread, given.parameters)
    bent = np.maximum(-rows[2], 0.0)
    curved, steep = (np.maximum.reduceat(one, integrals.first, axis=-1) for one in (bent, np.abs(rows[1])))
    whole = integrals.of_raters(bent) if curvature is None else curvature
    rest = 1.0 / (1.0 / variance + np.maximum(whole - curved, 0.0))
    width = REACH * np.sqrt(rest) + steep * rest
    return a[:, None] + np.linspace(-1.0, 1.0, count)[:, None] * width[:, None]


def log_of_rows(integrals: Integrals, given: RowParameters) -> FloatArray:
    """Return the log probability of each row given all others, shape (draws, rows), rows sorted by rater."""
    whole, rest = (np.full(given.drive.shape, -np.inf) for _ in range(2))
    for part in integrals.parts(given):
        weight, values = _without(integrals, part)
        np.logaddexp(rest, log_sum(weight, axis=1), out=rest)
        weight += values
        np.logaddexp(whole, log_sum(weight, axis=1), out=whole)
    return whole - rest


def below_rows(integrals: Integrals, given: RowParameters) -> FloatArray:
    """Return the probability below each row given all others, as `row_scores.below`, shape (draws, rows)."""
    rest, under = (np.full(given.drive.shape, -np.inf) for _ in range(2))
    for part in integrals.parts(given):
        weight, _ = _without(integrals, part)
        np.logaddexp(rest, log_sum(weight, axis=1), out=rest)
        own, of_law = part.given, part.given.parameters.at_points()
        expected = own.drive[:, None] + part.grid[..., integrals.rater]
        with np.errstate(divide="ignore"):
            weight += np.log(below(integrals.law, own.rows.at_points(), expected, own.spread[:, None], of_law))
        np.logaddexp(under, log_sum(weight, axis=1), out=under)
    return np.exp(under - rest)


def log_of_raters(integrals: Integrals, given: RowParameters) -> FloatArray:
    """Return the log density of each rater's rows given all other raters', shape (draws, raters)."""
    found = np.full((len(given.drive), integrals.count.size), -np.inf)
    for part in integrals.parts(given):
        density = log_sum(part.log_weight + integrals.values(part.given, part.grid), axis=1)
        np.logaddexp(found, density, out=found)
    return found


def _without(integrals: Integrals, part: Part) -> tuple[FloatArray, FloatArray]:
    """Return log weights of the points without each row, and its log probability there, (draws, points, rows)."""
    values = integrals.row_values(part.given, part.grid)
    whole = part.log_weight + integrals.of_raters(values)
    return whole[..., integrals.rater] - values, values
