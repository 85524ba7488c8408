"""Figures' artists by name, and made-up curves to be drawn."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from softness_bayes.checking.inflection import Curves, find_inflection
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.load_groups import groups_of

FINGER_RADIUS = 8e-3
FABRICS = np.array([3e3, 4e4, 5e5])
LOADS: dict[str, tuple[Load, ...]] = {
    "one": (Force(1.0),),
    "mixture": (Indentation(1e-3), Indentation(3e-3), Force(0.5)),
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


def invented_run(loads=LOADS["one"], invented=None, moduli=FABRICS, names=None, scale=MAGNITUDE, **members):
    """Return a run as figures read it, with some curves; `members` are further ones, or replace these."""
    curves = invented_curves(loads, 4) if invented is None else invented
    fabrics = {"effective_modulus_kpa": ("fabric", np.asarray(moduli) / 1e3), "finger_radius_mm": 1e3 * FINGER_RADIUS}
    called = [f"cloth {k}" for k in range(len(moduli))] if names is None else list(names)
    groups = {
        "constant_data": xr.Dataset(fabrics, coords={"fabric": called}),
        "predictions": xr.Dataset({"total_rate": (("draw", "load", "point"), curves.total_rate)}),
    } | members.pop("groups", {})
    ends = float(np.min(moduli)), float(np.max(moduli))
    usual = {
        "tree": xr.DataTree.from_dict(groups), "group": groups.__getitem__, "scale": scale, "is_first_look": False,
        "loads": loads, "load_groups": groups_of(loads), "curves": lambda: curves,
        "inflections": lambda: find_inflection(curves, 0.0, ends),
    }  # fmt: skip
    return SimpleNamespace(**usual | members)


def invented_draws(draws, prior=None, ensemble=None):
    """Return a run whose parameters, the first of the declared ones, have these draws: walkers, steps, parameters."""
    names = [*EVERY_PARAMETER][: draws.shape[-1]]
    groups = {
        group: xr.Dataset({name: (("chain", "draw"), values[..., k]) for k, name in enumerate(names)})
        for group, values in (("posterior", draws), ("prior", draws if prior is None else prior))
    }
    if ensemble is not None:
        every = np.repeat(np.asarray(ensemble)[:, None], draws.shape[1], axis=1)
        groups["sample_stats"] = xr.Dataset({"ensemble": (("chain", "draw"), every)})
    run = invented_run(groups=groups)
    return run, [EVERY_PARAMETER[name].label for name in names]


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
