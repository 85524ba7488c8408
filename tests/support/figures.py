"""Figures' artists by name, and a result made up to be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from softness_bayes.arviz_bridge import ENSEMBLE, to_tree
from softness_bayes.checking.inflection import Curves, find_inflection
from softness_bayes.results.result import Result
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


TURNING = ("inflection", "prior_inflection")
"""Groups with the turning points of many draws of posterior and prior."""


def finished_run() -> Result:
    """Return a result of two parameters, three fabrics and two loads, as a run stores it."""
    rng = np.random.default_rng(9)
    loads = (Indentation(1e-3), Force(0.5))
    curves = invented_curves(loads, 20)
    turn = find_inflection(curves, 0.0, (FABRICS.min(), FABRICS.max()))
    along, at, rows = ("load", "e_fab_kpa"), ("load",), ("rating_row",)
    lines = {"total_rate": curves.total_rate, "typical_rating": 1.0 + curves.total_rate}
    lines |= {"e_skin_kpa": curves.skin_modulus / 1e3, "contact_radius_mm": curves.radius * 1e3}
    lines |= {"contact_force_n": curves.force}
    points = {"outcome": turn.outcome, "e_fab_kpa": turn.modulus / 1e3, "ratio": turn.ratio}
    points |= {"force_n": turn.force, "drop": turn.drop, "inside": turn.inside.astype(np.int8)}
    places = {f"inflection_{name}": values for name, values in points.items()}
    participant, fabric, load = (index.ravel() for index in np.indices((4, 3, 2)))
    index = {"participant_index": participant, "fabric_index": fabric, "load_index": load}
    tree = to_tree(
        {
            "posterior": {name: np.exp(rng.standard_normal((8, 60))) for name in ("b", "gamma", "mu")},
            "prior": {name: np.exp(rng.standard_normal((1, 90))) for name in ("b", "gamma")},
            "predictions": {name: values[None] for name, values in (lines | places).items()},
            **{group: {name: values[None] for name, values in places.items()} for group in TURNING},
            "observed_data": {"rating": np.exp(rng.standard_normal(24))},
            "constant_data": {
                "effective_modulus_kpa": FABRICS / 1e3,
                "poisson_ratio": np.full(3, 0.3),
                "indentation_mm": [1.0, np.nan],
                "force_n": [np.nan, 0.5],
                **index,
            },
        },
        {
            **dict.fromkeys(lines, along),
            **dict.fromkeys([*places, "indentation_mm", "force_n"], at),
            **dict.fromkeys([*index, "rating"], rows),
            **dict.fromkeys(["effective_modulus_kpa", "poisson_ratio"], ("fabric",)),
        },
        {
            "e_fab_kpa": curves.modulus / 1e3,
            "fabric": ["gauze", "lawn", "felt"],
            "load": ["1 mm", "0.5 N"],
            ENSEMBLE: np.repeat([0, 1], 4),
        },
    )
    return Result(tree, pd.DataFrame())
