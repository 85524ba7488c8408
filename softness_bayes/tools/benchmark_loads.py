"""Cost of many loads: ``python -m softness_bayes.tools.benchmark_loads [FILE.csv]``.

Compiles scenes of 3 to 3000 distinct forces or indentations, with one table for all of them and with a table for each,
and times a call. A scene has 360 conditions, or one per load if there are more loads. The error of the response is the
largest over a sample of loads that includes both ends of the range, relative to much more accurate single-load tables.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.subject import BATCH
from softness_bayes.model.scenes import curve_of_held, prior_draws
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch import shared_fields
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.resolution import first
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

KINDS: Mapping[str, tuple[type[Force] | type[Indentation], float, float]] = {
    "force": (Force, 0.3, 1.5),
    "indentation": (Indentation, 0.5e-3, 3e-3),
}
"""Kind of load, and the ends of its range [N or m]."""

COUNTS = (3, 30, 300, 3000)
"""Numbers of distinct loads."""

MOST_APART = 300
"""Largest number of loads that are compiled one by one, which takes minutes."""

CONDITIONS, REPEATS = 360, 5
MODULI = np.geomspace(5e3, 5e6, 12)
COMPILED, USED, CLOSE = (Discretisation(9, 6.0, tolerance) for tolerance in (1e-5, 3e-4, 1e-7))
"""Resolution that scenes are compiled for, that they are cut to (as runs of the usual accuracy), and the reference."""


class Measured(NamedTuple):
    """Measurements of one scene."""

    kind: str
    loads: int
    tables: str
    """One for all loads, or one for each."""
    conditions: int
    compile_s: float
    call_ms: float
    """For each parameter vector."""
    error: float
    """Largest, of the response relative to the vector's peak."""


def measured(kind: str, count: int, apart: bool, parameters: TouchParameters) -> Measured:
    """Return cost and error of a scene with this number of loads: one table per load (`apart`) or one for all."""
    made, low, high = KINDS[kind]
    loads: list[Load] = [made(float(x)) for x in np.linspace(low, high, count)]
    n = max(CONDITIONS, count)
    pairs = np.unique(np.stack([np.arange(n) * count // n, np.arange(n) % MODULI.size]), axis=1)
    firing = curve_of_held(PAPER_CHANNELS, MENDED.membrane, 0.0, COMPILED.rate_nodes)
    limit = sys.maxsize if apart else shared_fields.MANY_LOADS
    with patch.object(shared_fields, "MANY_LOADS", limit):
        shared_fields.forget()
        begun = time.process_time()
        whole = Scene(MODULI, 0.3, loads, firing, pairs[1], pairs[0], readings=MENDED, discretisation=COMPILED)
        spent = time.process_time() - begun
        used, calls = whole.coarser(USED), []
        for _ in range(REPEATS):
            begun = time.process_time()
            rate = used.total_rate(parameters)
            calls.append(time.process_time() - begun)
    size = np.size(parameters.b)
    return Measured(
        kind,
        count,
        "one for each load" if apart or count <= shared_fields.MANY_LOADS else "one for all",
        pairs.shape[1],
        spent,
        1e3 * min(calls) / size,
        _error(used, rate, pairs, parameters),
    )


def _error(used: Scene, rate: Array, pairs: NDArray[np.intp], parameters: TouchParameters) -> float:
    """Return the largest difference from much more accurate single-load tables, relative to each peak."""
    count = len(used.loads)
    some = np.unique(np.r_[np.linspace(0, count - 1, min(count, 5)), 1, count - 2].round().astype(int))
    here = np.flatnonzero(np.isin(pairs[0], some))
    load = np.searchsorted(some, pairs[0][here])
    close = Scene(
        MODULI,
        0.3,
        [used.loads[k] for k in some],
        used.firing,
        pairs[1][here],
        load,
        readings=MENDED,
        discretisation=CLOSE,
    )
    difference = np.abs(rate[:, here] - close.total_rate(parameters)).max(axis=1)
    peak = rate.max(axis=1)
    return float((difference / np.where(peak > 0, peak, 1.0)).max())


def every(counts: Sequence[int] = COUNTS, batch: int = BATCH) -> list[Measured]:
    """Return all measurements, and print each one when it is done."""
    space = parameter_space(fix=PAPER_CHANNELS._asdict())
    parameters, found = first(prior_draws(space).parameters, batch), []
    for kind in KINDS:
        for count in counts:
            ways = [False] if count <= shared_fields.MANY_LOADS else [False, True][: 1 + (count <= MOST_APART)]
            for apart in ways:
                found.append(measured(kind, count, apart, parameters))
                print(found[-1])
    return found


def written(rows: Sequence[Measured], path: Path) -> None:
    """Write measurements as CSV."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Measured._fields)
        for row in rows:
            numbers = f"{row.compile_s:.2f}", f"{row.call_ms:.3f}", f"{row.error:.0e}"
            writer.writerow([row.kind, row.loads, row.tables, row.conditions, *numbers])


def main() -> None:
    """Measure, and write a table if a file is given."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", nargs="?", type=Path, help="CSV file to write")
    path = parser.parse_args().file
    rows = every()
    if path is not None:
        written(rows, path)


if __name__ == "__main__":
    main()
