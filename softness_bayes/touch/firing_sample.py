"""Exact rate curves of a sample of channel vectors, to measure a firing-rate surface's error on any scene.

Exact rates take milliseconds per current, so the curves are stored. ``python -m
softness_bayes.tools.firing_sample_build`` recomputes them for every membrane that has a surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.neuron.firing import RateCurve
from softness_bayes.touch.neuron.membrane import Channels, Driven, Membrane
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

TABLE = "firing_sample.npz"
"""Name of the data file next to this module."""


@dataclass(frozen=True)
class FiringSample:
    """Channel vectors, log-normal about the box's centre and inside the box, and their exact curves.

    Parameters
    ----------
    channels
        Multipliers, each of shape (n,).
    curve
        Their exact curves, of batch shape (n,).
    """

    channels: Channels
    curve: RateCurve
    noise = 0.0

    @classmethod
    def load(cls, membrane: Membrane) -> FiringSample | None:
        """Return the stored sample of a membrane, or None."""
        with (resources.files(__package__) / TABLE).open("rb") as file, np.load(file) as data:
            if membrane.name not in data:
                return None
            rows = data[membrane.name]
        surface = FiringSurface.load(membrane)
        curve = RateCurve(rows[:, 4], rows[:, 5], rows[:, 6:], surface.max_current, surface.error)
        return cls(Channels(*rows[:, :4].T), curve)

    def put_into(self, parameters: TouchParameters) -> TouchParameters:
        """Return the first parameter vectors, shape (vectors,), with the sample's channel multipliers."""
        size = min(np.size(parameters.alpha), self.curve.rheobase.size)
        first = TouchParameters(*(np.broadcast_to(v, np.shape(parameters.alpha))[:size] for v in parameters))
        return first._replace(**{name: values[:size] for name, values in self.channels._asdict().items()})

    def curves(self, parameters: Driven) -> RateCurve:
        """Return the curves of parameter vectors, shape (vectors,), whose multipliers come from the sample."""
        order = np.argsort(self.channels.c_Na)
        place = np.searchsorted(np.asarray(self.channels.c_Na)[order], parameters.c_Na)
        return self.curve.take(order[place])

    def exact(self) -> FiringSample:
        """Return this source: its curves are exact."""
        return self

    def shortened(self, terms: int) -> FiringSample:
        """Return this source: exact curves keep all terms."""
        return self
