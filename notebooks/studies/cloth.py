"""Validity of the model for real cloth: ``python cloth.py FILE [FIGURE]`` prints the guide's table and draws it.

FILE is a table of bending rigidities of real fabrics, which is not part of this project (see docs/cloth.md).
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softness_bayes.base.readable import percent
from softness_bayes.data import Fabrics
from softness_bayes.model.build import COARSE
from softness_bayes.model.reach import SKINS, reach
from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.readings import MENDED

NAME, RIGIDITY = "fabric_id", "bending_warp_N_m"
"""Columns of the table: names, and bending rigidities across the warp [N m]."""

LOADS: tuple[Load, ...] = (*map(Force, (0.1, 0.5, 1.0, 2.0)), *map(Indentation, (1e-3, 2e-3, 3e-3)))

HEAD = (
    *("skin", "load", "fires from E_fab [kPa]", "silent", "questionable", "meaningless", "within reach"),
    "median indentation [mm]",
)
MODULI = np.geomspace(1e3, 1e9, 1200)
"""Effective moduli [Pa] among which the softest is sought for which receptors fire."""


def read_cloth(path: Path) -> Fabrics:
    """Return the fabrics of the table by their bending rigidities."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    rigidity = np.array([float(row[RIGIDITY]) for row in rows])
    return Fabrics(tuple(row[NAME] for row in rows), bending_rigidity=rigidity)


def table_of(fabrics: Fabrics) -> list[tuple[str, ...]]:
    """Return a row for each skin and load: shares of the fabrics in per cent, and the median indentation."""
    found = []
    for skin in SKINS:
        values = usual_values(MENDED, skin)
        parameters = touch_parameters(values)
        # without channels the rates come from the shipped surface
        named = {name: x for name, x in values.items() if name not in Channels._fields}
        scene = scene_of(fabrics, LOADS, named, MENDED, discretisation=COARSE)
        shares, depth = reach(scene, parameters), scene.contact(parameters).indentation.ravel() * 1e3
        grid = Fabrics(tuple(map(str, range(MODULI.size))), effective_modulus=MODULI)
        firing = scene_of(grid, LOADS, named, MENDED, discretisation=COARSE).total_rate(parameters).ravel() > 0
        for k, load in enumerate(LOADS):
            fires = MODULI[firing[np.repeat(np.arange(len(LOADS)), MODULI.size) == k]]
            onset = f"{float(f'{1e-3 * fires[0]:.2g}'):g}" if fires.size else "never"
            here = scene.load == k
            percents = (percent(each[here].mean()) for each in shares)
            found.append((skin, str(load), onset, *percents, f"{np.median(depth[here]):.2g}"))
    return found


def lines_of(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows in the format of the guide's page."""
    return [f"| {' | '.join(row)} |" for row in (HEAD, ["---"] * len(HEAD), *rows)]


def draw(rows: Sequence[Sequence[str]], path: Path) -> None:
    """Draw the share of fabrics within reach, and of those outside it, for each skin and load."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, len(SKINS), figsize=(7.5, 2.6), sharey=True, layout="constrained")
    for axes, skin in zip(panels, SKINS, strict=True):
        mine = [row for row in rows if row[0] == skin]
        silent, within = (np.array([float(row[k].strip("<> %")) for row in mine]) for k in (3, 6))
        bottom = np.zeros(len(mine))
        for share, colour, label in (
            (within, "#0072b2", "within reach"),
            (np.maximum(100 - within - silent, 0), "#e69f00", "geometry meaningless"),
            (silent, "#bbbbbb", "silent: no receptor fires"),
        ):
            axes.bar([row[1] for row in mine], share, bottom=bottom, color=colour, label=label)
            bottom = bottom + share
        axes.set(title=f"skin: priors '{skin}'", ylim=(0, 100))
    panels[0].set_ylabel("fabrics [%]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(path, dpi=130)


def main(arguments: Sequence[str]) -> None:
    """Print the table of a file, or a message if there is no file."""
    path = Path(arguments[0]) if arguments else Path("cloth.csv")
    if not path.is_file():
        print(f"{path}: no such file; skipped, since the table of real cloth is not part of this project")
        return
    rows = table_of(read_cloth(path))
    print(*lines_of(rows), sep="\n")
    if len(arguments) > 1:
        draw(rows, Path(arguments[1]))


if __name__ == "__main__":
    main(sys.argv[1:])
