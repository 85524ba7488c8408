"""Draws that are exchangeable with a given draw of a density, whether or not chains converge.

A chain with a reversible kernel runs from the given draw for a number of steps, to a point in the past of a chain
through that draw. Other chains then run from this point for as many steps. Their last points and the given draw are
exchangeable, so that the rank of the given draw among them is uniform (the parallel method of Besag and Clifford,
Biometrika 76, 633, 1989; Gandy and Scott, arXiv:2001.06465). The number of steps affects the power of a test, because
points of chains that mix slowly are close to each other, but never its validity.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.moves import Student

FloatArray = NDArray[np.float64]

STEPS = 4_000
"""Number of steps of every chain."""

_INDEPENDENT = 0.25  # share of proposals that do not depend on the position
_FACTORS = (1.0, 0.3, 0.1, 0.03)  # lengths of steps, in those that suit a normal density


class ReversibleKernel:
    """A reversible kernel made of two kinds of proposals in the coordinates of a map, for many chains at once.

    Parameters
    ----------
    density
        Log density of points (points, dimension), shape (points,).
    archive
        Points, shape (points, dimension), from which the map is learnt, and whose differences are proposed as steps.
        They may depend on everything except the given draw, and need not be draws of the density.
    """

    def __init__(self, density: Callable[[FloatArray], FloatArray], archive: FloatArray) -> None:
        self._density = density
        self._map = TriangularMap.fit(archive, float(len(archive)))
        self._archive = self._map.inverse(archive)
        self._law = Student()

    def walk(self, z: FloatArray, steps: int, rng: np.random.Generator) -> FloatArray:
        """Return the points reached from ``z`` of shape (chains, dimension) after a number of steps."""
        y = self._map.inverse(z)
        at = self._density(z) + self._map.log_volume(y)
        for _ in range(steps):
            proposed, ratio = self._proposed(y, rng)
            found = self._density(self._map.forward(proposed)) + self._map.log_volume(proposed)
            with np.errstate(invalid="ignore"):
                accepted = np.log(rng.random(len(z))) < np.nan_to_num(found, nan=-np.inf) - at + ratio
            y, at = np.where(accepted[:, None], proposed, y), np.where(accepted, found, at)
        return self._map.forward(y)

    def _proposed(self, y: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return a proposal for each chain, and the log ratio of proposal densities, old over new."""
        chains, dimension = y.shape
        # each chain chooses for itself: a choice that chains share would make them depend on one another
        alone = np.asarray(rng.random(chains) < _INDEPENDENT)
        elsewhere, ratio = self._law(y, rng)
        first, second = rng.integers(len(self._archive), size=(2, chains))
        factor = rng.choice(_FACTORS, chains) * 2.38 / np.sqrt(2.0 * dimension)
        near = y + factor[:, None] * (self._archive[first] - self._archive[second])
        return np.where(alone[:, None], elsewhere, near), np.where(alone, ratio, 0.0)


def exchangeable_draws(
    density: Callable[[FloatArray], FloatArray],
    draw: FloatArray,
    archive: FloatArray,
    count: int,
    rng: np.random.Generator,
    steps: int = STEPS,
) -> FloatArray:
    """Return draws that are exchangeable with a given draw, shape (count, dimension).

    Parameters
    ----------
    density, archive
        As for `ReversibleKernel`.
    draw
        The given draw of the density, shape (dimension,).
    count
        Number of draws.
    rng
        Random generator.
    steps
        Number of steps of every chain.
    """
    kernel = ReversibleKernel(density, archive)
    past = kernel.walk(draw[None], steps, rng)
    return kernel.walk(np.repeat(past, count, axis=0), steps, rng)
