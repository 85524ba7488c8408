"""Common parts of figures: panels, credible bands, intervals, the fabrics' marks, axes with units, legends."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.defaults import LEVELS, LIMITS
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.style import Style
from softness_bayes.touch.contact import Load
from softness_bayes.touch.load_groups import LoadGroup, LoadGroups

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LONGEST, LONGEST_ROW = 18, 26
"""Largest number of letters in a name above a panel, and beside a row; the middle of a longer name is omitted."""

MEASURED = 8
"""Number of longest names whose length is measured."""

FOREIGN = 1.3
"""Assumed width of a letter that the default font lacks, relative to the font size."""

PITCH = 1.25
"""Smallest distance between two names, relative to the font size."""

WIDENED = 1.1
"""Smallest width of a panel after the layout, relative to its width before the layout."""

LEAD, SPARE = 8.0, 6.0
"""Height of the lines from the panel to the names, and space above the names [pt]."""

GUIDE, INK = "#D4D4D4", "#404040"
"""Colours of lines and names."""


def short_name(name: str, longest: int = LONGEST) -> str:
    """Return a name in which a long middle part is replaced by an ellipsis and dollar signs are escaped."""
    if len(name) > longest:
        end = (longest - 1) // 2
        name = f"{name[: longest - 1 - end]}…{name[len(name) - end :]}"
    return name.replace("$", r"\$")


def short_names(names: Sequence[str]) -> list[str]:
    """Return short names; if two would be equal, the common beginning and ending of all names are omitted."""
    short = [short_name(name) for name in names]
    if len({*short}) == len({*names}):
        return short
    begin, end = _shared(names), _shared([name[::-1] for name in names])
    inner = [name[begin : len(name) - end] if begin + end < len(name) else name for name in names]
    return [short_name(f"…{name}{'…' * bool(end)}") for name in inner]


def _shared(names: Sequence[str]) -> int:
    """Return the number of letters in the common beginning of all names."""
    first, last = min(names), max(names)
    return next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(len(first), len(last)))


def room_for(names: Sequence[str], style: Style) -> float:
    """Return the height of vertical names above a panel [in]; 0 without names."""
    short = short_names(names)
    several = {*sorted(short, key=len)[-MEASURED:], *sorted(short, key=lambda name: len(name.encode()))[-MEASURED:]}
    longest = max((_length(name, style.small) for name in several), default=0.0)
    return (longest + LEAD + SPARE) / 72.0 if names else 0.0


@lru_cache(maxsize=4096)
def _length(text: str, size: float) -> float:
    """Return the length of a text [pt]; letters that the default font lacks have an assumed width."""
    from matplotlib.font_manager import FontProperties, findfont, get_font
    from matplotlib.textpath import TextPath

    known = get_font(findfont(FontProperties())).get_charmap()
    foreign = sum(ord(letter) not in known for letter in text)
    usual = "".join(letter for letter in text if ord(letter) in known)
    drawn = float(TextPath((0.0, 0.0), usual, size=size).get_extents().width) if usual.strip() else 0.0
    return drawn + FOREIGN * size * foreign


def apart(places: ArrayLike, distance: float) -> Array:
    """Return positions in [0, 1] that are at least a distance apart and closest to the given ones in least squares.

    Parameters
    ----------
    places
        Given positions in ascending order, shape (n,); n - 1 distances must fit into [0, 1].
    distance
        Smallest distance between neighbours.
    """
    from scipy.optimize import isotonic_regression

    steps = distance * np.arange(np.size(places))
    moved: Array = isotonic_regression(np.asarray(places, float) - steps).x
    return np.clip(moved, 0.0, max(0.0, 1.0 - float(steps[-1]))) + steps


def name_fabrics(axes: Axes, places: ArrayLike, names: Sequence[str], style: Style, gid: str) -> int:
    """Write names above a panel whose limits are set, and return the number of names.

    If not all names fit, an evenly spaced subset is written. Fabrics outside the panel are not named.

    Parameters
    ----------
    axes
        The panel.
    places, names
        Place on the horizontal axis and name of each fabric, shape (fabrics,).
    style
        Size of the letters, and width of the page.
    gid
        Artists are named ``name/GID/NAME`` and ``guide/GID``.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.transforms import offset_copy

    low, high = axes.get_xlim()
    x = np.asarray(places, float)
    share = np.log(x / low) / np.log(high / low) if axes.get_xscale() == "log" else (x - low) / (high - low)
    order = np.array([k for k in np.argsort(share, kind="stable") if 0.0 <= share[k] <= 1.0], dtype=np.intp)
    if not order.size:
        return 0
    figure = axes.get_figure(root=True)
    assert figure is not None
    # the layout widens the panels
    distance = PITCH * style.small / 72.0 / (WIDENED * axes.get_position().width * figure.get_figwidth())
    named = np.linspace(0, order.size - 1, min(order.size, 1 + int(1.0 / distance)))  # all, or evenly spaced ones
    order = order[np.unique(named.round().astype(np.intp))]
    above = offset_copy(axes.transAxes, fig=figure, y=LEAD, units="points")
    lead = {"arrowstyle": "-", "color": GUIDE, "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 0.0, "relpos": (0.5, 0.0)}
    lead["patchA"] = None  # clipping the line at the text box would take half the time of a figure
    written = short_names(names)
    for k, at in zip(order, apart(share[order], distance), strict=True):
        words = axes.annotate(written[k], (share[k], 1.0), (at, 1.0), "axes fraction", above, lead, rotation=90)
        words.set(ha="center", va="bottom", fontsize=style.small, color=INK, gid=f"name/{gid}/{names[k]}")
    feet = LineCollection([[(x[k], 0.0), (x[k], 1.0)] for k in order], colors=GUIDE, linewidths=0.5, zorder=0.2)
    feet.set(transform=axes.get_xaxis_transform(), gid=f"guide/{gid}")
    axes.add_collection(feet, autolim=False)
    return int(order.size)


TINTS = (0.5, 0.22)
"""Colour strength of each credible level."""

WIDE = 6.0
"""Smallest width of a figure whose text and legend fit on one line [in]."""

NARROWEST = 1.6
"""Smallest width of a panel that has separate tick labels and axis labels [in]."""

LEAST_PLAIN, MOST_PLAIN = 0.0005, 2e5
"""Range of a logarithmic axis within which tick labels are plain numbers."""

MODULUS_LABEL = r"fabric modulus $E_\mathrm{fab}$ [kPa]"
RATIO_LABEL = r"$E_\mathrm{fab}\,/\,E_\mathrm{skin}$ [–]"


def title(load: Load | LoadGroup) -> str:
    """Return the heading of a load or a group of loads, as in 'Indentation 1 mm'."""
    return f"{type(load.load if isinstance(load, LoadGroup) else load).__name__} {load}"


def fitting(columns: int, style: Style) -> int:
    """Return the number of panels, at most `columns`, that fit in one row of a page."""
    return max(1, min(columns, int(style.page / NARROWEST)))


class Panels(NamedTuple):
    """A figure of panels."""

    figure: Figure
    panels: list[Axes]
    heads: list[Axes]
    """Uppermost axes of each panel, which carry the title: its margin, or the panel itself."""

    def with_legend(self, more: str = "") -> Figure:
        """Return the figure, with a legend below its panels."""
        legend_below(self.figure, self.panels, more)
        return self.figure


def make_panels(
    count: int,
    style: Style,
    height: float,
    columns: int = 4,
    xlabel: str = "",
    ylabel: str = "",
    sharex: bool = False,
    sharey: bool = False,
    narrow: bool = False,
    margin: float = 0.0,
) -> Panels:
    """Return a figure of `count` panels in full rows of a given height [in].

    It is as wide as a page, or as a column (`narrow`). The label of the horizontal axis stands below the lowest panel
    of each column, and that of the vertical axis beside the first panel of each row. `margin`, a fraction of the
    panel height, adds separate axes above each panel.
    """
    from matplotlib.figure import Figure

    columns = fitting(columns, style)
    rows = -(-count // columns)
    ratios = [margin, 1.0] * rows if margin else [1.0] * rows
    figure = Figure(figsize=(style.column if narrow else style.page, height * rows + 0.5), layout="constrained")
    cells = figure.subplots(len(ratios), columns, sharex=sharex, squeeze=False, height_ratios=ratios)
    step = len(ratios) // rows
    heads, panels = cells[::step].ravel(), cells[step - 1 :: step].ravel()
    for spare in {*heads[count:], *panels[count:]}:
        spare.remove()
    for place, axes in enumerate(panels[:count]):
        if sharey and place:
            axes.sharey(panels[0])
        if place % columns == 0:
            axes.set_ylabel(ylabel)
        elif sharey:
            axes.tick_params(which="both", labelleft=False)
        if place + columns >= count:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(xlabel)
    return Panels(figure, list(panels[:count]), list(heads[:count]))


def load_panels(
    loads: Sequence[Load | LoadGroup],
    xlabel: str,
    ylabel: str,
    style: Style,
    margin: float = 0.0,
    names: Sequence[str] = (),
) -> Panels:
    """Return a figure with a panel for each load and common axes, at most four per row, fewer on a narrow page.

    Rows have similar numbers of panels. A single panel is as wide as one column of a page. There is space for the
    names of fabrics above each row. `margin` is that of `make_panels`.
    """
    rows = -(-len(loads) // fitting(4, style))
    columns, above = -(-len(loads) // rows), room_for(names, style)
    height, narrow = 2.0 * (1.0 + margin) + above, len(loads) == 1
    grid = make_panels(len(loads), style, height, columns, xlabel, ylabel, True, True, narrow, margin)
    for head, load in zip(grid.heads, loads, strict=True):
        head.set_title(title(load), pad=72.0 * above if above and not margin else None)
    return grid


def finish_load_panels(
    grid: Panels,
    loads: Sequence[Load | LoadGroup],
    places: Sequence[Array],
    fabrics: Sequence[tuple[Array, Sequence[str]]],
    style: Style,
) -> None:
    """Set the common limits of the horizontal axes, write the names of the fabrics, and draw the legend.

    `places` are the points of each panel's curves; `fabrics` has the places and names of each panel's fabrics. A note
    on the panel with the most unnamed fabrics is added unless all are named.
    """
    unnamed = {0: ""}
    limits = min(float(x.min()) for x in places), max(float(x.max()) for x in places)
    for axes, load, (at, names) in zip(grid.panels, loads, fabrics, strict=True):
        axes.set(xscale="log", xlim=limits)
        number_ticks(axes.xaxis)
        written = name_fabrics(axes, at, names, style, str(load)) if names else 0
        unnamed.setdefault(len(names) - written, f"{written} of {len(names)} fabrics are named")
    legend_below(grid.figure, grid.panels, unnamed[max(unnamed)])


def draw_bands(axes: Axes, x: Array, draws: Array, colour: str, style: Style, gid: str) -> None:
    """Draw the median and the central credible bands of curves, shape (draws, points), along x.

    A point where a draw is NaN leaves a gap, so that a failed prediction stays visible.
    """
    axes.plot(x, np.median(draws, axis=0), color=colour, label="median", gid=f"median/{gid}")
    for level, strength, order in zip(LEVELS, TINTS, (1.5, 1.0), strict=True):
        low, high = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
        band = axes.fill_between(x, low, high, color=style.tint(colour, strength), linewidth=0, zorder=order)
        band.set(label=f"{100 * level:.0f} % credible", gid=f"band{100 * level:.0f}/{gid}")


def draw_interval(
    axes: Axes,
    draws: Array,
    height: float,
    colour: str,
    sizes: tuple[float, float],
    gids: tuple[str, str],
    label: str | None = None,
) -> Array:
    """Draw a bar over the central 90 % of draws and a dot at their median, at a height in units of the panel.

    Parameters
    ----------
    axes
        The panel.
    draws
        At least one finite value, shape (draws,).
    height
        0 at the bottom of the panel, 1 at its top.
    colour
        Colour of bar and dot.
    sizes
        Width of the bar and diameter of the dot [pt].
    gids
        Names of bar and dot.
    label
        The bar in the legend.

    Returns
    -------
    ndarray
        Lower end, median and upper end, shape (3,).
    """
    low, middle, high = ends = np.quantile(draws, LIMITS[::2])
    look: dict[str, Any] = {"color": colour, "transform": axes.get_xaxis_transform(), "clip_on": False, "zorder": 3}
    axes.plot([low, high], [height, height], linewidth=sizes[0], gid=gids[0], label=label, **look)
    axes.plot([middle], [height], "o", markersize=sizes[1], gid=gids[1], **look)
    return np.asarray(ends)


def draw_rug(axes: Axes, x: Array, style: Style, gid: str, names: Sequence[str] = ()) -> None:
    """Mark the fabrics of the data along the bottom of the panel."""
    foot = np.full(np.shape(x), 0.03)
    marks = axes.plot(x, foot, "|", markersize=5, markeredgewidth=0.7, color=style.data, gid=f"fabrics/{gid}")[0]
    marks.set(transform=axes.get_xaxis_transform(), label="fabrics of the data")
    name_rows(marks, names)


def number_ticks(axis: Axis, narrow: bool = False) -> None:
    """Label the ticks of a logarithmic axis in one notation: plain numbers, or powers of ten.

    The limits of the axis must be set. A narrow panel has fewer ticks.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    decades = np.log10(high) - np.log10(low)
    sets = ((1, 2, 5), (1, 3), (1,)) if narrow else ((1, 2, 3, 4, 6, 8), (1, 2, 5), (1,))
    axis.set_major_locator(LogLocator(subs=sets[0 if decades < 1 else 1 if decades < 2 else 2], numticks=9))
    plain = low >= LEAST_PLAIN and high < MOST_PLAIN
    axis.set_major_formatter(FuncFormatter((lambda value, _: f"{value:.12g}") if plain else _power))
    axis.set_minor_formatter(NullFormatter())
    if decades > 4:
        axis.set_minor_locator(LogLocator(subs=(2, 5), numticks=99))


def _power(value: float, _: int | None = None) -> str:
    """Return a number as a power of ten, multiplied by its first digit unless that is 1."""
    exponent = int(np.floor(np.log10(value) + 1e-9))
    first = round(value / 10.0**exponent)
    return rf"$10^{{{exponent}}}$" if first == 1 else rf"${first}\cdot10^{{{exponent}}}$"


def say_grouped(figure: Figure, groups: LoadGroups, style: Style, curves: bool = True) -> Figure:
    """Write a note at the top of a figure of grouped loads, including the loads of the curves; return the figure."""
    if groups.merged:
        at = "; curves are at the middle load of each" if curves else ""
        with style.applied():
            figure.suptitle(f"{groups.sentence}{at}", fontsize=style.small)
    return figure


def legend_below(figure: Figure, axes: Sequence[Axes], more: str = "") -> None:
    """Draw a legend below the panels, with each label once, and a line of text below it."""
    handles: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    columns = 2 if len(axes) == 1 or figure.get_figwidth() < WIDE else len(handles)
    legend = figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=columns)
    if more:
        legend.set_title(more)
