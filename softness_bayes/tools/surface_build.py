"""Builder of firing-rate surfaces and curves, with their errors: ``python -m softness_bayes.tools.surface_build``.

It takes some twenty minutes for each membrane and writes the same tables on every run with the same versions on the
same machine; elsewhere they agree to 1e-7, because exp differs in its last bits between processors. ``--measure`` only
measures the tables that are there against exact rates, on random points; ``--membrane`` does one and leaves the others
as they are; ``--sample`` makes the sample of exact rate curves by which resolutions are judged; ``--curves`` makes the
curves of channels that are not sampled, in a minute.
"""

from __future__ import annotations

import argparse
import json
import zipfile
from collections.abc import Callable, Mapping
from importlib import resources
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from softness_bayes import touch
from softness_bayes.base.errors import NumericalError
from softness_bayes.touch import neuron
from softness_bayes.touch.accuracy import PRESETS, TABLE
from softness_bayes.touch.neuron.cells import Cells, fold, rest
from softness_bayes.touch.neuron.firing import CURVES, exact_curve, exact_curves, key, text_of
from softness_bayes.touch.neuron.fixed_channels import USUAL_CURRENT
from softness_bayes.touch.neuron.limit_cycle import steady_orbit
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, HODGKIN_HUXLEY, PAPER_CHANNELS, Channels
from softness_bayes.touch.neuron.polynomials import TotalDegree
from softness_bayes.touch.neuron.rate import Onset, onset, simulated
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT, CurveError
from softness_bayes.touch.neuron.surface import DESIGNS, ERRORS, TABLES, Border, FiringSurface, SurfaceInputs

FloatArray = NDArray[np.float64]
Say = Callable[[str], None]

RATE_NODES = sorted({preset.rate_nodes for preset in PRESETS})

CASES = [
    *((PAPER_CHANNELS, CONNOR_STEVENS, USUAL_CURRENT, nodes) for nodes in RATE_NODES),
    (PAPER_CHANNELS, CONNOR_STEVENS, LARGEST_CURRENT, RATE_NODES[-1]),
    *((PAPER_CHANNELS, HODGKIN_HUXLEY, USUAL_CURRENT, nodes) for nodes in RATE_NODES),
]
"""Arguments of `exact_curve` for each shipped curve: what runs with the paper's channels ask for."""

UNMEASURED = CurveError(np.nan, np.nan, np.nan)

NEAR_JUMP = 1e-3
"""Currents from a jump [µA/cm²] within which the error of the onset is what is measured."""


def low_discrepancy(variables: int, points: int) -> FloatArray:
    """Return points that fill the cube [-1, 1] with the density of Chebyshev points, shape (variables, points).

    The additive recurrence of the roots of ``x^(d+1) = x + 1``, mapped by the cosine.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (variables + 1))
    steps = root ** -np.arange(1.0, variables + 1.0)
    return np.cos(np.pi * ((0.5 + np.outer(steps, np.arange(1, points + 1))) % 1.0))


def build(design: SurfaceInputs, say: Say) -> FiringSurface:
    """Build one surface: exact onsets and rates at many channel vectors, and the polynomials that fit them."""
    axes, nodes = len(design.axes), design.nodes
    place = low_discrepancy(axes, design.points)
    border = np.zeros(0) if design.border is None else _border(design, design.border)
    if design.border is not None:
        empty = FiringSurface(design, np.zeros((0, 0)), border, UNMEASURED, design.degree)
        place = place[:, empty.before_corner(place) > design.border.margin]
    channels = design.channels_at(place)
    begin = _begin_at_births(design, channels) if design.closest else None
    if begin is None:  # membranes that are known to fire just above their fold, without simulation
        onsets = fold(channels, design.membrane)
        zero = np.zeros_like(onsets.current)
        begin = Onset(onsets.current, zero, onsets.prefactor, zero.astype(bool))
    say(f"{place.shape[1]} channel vectors, firing begins at {begin.rheobase.min():.3f} to {begin.rheobase.max():.3f}")
    distances = 0.5 * (design.nodes_w[:, None] + 1.0) * np.sqrt(design.max_current - begin.rheobase)
    first = int(design.closest == 0.0)
    values = np.empty_like(distances)
    values[:first] = begin.prefactor
    for node in range(first, nodes):
        squares = distances[node] ** 2
        rate = simulated(begin.rheobase + squares, channels, design.membrane, squares).rate
        if not (rate > 0.0).all():
            raise NumericalError(f"{(rate == 0.0).sum()} membranes are silent above their rheobase")
        values[node] = (rate - begin.rate) / distances[node]
        say(f"node {node + 1} of {nodes}")
    polynomials = np.linalg.solve(chebyshev.chebvander(design.nodes_w, nodes - 1), values)
    known = np.vstack([begin.rheobase, begin.rate, polynomials]).T
    fitted = np.linalg.lstsq(TotalDegree(axes, design.degree).basis(place), known, rcond=None)[0]
    to_monomials = np.zeros((nodes, nodes))
    for k, row in enumerate(np.eye(nodes)):
        powers = np.asarray(chebyshev.cheb2poly(row))
        to_monomials[k, : powers.size] = powers
    return FiringSurface(
        design, np.hstack([fitted[:, :2], fitted[:, 2:] @ to_monomials]), border, UNMEASURED, design.degree
    )


def _begin_at_births(design: SurfaceInputs, channels: Channels) -> Onset:
    """Return the onset of membranes that begin to fire at a fold of orbits.

    That of the first hundred is searched over all currents. A polynomial fitted to these says where the others'
    searches start, a few at a time.
    """
    some, others = (Channels(*(c[part] for c in channels)) for part in (slice(100), slice(100, None)))
    onsets = [onset(some, design.membrane)]
    terms = TotalDegree(len(design.axes), 5)
    fitted = np.linalg.lstsq(terms.basis(design.place(np.array(some))), onsets[0].rheobase, rcond=None)[0]
    expected = terms.basis(design.place(np.array(others))) @ fitted
    for start in range(0, expected.size, 71):
        part = slice(start, start + 71)
        onsets.append(onset(Channels(*(c[part] for c in others)), design.membrane, expected[part]))
    begin = Onset(*(np.concatenate(arrays) for arrays in zip(*onsets, strict=True)))
    if not begin.born.all():
        raise NumericalError(f"{design.membrane.name}: firing does not begin in one way over the box")
    return begin


def _border(design: SurfaceInputs, border: Border) -> FloatArray:
    """Fit a polynomial to the c_K coordinate beyond which firing no longer begins at the fold (by bisection)."""
    others = low_discrepancy(3, border.points)
    low, high = np.full(border.points, -2.0), np.full(border.points, 1.6)
    for _ in range(24):
        middle = 0.5 * (low + high)
        channels = design.channels_at(np.array([others[0], middle, others[1], others[2]]))
        current = fold(channels, design.membrane).current + border.distance**2
        cells = Cells.of(design.membrane, channels, current)
        # a tolerance of periods that is sufficient to tell firing from rest
        fires = steady_orbit(cells, rest(channels, design.membrane), 1e-7, 1e-5).rate > 0.0
        low, high = np.where(fires, middle, low), np.where(fires, high, middle)
    used = high < 1.3  # slightly outside the box
    return np.linalg.lstsq(TotalDegree(3, border.degree).basis(others[:, used]), high[used], rcond=None)[0]


def measure(
    surface: FiringSurface, say: Say, points: int = 100_000, corner: int = 16, seed: int = 1, onsets: int = 200
) -> dict[str, float]:
    """Measure a surface against exact rates.

    Parameters
    ----------
    surface : FiringSurface
        The surface.
    say : callable
        Callback for progress messages.
    points : int
        Random points (channels and current together), a tenth of them within 1 % of the multiplier c_K before the
        border of the corner. Where there is no corner, all of them anywhere in the box.
    corner : int
        Number of channel vectors in the corner whose individual curves are also measured.
    seed : int
        Seed of the points.
    onsets : int
        Number of channel vectors whose onset is compared with the exact one, where it is a jump.

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
    place = _places(surface, rng, points - near, lambda at: ~surface.corner(at))
    if near:
        beside = _places(surface, rng, near, lambda at: (surface.before_corner(at) < 0.1) & ~surface.corner(at))
        place = np.hstack([place, beside])
    channels, jump = design.channels_at(place), design.closest > 0.0
    begin = surface.curve(channels).rheobase
    current = _currents(rng, begin, points, design)
    exact = np.empty(points)
    for start in range(0, points, 2000):
        part = slice(start, start + 2000)
        some = Channels(*(c[part] for c in channels))
        exact[part] = simulated(current[part], some, design.membrane, (current - begin)[part]).rate
        say(f"{min(start + 2000, points)} of {points} points")
    size, fires = np.abs(surface.curve(channels).rate(current[:, None])[:, 0] - exact), exact > 0.0
    relative = size[fires] / exact[fires]
    place_error, rate_error = _measure_onset(surface, rng, onsets) if jump else (0.0, 0.0)
    vectors = _places(surface, rng, corner, surface.corner) if design.border is not None else np.zeros((4, 0))
    corner_errors = [_measure_own(design, vector, rng) for vector in vectors.T]
    return {
        "points": points,
        "near_border": near,
        "hertz": float(size.max()),
        "relative": float(relative.max()),
        "of_allowance": float((size / np.maximum(0.1, 1e-3 * exact)).max()),
        "relative_median": float(np.median(relative)),
        "relative_999": float(np.quantile(relative, 0.999)),
        "onset_hertz": rate_error,
        "onset_current": place_error,
        "corner_vectors": len(corner_errors),
        "corner_hertz": max((e.hertz for e in corner_errors), default=0.0),
        "corner_onset_hertz": max((e.onset_hertz for e in corner_errors), default=0.0),
    }


def _places(
    surface: FiringSurface, rng: np.random.Generator, count: int, wanted: Callable[[FloatArray], NDArray[np.bool_]]
) -> FloatArray:
    """Return random places of the box at which a condition holds, shape (axes, count)."""
    places = np.zeros((len(surface.design.axes), 0))
    while places.shape[1] < count:
        place = rng.uniform(-1.0, 1.0, (len(places), 10_000))
        places = np.hstack([places, place[:, wanted(place)]])
    return places[:, :count]


def _currents(rng: np.random.Generator, begin: FloatArray, count: int, design: SurfaceInputs) -> FloatArray:
    """Draw currents [µA/cm²], a third of them close above the rheobases `begin`, where errors are largest."""
    current, jump = np.asarray(rng.uniform(0.0, design.max_current, count)), design.closest > 0.0
    close = rng.random(count) < 1 / 3
    nearest = np.log10(NEAR_JUMP) if jump else -4.0
    current[close] = np.minimum(begin + 10.0 ** rng.uniform(nearest, 0.0, count), design.max_current)[close]
    return np.where(np.abs(current - begin) < NEAR_JUMP, begin + NEAR_JUMP, current) if jump else current


def _measure_onset(surface: FiringSurface, rng: np.random.Generator, vectors: int) -> tuple[float, float]:
    """Return the largest errors of a jump's place [µA/cm²] and of the rate just above it [Hz], at random places."""
    design = surface.design
    channels = design.channels_at(rng.uniform(-1.0, 1.0, (len(design.axes), vectors)))
    curve = surface.curve(channels)
    begin = onset(channels, design.membrane, curve.rheobase)
    place, rate = np.abs(begin.rheobase - curve.rheobase), np.abs(begin.rate - curve.onset_rate)
    return float(place.max(initial=0.0)), float(rate.max(initial=0.0))


def _measure_own(design: SurfaceInputs, place: FloatArray, rng: np.random.Generator) -> CurveError:
    """Return the error of a vector's individual curve at random currents more than 1e-3 µA/cm² above its onset."""
    channels = Channels(*(float(c[0]) for c in design.channels_at(place[:, None])))
    curve = exact_curve(channels, design.membrane, design.max_current, design.nodes)
    begin = float(curve.rheobase)
    close, any_ = begin + 10.0 ** rng.uniform(-3.0, 0.0, 25), rng.uniform(begin + 1e-3, design.max_current, 25)
    current = np.append(close, any_)
    many = Channels(*(np.full(current.size, c) for c in channels))
    exact = simulated(current, many, design.membrane, np.full(current.size, np.nan)).rate
    difference = np.abs(curve.rate(current) - exact)
    return CurveError(float(difference.max()), float((difference / exact).max()), curve.error.onset_hertz)


def exact_sample(surface: FiringSurface, size: int = 200, nodes: int = 30, spread: float = 0.03) -> FloatArray:
    """Return exact rate curves as a table: multipliers, rheobase, rate just above it, coefficients.

    Parameters
    ----------
    surface
        The membrane's surface.
    size, nodes, spread
        Channel vectors, exact rates of each, and the standard deviation of a multiplier's logarithm.
    """
    rng, drawn = np.random.default_rng(0), np.empty((0, 4))
    while len(drawn) < size:
        some = np.asarray(surface.design.channels) * np.exp(spread * rng.standard_normal((size, 4)))
        drawn = np.concatenate([drawn, some[surface.answers(Channels(*some.T))]])
    channels = Channels(*drawn[:size].T)
    onset_current = surface.curve(channels).rheobase
    curve = exact_curves(channels, surface.design.membrane, surface.max_current, nodes, onset_current)
    return np.column_stack([*channels, curve.rheobase, curve.onset_rate, curve.coefficients])


def write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a NumPy archive whose bytes depend only on its arrays."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in sorted(arrays.items()):
            content = BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getvalue(), zipfile.ZIP_DEFLATED)


def main() -> None:
    """Build, write and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(neuron.__file__).parent, help="folder to write to")
    parser.add_argument("--measure", action="store_true", help="only measure the tables that are shipped")
    parser.add_argument("--sample", action="store_true", help="only make the sample of exact curves of all membranes")
    parser.add_argument("--curves", action="store_true", help="only make the curves of channels that are not sampled")
    parser.add_argument("--points", type=int, default=100_000, help="points of the measurement")
    parser.add_argument("--membrane", choices=DESIGNS, action="append", help="only this one; may be repeated")
    options = parser.parse_args()
    if options.sample:
        samples = {name: exact_sample(FiringSurface.load(one.membrane)) for name, one in DESIGNS.items()}
        write(Path(touch.__file__).parent / TABLE, samples)
        return
    if options.curves:
        curves = {key(*case): exact_curve(*case) for case in CASES}
        (options.out / CURVES).write_text(text_of(curves), encoding="utf-8")
        return
    chosen = options.membrane or list(DESIGNS)
    shipped = chosen if options.measure else [name for name in DESIGNS if name not in chosen]
    surfaces = {name: FiringSurface.load(DESIGNS[name].membrane) for name in shipped}
    errors = json.loads((resources.files(neuron) / ERRORS).read_text())
    with threadpool_limits(1):
        if not options.measure:
            surfaces |= {name: build(DESIGNS[name], print) for name in chosen}
            parts: dict[str, NDArray[Any]] = {}
            for name, one in surfaces.items():
                digest = np.array(one.design.digest)
                parts |= {f"{name}/border": one.border, f"{name}/digest": digest, f"{name}/table": one.table}
            write(options.out / TABLES, parts)
        errors |= {name: measure(surfaces[name], print, options.points) for name in chosen}
    (options.out / ERRORS).write_text(json.dumps(errors, indent=2) + "\n")


if __name__ == "__main__":
    main()
