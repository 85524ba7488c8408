"""Builder of the firing-rate surfaces, which also measures them: ``python -m softness_bayes.tools.surface_build``.

It takes some twenty minutes for each membrane on one processor and writes the same tables on every run with the same
versions on the same machine; elsewhere they agree to 1e-7, because exp differs in its last bits between processors.
``--measure`` only measures the tables that are there against exact rates, on random points; ``--membrane`` does one and
leaves the others as they are.
"""

from __future__ import annotations

import argparse
import json
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib import resources
from io import BytesIO
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from softness_bayes.errors import NumericalError
from softness_bayes.touch import neuron
from softness_bayes.touch.neuron.equilibrium import fold, rest
from softness_bayes.touch.neuron.firing import CurveError, exact_curve
from softness_bayes.touch.neuron.limit_cycle import steady_orbit
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.neuron.onset import Onset, onset
from softness_bayes.touch.neuron.polynomials import TotalDegree
from softness_bayes.touch.neuron.rate import simulated
from softness_bayes.touch.neuron.surface import ERRORS, TABLES, FiringSurface
from softness_bayes.touch.neuron.surface_design import DESIGNS, Border, SurfaceInputs
from softness_bayes.touch.neuron.vector_field import Cells

FloatArray = NDArray[np.float64]

TABLES_AT = Path(neuron.__file__).parent
"""Folder of the tables that are shipped."""
Say = Callable[[str], None]
Spread = Callable[..., Iterable[Any]]

_BORDER_SEARCH = (-2.0, 1.6)  # range of c_K coordinates in which the border is searched
_BORDER_USED = 1.3  # limit of the c_K coordinate for the fit: slightly outside the box
_HALVINGS = 24
_SCOUTS = 100  # channel vectors whose onset is searched over all currents
_SCOUT_DEGREE = 5  # total degree of the polynomial that predicts the others' rheobase from these
_ONSETS_TOGETHER = 71  # batch size for the other vectors, which are shared among processes
_LOOSE = 1e-5  # tolerance of periods, sufficient to tell firing from rest
_UNMEASURED = CurveError(np.nan, np.nan, np.nan)

ONSET_VECTORS = 200
"""Channel vectors at which the onset is measured where it is a jump."""

NEAR_JUMP = 1e-3
"""Currents from a jump [µA/cm²] within which the error of the onset is what is measured."""

_MEASURED_TOGETHER = 2000  # points simulated in parallel

NEAR_BORDER = 0.1
"""Places of c_K from the corner's border, in half-widths of the box, that count as near: 1 % of the multiplier."""


def low_discrepancy(variables: int, points: int) -> FloatArray:
    """Return points that fill the cube [-1, 1] with the density of Chebyshev points, shape (variables, points).

    The additive recurrence of the roots of ``x^(d+1) = x + 1``, mapped by the cosine.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (variables + 1))
    steps = root ** -np.arange(1.0, variables + 1.0)
    return np.cos(np.pi * ((0.5 + np.outer(steps, np.arange(1, points + 1))) % 1.0))


def build(design: SurfaceInputs, say: Say, spread: Spread = map) -> FiringSurface:
    """Build one surface."""
    axes = len(design.axes)
    place = low_discrepancy(axes, design.points)
    border = np.zeros(0) if design.border is None else _border(design, design.border)
    surface = FiringSurface(design, np.zeros((0, 0)), border, _UNMEASURED, design.degree)
    if design.border is not None:
        place = place[:, surface.before_corner(place) > design.border.margin]
    channels = design.channels_at(place)
    begin = _begin_at_fold(design, channels) if design.closest == 0.0 else _begin_at_births(design, channels, spread)
    if design.closest > 0.0 and not begin.born.all():
        raise NumericalError(f"{design.membrane.name}: firing does not begin in one way over the box")
    say(f"{place.shape[1]} channel vectors, firing begins at {begin.rheobase.min():.3f} to {begin.rheobase.max():.3f}")
    s_max = np.sqrt(design.max_current - begin.rheobase)
    distances = 0.5 * (design.nodes_w[:, None] + 1.0) * s_max
    first = int(design.closest == 0.0)
    values = np.empty_like(distances)
    values[:first] = begin.prefactor
    found = spread(
        simulated,
        list(begin.rheobase + distances[first:] ** 2),
        [channels] * (design.nodes - first),
        [design.membrane] * (design.nodes - first),
        list(distances[first:] ** 2),
    )
    for node, orbit in enumerate(found, first):
        if not (orbit.rate > 0.0).all():
            raise NumericalError(f"{(orbit.rate == 0.0).sum()} membranes are silent above their rheobase")
        values[node] = (orbit.rate - begin.rate) / distances[node]
        say(f"node {node + 1} of {design.nodes}")
    polynomials = np.linalg.solve(chebyshev.chebvander(design.nodes_w, design.nodes - 1), values)
    basis = TotalDegree(axes, design.degree).basis(place)
    known = np.vstack([begin.rheobase, begin.rate, polynomials]).T
    fitted = np.linalg.lstsq(basis, known, rcond=None)[0]
    to_monomials = np.array([_padded(chebyshev.cheb2poly(row), design.nodes) for row in np.eye(design.nodes)])
    return FiringSurface(
        design, np.hstack([fitted[:, :2], fitted[:, 2:] @ to_monomials]), border, _UNMEASURED, design.degree
    )


def _begin_at_fold(design: SurfaceInputs, channels: Channels) -> Onset:
    """Return the onset of membranes that are known to fire just above their fold, without simulation."""
    found = fold(channels, design.membrane)
    zero = np.zeros_like(found.current)
    return Onset(found.current, zero, found.prefactor, zero.astype(bool))


def _begin_at_births(design: SurfaceInputs, channels: Channels, spread: Spread) -> Onset:
    """Return the onset of membranes that begin to fire at a fold of orbits; searches start near known onsets."""
    some, others = (Channels(*(c[part] for c in channels)) for part in (slice(_SCOUTS), slice(_SCOUTS, None)))
    scouted = onset(some, design.membrane)
    terms = TotalDegree(len(design.axes), _SCOUT_DEGREE)
    fitted = np.linalg.lstsq(terms.basis(design.place(np.array(some))), scouted.rheobase, rcond=None)[0]
    expected = terms.basis(design.place(np.array(others))) @ fitted
    parts = _parts(expected.size, _ONSETS_TOGETHER)
    found = spread(
        onset,
        [Channels(*(c[part] for c in others)) for part in parts],
        [design.membrane] * len(parts),
        [expected[part] for part in parts],
    )
    return Onset(*(np.concatenate(arrays) for arrays in zip(scouted, *found, strict=True)))


def _parts(size: int, together: int) -> list[slice]:
    return [slice(start, start + together) for start in range(0, size, together)]


@contextmanager
def spread_over(processes: int) -> Iterator[Spread]:
    """Provide a map function that distributes its arguments over several processes."""
    if processes == 1:
        yield map
    else:
        with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
            yield pool.map


def _padded(coefficients: ArrayLike, size: int) -> FloatArray:
    known = np.asarray(coefficients, dtype=float)
    return np.append(known, np.zeros(size - known.size))


def _border(design: SurfaceInputs, border: Border) -> FloatArray:
    """Fit a polynomial to the c_K coordinate beyond which firing no longer begins at the fold (by bisection)."""
    others = low_discrepancy(3, border.points)
    low, high = (np.full(border.points, place) for place in _BORDER_SEARCH)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        fires = _fires_near_fold(design, np.array([others[0], middle, others[1], others[2]]), border.distance)
        low, high = np.where(fires, middle, low), np.where(fires, high, middle)
    used = high < _BORDER_USED
    return np.linalg.lstsq(TotalDegree(3, border.degree).basis(others[:, used]), high[used], rcond=None)[0]


def _fires_near_fold(design: SurfaceInputs, place: FloatArray, distance: float) -> NDArray[np.bool_]:
    channels = design.channels_at(place)
    cells = Cells.of(design.membrane, channels, fold(channels, design.membrane).current + distance**2)
    return steady_orbit(cells, rest(channels, design.membrane), 1e-7, _LOOSE).rate > 0.0


def measure(
    surface: FiringSurface,
    say: Say,
    points: int = 100_000,
    corner: int = 16,
    seed: int = 1,
    onsets: int = ONSET_VECTORS,
    spread: Spread = map,
) -> dict[str, float]:
    """Measure a surface against exact rates.

    Parameters
    ----------
    surface : FiringSurface
        The surface.
    say : callable
        Callback for progress messages.
    points : int
        Random points (channels and current together), a tenth of them near the border of the corner. Where there is no
        corner, all of them anywhere in the box.
    corner : int
        Number of channel vectors in the corner whose individual curves are also measured.
    seed : int
        Seed of the points.
    onsets : int
        Number of channel vectors whose onset is compared with the exact one, where it is a jump.
    spread : callable
        Map function for parts of the points, as from :func:`spread_over`; it does not affect the results.

    Returns
    -------
    dict
        Numbers of points; the largest error [Hz], relative to the rate, and relative to its allowance of
        max(0.1 Hz, 1e-3 of the rate), all but within 1e-3 µA/cm² of a jump; the median and the 99.9 % quantile of the
        relative error where the membrane fires; the largest error of the rate just above a jump [Hz] and of its place
        [µA/cm²]; and the same of the corner's own curves.
    """
    rng, design = np.random.default_rng(seed), surface.design
    near = points // 10 if design.border is not None else 0
    place = np.hstack([_anywhere(surface, rng, points - near), _near_border(surface, rng, near)])
    channels, jump = design.channels_at(place), design.closest > 0.0
    begin = surface.curve(channels).rheobase
    current = _currents(rng, begin, place.shape[1], design)
    exact = _exact_rates(surface, current, channels, begin, say, spread)
    difference = surface.curve(channels).rate(current[:, None])[:, 0] - exact
    found = _quantiles(difference, exact)
    place_error, rate_error = _measure_onset(surface, rng, onsets) if jump else (0.0, 0.0)
    vectors = _inside_corner(surface, rng, corner) if design.border is not None else np.zeros((4, 0))
    own = [_measure_own(design, vector, rng, say) for vector in vectors.T]
    return {
        "points": int(current.size),
        "near_border": int(near),
        **found,
        "onset_hertz": rate_error,
        "onset_current": place_error,
        "corner_vectors": len(own),
        "corner_hertz": max((e.hertz for e in own), default=0.0),
        "corner_onset_hertz": max((e.onset_hertz for e in own), default=0.0),
    }


def _currents(rng: np.random.Generator, begin: FloatArray, count: int, design: SurfaceInputs) -> FloatArray:
    """Draw currents [µA/cm²], a third of them close above the rheobases `begin`, where errors are largest."""
    current, jump = np.asarray(rng.uniform(0.0, design.max_current, count)), design.closest > 0.0
    close = rng.random(count) < 1 / 3
    nearest = np.log10(NEAR_JUMP) if jump else -4.0
    current[close] = np.minimum(begin + 10.0 ** rng.uniform(nearest, 0.0, count), design.max_current)[close]
    return np.where(np.abs(current - begin) < NEAR_JUMP, begin + NEAR_JUMP, current) if jump else current


def _exact_rates(
    surface: FiringSurface, current: FloatArray, channels: Channels, begin: FloatArray, say: Say, spread: Spread
) -> FloatArray:
    """Compute exact rates of all points in batches."""
    parts = _parts(current.size, _MEASURED_TOGETHER)
    exact = np.empty_like(current)
    found = spread(
        simulated,
        [current[part] for part in parts],
        [Channels(*(c[part] for c in channels)) for part in parts],
        [surface.design.membrane] * len(parts),
        [(current - begin)[part] for part in parts],
    )
    for part, orbit in zip(parts, found, strict=True):
        exact[part] = orbit.rate
        say(f"{min(part.stop, current.size)} of {current.size} points")
    return exact


def _measure_onset(surface: FiringSurface, rng: np.random.Generator, vectors: int) -> tuple[float, float]:
    """Largest errors of a jump's place [µA/cm²] and of the rate just above it [Hz], at random places of the box."""
    design = surface.design
    channels = design.channels_at(rng.uniform(-1.0, 1.0, (len(design.axes), vectors)))
    curve = surface.curve(channels)
    begin = onset(channels, design.membrane, curve.rheobase)
    place, rate = np.abs(begin.rheobase - curve.rheobase), np.abs(begin.rate - curve.onset_rate)
    return float(place.max(initial=0.0)), float(rate.max(initial=0.0))


def _anywhere(surface: FiringSurface, rng: np.random.Generator, points: int) -> FloatArray:
    """Uniform random points in the box outside the corner, where vectors have individual curves."""
    place = rng.uniform(-1.0, 1.0, (len(surface.design.axes), points))
    while (bad := np.flatnonzero(surface.corner(place))).size:
        place[:, bad] = rng.uniform(-1.0, 1.0, (len(place), bad.size))
    return place


def _near_border(surface: FiringSurface, rng: np.random.Generator, points: int) -> FloatArray:
    """Places within 1 % of the multiplier c_K before the border."""
    found = np.zeros((len(surface.design.axes), 0))
    while found.shape[1] < points:
        place = rng.uniform(-1.0, 1.0, (len(surface.design.axes), 100_000))
        place = place[:, (surface.before_corner(place) < NEAR_BORDER) & ~surface.corner(place)]
        found = np.hstack([found, place])
    return found[:, :points]


def _inside_corner(surface: FiringSurface, rng: np.random.Generator, vectors: int) -> FloatArray:
    found = np.zeros((len(surface.design.axes), 0))
    while found.shape[1] < vectors:
        place = rng.uniform(-1.0, 1.0, (len(surface.design.axes), 10_000))
        found = np.hstack([found, place[:, surface.corner(place)]])
    return found[:, :vectors]


def _measure_own(design: SurfaceInputs, place: FloatArray, rng: np.random.Generator, say: Say) -> CurveError:
    """Error of a vector's individual exact curve at random currents more than 1e-3 µA/cm² above its onset."""
    channels = Channels(*(float(c[0]) for c in design.channels_at(place[:, None])))
    curve = exact_curve(channels, design.membrane, design.max_current, design.nodes)
    current = np.append(
        float(curve.rheobase) + 10.0 ** rng.uniform(-3.0, 0.0, 25),
        rng.uniform(float(curve.rheobase) + 1e-3, design.max_current, 25),
    )
    many = Channels(*(np.full(current.size, c) for c in channels))
    exact = simulated(current, many, design.membrane, np.full(current.size, np.nan)).rate
    difference = np.abs(curve.rate(current) - exact)
    say(f"corner {channels}: {difference.max():.2g} Hz, onset {curve.error.onset_hertz:.2g} Hz")
    return CurveError(float(difference.max()), float((difference / exact).max()), curve.error.onset_hertz)


def _quantiles(difference: FloatArray, exact: FloatArray) -> dict[str, float]:
    size, fires = np.abs(difference), exact > 0.0
    relative = size[fires] / exact[fires]
    return {
        "hertz": float(size.max()),
        "relative": float(relative.max()),
        "of_allowance": float((size / np.maximum(0.1, 1e-3 * exact)).max()),
        "relative_median": float(np.median(relative)),
        "relative_999": float(np.quantile(relative, 0.999)),
        "false_onsets": int(((exact > 0.0) != (np.abs(difference + exact) > 0.0)).sum()),
    }


def write(surfaces: Mapping[str, FiringSurface], path: Path) -> None:
    """Write surfaces as a NumPy archive whose bytes depend only on its arrays."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, surface in sorted(surfaces.items()):
            for key, array in (
                ("border", surface.border),
                ("digest", np.array(surface.design.digest)),
                ("table", surface.table),
            ):
                content = BytesIO()
                np.lib.format.write_array(content, np.ascontiguousarray(array), allow_pickle=False)
                archive.writestr(zipfile.ZipInfo(f"{name}/{key}.npy"), content.getvalue(), zipfile.ZIP_DEFLATED)


def main() -> None:
    """Build, write and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=TABLES_AT, help="folder to write to")
    parser.add_argument("--measure", action="store_true", help="only measure the tables that are shipped")
    parser.add_argument("--points", type=int, default=100_000, help="points of the measurement")
    parser.add_argument("--membrane", choices=DESIGNS, action="append", help="only this one; may be repeated")
    parser.add_argument("--processes", type=int, default=1, help="processes that share the work")
    options = parser.parse_args()
    chosen = options.membrane or list(DESIGNS)
    shipped = chosen if options.measure else [name for name in DESIGNS if name not in chosen]
    surfaces = {name: FiringSurface.load(DESIGNS[name].membrane) for name in shipped}
    errors = json.loads((resources.files(neuron) / ERRORS).read_text())
    with threadpool_limits(1):

        def say(line: str, start: float = time.perf_counter()) -> None:
            print(f"{time.perf_counter() - start:6.0f} s  {line}", flush=True)

        with spread_over(options.processes) as spread:
            if not options.measure:
                surfaces |= {name: build(DESIGNS[name], say, spread) for name in chosen}
                write(surfaces, options.out / TABLES)
            for name in chosen:
                errors[name] = measure(surfaces[name], say, options.points, spread=spread)
                say(f"{name}: {errors[name]}")
    errors = {name: error for name, error in errors.items() if name in DESIGNS}
    (options.out / ERRORS).write_text(json.dumps(errors, indent=2) + "\n")


if __name__ == "__main__":
    main()
