"""Integrals over all effects of raters whose answers differ, on dense points, for few rows of laws with heavy tails.

With few rows a rater's exponent and noise are hardly known: their nodes are those of the prior, and the points of the
level and of raters' scales are those of `dense_integrals`. It is the reference of `own_integrals` for such tables.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.dense_integrals import DenseIntegrals
from softness_bayes.likelihood.mu_nodes import draw_index
from softness_bayes.likelihood.own_draws import PROPOSALS, log_of_raters
from softness_bayes.likelihood.own_integrals import OwnIntegrals
from softness_bayes.likelihood.quadrature import Quadrature, gauss_hermite
from softness_bayes.likelihood.rater_grids import Part
from softness_bayes.likelihood.rater_integrals import RaterIntegrals
from softness_bayes.likelihood.rater_rows import RowParameters

FloatArray = NDArray[np.float64]

EXPONENTS, NOISES = 15, 11
"""Nodes of a rater's exponent and noise."""

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


class OwnDenseIntegrals(DenseIntegrals, OwnIntegrals):
    """The integrals over the level and raters' scales, exponents and noise on dense points."""

    def _prior_nodes(self, given: RowParameters) -> Iterator[tuple[RowParameters, float]]:
        """Return the parameters at nodes of raters' exponents and noise, with their log weights."""
        one = np.ones((len(given.drive), self.count.size))
        sizes = EXPONENTS if "gamma" in self.differ else 1, NOISES if self.noisy else 1
        (x, of_x), (z, of_z) = ((x, weight - 0.5 * x**2 - _LOG_ROOT_TWO_PI) for x, weight in map(gauss_hermite, sizes))
        for w, of_w in zip(z, of_z, strict=True):
            for u, of_u in zip(x, of_x, strict=True):
                yield self.at_node(given, u * one, w * one), float(of_u + of_w)

    def values(self, given: RowParameters, a: FloatArray) -> FloatArray:
        """Return the log densities of raters at points (draws, points, raters), exponents and noise integrated out."""
        if given.own is None:
            return RaterIntegrals.values(self, given, a)
        found = np.full(a.shape, -np.inf)
        for own, log_weight in self._prior_nodes(given):
            np.logaddexp(found, RaterIntegrals.values(self, own, a) + log_weight, out=found)
        return found

    def parts(self, given: RowParameters) -> Iterator[Part]:
        """Return points of all raters' scales at each node, with weights given all other raters."""
        grid, log_weight = self.law_of_others(given)
        for own, of_node in self._prior_nodes(given):
            yield Part(own, grid, log_weight + of_node)

    def draw(
        self, rng: np.random.Generator, given: RowParameters, quadrature: Quadrature
    ) -> tuple[FloatArray, FloatArray]:
        """Equivalent of `OwnIntegrals.draw`; exponents and noise by importance resampling from the prior."""
        level, moved = DenseIntegrals.draw(self, rng, given, quadrature)
        u, w = (
            rng.standard_normal((PROPOSALS, *moved.shape)) if name in self.differ else np.zeros((1, *moved.shape))
            for name in ("gamma", "varsigma")
        )
        value = log_of_raters(self, given, level + moved, u, w)
        chosen = draw_index(rng, value)[None]
        u, w = (np.take_along_axis(np.broadcast_to(one, value.shape), chosen, axis=0)[0] for one in (u, w))
        return level, np.concatenate([moved, u, w], axis=-1)
