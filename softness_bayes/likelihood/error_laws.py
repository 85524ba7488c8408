"""Error laws of single observations about their expectation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorLaw:
    """The law of one observation's error, in additive numbers of its scale.

    Parameters
    ----------
    name
        Name in the table of observation models.
    draw
        Draws errors in units of their spread; takes a source of random numbers, a shape (..., rows) and the model's
        parameters of batch shape (...).
    normal_scores
        Turns errors (..., rows) into normal ones with the same spread and the same probability of a smaller error
        (Dunn and Smyth, J. Comp. Graph. Stat. 5, 236, 1996). Checks of residuals need no other law than the normal.
    """

    name: str
    draw: Callable[[np.random.Generator, tuple[int, ...], Any], FloatArray]
    normal_scores: Callable[[FloatArray, Any], FloatArray]


def _draw_normal(rng: np.random.Generator, shape: tuple[int, ...], parameters: Any) -> FloatArray:
    return rng.standard_normal(shape)


def _as_they_are(errors: FloatArray, parameters: Any) -> FloatArray:
    return errors


NORMAL = ErrorLaw("normal", _draw_normal, _as_they_are)
"""Normal errors: log-normal about a magnitude estimate or a force, normal about a z-score."""
