"""Ratings against the fabric's modulus under each load: observed, predicted (model.md 9), and those of a design."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.layout import Layout
from softness_bayes.likelihood.scales import MAGNITUDE, Scale
from softness_bayes.plotting import stored
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    Array,
    draw_bands,
    draw_rug,
    finish_load_panels,
    legend_below,
    load_panels,
    number_ticks,
    say_grouped,
)
from softness_bayes.plotting.response import modulus_axes
from softness_bayes.plotting.style import USUAL, Style, styled
from softness_bayes.touch.load_groups import LoadGroups

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


CROWD = 60
"""Smallest number of points in a panel for which small points are drawn."""


class Observed(NamedTuple):
    """Summary of the ratings of each condition; every field has shape (conditions,)."""

    modulus: Array
    """E_fab [Pa]."""
    load: NDArray[np.intp]
    """Index of the load."""
    mean: Array
    """Geometric mean over the participants (for z-scores, arithmetic mean); NaN without ratings."""
    low: Array
    """Mean divided by one geometric standard deviation between participants (for z-scores, mean minus one standard
    deviation); NaN for fewer than two participants."""
    high: Array
    """Mean multiplied by one geometric standard deviation between participants (for z-scores, mean plus one standard
    deviation); NaN for fewer than two participants."""
    participants: NDArray[np.intp]
    """Number of participants who rated the condition."""
    limits: tuple[Array, Array] | None = None
    """90 % limits of E_fab [Pa], equal where it is known; None if all are known."""


def rating(result: stored.Drawable, style: Style, against_ratio: bool = False) -> Figure:
    """Draw predicted and observed ratings against E_fab or E_fab / E_skin, one panel per load.

    The bands are credible intervals of the rating that a typical participant (s = 0) gives on average. They exclude the
    noise of single ratings and the participants' rating scales. The points are those of `observed_ratings`. Ratings
    outside `Scale.drawn` are drawn at its ends.

    Returns
    -------
    Figure
        Artists named ``median/1 mm``, ``band90/1 mm``, ``band50/1 mm``, ``ratings/1 mm`` (points), ``spread/1 mm``
        (bars), ``name/1 mm/NAME``, ``guide/1 mm``, and for limits of moduli ``limits/1 mm``.
    """
    curves, loads, scale, observed = result.curves(), result.load_groups.called, result.scale, observed_of(result)
    draws = np.clip(np.asarray(result.typical_ratings(), float), *scale.drawn)
    means = np.clip([observed.mean, observed.low, observed.high], *scale.drawn)
    horizontal, names = modulus_axes(curves, against_ratio), stored.fabric_names(result)
    grid = load_panels(loads, horizontal[0].label, scale.label, style, names=names)
    fabrics: list[tuple[Array, list[str]]] = []
    for k, (axes, load, axis) in enumerate(zip(grid.panels, loads, horizontal, strict=True)):
        here = (observed.load == k) & np.isfinite(means[0])
        places = axis.place(observed.modulus[here])
        called = [names[row % len(names)] for row in np.flatnonzero(here)]
        draw_bands(axes, axis.grid, axis.carry(draws[:, k]), style.posterior, style, str(load))
        _draw_observed(axes, places, means[:, here], scale, style, str(load), called)
        if observed.limits:
            low, high = (axis.place(ends[here]) for ends in observed.limits)
            some = high > low
            bars = axes.hlines(means[0, here][some], low[some], high[some], linewidth=0.8)
            bars.set(label="90 % limits of the modulus", gid=f"limits/{load}", zorder=1.8)
            bars.set_color(style.tint(style.data, 0.35))
        axes.set_yscale(scale.axis)
        fabrics.append((places, called))
    for axes in grid.panels if scale.axis == "log" else ():
        number_ticks(axes.yaxis)
    finish_load_panels(grid, loads, [axis.grid for axis in horizontal], fabrics, style)
    return say_grouped(grid.figure, result.load_groups, style)


def observed_of(result: stored.Drawable) -> Observed:
    """Return the ratings of a run by condition: a fabric under one load or under one group of loads."""
    from softness_bayes.checking.layout import ratings_in

    constant, modulus = result.group("constant_data"), stored.fabric_modulus(result)
    count, limits = result.load_groups.at.size, stored.modulus_limits(result)
    observed = observed_ratings(
        ratings_in(result.tree),
        stored.rated_load(result) * modulus.size + constant["fabric_index"].values,
        constant["participant_index"].values,
        np.tile(modulus, count),
        np.repeat(np.arange(count), modulus.size),
        scale=result.scale,
    )
    ends = None if limits is None else (np.tile(limits[0], count), np.tile(limits[2], count))
    return observed._replace(limits=ends)


def observed_ratings(
    rating: ArrayLike,
    condition: ArrayLike,
    participant: ArrayLike,
    modulus: ArrayLike,
    load: ArrayLike,
    *,
    scale: Scale = MAGNITUDE,
) -> Observed:
    """Summarise ratings by condition, with each participant's rating scale removed.

    log y = c_condition + s_participant + e is solved by least squares with the s summing to zero
    (`likelihood.layout.Layout.fit`), so that neither a participant's rating scale nor a missing rating shifts a
    condition. The mean and the spread of a condition are those of log y - s between its participants, each of whom
    counts once.

    Parameters
    ----------
    rating
        Ratings, positive or NaN where missing, shape (ratings,).
    condition, participant
        Indices of each rating's condition and participant, shape (ratings,).
    modulus, load
        E_fab [Pa] and index of the load of each condition, shape (conditions,).
    scale
        Scale of the ratings. z-scores are already standardised: differences between participants remain.

    Raises
    ------
    InputError
        If a rating is not on the scale.
    """
    modulus, load = np.asarray(modulus, float), np.asarray(load, np.intp)
    known = ~np.isnan(rating := np.asarray(rating, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        additive = scale.additive(rating[known])
    if not np.isfinite(additive).all():
        raise InputError(f"observed ratings: expected {scale.suitable} ratings; a {scale.mean} needs them")
    rated, place = np.unique(np.asarray(condition)[known], return_inverse=True)
    people, person = np.unique(np.asarray(participant)[known], return_inverse=True)
    layout = Layout(Design(place, person, rated, people.size), modulus[rated], load[rated], scale=scale)
    aligned = additive - layout.fit(rating[known]).participant[person] if scale.own_units else additive
    cells, total = layout.design.cells, np.zeros((people.size, rated.size))
    np.add.at(total, (person, place), aligned)
    each = np.divide(total, cells, out=np.full(total.shape, np.nan), where=cells > 0)
    count, found = (cells > 0).sum(axis=0), np.full((3, modulus.size), np.nan)
    mean = np.nanmean(each, axis=0)
    spread = np.sqrt(np.nansum((each - mean) ** 2, axis=0) / np.where(count > 1, count - 1, np.nan))
    found[:, rated] = scale.natural(np.stack([mean, mean - spread, mean + spread]))
    middle, low, high = found
    return Observed(modulus, load, middle, low, high, np.bincount(rated, count, modulus.size).astype(np.intp))


def _draw_observed(
    axes: Axes, x: Array, means: Array, scale: Scale, style: Style, gid: str, names: Sequence[str]
) -> None:
    """Draw mean, lower and upper end, shape (3, conditions), of observed ratings.

    If there are many points, they are small and drawn below the curve.
    """
    size, strength, width, order = (1.2, 0.35, 0.3, 1.6) if x.size > CROWD else (3.0, 0.6, 0.8, 2.0)
    spread = axes.vlines(x, *means[1:], color=style.tint(style.data, strength), linewidth=width, zorder=order)
    spread.set(label="± 1 sd between participants", gid=f"spread/{gid}")
    points = axes.plot(x, means[0], "o", color=style.data, markersize=size, gid=f"ratings/{gid}")[0]
    points.set(label=scale.mean, zorder=1.7 if order < 1.7 else 3)
    for marks in (spread, points):
        name_rows(marks, names)


@styled
def design_figure(
    modulus: ArrayLike,
    response: ArrayLike,
    observed: Observed,
    groups: LoadGroups,
    *,
    scale: Scale = MAGNITUDE,
    style: Style = USUAL,
) -> Figure:
    """Draw the mean rating of each condition over the response predicted by the prior.

    Each draw of the response is divided by its maximum.

    Parameters
    ----------
    modulus
        Grid of E_fab [Pa], shape (points,).
    response
        Draws of the response under the prior, shape (draws, loads, points).
    observed
        The data of these loads.
    groups
        The loads, with one panel each. If there are many, they are grouped; a group's response is that of its middle
        load.
    scale
        Scale of the ratings.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``median/1 mm``, ``band90/1 mm``, ``band50/1 mm`` (response), ``fabrics/1 mm`` and
        ``ratings/1 mm`` (means, on the axis at the right).
    """
    grid, draws = np.asarray(modulus, float) / 1e3, np.asarray(response, float)
    loads = groups.called
    largest = draws.max(axis=(1, 2), keepdims=True)
    relative = np.divide(draws, largest, out=np.zeros_like(draws), where=largest > 0)
    grid_of_loads = load_panels(loads, MODULUS_LABEL, "response / largest under the prior", style)
    twins = [axes.twinx() for axes in grid_of_loads.panels]
    limits = _limits(observed.mean[observed.load >= 0], scale)
    for index, (axes, twin, load) in enumerate(zip(grid_of_loads.panels, twins, loads, strict=True)):
        here = (observed.load == index) & np.isfinite(observed.mean)
        x = observed.modulus[here] / 1e3
        draw_bands(axes, grid, relative[:, index], style.prior, style, str(load))
        draw_rug(axes, x, style, str(load))
        points = twin.plot(x, observed.mean[here], "o", color=style.data, markersize=3, gid=f"ratings/{load}")[0]
        points.set(label=scale.mean)
        axes.set(xscale="log", xlim=(grid.min(), grid.max()), ylim=(0, 1.05))
        twin.set(yscale=scale.axis, ylim=limits)
        twin.spines["right"].set_visible(True)
        number_ticks(axes.xaxis)
        if scale.axis == "log":
            number_ticks(twin.yaxis)
    twins[-1].set_ylabel(scale.label)
    say_grouped(grid_of_loads.figure, groups, style)
    legend_below(grid_of_loads.figure, [*grid_of_loads.panels, *twins])
    return grid_of_loads.figure


def _limits(means: Array, scale: Scale) -> tuple[float, float]:
    """Return the ends of an axis of means, with a margin."""
    additive = scale.additive(means[np.isfinite(means)])
    low, high = additive.min(), additive.max()
    margin = 0.08 * (high - low) or 1.0
    ends = scale.natural(np.array([low - margin, high + margin]))
    return float(ends[0]), float(ends[1])
