"""Forest plot of a study: intervals of each table, fitted separately and pooled, above that of the population."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.plotting.panels import (
    LONGEST_ROW,
    MODULUS_LABEL,
    fitting,
    legend_below,
    make_panels,
    number_ticks,
    short_name,
)
from softness_bayes.plotting.style import USUAL, Style, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_ROW, _SPARE = 0.17, 1.0  # height of a row, and of the margins above and below [in]


class Forest(NamedTuple):
    """Intervals of one parameter; the first axis of each array is lower end, middle and upper end."""

    parameter: str
    label: str
    """Label of the axis."""
    tables: Sequence[str]
    separate: Array
    """Intervals of the separate fits, shape (3, tables)."""
    shrunken: Array | None = None
    """Intervals of the pooled fit, shape (3, tables); None if no population was fitted."""
    population: Array | None = None
    """Interval of the population mean, shape (3,)."""
    new: Array | None = None
    """Predicted interval of a new table, shape (3,)."""


@styled
def forest_figure(forests: Sequence[Forest], *, style: Style = USUAL) -> Figure:
    """Draw a panel per parameter and a row per table, with the population mean and a new table at the bottom.

    Parameters
    ----------
    forests
        Intervals of each parameter; all have the same tables.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Lines named ``separate/b``, ``shrunken/b``, ``population/b`` and ``new/b``, and points ``…/b/middle``.

    Raises
    ------
    InputError
        If there is nothing to show.
    """
    if not forests or not forests[0].tables:
        raise InputError("figure: no tables in a study")
    rows, columns = len(forests[0].tables) + 2, fitting(min(3, len(forests)), style)
    height = max(_ROW * rows + _SPARE, 2.0)
    grid = make_panels(len(forests), style, height, columns, sharey=True, narrow=columns == 1)
    names = [short_name(name, LONGEST_ROW) for name in forests[0].tables]
    grid.panels[0].set_yticks(np.arange(rows), [*names, "population", "a further table"])
    for axes, forest in zip(grid.panels, forests, strict=True):
        _draw(axes, forest, style)
    grid.panels[0].set_ylim(rows - 0.4, -0.6)
    return grid.with_legend()


def _draw(axes: Axes, forest: Forest, style: Style) -> None:
    """Draw the intervals of one parameter."""
    place = np.arange(len(forest.tables), dtype=float)
    shrunken, of = forest.shrunken is not None, forest.parameter
    _intervals(
        axes, forest.separate, place - 0.15 * shrunken, style.prior, f"separate/{forest.parameter}", "separately"
    )
    if forest.shrunken is not None:
        _intervals(
            axes, forest.shrunken, place + 0.2, style.posterior, f"shrunken/{forest.parameter}", "in the population"
        )
    for kind, interval, row in (("population", forest.population, 0), ("new", forest.new, 1)):
        if interval is not None:
            at = np.array([float(len(forest.tables) + row)])
            _intervals(axes, interval[:, None], at, style.inflection, f"{kind}/{of}")
    axes.axhline(len(forest.tables) - 0.5, color=style.tint(style.prior, 0.5), linewidth=0.6)
    axes.set_xlabel(forest.label)
    if not shrunken:
        axes.set_title("not pooled")
    if forest.separate.min() > 0:
        axes.set_xscale("log")
        number_ticks(axes.xaxis)


def _intervals(axes: Axes, ends: Array, place: Array, colour: str, gid: str, label: str = "") -> None:
    """Draw a line from the lower to the upper end of each interval, and a point at its middle."""
    axes.hlines(place, ends[0], ends[2], color=colour, linewidth=1.2).set_gid(gid)
    marks = axes.plot(ends[1], place, linestyle="none", marker="o", markersize=3, color=colour)[0]
    marks.set(gid=f"{gid}/middle", label=label or "_")


@styled
def gain_figure(gains: pd.DataFrame, about: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw the information of each candidate against its modulus, a panel for each load.

    Behind it is the expected response, whose axis is on the right.

    Parameters
    ----------
    gains
        Table of `Plan.gains`.
    about
        What is to be learnt.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``gain/LOAD`` (all candidates), ``owned/LOAD`` (those that the experiment has), ``chosen/LOAD``
        and ``response/LOAD`` (90 % band).
    """
    by_load = gains.sort_values("e_fab_kpa").groupby(["indentation_mm", "force_n"], dropna=False)
    label, columns = f"information on {', '.join(about)} [nats]", min(4, by_load.ngroups)
    grid = make_panels(by_load.ngroups, style, 2.2, columns, MODULUS_LABEL, label, sharey=True)
    ends = gains["response_low"].min(), gains["response_high"].max() + 1e-9
    behind = [axes.twinx() for axes in grid.panels]
    for axes, back, (_, part) in zip(grid.panels, behind, by_load, strict=True):
        depth, force = part[["indentation_mm", "force_n"]].to_numpy()[0]
        load = f"{depth:g} mm" if np.isfinite(depth) else f"{force:g} N" if np.isfinite(force) else "free touch"
        x, gain = part["e_fab_kpa"], part["gain_nats"]
        band = back.fill_between(x, part["response_low"], part["response_high"], gid=f"response/{load}", linewidth=0)
        band.set(color=style.tint(style.prior, 0.3), label="expected response, 90 % credible")
        back.set_ylim(ends)
        back.tick_params(right=False, labelright=False)
        axes.set_zorder(back.get_zorder() + 1)
        axes.patch.set_visible(False)
        axes.plot(x, gain, color=style.posterior, linewidth=1.0, gid=f"gain/{load}", label="information")
        for what, some, look in (("owned", ~part["to_obtain"], "o"), ("chosen", part["chosen"] > 0, "D")):
            marks = axes.plot(x[some], gain[some], look, markersize=4, gid=f"{what}/{load}", label=what)
            marks[0].set_color(style.data if what == "chosen" else style.absent)
        axes.set(xscale="log", title=load, ylim=(0.0, 1.1 * gains["gain_nats"].max() + 1e-9))
        number_ticks(axes.xaxis, narrow=True)
    behind[-1].tick_params(right=True, labelright=True)
    behind[-1].set_ylabel("response")
    behind[-1].spines["right"].set_visible(True)
    legend_below(grid.figure, [*grid.panels, *behind])
    return grid.figure


MARKERS = "s^vDP*X<>dph"
"""Markers of the peers, used in turn."""


@styled
def work_precision_figure(
    series: Mapping[str, Sequence[tuple[float, float]]],
    peers: Mapping[str, tuple[float, float]],
    dial: Sequence[tuple[float, float]] = (),
    machine: str = "",
    *,
    style: Style = USUAL,
) -> Figure:
    """Draw time against error: a line for each series, and a point for each peer.

    Parameters
    ----------
    series
        Name of each series -> time per parameter vector [s] and largest error of each setting.
    peers
        Name of each peer -> time per parameter vector [s] and error.
    dial
        Time and error at the default accuracy setting, which is marked.
    machine
        Description of the machine on which the times were measured.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Lines named ``series/NAME``, points named ``peer/NAME`` and ``dial``.

    Raises
    ------
    InputError
        If there is nothing to draw.
    """
    from matplotlib.figure import Figure

    if not series:
        raise InputError("work against precision: expected at least one series")
    figure = Figure(figsize=(style.page, 0.55 * style.page), layout="constrained")
    axes = figure.add_subplot()
    for k, (name, pairs) in enumerate(series.items()):
        time, wrong = np.reshape(pairs, (-1, 2)).T * [[1e6], [1.0]]
        some = (time > 0) & (wrong > 0)  # the axes are logarithmic
        (line,) = axes.plot(wrong[some], time[some], "o-", ms=2.5, color=style.ensembles[k % len(style.ensembles)])
        line.set(label=name, gid=f"series/{name}")
    for k, (name, (second, off)) in enumerate(peers.items()):
        mark = MARKERS[k % len(MARKERS)]
        (line,) = axes.plot([off], [1e6 * second], mark, ms=4, color=style.prior, ls="none", label=name)
        line.set_gid(f"peer/{name}")
    if dial:
        time, wrong = 1e6 * np.array(dial).T[0], np.array(dial).T[1]
        (line,) = axes.plot(wrong, time, "o", ms=9, mfc="none", color="black", ls="none", label="default accuracy")
        line.set_gid("dial")
    axes.set(xscale="log", yscale="log", xlabel="largest error, relative to the peak response")
    axes.set_ylabel("time per parameter vector [µs]")
    axes.invert_xaxis()
    axes.set_title(machine)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
