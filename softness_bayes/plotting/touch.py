"""A touch: pressure and stress under the pad, and its receptors by their rate (model.md 4-8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

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
"""Share of the largest stress below which the axis of distances ends."""

COLOURS = "viridis"
"""Colour map of rates: even in lightness and safe for the colour-blind."""


class Touches(NamedTuple):
    """Touches of some fabrics under some loads; limits are lower, middle and upper ones over draws."""

    distance: Array
    """From the contact's axis [m], shape (distances,)."""
    pressure: Array
    """Limits of the pressure [Pa], shape (3, loads, fabrics, distances)."""
    stress: Array
    """Limits of the stress at the receptors' depth [Pa], same shape."""
    rate: Array
    """Middle rate of a receptor [Hz], shape (loads, fabrics, distances)."""
    radius: Array
    """Middle contact radius [m], shape (loads, fabrics)."""
    loads: Sequence[str]
    """Names of the loads."""
    fabrics: Sequence[str]
    """Names of the fabrics."""
    modulus: Array
    """Their E_fab [Pa]."""
    receptors: Array
    """Places of receptors along and across the finger [m], shape (receptors, 2)."""
    pad: Array
    """Length and width of the pad [m]."""
    centre: Array
    """Point of the pad on the contact's axis [m]."""


def touch_figure(touches: Touches, *, style: Style = USUAL) -> Figure:
    """Draw pressure and stress against the distance from the axis, and below them the pad's receptors.

    Each column is a load; a narrow page shows the smallest and the largest. Lines are medians over the draws, bands
    their central 95 %. Receptors are drawn at random from their density, in the colour of the median rate at their
    distance; open ones are silent. The circle is the edge of the contact.

    Returns
    -------
    Figure
        Artists named ``stress/1 mm/0``, ``pressure/1 mm/0``, ``band95/1 mm/0``, ``firing/1 mm/0`` and
        ``silent/1 mm/0``, the last number that of the fabric; lengths in mm, stresses in kPa.

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
        # the pad's panels have its proportions, which fixes the height
        tall = (width - 0.9) / columns * touches.pad[1] / touches.pad[0]
        words = 0.0 if width >= WIDE else 0.5  # of the legend
        figure = Figure(figsize=(width, 2.0 + words + rows * (tall + 0.12) + 0.8), layout="constrained")
        grid = figure.add_gridspec(rows + 1, columns, height_ratios=[1.9 / tall, *[1.0] * rows])
        _draw_profiles(figure, grid, touches, style)
        top = float(touches.rate.max()) or 1.0
        maps = [
            [_draw_pad(figure.add_subplot(grid[row + 1, k]), touches, k, row, top, style) for k in range(columns)]
            for row in range(rows)
        ]
        for row, panels in enumerate(maps):
            panels[0].set_ylabel("across [mm]")
            panels[0].set_title(_called(touches, row), color=_colour(style, row))
            for place, axes in enumerate(panels):
                axes.tick_params(labelleft=place == 0, labelbottom=row == rows - 1)
        for axes in maps[-1]:
            axes.set_xlabel("along the finger [mm]")
        _key_of_rates(figure, [axes for panels in maps for axes in panels], top)
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
    for k, load in enumerate(touches.loads):
        axes = figure.add_subplot(grid[0, k], sharey=first)
        for fabric in range(len(touches.fabrics)):
            colour, gid = _colour(style, fabric), f"{load}/{fabric}"
            low, middle, high = stress[:, k, fabric]
            band = axes.fill_between(x, low, high, color=style.tint(colour, 0.25), linewidth=0)
            band.set_gid(f"band95/{gid}")
            axes.plot(x, middle, color=colour, gid=f"stress/{gid}")
            axes.plot(x, pressure[1, k, fabric], color=colour, linewidth=0.7, linestyle="--", gid=f"pressure/{gid}")
        axes.set(title=load, xlim=(0.0, seen.max(initial=x[1])), xlabel="from the axis [mm]")
        axes.tick_params(labelleft=first is None)
        first = first or axes
    if first is not None:
        first.set(ylim=(0.0, None), ylabel="stress [kPa]")
        keys = [
            Line2D([], [], color="black", linewidth=0.9, label="stress at the receptors, 95 % credible"),
            Line2D([], [], color="black", linewidth=0.9, linestyle="--", label="pressure on the skin"),
        ]
        keys += [
            Line2D([], [], color=_colour(style, k), label=_called(touches, k)) for k in range(len(touches.fabrics))
        ]
        figure.legend(handles=keys, loc="outside upper left", ncols=3 if figure.get_figwidth() >= WIDE else 1)


def _draw_pad(axes: Axes, touches: Touches, load: int, fabric: int, top: float, style: Style) -> Axes:
    from matplotlib.patches import Circle

    places, gid = touches.receptors * 1e3, f"{touches.loads[load]}/{fabric}"
    away = np.hypot(*(touches.receptors - touches.centre).T)
    rate = np.interp(away, touches.distance, touches.rate[load, fabric])
    fires = rate > 0
    silent = axes.plot(*places[~fires].T, "o", markersize=1.8, markerfacecolor="none", markeredgewidth=0.4)[0]
    silent.set(color=style.absent, gid=f"silent/{gid}", zorder=1)
    x, y = places[fires].T
    dots = axes.scatter(x, y, 7, rate[fires], cmap=COLOURS, vmin=0.0, vmax=top, linewidths=0, zorder=2)
    dots.set_gid(f"firing/{gid}")
    edge = Circle(tuple(touches.centre * 1e3), touches.radius[load, fabric] * 1e3, fill=False, linewidth=0.6)
    axes.add_patch(edge)
    length, width = touches.pad * 1e3
    axes.set(xlim=(0.0, length), ylim=(0.0, width), aspect="equal")
    axes.set(xticks=np.arange(0.0, length + 1, 10), yticks=np.arange(0.0, width + 1, 10))
    return axes


def _key_of_rates(figure: Figure, axes: Sequence[Axes], top: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    mapped = ScalarMappable(Normalize(0.0, top), COLOURS)
    figure.colorbar(
        mapped, ax=list(axes), location="bottom", aspect=50, shrink=0.6, label="firing rate of a receptor [Hz]"
    )
