"""Forest plot of a study: intervals of each table, fitted separately and pooled, above that of the population."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.plotting.names import LONGEST_ROW, short_name
from softness_bayes.plotting.panels import fitting, legend_below, number_ticks
from softness_bayes.plotting.style import USUAL, Style, styled

if TYPE_CHECKING:
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
    from matplotlib.figure import Figure

    if not forests or not forests[0].tables:
        raise InputError("figure: no tables in a study")
    rows = len(forests[0].tables) + 2
    columns = fitting(min(3, len(forests)), style)
    lines = -(-len(forests) // columns)
    width = style.column if columns == 1 else style.page
    figure = Figure(figsize=(width, lines * max(_ROW * rows + _SPARE, 2.0)), layout="constrained")
    cells = figure.subplots(lines, columns, sharey=True, squeeze=False).ravel()
    for spare in cells[len(forests) :]:
        spare.remove()
    for axes, forest in zip(cells, forests, strict=False):
        _draw(axes, forest, style)
    names = [short_name(name, LONGEST_ROW) for name in forests[0].tables]
    cells[0].set_yticks(np.arange(rows), [*names, "population", "a further table"])
    cells[0].set_ylim(rows - 0.4, -0.6)
    legend_below(figure, list(cells[: len(forests)]))
    return figure


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
