"""Separate modes of a density: the mode of each draw, and a map of each mode.

Each mode is initially the normal approximation at an optimum. A separate, possibly curved map is fitted to it in the
pilot run; draws are then reassigned using these maps. Overlapping modes are merged.
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

_ROUNDS = 10  # iterations of assigning draws to modes and refitting the maps
_FEWEST = 4  # distinct draws per dimension below which the map of a mode is not refitted
_NEAR = 3.0  # a draw belongs to two modes if their log densities differ by less than this
_SHARED = 0.1  # share of such draws above which two modes overlap

_LAW = Student()


def labels(modes: Sequence[TriangularMap], z: FloatArray) -> Labels:
    """Return the index of the mode of each point, shape (...), for ``z`` of shape (..., dimension)."""
    return np.asarray(_log_densities(modes, z.reshape(-1, z.shape[-1])).argmax(axis=0).reshape(z.shape[:-1]))


def learn_modes(
    modes: Sequence[TriangularMap], walks: FloatArray, log_density: FloatArray, tau: float, linear: int = 0
) -> tuple[TriangularMap, ...]:
    """Learn a map of each mode from a pilot run, ordered by decreasing number of draws.

    Parameters
    ----------
    modes
        Maps of the modes so far.
    walks, log_density, tau, linear
        As for `adaptation.learn`.

    Returns
    -------
    tuple of TriangularMap
        Maps of the modes; a single map if there turns out to be only one mode.
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
    """Alternate between fitting maps and assigning draws until few draws change their mode."""
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
    """Return two overlapping modes, with many draws of one also belonging to the other, or None."""
    density = _log_densities(modes, draws)
    for k, other in permutations(range(len(modes)), 2):
        mine = label == k
        if mine.any() and (density[other, mine] > density[k, mine] - _NEAR).mean() > _SHARED:
            return k, other
    return None


def _log_densities(modes: Sequence[TriangularMap], z: FloatArray) -> FloatArray:
    each = ((mode, mode.inverse(z)) for mode in modes)
    return np.stack([_LAW.log_density(y) - mode.log_volume(y) for mode, y in each])
