"""Response as a function of fabric modulus for each draw, and its turning point (model.md 11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.readable import chance
from softness_bayes.sampler.chain_statistics import Estimate, quantile, share
from softness_bayes.touch.contact import Load
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

LEAST_DROP = 0.05
"""A maximum counts as a turning point if it exceeds both ends of the range by this share of itself.

Curves, checks and the paper's claims share this threshold, which comes from the claims' criteria (model.md 11). A
response with a smaller fall changes the mean rating of a fabric by less than its standard error in usual tables.
"""

RANGE_FACTOR = 10.0
"""The range of a turning point: from a tenth of the smallest fabric to ten times the largest."""

CURVE_POINTS = 161
"""Number of grid points of a response curve."""

TURNING_POINTS = 41
"""Number of grid points for the turning points of thousands of draws; their position is accurate to 0.1 %."""

PERCENTS = (0.05, 0.5, 0.95)
"""Lower limit, median and upper limit of turning points in tables."""

STORED: Mapping[str, tuple[str, float | None, str]] = {
    "outcome": ("inflection_outcome", None, ""),
    "modulus": ("inflection_e_fab_kpa", 1e3, "kPa"),
    "ratio": ("inflection_ratio", 1.0, ""),
    "force": ("inflection_force_n", 1.0, "N"),
    "drop": ("inflection_drop", 1.0, ""),
    "inside": ("inflection_inside", None, ""),
}
"""Variable of a result, its unit in SI (None for codes), and its unit in words, by field of `Inflection`."""

_PIECE = 500  # draws whose curves are kept in memory at once


class CurveShape(IntEnum):
    """Shape of the response of one draw under one load over the range of fabrics."""

    NONE = 0
    """No interior maximum."""
    INTERIOR = 1
    """An interior maximum: the response turns over."""
    SILENT = 2
    """No receptor fires anywhere."""


class Curves(NamedTuple):
    """Response and contact along a grid of fabric moduli, for every draw and load."""

    modulus: Array
    """E_fab [Pa], shape (points,), with constant ratio."""
    total_rate: Array
    """Response [spikes/s], shape (draws, loads, points)."""
    skin_modulus: Array
    """E_skin [Pa], same shape."""
    force: Array
    """Hertz's force [N], same shape."""
    radius: Array
    """Contact radius [m], same shape."""


class Inflection(NamedTuple):
    """Turning points of the response (its maximum; the paper's inflection), every field of shape (draws, loads)."""

    outcome: NDArray[np.int8]
    """An `CurveShape` for each draw and load."""
    modulus: Array
    """E_fab at the maximum [Pa]; like the next three fields, NaN unless the outcome is interior."""
    ratio: Array
    """E_fab / E_skin there [-]."""
    force: Array
    """Hertz's force there [N]."""
    drop: Array
    """Fall from the maximum to the stiff end of the range, as a share of the maximum [-]."""
    inside: NDArray[np.bool_]
    """True if an interior maximum lies within the moduli of the fabrics themselves."""


def curve_scene(scene: Scene, points: int = CURVE_POINTS, loads: Sequence[Load] | None = None) -> Scene:
    """Return the scene whose fabrics are a logarithmic grid over the range of turning points.

    Finger, readings and resolution are those of `scene`, and so are the loads unless others are given; the Poisson
    ratio is the median of its fabrics.
    """
    low, high = scene.modulus.min() / RANGE_FACTOR, scene.modulus.max() * RANGE_FACTOR
    return scene.on_grid(np.geomspace(low, high, points), loads)


def response_curves(grid: Scene, parameters: TouchParameters) -> Curves:
    """Evaluate a scene made by `curve_scene` for a batch of draws, shape (draws,)."""
    points = grid.n_conditions // len(grid.loads)
    rate, contact = grid.total_rate(parameters), grid.contact(parameters)

    def by_load(values: Array) -> Array:
        return values.reshape(*values.shape[:-1], len(grid.loads), points)

    return Curves(
        grid.modulus[:points],
        by_load(rate),
        by_load(contact.skin_modulus),
        by_load(contact.force),
        by_load(contact.radius),
    )


def find_inflection(
    curves: Curves, error: float, data_range: tuple[float, float], least_drop: float = LEAST_DROP
) -> Inflection:
    """Locate the maximum of every curve and classify it.

    The largest point of the grid is refined by the quartic through it and its four neighbours in
    ln E_fab. It counts as interior only if it exceeds the response at both ends by `least_drop` of
    itself and by three times the numerical error.

    Parameters
    ----------
    curves
        From `response_curves`.
    error
        Numerical error of the response relative to its peak [-].
    data_range
        Smallest and largest modulus of the fabrics themselves [Pa].
    least_drop
        Share of the maximum by which it must exceed both ends.
    """
    rate, log_modulus = curves.total_rate, np.log(curves.modulus)
    points = log_modulus.size
    top = np.clip(rate.argmax(axis=-1), 2, points - 3)
    offset, peak = _refine(np.stack([np.take_along_axis(rate, (top + k)[..., None], -1)[..., 0] for k in _STENCIL], -1))
    place = top + offset
    silent = rate.max(axis=-1) == 0
    margin = max(least_drop, 3.0 * error) * peak
    interior = ~silent & (peak - rate[..., 0] >= margin) & (peak - rate[..., -1] >= margin)
    outcome = np.where(silent, CurveShape.SILENT, np.where(interior, CurveShape.INTERIOR, CurveShape.NONE)).astype(
        np.int8
    )

    def at_peak(values: Array) -> Array:
        below = np.floor(place).astype(int)
        left, right = (np.take_along_axis(np.log(values), (below + k)[..., None], -1)[..., 0] for k in (0, 1))
        return np.where(interior, np.exp(left + (place - below) * (right - left)), np.nan)

    modulus = np.where(interior, np.exp(np.interp(place, np.arange(points), log_modulus)), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        drop = np.where(interior, 1.0 - rate[..., -1] / peak, np.nan)
        inside = interior & (modulus >= data_range[0]) & (modulus <= data_range[1])
    return Inflection(outcome, modulus, modulus / at_peak(curves.skin_modulus), at_peak(curves.force), drop, inside)


def turning_points(
    scene: Scene,
    parameters: TouchParameters,
    error: float,
    points: int = TURNING_POINTS,
    loads: Sequence[Load] | None = None,
) -> Inflection:
    """Return the turning points of many draws without storing their curves.

    Parameters
    ----------
    scene
        Scene of the data; the range of its fabrics defines the grid, as in `curve_scene`.
    parameters
        A batch of draws, shape (draws,).
    error
        As for `find_inflection`.
    points
        Number of grid points.
    loads
        Loads; by default those of the scene.
    """
    grid, fabrics = curve_scene(scene, points, loads), (float(scene.modulus.min()), float(scene.modulus.max()))
    parameters = TouchParameters(*np.broadcast_arrays(*parameters))
    draws = np.shape(parameters.b)[0]
    pieces = [
        find_inflection(
            response_curves(grid, TouchParameters(*(v[k : k + _PIECE] for v in parameters))), error, fabrics
        )
        for k in range(0, draws, _PIECE)
    ]
    return Inflection(*(np.concatenate(field) for field in zip(*pieces, strict=True)))


_STENCIL = (-2, -1, 0, 1, 2)


def _refine(values: Array) -> tuple[Array, Array]:
    """Return offset and height of the maximum of the quartic through five values, near the middle one."""
    c = values @ np.linalg.inv(np.vander(np.array(_STENCIL, float), increasing=True)).T
    x = np.zeros(values.shape[:-1])
    for _ in range(4):
        slope = c[..., 1] + x * (2 * c[..., 2] + x * (3 * c[..., 3] + x * 4 * c[..., 4]))
        bend = 2 * c[..., 2] + x * (6 * c[..., 3] + x * 12 * c[..., 4])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(bend < 0, -slope / bend, 0.0)
        x = np.clip(x + np.nan_to_num(step, posinf=0.0, neginf=0.0), -1.0, 1.0)
    height = c[..., 0] + x * (c[..., 1] + x * (c[..., 2] + x * (c[..., 3] + x * c[..., 4])))
    return x, np.maximum(height, values.max(axis=-1))


def turning_table(
    draws: Inflection,
    loads: Sequence[str],
    prior: Inflection | None = None,
    ensembles: int = 1,
) -> pd.DataFrame:
    """Return the table of turning points, one row per load, with the columns of `Result.inflection`.

    Parameters
    ----------
    draws
        Turning points of posterior draws, with fields of shape (chains, draws, loads).
    loads
        Names of the loads.
    prior
        Turning points of independent prior draws, with the fields and loads of the posterior's; None if there are none.
    ensembles
        Number of ensembles, whose chains follow each other in equal numbers.
    """
    rows = []
    for k, load in enumerate(loads):
        outcome = _walks(draws.outcome[..., k], ensembles)
        found = {f"p_{kind.name.lower()}": share(outcome == kind) for kind in CurveShape}
        before = Estimate(np.nan, np.nan)
        if prior is not None:
            before = share(prior.outcome[..., k].reshape(1, 1, -1) == CurveShape.INTERIOR)
        found |= {"prior_p_interior": before, "p_inside": share(_walks(draws.inside[..., k], ensembles))}
        for field in ("modulus", "ratio", "force", "drop"):
            variable, factor, _ = STORED[field]
            name, walks = (
                variable.removeprefix("inflection_"),
                _walks(getattr(draws, field)[..., k] / (factor or 1.0), ensembles),
            )
            columns = zip((f"{name}_low", name, f"{name}_high"), PERCENTS, strict=True)
            found |= {column: quantile(walks, probability) for column, probability in columns}
        errors = {f"{name}_mcse": one.error for name, one in found.items()}
        rows.append({"load": load, **{name: one.value for name, one in found.items()}, **errors})
    return pd.DataFrame(rows).set_index("load")


def with_errors(table: pd.DataFrame, columns: Sequence[str]) -> pd.DataFrame:
    """Return some columns of a `turning_table` as text, each number with its Monte-Carlo standard error.

    A number without an error comes from too few or constant draws and is left out. A probability (columns named p_ or
    prior_p_) is in per cent; one of 0 or 1, which draws cannot establish, is a bound.
    """

    def written(value: float, error: float, probability: bool) -> str:
        if not (np.isfinite(value) and error > 0):
            return "–"
        if probability and value in (0.0, 1.0):
            return chance(value)
        return f"{100 * value:.3g} ± {100 * error:.1g} %" if probability else f"{value:.3g} ± {error:.1g}"

    found = {}
    for name in columns:
        of_probability = name.removeprefix("prior_").startswith("p_")
        pairs = zip(table[name], table[f"{name}_mcse"], strict=True)
        found[name] = [written(value, error, of_probability) for value, error in pairs]
    return pd.DataFrame(found, table.index)


def _walks(values: NDArray[Any], ensembles: int) -> NDArray[Any]:
    """Rearrange draws (chains, draws) as (ensembles, draws, walkers)."""
    return np.swapaxes(values.reshape(ensembles, -1, values.shape[-1]), 1, 2)
