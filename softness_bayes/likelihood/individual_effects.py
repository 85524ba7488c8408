"""Effects of raters with individual fingers, and the responses of these fingers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.design import Design

FloatArray = NDArray[np.float64]


class IndividualEffects(NamedTuple):
    """Values of the common mean and of the raters' effects."""

    mu: FloatArray
    """Shape (...)."""
    participant: FloatArray
    """Deviations of log ratings, shape (..., participants)."""
    finger: NDArray[np.intp]
    """Each rater's finger, an index into `FingerGrid.z`, shape (..., participants)."""
    deviation: FloatArray
    """The finger's deviations from the typical one, shape (..., participants, quantities), as `FingerGrid.names`."""


def own_drive(drive: FloatArray, design: Design, finger: NDArray[np.intp]) -> FloatArray:
    """Return the drive of each row's rater in the row's condition, shape (..., rows)."""
    column = (1 + finger[..., design.participant]) * design.n_conditions + design.condition
    shape = np.broadcast_shapes(drive.shape[:-1], column.shape[:-1])
    drive, column = (np.broadcast_to(v, (*shape, v.shape[-1])) for v in (drive, column))
    return np.take_along_axis(drive, column, axis=-1)
