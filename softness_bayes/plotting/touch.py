"""Figure of a touch: pressure and stress under the finger pad, and firing rates of its receptors (model.md 4-8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.plotting.panels import WIDE, Array, fitting, short
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpec

SEEN = 0.02
"""Fraction of the largest stress at which the axis of distances ends."""

MARGIN = 1.25
"""Half-width of the shown part of the pad, relative to the largest contact radius."""

COLOURS = "viridis"
"""Colour map of rates, which is perceptually uniform and suitable for colour-blind readers."""


class Touches(NamedTuple):
    """Touches of some fabrics under some loads; limits are lower limit, median and upper limit over the draws."""

    distance: Array
    """Distances from the axis of the contact [m], shape (distances,)."""
    pressure: Array
    """Limits of the pressure [Pa], shape (3, loads, fabrics, distances)."""
    stress: Array
    """Limits of the stress at the receptors' depth [Pa], same shape."""
    rate: Array
    """Median rate of a receptor [Hz], shape (loads, fabrics, distances)."""
    radius: Array
    """Median contact radius [m], shape (loads, fabrics)."""
    loads: Sequence[str]
    """Names of the loads."""
    fabrics: Sequence[str]
    """Names of the fabrics."""
    modulus: Array
    """E_fab of the fabrics [Pa]."""
    receptors: Array
    """Positions of the receptors along and across the finger [m], shape (receptors, 2)."""
    pad: Array
    """Length and width of the pad [m]."""
    centre: Array
    """Point of the pad on the contact's axis [m]."""


def touch_figure(touches: Touches, *, style: Style = USUAL) -> Figure:
    """Draw pressure, stress and firing rate against the distance from the axis, and maps of the pad's receptors below.

    Each column is a load; a narrow page shows the smallest and the largest. Lines are medians over the draws, and
    bands are their central 95 %. Receptor positions are sampled from the receptor density. Their colour is the median
    rate at their distance; open symbols are silent receptors. The circle is the edge of the contact. Only the part
    of the pad around the contact is shown.

    Returns
    -------
    Figure
        Artists named ``stress/1 mm/0``, ``pressure/1 mm/0``, ``band95/1 mm/0``, ``rate/1 mm/0``, ``firing/1 mm/0``,
        ``silent/1 mm/0`` and ``contact/1 mm/0``. The last number is the index of the fabric. Lengths are in mm,
        stresses in kPa.

    Raises
    ------
    InputError
        If the shapes disagree.
    """
    shape = (len(touches.loads), len(touches.fabrics), touches.distance.size)
    if not touches.pressure.shape == touches.stress.shape == (3, *shape) or touches.rate.shape != shape:
        raise InputError(f"touch figure: stress of shape {touches.stress.shape}, expected {(3, *shape)}")
    from matplotlib.figure import Figure

    columns, rows = fitting(shape[0], style), shape[1]
    touches = _under(touches, np.unique(np.linspace(0, shape[0] - 1, columns).round().astype(int)))
    with style.applied():
        width = style.column if columns == 1 else style.page
        # the maps have the proportions of the pad, which determines the height
        tall = (width - 0.9) / columns * touches.pad[1] / touches.pad[0]
        words = 0.0 if width >= WIDE else 0.5  # height of the legend
        figure = Figure(figsize=(width, 3.6 + words + rows * (tall + 0.12) + 0.8), layout="constrained")
        grid = figure.add_gridspec(rows + 2, columns, height_ratios=[1.7 / tall, 1.4 / tall, *[1.0] * rows])
        _draw_profiles(figure, grid, touches, style)
        ends = _ends_of_rates(touches)
        maps = [
            [_draw_pad(figure.add_subplot(grid[row + 2, k]), touches, k, row, ends, style) for k in range(columns)]
            for row in range(rows)
        ]
        for row, panels in enumerate(maps):
            panels[0].set_ylabel("across [mm]")
            panels[0].set_title(_called(touches, row), color=_colour(style, row))
            for place, axes in enumerate(panels):
                axes.tick_params(labelleft=place == 0, labelbottom=row == rows - 1)
        for axes in maps[-1]:
            axes.set_xlabel("along the finger [mm]")
        _key_of_rates(figure, [axes for panels in maps for axes in panels], ends)
        _key_of_receptors(figure, style)
    return figure


def _under(touches: Touches, loads: NDArray[np.intp]) -> Touches:
    """Return the touches under some loads."""
    return touches._replace(
        pressure=touches.pressure[:, loads],
        stress=touches.stress[:, loads],
        rate=touches.rate[loads],
        radius=touches.radius[loads],
        loads=[touches.loads[k] for k in loads],
    )


def _called(touches: Touches, fabric: int) -> str:
    return f"{touches.fabrics[fabric]}, {short(touches.modulus[fabric] / 1e3)} kPa"


def _colour(style: Style, fabric: int) -> str:
    return style.ensembles[fabric % len(style.ensembles)]


def _draw_profiles(figure: Figure, grid: GridSpec, touches: Touches, style: Style) -> None:
    from matplotlib.lines import Line2D

    x, stress, pressure = touches.distance * 1e3, touches.stress / 1e3, touches.pressure / 1e3
    seen = x[(stress[1] > SEEN * stress[1].max()).any(axis=(0, 1))]
    first: Axes | None = None
    firing: Axes | None = None
    for k, load in enumerate(touches.loads):
        axes = figure.add_subplot(grid[0, k], sharey=first)
        below = figure.add_subplot(grid[1, k], sharey=firing)
        for fabric in range(len(touches.fabrics)):
            colour, gid = _colour(style, fabric), f"{load}/{fabric}"
            low, middle, high = stress[:, k, fabric]
            band = axes.fill_between(x, low, high, color=style.tint(colour, 0.25), linewidth=0)
            band.set_gid(f"band95/{gid}")
            axes.plot(x, middle, color=colour, gid=f"stress/{gid}")
            axes.plot(x, pressure[1, k, fabric], color=colour, linewidth=0.7, linestyle="--", gid=f"pressure/{gid}")
            below.plot(x, touches.rate[k, fabric], color=colour, gid=f"rate/{gid}")
        axes.set(title=load)
        below.set(xlabel="from the axis [mm]")
        for panel in (axes, below):
            panel.set_xlim(0.0, seen.max(initial=x[1]))
            panel.tick_params(labelleft=first is None, labelbottom=panel is below)
        first, firing = first or axes, firing or below
    if first is not None and firing is not None:
        first.set(ylim=(0.0, None), ylabel="stress [kPa]")
        firing.set(ylim=(0.0, None), ylabel="firing rate [Hz]")
        keys = [
            Line2D([], [], color="black", linewidth=0.9, label="stress at the receptors, 95 % credible"),
            Line2D([], [], color="black", linewidth=0.9, linestyle="--", label="pressure on the skin"),
        ]
        keys += [
            Line2D([], [], color=_colour(style, k), label=_called(touches, k)) for k in range(len(touches.fabrics))
        ]
        figure.legend(handles=keys, loc="outside upper left", ncols=3 if figure.get_figwidth() >= WIDE else 1)


def _rates(touches: Touches, load: int, fabric: int) -> Array:
    """Return the rate of each receptor of the pad."""
    away = np.hypot(*(touches.receptors - touches.centre).T)
    found: Array = np.interp(away, touches.distance, touches.rate[load, fabric])
    return found


def _ends_of_rates(touches: Touches) -> tuple[float, float]:
    """Return the smallest and largest rates of the firing receptors, which are the limits of the colour map."""
    every = [_rates(touches, k, f) for k in range(len(touches.loads)) for f in range(len(touches.fabrics))]
    rates = np.concatenate(every)
    firing = rates[rates > 0]
    low, high = (float(firing.min()), float(firing.max())) if firing.size else (0.0, 1.0)
    return (low, high) if high > low else (0.0, high)


def _window(touches: Touches) -> tuple[Array, Array]:
    """Return the limits of the shown part of the pad [m], with the proportions of the pad and all contacts inside."""
    half = min(MARGIN * float(touches.radius.max()), 0.5 * float(touches.pad[1]))
    size = np.array([half * touches.pad[0] / touches.pad[1], half])
    middle = np.clip(touches.centre, size, touches.pad - size)
    return middle - size, middle + size


def _draw_pad(axes: Axes, touches: Touches, load: int, fabric: int, ends: tuple[float, float], style: Style) -> Axes:
    from matplotlib.patches import Circle
    from matplotlib.ticker import MultipleLocator

    places, gid = touches.receptors * 1e3, f"{touches.loads[load]}/{fabric}"
    rate = _rates(touches, load, fabric)
    fires = rate > 0
    silent = axes.plot(*places[~fires].T, "o", markersize=2.2, markerfacecolor="none", markeredgewidth=0.4)[0]
    silent.set(color=style.absent, gid=f"silent/{gid}", zorder=1)
    x, y = places[fires].T
    dots = axes.scatter(x, y, 16, rate[fires], cmap=COLOURS, vmin=ends[0], vmax=ends[1], linewidths=0, zorder=2)
    dots.set_gid(f"firing/{gid}")
    edge = Circle(tuple(touches.centre * 1e3), touches.radius[load, fabric] * 1e3, fill=False, linewidth=0.6)
    edge.set_gid(f"contact/{gid}")
    axes.add_patch(edge)
    (left, foot), (right, top) = (corner * 1e3 for corner in _window(touches))
    axes.set(xlim=(left, right), ylim=(foot, top), aspect="equal")
    axes.xaxis.set_major_locator(MultipleLocator(5.0))
    axes.yaxis.set_major_locator(MultipleLocator(5.0))
    return axes


def _key_of_receptors(figure: Figure, style: Style) -> None:
    """Draw the legend of the receptor symbols below the maps."""
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    dot: dict[str, Any] = {"linestyle": "none", "marker": "o"}
    keys = [
        Line2D([], [], color=colormaps[COLOURS](0.7), markersize=4, label="firing receptor (colour: rate)", **dot),
        Line2D([], [], color=style.absent, markerfacecolor="none", markersize=3, label="silent receptor", **dot),
        Line2D([], [], color="black", linewidth=0.6, label="edge of the contact"),
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=3 if figure.get_figwidth() >= WIDE else 1)


def _key_of_rates(figure: Figure, axes: Sequence[Axes], ends: tuple[float, float]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    mapped = ScalarMappable(Normalize(*ends), COLOURS)
    figure.colorbar(
        mapped, ax=list(axes), location="bottom", aspect=50, shrink=0.6, label="firing rate of a receptor [Hz]"
    )
