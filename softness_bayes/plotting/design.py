"""Data and fabrics of a design, compared with the response predicted by the prior under each load."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.likelihood.scales import MAGNITUDE, Scale
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    Array,
    check_loads,
    draw_bands,
    draw_rug,
    grid_of_panels,
    legend_below,
    number_ticks,
    say_grouped,
    title,
)
from softness_bayes.plotting.rating import Observed
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.touch.load_groups import LoadGroups

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _limits(means: Array, scale: Scale) -> tuple[float, float]:
    """Return the ends of an axis of means, with a margin."""
    additive = scale.additive(means[np.isfinite(means)])
    low, high = additive.min(), additive.max()
    margin = 0.08 * (high - low) or 1.0
    ends = scale.natural(np.array([low - margin, high + margin]))
    return float(ends[0]), float(ends[1])


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
        Artists named ``median/1 mm``, ``band95/1 mm``, ``band50/1 mm`` (response), ``fabrics/1 mm`` and
        ``ratings/1 mm`` (means, on the axis at the right).

    Raises
    ------
    InputError
        If there is not one load for each set of curves.
    """
    grid, draws = np.asarray(modulus, float) / 1e3, np.asarray(response, float)
    loads = groups.called
    check_loads(loads, draws.shape[1])
    largest = draws.max(axis=(1, 2), keepdims=True)
    relative = np.divide(draws, largest, out=np.zeros_like(draws), where=largest > 0)
    with style.applied():
        figure, panels, _ = grid_of_panels(len(loads), MODULUS_LABEL, "response / largest under the prior", style)
        twins = [axes.twinx() for axes in panels]
        for index, (axes, twin, load) in enumerate(zip(panels, twins, loads, strict=True)):
            here = (observed.load == index) & np.isfinite(observed.mean)
            x = observed.modulus[here] / 1e3
            draw_bands(axes, grid, relative[:, index], style.prior, style, str(load))
            draw_rug(axes, x, style, str(load))
            points = twin.plot(x, observed.mean[here], "o", color=style.data, markersize=3, gid=f"ratings/{load}")[0]
            points.set(label=scale.mean)
            axes.set(xscale="log", title=title(load), xlim=(grid.min(), grid.max()), ylim=(0, 1.05))
            twin.set(yscale=scale.axis, ylim=_limits(observed.mean[observed.load >= 0], scale))
            twin.spines["right"].set_visible(True)
            number_ticks(axes.xaxis)
        twins[-1].set_ylabel(scale.label)
        for twin in twins:
            if scale.axis == "log":
                number_ticks(twin.yaxis)
        say_grouped(figure, groups, style)
        legend_below(figure, [*panels, *twins])
    return figure
