"""Ratings against the fabric's modulus, predicted and observed, under each load (model.md 9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.likelihood.scales import MAGNITUDE, Scale
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.names import name_fabrics, named_in_words, room_for
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    RATIO_LABEL,
    Array,
    RatioAxis,
    check_loads,
    draw_bands,
    grid_of_panels,
    legend_below,
    number_ticks,
    title,
)
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.touch.contact import Load
from softness_bayes.touch.load_groups import LoadGroup

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

    def within(self, least: float, most: float) -> Observed:
        """Return a copy with ratings clipped to two limits."""
        mean, low, high = (np.clip(value, least, most) for value in (self.mean, self.low, self.high))
        return self._replace(mean=mean, low=low, high=high)


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

    log y = c_condition + s_participant + e is solved by least squares with the s summing to zero, so
    that neither a participant's rating scale nor a missing rating shifts a condition. exp(c) is then
    the geometric mean, and the spread is that of exp(log y - s): the disagreement between participants
    after their scales are removed. A participant's repeated ratings count as their geometric mean.

    Parameters
    ----------
    rating
        Ratings, positive or NaN where missing, shape (ratings,).
    condition, participant
        Indices of each rating's condition and participant, shape (ratings,).
    modulus, load
        E_fab [Pa] and index of the load of each condition, shape (conditions,).
    scale
        Scale of the ratings. z-scores are already standardised. They are averaged without a transformation: means are
        arithmetic, and differences between participants remain.

    Raises
    ------
    InputError
        If a rating is not on the scale.
    """
    rating, condition = np.asarray(rating, float), np.asarray(condition, np.intp)
    modulus, load = np.asarray(modulus, float), np.asarray(load, np.intp)
    known = ~np.isnan(rating)
    with np.errstate(divide="ignore", invalid="ignore"):
        additive = scale.additive(rating)
    if not np.isfinite(additive[known]).all():
        raise InputError(f"observed ratings: expected {scale.suitable} ratings; a {scale.mean} needs them")
    _, participant = np.unique(np.asarray(participant), return_inverse=True)
    shape = (modulus.size, int(participant.max(initial=-1)) + 1)
    total, trials = np.zeros(shape), np.zeros(shape)
    np.add.at(total, (condition[known], participant[known]), additive[known])
    np.add.at(trials, (condition[known], participant[known]), 1.0)
    rows, columns = np.nonzero(trials)
    value = total[rows, columns] / trials[rows, columns]
    aligned = value - _effects(value, rows, columns, shape)[columns] if scale.own_units else value
    count = np.bincount(rows, minlength=shape[0])
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(rows, aligned, shape[0]) / count
        variance = np.bincount(rows, (aligned - mean[rows]) ** 2, shape[0]) / (count - 1)
    spread = np.sqrt(np.where(count > 1, variance, np.nan))
    middle, low, high = scale.natural(np.stack([mean, mean - spread, mean + spread]))
    return Observed(modulus, load, middle, low, high, count)


def _effects(value: Array, rows: NDArray[np.intp], columns: NDArray[np.intp], shape: tuple[int, int]) -> Array:
    """Return the least-squares estimate of each participant's s; the mean over participants with ratings is 0.

    Parameters
    ----------
    value
        c_condition + s_participant + e, shape (values,).
    rows, columns
        Indices of each value's condition and participant, shape (values,).
    shape
        Numbers of conditions and participants.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import lsqr

    each = np.arange(rows.size)
    places = np.concatenate([each, each]), np.concatenate([rows, shape[0] + columns])
    design = csr_array((np.ones(2 * rows.size), places), shape=(rows.size, sum(shape)))
    effect: Array = lsqr(design, value, atol=1e-15, btol=1e-15, conlim=0.0)[0][shape[0] :]
    present = np.unique(columns)
    return effect - effect[present].mean() if present.size else effect


def rating_figure(
    modulus: ArrayLike,
    rating: ArrayLike,
    observed: Observed,
    loads: Sequence[Load | LoadGroup],
    *,
    scale: Scale = MAGNITUDE,
    skin_modulus: ArrayLike | None = None,
    names: Sequence[str] = (),
    style: Style = USUAL,
) -> Figure:
    """Draw predicted and observed ratings against E_fab or E_fab / E_skin, one panel per load.

    The bands are credible intervals of the rating that a typical participant (s = 0) gives on
    average. They exclude the noise of single ratings and the participants' rating scales. The points are
    those of `observed_ratings`. Ratings outside `Scale.drawn` are drawn at its ends.

    Parameters
    ----------
    modulus
        Grid of E_fab [Pa], shape (points,).
    rating
        Draws of the predicted rating, shape (draws, loads, points).
    observed
        The data.
    loads
        The load of each panel.
    scale
        Scale of the ratings.
    skin_modulus
        E_skin [Pa] of every draw along the grid, shape (draws, loads, points). If given, the axis is
        E_fab / E_skin: the curve of each draw uses the ratio of that draw, and the data use the median ratio.
    names
        Fabric name of each observed condition, written above its point; by default no names are written.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``median/1 mm``, ``band95/1 mm``, ``band50/1 mm``, ``ratings/1 mm`` (points) and
        ``spread/1 mm`` (bars), for limits of moduli ``limits/1 mm``, and, for names, ``name/1 mm/NAME`` and
        ``guide/1 mm``. The horizontal axis is E_fab in kPa or its ratio to E_skin.

    Raises
    ------
    InputError
        If there is not one load for each set of curves.
    """
    modulus, draws = np.asarray(modulus, float), np.asarray(rating, float)
    check_loads(loads, draws.shape[1])
    draws, observed = np.clip(draws, *scale.drawn), observed.within(*scale.drawn)
    xlabel = MODULUS_LABEL if skin_modulus is None else RATIO_LABEL
    with style.applied():
        figure, panels, _ = grid_of_panels(len(loads), xlabel, scale.label, style, above=room_for(names, style))
        ends: list[float] = []
        at: list[tuple[Array, list[str]]] = []
        for index, (axes, load) in enumerate(zip(panels, loads, strict=True)):
            here = (observed.load == index) & np.isfinite(observed.mean)
            skin = None if skin_modulus is None else np.asarray(skin_modulus)[:, index]
            shown = [one[here] for one in (observed.modulus, *(observed.limits or ()))]
            x, curves, (places, *limits) = _along_axis(modulus, draws[:, index], shown, skin)
            draw_bands(axes, x, curves, style.posterior, style, str(load))
            called = [names[int(k)] for k in np.flatnonzero(here)] if names else []
            _draw_observed(axes, places, observed, here, scale, style, str(load), called)
            if limits:
                _draw_limits(axes, limits[0], limits[1], observed.mean[here], style, str(load))
            axes.set(xscale="log", yscale=scale.axis)
            axes.set_title(title(load), pad=72.0 * room_for(names, style) or None)
            ends += [x.min(), x.max()]
            at.append((places, called))
        written = []
        for axes, load, (places, called) in zip(panels, loads, at, strict=True):
            axes.set_xlim(min(ends), max(ends))
            number_ticks(axes.xaxis)
            if scale.axis == "log":
                number_ticks(axes.yaxis)
            written.append(name_fabrics(axes, places, called, style, str(load)) if called else 0)
        legend_below(figure, panels, named_in_words(written, [len(called) for _, called in at]))
    return figure


def _along_axis(
    modulus: Array, draws: Array, observed: Sequence[Array], skin_modulus: Array | None
) -> tuple[Array, Array, list[Array]]:
    """Return a panel's grid, the draws on this grid, and the positions of moduli of the data.

    The axis is E_fab [kPa] or, if E_skin [Pa] is given, their ratio.
    """
    if skin_modulus is None:
        return modulus / 1e3, draws, [one / 1e3 for one in observed]
    axis = RatioAxis.of(modulus, skin_modulus)
    return axis.grid, axis.carry(draws), [axis.place(one) for one in observed]


def _draw_limits(axes: Axes, low: Array, high: Array, rating: Array, style: Style, gid: str) -> None:
    """Draw the limits of moduli that are not known."""
    some = high > low
    bars = axes.hlines(rating[some], low[some], high[some], color=style.tint(style.data, 0.35), linewidth=0.8)
    bars.set(label="90 % limits of the modulus", gid=f"limits/{gid}", zorder=1.8)


def _draw_observed(
    axes: Axes,
    x: Array,
    observed: Observed,
    here: NDArray[np.bool_],
    scale: Scale,
    style: Style,
    gid: str,
    names: Sequence[str] = (),
) -> None:
    # if there are many points, they are small and drawn below the curve
    many = np.size(x) > CROWD
    colour, width = style.tint(style.data, 0.35 if many else 0.6), 0.3 if many else 0.8
    spread = axes.vlines(x, observed.low[here], observed.high[here], color=colour, linewidth=width)
    spread.set(label="± 1 sd between participants", gid=f"spread/{gid}", zorder=1.6 if many else 2)
    size = 1.2 if many else 3
    points = axes.plot(x, observed.mean[here], "o", color=style.data, markersize=size, gid=f"ratings/{gid}")[0]
    points.set(label=scale.mean, zorder=1.7 if many else 3)
    for marks in (spread, points):
        name_rows(marks, names)
