"""Figures' artists by name, and made-up curves to be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from softness_bayes.checking.inflection import Curves
from softness_bayes.touch.contact import Force, Indentation, Load

FINGER_RADIUS = 8e-3
FABRICS = np.array([3e3, 4e4, 5e5])
LOADS: dict[str, tuple[Load, ...]] = {
    "one": (Force(1.0),),
    "mixture": (Indentation(1e-3), Indentation(3e-3), Force(0.5)),
    "five": tuple(Indentation(depth * 1e-3) for depth in (1, 1.5, 2, 2.5, 3)),
}


def invented_curves(loads: Sequence[Load], draws: int, loudness: float = 300.0, seed: int = 1) -> Curves:
    """Return curves that rise at one modulus and fall at a later one, the more the later the load."""
    rng = np.random.default_rng(seed)
    modulus = np.geomspace(FABRICS.min() / 10, FABRICS.max() * 10, 81)
    shape = (draws, len(loads), modulus.size)
    place = np.log(5e4) + 0.3 * rng.standard_normal((draws, 1, 1))
    x = np.log(modulus) - place
    fall = 0.15 * np.arange(len(loads))[:, None] * rng.uniform(0.5, 1.5, (draws, 1, 1))
    rate = loudness * np.maximum(np.tanh(x), 0.0) * (1.0 - fall * (1.0 + np.tanh(x - 2.0)) / 2.0)
    skin = np.broadcast_to(1e5 * np.exp(0.2 * rng.standard_normal((draws, 1, 1))), shape)
    radius = np.broadcast_to(np.linspace(1.2, 0.4, modulus.size) * 0.5 * FINGER_RADIUS, shape)
    return Curves(modulus, rate, skin, np.ones(shape), radius)


def artist(figure: Figure, gid: str) -> Artist:
    """Return the one artist of a name."""
    found = figure.findobj(lambda each: each.get_gid() == gid)
    assert len(found) == 1, gid
    return found[0]


def outline(band: Artist) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper limit of a filled band along its x."""
    vertices = band.get_paths()[0].vertices
    points = (len(vertices) - 3) // 2
    return vertices[1 : points + 1, 1], vertices[points + 2 : -1, 1][::-1]


def drawn(figure: Figure) -> Figure:
    """Draw a figure whole, so that a warning on the way fails the test."""
    figure.draw_without_rendering()
    return figure
