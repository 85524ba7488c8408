"""Builder of the sample of exact rate curves: ``python -m softness_bayes.tools.firing_sample_build``."""

from __future__ import annotations

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


def rows(membrane: Membrane, size: int = SIZE) -> Array:
    """Return the sample as a table: multipliers, rheobase, rate just above it, coefficients."""
    surface, rng, found = FiringSurface.load(membrane), np.random.default_rng(0), np.empty((0, 4))
    while len(found) < size:
        some = np.asarray(surface.design.channels) * np.exp(SPREAD * rng.standard_normal((size, 4)))
        found = np.concatenate([found, some[surface.answers(Channels(*some.T))]])
    channels = Channels(*found[:size].T)
    curve = exact_curves(channels, membrane, surface.max_current, NODES, surface.curve(channels).rheobase)
    return np.column_stack([*channels, curve.rheobase, curve.onset_rate, curve.coefficients])


def main() -> None:
    """Make the file."""
    with ZipFile(Path(touch.__file__).parent / TABLE, "w", ZIP_DEFLATED) as archive:
        for name, design in sorted(DESIGNS.items()):
            content = BytesIO()
            np.lib.format.write_array(content, rows(design.membrane), allow_pickle=False)
            archive.writestr(ZipInfo(f"{name}.npy"), content.getvalue(), ZIP_DEFLATED)


if __name__ == "__main__":
    main()
