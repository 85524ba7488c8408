"""Onsets of firing that take a search of seconds, as they are stored."""

from __future__ import annotations

import json

import numpy as np

from softness_bayes.touch.neuron.membrane import HODGKIN_HUXLEY, Channels
from softness_bayes.touch.neuron.rate import Onset, onset
from softness_bayes.touch.neuron.surface import FiringSurface
from support.paths import REFERENCE

CORNER = Channels(0.945, 1.276, 0.9, 1.35)
"""Connor's and Stevens' membrane begins to fire with a jump there, above a fold of equilibria."""

HODGKIN_HUXLEY_OWN = Channels(1.0, 1.0, 1.0, 1.0)


EXACT_ENOUGH = 5e-8
"""Tolerance of exact rates beside which a curve is judged: they differ by 1e-6 and take half the time."""


def births() -> tuple[Channels, Onset]:
    """Return what :func:`search_births` finds, as it is stored; its tests search again."""
    stored = json.loads((REFERENCE / "onsets.json").read_text())
    begin = (np.array(stored[name]) for name in ("rheobase", "rate"))
    return Channels(*map(np.array, stored["channels"])), Onset(*begin, np.full(3, np.nan), np.ones(3, bool))


def search_births() -> tuple[Channels, Onset]:
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
    """Return the onset of `CORNER` as it is stored; a slow test searches for it again."""
    stored = json.loads((REFERENCE / "onsets.json").read_text())["corner"]
    return Onset(np.float64(stored["rheobase"]), np.float64(stored["rate"]), np.float64(np.nan), np.bool_(False))
