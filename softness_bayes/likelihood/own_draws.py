"""Draws of the level and of raters' scales, exponents and noise given all ratings, for any error law (model.md 9)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.interval_law import log_probability
from softness_bayes.likelihood.mu_nodes import draw_index, draw_on
from softness_bayes.likelihood.own_laws import OwnLaw, factor
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.quadrature import ROUGHLY
from softness_bayes.likelihood.rater_grids import REACH
from softness_bayes.likelihood.rater_integrals import LEVELS
from softness_bayes.likelihood.rater_rows import RowParameters

FloatArray = NDArray[np.float64]

PROPOSALS = 64
"""Number of draws of a rater's effects among which one is chosen by weight (importance resampling)."""

_WIDER = 1.15  # standard deviations of the proposals, relative to those of the normal law


def draw_effects(
    rng: np.random.Generator, integrals: Any, given: RowParameters, law: OwnLaw
) -> tuple[FloatArray, FloatArray]:
    """Return draws of the level, (draws, 1), and of each rater's a_p less the level, u and w, (draws, 3 raters).

    The level is drawn from its density at points; a rater's effects by importance resampling from their normal law
    given the level.
    """
    x = law.mean.level + np.linspace(-REACH, REACH, LEVELS) / np.sqrt(law.precision)
    each = integrals.at_these_levels(given, law, x, ROUGHLY)
    level = draw_on(rng, x, each.sum(axis=-1) + integrals.log_prior(x))[:, None]
    found = np.empty((3, len(level), integrals.count.size))
    for piece in pieces(len(level), PROPOSALS * integrals.rater.size):
        found[:, piece] = _of_raters(rng, integrals, given.part(piece), law.part(piece), level[piece])
    found[0] *= given.tau
    return level, np.concatenate(list(found), axis=-1)


def _of_raters(
    rng: np.random.Generator, integrals: Any, given: RowParameters, law: OwnLaw, level: FloatArray
) -> FloatArray:
    """Return each rater's effects in standard deviations of their priors, shape (3, draws, raters)."""
    root = np.linalg.cholesky(law.covariance)
    score = rng.standard_normal((PROPOSALS, *law.covariance.shape[:-1]))
    moved = law.to_level * (level - law.mean.level)[..., None]
    mean = np.stack([law.mean.scale, law.mean.u, law.mean.w], axis=-1) - moved
    effects = mean + _WIDER * (root @ score[..., None])[..., 0]
    for k, name in enumerate(("gamma", "varsigma"), 1):
        if name not in integrals.differ:
            effects[..., k] = 0.0
            score[..., k] = 0.0
    scale, u, w = np.moveaxis(effects, -1, 0)
    value = log_of_raters(integrals, given, level + given.tau * scale, u, w)
    value += 0.5 * ((score**2).sum(axis=-1) - (effects**2).sum(axis=-1))
    chosen = draw_index(rng, value)
    return np.asarray(np.take_along_axis(np.moveaxis(effects, -1, 0), chosen[None, None], axis=1)[:, 0])


def log_of_raters(integrals: Any, given: RowParameters, a: FloatArray, u: FloatArray, w: FloatArray) -> FloatArray:
    """Return each rater's log density given a_p, u and w, each (..., draws, raters), of that shape."""
    own, rater = given.own, integrals.rater
    assert own is not None
    expected = a[..., rater] + factor(own.exponent * u)[..., rater] * given.drive
    spread = given.spread * factor(own.noise * w)[..., rater] if integrals.noisy else given.spread
    found: FloatArray = integrals.of_raters(
        log_probability(integrals.law, given.rows, expected, spread, given.parameters)
    )
    return found
