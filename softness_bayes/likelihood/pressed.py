"""Raters with plate forces on their own fingers: the law of each one's skin before any rating (model.md 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.touch.finger_grid import SkinLaws


@dataclass(frozen=True, eq=False)
class PressedRaters:
    """Raters for whom there are also plate forces.

    Parameters
    ----------
    forces
        The forces.
    rater, finger
        Index of each such person among the raters (-1 for people who are not raters) and among the fingers of the
        forces, shape (people,).
    """

    forces: CompressionForces
    rater: NDArray[np.intp]
    finger: NDArray[np.intp]

    @classmethod
    def of(cls, forces: CompressionForces, raters: Sequence[str], pressed: Sequence[str]) -> PressedRaters | None:
        """Return the people whose names occur in both lists; None if there are none."""
        place = {name: k for k, name in enumerate(pressed)}
        both = [(k, place[name]) for k, name in enumerate(raters) if name in place]
        if not both:
            return None
        rater, finger = np.array(both, np.intp).T
        return cls(forces, rater, finger)

    @property
    def size(self) -> int:
        """Number of people."""
        return self.rater.size

    def as_strangers(self) -> PressedRaters:
        """Return the same people as if none of them were raters."""
        return PressedRaters(self.forces, np.full_like(self.rater, -1), self.finger)

    def skins(self, names: Sequence[str], parameters: Parameters) -> SkinLaws:
        """Return the laws of their skins given the forces, for the quantities that differ between raters (`names`).

        Quantities that do not differ between raters have deviation 0. If m is one of them, a rater has the m of the
        typical finger, and the law of ln b is marginal over m in the forces.
        """
        law = self.forces.finger_law(parameters)
        mean, root = law.mean[..., self.finger, :], law.root[..., self.finger, :, :]
        nothing = np.zeros(mean.shape[:-1])
        if "m" not in names:
            return SkinLaws(mean[..., 0], nothing, root[..., 0, 0], nothing, nothing)
        if "b" not in names:
            sd = np.hypot(root[..., 1, 0], root[..., 1, 1])
            return SkinLaws(nothing, mean[..., 1], nothing, nothing, sd)
        return SkinLaws(mean[..., 0], mean[..., 1], root[..., 0, 0], root[..., 1, 0], root[..., 1, 1])
