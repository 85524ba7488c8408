"""Separate modes of a density: the mode of each draw, and a map of each mode.

A mode starts as the normal law that matches an optimum. From a pilot walk it gets its own map, which may be curved;
draws are then assigned again, by the maps. Modes that overlap are merged.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap, learn
from softness_bayes.sampler.moves import Student

FloatArray = NDArray[np.float64]
Labels = NDArray[np.intp]

_ROUNDS = 10  # of assigning draws to modes and fitting the maps again
_FEWEST = 4  # distinct draws of a mode, for each dimension, below which its map is not fitted again
_NEAR = 3.0  # a draw belongs to two modes if their log densities differ by less
_SHARED = 0.1  # share of such draws above which two modes overlap

_LAW = Student()


def labels(modes: Sequence[TriangularMap], z: FloatArray) -> Labels:
    """Return the number of the mode that each point belongs to, shape (...), for ``z`` of shape (..., dimension)."""
    return np.asarray(_log_densities(modes, z.reshape(-1, z.shape[-1])).argmax(axis=0).reshape(z.shape[:-1]))


def learn_modes(
    modes: Sequence[TriangularMap], walks: FloatArray, log_density: FloatArray, tau: float, linear: int = 0
) -> tuple[TriangularMap, ...]:
    """Learn a map of each mode from a pilot walk, the mode with most draws first.

    Parameters
    ----------
    modes
        Maps of the modes so far.
    walks, log_density, tau, linear
        As `adaptation.learn` takes them.

    Returns
    -------
    tuple of TriangularMap
        One map for all draws if the modes turn out to be one.
    """
    draws, height = walks.reshape(-1, walks.shape[-1]), log_density.ravel()
    found = list(modes)
    while len(found) > 1:
        found, label = _mapped(found, draws, height, tau, linear)
        if (pair := _overlapping(found, label, draws)) is None:
            sizes = np.bincount(label, minlength=len(found))
            return tuple(found[k] for k in np.argsort(-sizes, kind="stable"))
        both = np.isin(label, pair)
        found = [mode for k, mode in enumerate(found) if k not in pair] + [
            learn(draws[both], height[both], tau, linear)
        ]
    return (learn(draws, height, tau, linear),)


def _mapped(
    modes: list[TriangularMap], draws: FloatArray, height: FloatArray, tau: float, linear: int
) -> tuple[list[TriangularMap], Labels]:
    """Fit maps and assign draws in turns until few draws change their mode."""
    label = labels(modes, draws)
    for _ in range(_ROUNDS):
        own = [label == k for k in range(len(modes))]
        enough = _FEWEST * draws.shape[-1]
        modes = [
            learn(draws[mine], height[mine], tau, linear) if len(np.unique(height[mine])) >= enough else mode
            for mode, mine in zip(modes, own, strict=True)
        ]
        before, label = label, labels(modes, draws)
        if (label != before).mean() < 1e-3:
            break
    return modes, label


def _overlapping(modes: Sequence[TriangularMap], label: Labels, draws: FloatArray) -> tuple[int, int] | None:
    """Return two modes of which many draws of one also belong to the other, or None."""
    density = _log_densities(modes, draws)
    for k, other in permutations(range(len(modes)), 2):
        mine = label == k
        if mine.any() and (density[other, mine] > density[k, mine] - _NEAR).mean() > _SHARED:
            return k, other
    return None


def _log_densities(modes: Sequence[TriangularMap], z: FloatArray) -> FloatArray:
    return np.stack([_LAW.log_density(mode.inverse(z)) - mode.log_volume for mode in modes])
