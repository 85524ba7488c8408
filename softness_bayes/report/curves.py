"""Contents of the interactive charts: bands of response and rating under each load, on either axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.turning_points import PERCENTS
from softness_bayes.plotting.panels import title
from softness_bayes.plotting.rating import observed_ratings
from softness_bayes.readable import chance, number
from softness_bayes.report.words import share
from softness_bayes.results.result import Result

Array = NDArray[np.float64]

QUANTILES: Mapping[str, float] = {"median": 0.5, "low50": 0.25, "high50": 0.75, "low95": 0.025, "high95": 0.975}
"""Column name -> quantile: the median and the limits of the central 50 % and 95 % of the draws."""

DIGITS = 5
"""Number of significant digits in the data of a chart."""


class Axis(NamedTuple):
    """A possible horizontal axis of a chart."""

    name: str
    label: str
    unit: str


AXES = (Axis("e_fab", "Fabric modulus E_fab [kPa]", "kPa"), Axis("ratio", "E_fab / E_skin", "times the skin"))
"""The horizontal axes: E_fab, and its ratio to the modulus of the compressed skin."""


class Shown(NamedTuple):
    """Contents of a chart for one load and axis; every list is a column."""

    title: str
    ends: tuple[float, float]
    """Ends of the axis."""
    rate: dict[str, list[float]]
    """Response [spikes/s]: x, and a column for each of `QUANTILES`."""
    rating: dict[str, list[float]]
    """Rating of a typical participant, with the same columns."""
    fabrics: dict[str, list[Any]]
    """Columns x, name, mean rating (NaN without ratings) and its spread between participants; `foot` is 0."""
    turn: dict[str, list[float]]
    """Columns left, middle and right: 90 % interval of the turning point; empty if no draw has a turning point."""
    told: str
    """Description of the turning point in words."""


def shown(result: Result) -> dict[str, list[Shown]]:
    """Return the contents for each load, by the name of the axis.

    Parameters
    ----------
    result
        A finished run on ratings, which stores the curves. The curves of a group of loads are those of its middle load.
    """
    curves, table, groups = result.curves(), result.inflection(), result.load_groups
    typical = result.typical_ratings()
    fabric = result.group("constant_data")["effective_modulus_kpa"].values
    names = [str(name) for name in result.group("constant_data")["fabric"].values]
    modulus, ratio = curves.modulus * 1e-3, curves.modulus / curves.skin_modulus
    found: dict[str, list[Shown]] = {axis.name: [] for axis in AXES}
    for k, load in enumerate(groups.called):
        row, observed = table.loc[str(load)], _observed(result, groups.of == k)
        turns = {"e_fab": _turn(row, "e_fab_kpa"), "ratio": _turn(row, "ratio")}
        layouts = {
            "e_fab": (modulus, curves.total_rate[:, k], typical[:, k], fabric),
            "ratio": _on_ratio(modulus, ratio[:, k], curves.total_rate[:, k], typical[:, k], fabric),
        }
        for axis in AXES:
            x, rate, rating, place = layouts[axis.name]
            found[axis.name].append(
                Shown(
                    title(load),
                    (float(x[0]), float(x[-1])),
                    _band(x, rate),
                    _band(x, rating),
                    {"x": _plain(place), "fabric": names, "foot": [0.0] * len(names), **observed},
                    turns[axis.name],
                    _told(title(load), row, axis),
                )
            )
    return found


def _on_ratio(modulus: Array, ratio: Array, rate: Array, rating: Array, fabric: Array) -> tuple[Array, ...]:
    """Return a common grid of E_fab / E_skin that all draws reach, curves on it, and the fabrics' median ratios."""
    own = np.log(ratio)
    grid = np.linspace(own[:, 0].max(), own[:, -1].min(), modulus.size)
    on_grid = [np.stack([np.interp(grid, x, y) for x, y in zip(own, z, strict=True)]) for z in (rate, rating)]
    place = np.median([np.interp(np.log(fabric), np.log(modulus), x) for x in own], axis=0)
    return np.exp(grid), *on_grid, np.exp(place)


def _band(x: Array, draws: Array) -> dict[str, list[float]]:
    limits = np.quantile(draws, [*QUANTILES.values()], axis=0)
    return {"x": _plain(x), **{name: _plain(column) for name, column in zip(QUANTILES, limits, strict=True)}}


def _observed(result: Result, loads: NDArray[np.bool_]) -> dict[str, list[Any]]:
    """Return a summary of every fabric's ratings under some loads, as in the figure of ratings."""
    constant = result.group("constant_data")
    modulus = constant["effective_modulus_kpa"].values * 1e3
    every = observed_ratings(
        result.group("observed_data")["rating"].values,
        loads[constant["load_index"].values] * modulus.size + constant["fabric_index"].values,
        constant["participant_index"].values,
        np.tile(modulus, 2),
        np.repeat([0, 1], modulus.size),
        scale=result.scale,
    )
    here = every.load == 1
    return {name: _plain(getattr(every, name)[here]) for name in ("mean", "low", "high")}


def _turn(row: Any, name: str) -> dict[str, list[float]]:
    limits = [float(row[f"{name}_low"]), float(row[name]), float(row[f"{name}_high"])]
    keys = ("left", "middle", "right")
    return {key: [value] if np.isfinite(value) else [] for key, value in zip(keys, _rounded(limits), strict=True)}


def _told(load: str, row: Any, axis: Axis) -> str:
    likely = f"the response turns over with probability {chance(row['p_interior'])}"
    likely += f" (prior: {chance(row['prior_p_interior'])})" if np.isfinite(row["prior_p_interior"]) else ""
    name = "e_fab_kpa" if axis.name == "e_fab" else "ratio"
    if not np.isfinite(row[name]):
        return f"{load}: {likely}."
    within = share(PERCENTS[2] - PERCENTS[0])
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    limits = f"{within} interval {number(low)} to {number(high)}"
    return f"{load}: {likely}; if so at {number(row[name])} {axis.unit} ({limits})."


def _rounded(values: Any) -> Array:
    return np.array([float(f"{value:.{DIGITS}g}") for value in np.asarray(values, float)])


def _plain(values: Any) -> list[float]:
    """Return rounded numbers as a list of Python floats."""
    found: list[float] = _rounded(values).tolist()
    return found
