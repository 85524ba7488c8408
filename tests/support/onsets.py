"""Onsets of firing that take a search of seconds, each made once for all the processes that run the tests."""

from __future__ import annotations

import numpy as np

from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, HODGKIN_HUXLEY, Channels
from softness_bayes.touch.neuron.onset import Onset, onset
from softness_bayes.touch.neuron.surface import FiringSurface

CORNER = Channels(0.945, 1.276, 0.9, 1.35)
"""Connor's and Stevens' membrane begins to fire with a jump there, above a fold of equilibria."""

HODGKIN_HUXLEY_OWN = Channels(1.0, 1.0, 1.0, 1.0)


def births() -> tuple[Channels, Onset]:
    """Return channels of Hodgkin's and Huxley's membrane and their onsets, folds of orbits.

    The first are the membrane's own, searched for without an expectation; those of the two others are expected where
    the surface has them.
    """
    surface = FiringSurface.load(HODGKIN_HUXLEY)
    # the first of these was once taken for another kind of onset, for passing slowly by the lost orbit
    others = surface.design.channels_at(np.array([[-0.627, 0.987, -0.734], [0.9, -0.95, 0.2]]).T)
    channels = Channels(*(np.append(own, two) for own, two in zip(HODGKIN_HUXLEY_OWN, others, strict=True)))
    return channels, onset(channels, HODGKIN_HUXLEY, np.append(np.nan, surface.curve(others).rheobase))


def corner_onset() -> Onset:
    """Return the onset of `CORNER`, searched for without an expectation."""
    return onset(CORNER, CONNOR_STEVENS)
