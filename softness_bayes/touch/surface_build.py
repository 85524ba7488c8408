"""Builds the firing-rate surfaces: ``python -m softness_bayes.touch.surface_build [file]``.

It takes about ten minutes on one processor, prints what it does, and writes the same bytes on every run with the same
versions on the same machine.
"""

from __future__ import annotations

import sys
import time
import zipfile
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from softness_bayes.errors import NumericalError
from softness_bayes.touch.cells import Cells
from softness_bayes.touch.cycle_fold import CycleFold, cycle_fold
from softness_bayes.touch.equilibrium import fold, rest
from softness_bayes.touch.firing import CurveError
from softness_bayes.touch.limit_cycle import steady_orbit
from softness_bayes.touch.membrane import Channels
from softness_bayes.touch.onset import birth, onset
from softness_bayes.touch.rate import simulated
from softness_bayes.touch.surface import DATA, DESIGNS, Border, Design, FiringSurface, TotalDegree

FloatArray = NDArray[np.float64]

_BORDER_SEARCH = (-2.0, 1.6)  # places of c_K between which the border is looked for
_BORDER_USED = 1.3  # places of c_K up to which it is fitted: a little beyond the box
_HALVINGS = 40
_LOOSE = 1e-5  # agreement of periods that suffices to tell firing from silence
_WAY = (0.015, 0.03, 0.06, 0.12, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # from the centre of the box outwards


def low_discrepancy(variables: int, points: int) -> FloatArray:
    """Points that fill the cube [-1, 1] with the density of Chebyshev points, shape (variables, points).

    The additive recurrence of the roots of ``x^(d+1) = x + 1``, mapped by the cosine.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (variables + 1))
    steps = root ** -np.arange(1.0, variables + 1.0)
    return np.cos(np.pi * ((0.5 + np.outer(steps, np.arange(1, points + 1))) % 1.0))


def build(design: Design, say: Callable[[str], None]) -> FiringSurface:
    """Make one surface."""
    place = low_discrepancy(len(design.axes), design.points)
    border = np.zeros(0) if design.border is None else _border(design, design.border)
    unmeasured = CurveError(np.nan, np.nan, np.nan)
    surface = FiringSurface(design, np.zeros((0, 0)), border, unmeasured)
    place = place[:, surface.at_fold(place)]
    channels = design.channels_at(place)
    say(f"{place.shape[1]} of {design.points} channel vectors fire just above their fold")
    rheobase, onset_rate, slope = _from_fold(design, channels) if design.closest == 0.0 else _born(design, channels)
    s_max = np.sqrt(design.max_current - rheobase)
    values = np.empty((design.nodes, rheobase.size))
    values[0] = slope
    for node, w in enumerate(design.nodes_w):
        s = 0.5 * (w + 1.0) * s_max
        if w == -1.0:
            continue
        start = time.perf_counter()
        rate = simulated(rheobase + s * s, channels, design.membrane, s * s).rate
        if not (rate > 0.0).all():
            raise NumericalError(f"{(rate == 0.0).sum()} of {rate.size} membranes are silent above their rheobase")
        values[node] = (rate - onset_rate) / s
        say(f"node {node + 1} of {design.nodes}: {time.perf_counter() - start:.1f} s")
    monomials = np.linalg.solve(np.vander(design.nodes_w, increasing=True), values)
    basis = TotalDegree(len(design.axes), design.degree).basis(place)
    table = np.linalg.lstsq(basis, np.vstack([rheobase, onset_rate, monomials]).T, rcond=None)[0]
    return FiringSurface(design, table, border, unmeasured)


def _from_fold(design: Design, channels: Channels) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rheobase, onset rate and its slope in s where firing begins at a fold of equilibria."""
    found = fold(channels, design.membrane)
    return found.current, np.zeros_like(found.current), found.prefactor


def _born(design: Design, channels: Channels) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same where firing begins at a fold of orbits, followed from the centre of the box; no slope is needed."""
    target = np.array(channels)
    centre = np.array(design.channels)
    begin = float(onset(design.channels, design.membrane).rheobase)
    middle = birth(centre, design.membrane, begin - 0.1, begin + 0.1)
    current = CycleFold(*(np.repeat(x, target.shape[1], axis=-1) for x in middle))
    known = [(0.0, current)]
    for share in _WAY:
        some = Channels(*(centre[:, None] + (target - centre[:, None]) * share))
        current = cycle_fold(some, design.membrane, _foresee(known, share))
        if not np.isfinite(current.current).all():
            raise NumericalError(f"{np.isnan(current.current).sum()} folds of orbits were lost on the way")
        known = [*known[-2:], (share, current)]
    return current.current, 1000.0 / current.period, np.full(target.shape[1], np.nan)


def _foresee(known: list[tuple[float, CycleFold]], share: float) -> CycleFold:
    """Extrapolate the folds known at up to three shares of the way (Lagrange)."""
    shares = np.array([at for at, _ in known])
    weights = [np.prod((share - np.delete(shares, i)) / (at - np.delete(shares, i))) for i, at in enumerate(shares)]
    fields = zip(*(fold_at for _, fold_at in known), strict=True)
    return CycleFold(*(sum(w * x for w, x in zip(weights, field, strict=True)) for field in fields))


def _border(design: Design, border: Border) -> FloatArray:
    """Polynomial for the place of c_K at which firing stops beginning at the fold, by bisection at every point."""
    others = low_discrepancy(3, border.points)
    low, high = (np.full(border.points, place) for place in _BORDER_SEARCH)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        fires = _fires_near_fold(design, np.array([others[0], middle, others[1], others[2]]), border.distance)
        low, high = np.where(fires, middle, low), np.where(fires, high, middle)
    used = high < _BORDER_USED
    return np.linalg.lstsq(TotalDegree(3, border.degree).basis(others[:, used]), high[used], rcond=None)[0]


def _fires_near_fold(design: Design, place: FloatArray, distance: float) -> NDArray[np.bool_]:
    channels = design.channels_at(place)
    cells = Cells.of(design.membrane, channels, fold(channels, design.membrane).current + distance**2)
    return steady_orbit(cells, rest(channels, design.membrane), agreement=_LOOSE).rate > 0.0


def write(surfaces: Mapping[str, FiringSurface], path: Path) -> None:
    """Write surfaces as a NumPy archive whose bytes depend on nothing but its arrays."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, surface in sorted(surfaces.items()):
            for key, array in (
                ("border", surface.border),
                ("coefficients", surface.coefficients),
                ("digest", np.array(surface.design.digest)),
            ):
                content = BytesIO()
                np.lib.format.write_array(content, np.ascontiguousarray(array), allow_pickle=False)
                archive.writestr(zipfile.ZipInfo(f"{name}/{key}.npy"), content.getvalue(), zipfile.ZIP_DEFLATED)


def main(path: Path) -> None:
    """Build all surfaces and write them."""
    surfaces = {}
    with threadpool_limits(1):
        for name, design in DESIGNS.items():
            start = time.perf_counter()
            surfaces[name] = build(design, lambda line, name=name: print(f"{name}: {line}", flush=True))
            print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    write(surfaces, path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name(DATA))
