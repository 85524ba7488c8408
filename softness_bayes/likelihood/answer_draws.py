"""Draws of the common mean and of individual exponents, noise levels and scales of raters, given all ratings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.answer_nodes import (
    AnswerModes,
    AnswerSpreads,
    MuNodes,
    RaterStatistics,
    at_scores,
    rule,
    terms_at,
)
from softness_bayes.likelihood.mu_nodes import draw_index, log_sum

FloatArray = NDArray[np.float64]

REACH, POINTS = 7.0, 101
"""Half-width of the grids about a mode, in standard deviations, and their number of points. Draws are uniform within a
cell, which adds (2 REACH / POINTS)² / 12 = 0.0016 to a variance of 1."""


def draw_own(
    rng: np.random.Generator,
    sums: RaterStatistics,
    spreads: AnswerSpreads,
    modes: AnswerModes,
    nodes: MuNodes,
    raters: FloatArray,
    counts: tuple[int, int],
    level: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Draw mu (relative to its prior mean) and raters' deviations: scales, log exponents, log noise.

    Parameters
    ----------
    sums, spreads, modes, nodes
        The raters, the spreads, and the nodes.
    raters
        Each rater's log density at the nodes of mu, shape (nodes, points, raters).
    counts
        Numbers of nodes for exponents and noise; 1 for a quantity that does not differ between raters.
    level
        Prior standard deviation of mu.

    Returns
    -------
    mu, scale, log_gamma, log_varsigma : ndarray
        Shapes (points, 1), then (points, raters) for the other three.
    """
    at = draw_index(rng, nodes.log_weight + raters.sum(axis=-1))
    mu = np.take_along_axis(nodes.mu, at[None], axis=0)[0][:, None]
    x, z = np.zeros((1, *modes.u.shape)), np.zeros((1, *modes.u.shape))
    grid = np.linspace(-REACH, REACH, POINTS)
    if counts[1] > 1:
        # noise first, with the exponent integrated out at each grid point
        inner, log_weight = (values[:, None, None, None] for values in rule(counts[0]))
        density = _log_density(sums, spreads, modes, mu, inner, grid[:, None, None])
        z = _within(rng, draw_index(rng, log_sum(density + log_weight, axis=0)), grid)[None]
    if counts[0] > 1:
        density = _log_density(sums, spreads, modes, mu, grid[:, None, None], z)
        x = _within(rng, draw_index(rng, density), grid)[None]
    u, w = (score[0] for score in at_scores(modes, x, z))
    terms = terms_at(sums, spreads, u[None], w[None], 0.0)
    gap, precision = terms.gap[0], terms.precision[0]
    information = precision.sum(axis=-1, keepdims=True) + level**-2
    mu = (precision * gap).sum(axis=-1, keepdims=True) / information
    mu = mu + rng.standard_normal(mu.shape) / np.sqrt(information)
    # the scale given all else: tau² is its share of the variance of the gap
    share = spreads.scale**2 * precision
    sd = spreads.scale * np.sqrt(np.maximum(1.0 - share, 0.0))
    scale = share * (gap - mu) + sd * rng.standard_normal(gap.shape)
    return mu, scale, spreads.exponent * u, spreads.noises * w


def _log_density(
    sums: RaterStatistics, spreads: AnswerSpreads, modes: AnswerModes, mu: FloatArray, x: FloatArray, z: FloatArray
) -> FloatArray:
    """Return each rater's log density at scores about the modes, given mu, up to a constant per rater."""
    terms = terms_at(sums, spreads, *at_scores(modes, x, z), 0.0)
    return terms.log_term - 0.5 * terms.precision * (terms.gap - mu) ** 2


def _within(rng: np.random.Generator, index: NDArray[np.intp], grid: FloatArray) -> FloatArray:
    """Return points drawn within the cells of a grid."""
    step = grid[1] - grid[0]
    return np.asarray(grid[index] + step * (rng.random(index.shape) - 0.5))
