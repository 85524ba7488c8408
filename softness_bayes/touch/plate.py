"""Contact of a fingerpad with a rigid flat plate: the limit of `contact` as E_fab goes to infinity."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.touch.contact import Finger
from softness_bayes.touch.skin import STRAIN, SkinDisplacement

Array = NDArray[np.float64]


class PlateLine(NamedTuple):
    """Force of a rigid plate, ln F = ln b + m slope + offset; arrays of the shape of the indentations."""

    slope: Array
    """a^power / R, the coefficient of m."""
    offset: Array
    """ln(4 a³ / (3 R (1 - nu_skin²))), the force on skin of unit modulus [ln m²]."""


def plate_line(indentation: ArrayLike, finger: Finger = Finger(), displacement: SkinDisplacement = STRAIN) -> PlateLine:
    """Return slope and offset of the force of a rigid flat plate, whose logarithm is linear in ln b and m.

    With k = 0 the skin's modulus is b exp(m a^power / R), E_star = E_skin / (1 - nu_skin²), and
    F = 4 E_star a³ / (3 R), a = sqrt(R delta) (model.md 2-3).

    Parameters
    ----------
    indentation
        delta [m], positive.
    finger, displacement
        The fingertip, and the reading of its displacement.
    """
    radius = np.sqrt(finger.radius * np.asarray(indentation, float))
    offset = np.log(4.0 * radius**3 / (3.0 * finger.radius * (1.0 - finger.poisson_ratio**2)))
    return PlateLine(radius**displacement.power / finger.radius, offset)


def plate_force(
    indentation: ArrayLike, b: Any, m: Any, finger: Finger = Finger(), displacement: SkinDisplacement = STRAIN
) -> Array:
    """Return the force [N] of a rigid plate at indentations [m], for b [Pa] and m; all broadcast."""
    line = plate_line(indentation, finger, displacement)
    return np.asarray(np.exp(np.log(b) + m * line.slope + line.offset))
