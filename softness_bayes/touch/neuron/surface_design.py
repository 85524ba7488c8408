"""Designs of the firing-rate surfaces: the inputs from which each surface is built."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.neuron.limit_cycle import AGREEMENT, TOLERANCE
from softness_bayes.touch.neuron.membrane import (
    CONNOR_STEVENS,
    HODGKIN_HUXLEY,
    PAPER_CHANNELS,
    PRINTED,
    Channels,
    Membrane,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Border:
    """Inputs for the border of the corner: the ``c_K`` beyond which firing no longer starts at the fold.

    Parameters
    ----------
    degree : int
        Total degree in the other multipliers.
    points : int
        Number of points to which the polynomial is fitted.
    distance : float
        Root of the current above the fold at which the cell is tested for firing [sqrt(µA/cm²)].
    margin : float
        Width of the strip along the border that is treated as the corner, in units of the box's half-width.
    """

    degree: int = 6
    points: int = 600
    distance: float = 0.01
    margin: float = 3e-3


@dataclass(frozen=True)
class SurfaceInputs:
    """Inputs from which one surface is built.

    Parameters
    ----------
    membrane : Membrane
        Constants.
    max_current : float
        Largest current [µA/cm²].
    degree : int
        Total degree in the multipliers.
    points : int
        Number of channel vectors to which the polynomials are fitted.
    nodes : int
        Nodes in ``s``, the root of the current above the rheobase.
    closest : float
        First node, as a share of the largest ``s``; 0 if the limit is known analytically.
    border : Border or None
        Border of the corner, if there is one.
    channels : Channels
        Centre of the box.
    half_width : float
        Half-width of the box, relative to its centre.
    """

    membrane: Membrane
    max_current: float
    degree: int
    points: int
    nodes: int
    closest: float = 0.0
    border: Border | None = None
    channels: Channels = PAPER_CHANNELS
    half_width: float = 0.1

    @property
    def axes(self) -> list[int]:
        """Multipliers that have an effect, as indices into ``Channels``; ``c_A`` has none without an A-current."""
        return [0, 1, 2, 3] if self.membrane.gating.a_current else [0, 1, 2]

    @property
    def nodes_w(self) -> FloatArray:
        """Nodes in ``w = 2 s / s_max - 1``, Chebyshev points between ``closest`` and 1."""
        share = 0.5 * (1.0 - np.cos(np.pi * np.arange(self.nodes) / (self.nodes - 1)))
        return 2.0 * (self.closest + (1.0 - self.closest) * share) - 1.0

    def place(self, channels: FloatArray) -> FloatArray:
        """Return the coordinates in the box of multipliers (4, n), in units of its half-width, shape (axes, n)."""
        return (np.asarray(channels)[: len(self._centre)] / self._centre - 1.0) / self.half_width

    @cached_property
    def _centre(self) -> FloatArray:
        return np.array(self.channels)[self.axes, None]

    def channels_at(self, place: FloatArray) -> Channels:
        """Return multipliers at coordinates of shape (axes, n); those without effect keep the value of the centre."""
        full = np.zeros((4, place.shape[1]))
        full[self.axes] = place
        return Channels(*(np.array(self.channels)[:, None] * (1.0 + self.half_width * full)))

    def interval(self, channel: str) -> tuple[float, float]:
        """Return the smallest and largest value of a multiplier in the box."""
        centre = self.channels[Channels._fields.index(channel)]
        return centre * (1 - self.half_width), centre * (1 + self.half_width)

    @property
    def digest(self) -> str:
        """SHA-256 of all inputs from which the surface is built."""
        declared = json.dumps([_declared(asdict(self)), TOLERANCE, AGREEMENT], sort_keys=True)
        return hashlib.sha256(declared.encode()).hexdigest()


def _declared(value: Any) -> Any:
    """Return the numbers and names of a design, without descriptions and derived private fields."""
    if isinstance(value, dict):
        return {key: _declared(item) for key, item in value.items() if not key.startswith("_") and key != "meaning"}
    return value


DESIGNS: Mapping[str, SurfaceInputs] = MappingProxyType(
    {
        design.membrane.name: design
        for design in (
            SurfaceInputs(CONNOR_STEVENS, max_current=60.0, degree=10, points=3072, nodes=20, border=Border()),
            SurfaceInputs(HODGKIN_HUXLEY, max_current=60.0, degree=9, points=384, nodes=20, closest=0.015),
        )
    }
)
"""Designs of the shipped surfaces, by membrane."""

NO_SURFACE: Mapping[str, str] = MappingProxyType(
    {
        PRINTED.name: "which is silent up to 38 µA/cm² for all multipliers, almost twice the paper's largest current, "
        "and begins to fire in more ways than one"
    }
)
"""Reasons why membranes have no surface. The printed membrane starts to fire at 39 to 67 µA/cm² at a fold of orbits,
but in a different way in a fiftieth of the box."""
