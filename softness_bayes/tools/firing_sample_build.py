"""Builder of the sample of exact rate curves: ``python -m softness_bayes.tools.firing_sample_build``."""

from __future__ import annotations

import argparse
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from softness_bayes import touch
from softness_bayes.touch.accuracy import TABLE
from softness_bayes.touch.neuron.firing import exact_curves
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.surface import DESIGNS, FiringSurface

Array = NDArray[np.float64]

SIZE, NODES, SPREAD = 200, 30, 0.03
"""Channel vectors, exact rates of each, and the standard deviation of a multiplier's logarithm."""


def draw(surface: FiringSurface, rng: np.random.Generator, size: int = SIZE) -> Channels:
    """Return channel vectors that the surface covers, shape (size,)."""
    centre = np.asarray(surface.design.channels)
    found = np.empty((0, 4))
    while len(found) < size:
        some = centre * np.exp(SPREAD * rng.standard_normal((size, 4)))
        found = np.concatenate([found, some[surface.answers(Channels(*some.T))]])
    return Channels(*found[:size].T)


def rows(membrane: Membrane, size: int = SIZE) -> Array:
    """Return the sample as a table: multipliers, rheobase, rate just above it, coefficients."""
    surface = FiringSurface.load(membrane)
    channels = draw(surface, np.random.default_rng(0), size)
    curve = exact_curves(channels, membrane, surface.max_current, NODES, surface.curve(channels).rheobase)
    return np.column_stack([*channels, curve.rheobase, curve.onset_rate, curve.coefficients])


def main() -> None:
    """Make the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(touch.__file__).parent, help="folder to write to")
    options = parser.parse_args()
    with ZipFile(options.out / TABLE, "w", ZIP_DEFLATED) as archive:
        for name, design in sorted(DESIGNS.items()):
            content = BytesIO()
            np.lib.format.write_array(content, rows(design.membrane), allow_pickle=False)
            archive.writestr(ZipInfo(f"{name}.npy"), content.getvalue(), ZIP_DEFLATED)


if __name__ == "__main__":
    main()
