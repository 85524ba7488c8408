"""The response against the fabric's modulus, under each load (model.md 8 and 11)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.plotting.inflection import MARGIN, draw_margin
from softness_bayes.plotting.names import name_fabrics, named_in_words, room_for
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    RATE_LABEL,
    RATIO_LABEL,
    Array,
    RatioAxis,
    check_loads,
    draw_bands,
    draw_rug,
    grid_of_panels,
    legend_below,
    number_ticks,
    title,
)
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.touch.contact import HERTZ_LIMIT, Load
from softness_bayes.touch.load_groups import LoadGroup

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softness_bayes.checking.inflection import Curves, Inflection

QUESTIONABLE = "#EFEFEF"
"""Background colour of a panel where Hertz's contact theory is questionable."""


def response_figure(
    curves: Curves,
    loads: Sequence[Load | LoadGroup],
    fabric_modulus: ArrayLike,
    *,
    inflection: Inflection | None = None,
    finger_radius: float | None = None,
    names: Sequence[str] = (),
    style: Style = USUAL,
) -> Figure:
    """Draw the total rate against E_fab: median, 50 % and 95 % credible bands, one panel per load.

    Parameters
    ----------
    curves
        Draws of the response: the return value of `checking.inflection.response_curves`.
    loads
        The load of each panel.
    fabric_modulus
        E_fab of the fabrics of the data [Pa], marked along the bottom of each panel.
    inflection
        If given, its posterior is drawn along the top of each panel, with the probability of a turning
        point.
    finger_radius
        Radius R of the fingertip [m]. If given, the panel is grey where the draws' median contact radius exceeds R/2.
    names
        Names of the fabrics, written above the panels; by default no names are written.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``median/1 mm``, ``band95/1 mm``, ``band50/1 mm``, ``fabrics/1 mm``, and, where
        drawn, ``hertz/1 mm``, ``density/1 mm``, ``probability/1 mm``, ``name/1 mm/NAME`` and ``guide/1 mm``; E_fab
        in kPa.

    Raises
    ------
    InputError
        If there is not one load for each set of curves.
    """
    check_loads(loads, curves.total_rate.shape[1])
    kilopascal = curves.modulus / 1e3
    with style.applied():
        margin = MARGIN if inflection is not None else 0.0
        above = room_for(names, style)
        figure, panels, heads = grid_of_panels(len(loads), MODULUS_LABEL, RATE_LABEL, style, margin, above)
        for index, (axes, load) in enumerate(zip(panels, loads, strict=True)):
            draw_bands(axes, kilopascal, curves.total_rate[:, index], style.posterior, style, str(load))
            draw_rug(axes, np.asarray(fabric_modulus) / 1e3, style, str(load), names)
            if finger_radius is not None:
                _mark_hertz(axes, kilopascal, curves.radius[:, index], finger_radius, str(load))
        places = [np.asarray(fabric_modulus) / 1e3] * len(loads)
        _finish(figure, panels, kilopascal, _top(curves.total_rate), loads, places, names, style)
        for index, (head, load) in enumerate(zip(heads, loads, strict=True)):
            if inflection is not None:
                draw_margin(head, inflection, index, style, str(load))
            head.set_title(title(load), pad=72.0 * above if above and inflection is None else None)
    return figure


def ratio_figure(
    curves: Curves,
    loads: Sequence[Load | LoadGroup],
    fabric_modulus: ArrayLike,
    *,
    names: Sequence[str] = (),
    style: Style = USUAL,
) -> Figure:
    """Draw the total rate against E_fab / E_skin, otherwise like `response_figure`.

    E_skin differs from draw to draw. The curve of each draw is interpolated, in the logarithm of the ratio
    for that draw, to a grid over the range common to all draws. The fabrics of the data are drawn at their
    median ratios.
    """
    check_loads(loads, curves.total_rate.shape[1])
    with style.applied():
        above = room_for(names, style)
        figure, panels, _ = grid_of_panels(len(loads), RATIO_LABEL, RATE_LABEL, style, above=above)
        axis = [RatioAxis.of(curves.modulus, curves.skin_modulus[:, index]) for index in range(len(loads))]
        for index, (axes, load) in enumerate(zip(panels, loads, strict=True)):
            common = axis[index].carry(curves.total_rate[:, index])
            draw_bands(axes, axis[index].grid, common, style.posterior, style, str(load))
            draw_rug(axes, axis[index].place(fabric_modulus), style, str(load), names)
            axes.set_title(title(load), pad=72.0 * above or None)
        places = [each.place(fabric_modulus) for each in axis]
        grid = np.array([each.grid for each in axis])
        _finish(figure, panels, grid, _top(curves.total_rate), loads, places, names, style)
    return figure


def _mark_hertz(axes: Axes, x: Array, radius: Array, finger_radius: float, gid: str) -> None:
    beyond = np.median(radius, axis=0) / finger_radius > HERTZ_LIMIT
    if beyond.any():
        ground = axes.fill_between(x, 0.0, 1.0, where=list(beyond), transform=axes.get_xaxis_transform())
        ground.set(facecolor=QUESTIONABLE, edgecolor="none", linewidth=0.0, zorder=0.1, gid=f"hertz/{gid}")
        ground.set_label(f"contact radius above {HERTZ_LIMIT:g} R: geometry questionable")


def _top(rate: Array) -> float:
    """Return the upper end of the axis of rates; 1 spike/s if no receptor fires."""
    upper = np.quantile(rate, 0.975, axis=0)
    return 1.12 * float(upper[np.isfinite(upper)].max(initial=0.0)) or 1.0


def _finish(
    figure: Figure,
    panels: Sequence[Axes],
    x: Array,
    top: float,
    loads: Sequence[Load | LoadGroup],
    places: Sequence[Array],
    names: Sequence[str],
    style: Style,
) -> None:
    """Set the axes of all panels, write the names of the fabrics, and draw the legend."""
    written = []
    for axes, load, here in zip(panels, loads, places, strict=True):
        axes.set_xscale("log")
        axes.set(xlim=(x.min(), x.max()), ylim=(0.0, top))
        number_ticks(axes.xaxis)
        written.append(name_fabrics(axes, here, names, style, str(load)) if names else 0)
    legend_below(figure, panels, named_in_words(written, [len(names)] * len(panels)))
