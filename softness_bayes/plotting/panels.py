"""Common parts of figures: panels, credible bands, the fabrics' marks, axes with units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.style import Style
from softness_bayes.touch.contact import Load
from softness_bayes.touch.load_groups import LoadGroup, LoadGroups

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LEVELS = (0.5, 0.95)
"""Credible levels of bands and regions."""

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
RATE_LABEL = "total rate [spikes/s]"


def title(load: Load | LoadGroup) -> str:
    """Return the heading of a load or a group of loads, as in 'Indentation 1 mm'."""
    return f"{type(load.load if isinstance(load, LoadGroup) else load).__name__} {load}"


def check_loads(loads: Sequence[Load | LoadGroup], count: int) -> None:
    """Raise an `InputError` unless there is one load for each of `count` curves, and at least one."""
    if len(loads) != count or not count:
        raise InputError(f"figure: {len(loads)} loads for {count} sets of curves")


@dataclass(frozen=True)
class RatioAxis:
    """A grid of E_fab / E_skin, which differs from draw to draw, in the range common to all draws of one load.

    Parameters
    ----------
    log_modulus
        ln E_fab on the grid of the curves, shape (points,).
    log_ratio
        ln(E_fab / E_skin) of every draw on the same grid, shape (draws, points).
    """

    log_modulus: Array
    log_ratio: Array

    @classmethod
    def of(cls, modulus: ArrayLike, skin_modulus: ArrayLike) -> Self:
        """Return the axis for moduli of fabric and skin [Pa], shapes (points,) and (draws, points)."""
        log_modulus = np.log(np.asarray(modulus, float))
        return cls(log_modulus, log_modulus - np.log(np.asarray(skin_modulus, float)))

    @property
    def grid(self) -> Array:
        """Logarithmically spaced E_fab / E_skin over the range common to all draws, shape (points,)."""
        low, high = self.log_ratio[:, 0].max(), self.log_ratio[:, -1].min()
        return np.exp(np.linspace(low, high, self.log_modulus.size))

    def carry(self, curves: Array) -> Array:
        """Interpolate curves over E_fab, shape (draws, points), to the grid, using the ratio of each draw."""
        at = np.log(self.grid)
        return np.stack([np.interp(at, x, y) for x, y in zip(self.log_ratio, curves, strict=True)])

    def place(self, modulus: ArrayLike) -> Array:
        """Return the posterior median of the ratio at given fabric moduli [Pa], shape (n,)."""
        at = np.log(np.asarray(modulus, float))
        return np.exp(np.median([np.interp(at, self.log_modulus, x) for x in self.log_ratio], axis=0))


class Grid(NamedTuple):
    """A figure of panels with common axes."""

    figure: Figure
    panels: list[Axes]
    heads: list[Axes]
    """Uppermost axes of each panel, which carry the title: its margin, or the panel itself."""


def grid_of_panels(count: int, xlabel: str, ylabel: str, style: Style, margin: float = 0.0, above: float = 0.0) -> Grid:
    """Return a figure of `count` panels with common axes, at most four per row, fewer on a narrow page.

    Rows have similar numbers of panels. A single panel is as wide as one column of a page. `margin`, a fraction of
    the panel height, adds separate axes above each panel. `above` [in] is the space for names above each row.
    """
    from matplotlib.figure import Figure

    rows = -(-count // fitting(4, style))
    columns = -(-count // rows)
    ratios = [margin, 1.0] * rows if margin else [1.0] * rows
    width, height = style.column if count == 1 else style.page, 2.0 * (1.0 + margin)
    figure = Figure(figsize=(width, (height + above) * rows + 0.5), layout="constrained")
    cells = figure.subplots(len(ratios), columns, sharex=True, squeeze=False, height_ratios=ratios)
    step = len(ratios) // rows
    heads, panels = cells[::step].ravel(), cells[step - 1 :: step].ravel()
    for spare in {*heads[count:], *panels[count:]}:
        spare.remove()
    for place, axes in enumerate(panels[:count]):
        if place:
            axes.sharey(panels[0])
        if place % columns:
            axes.tick_params(which="both", labelleft=False)
        else:
            axes.set_ylabel(ylabel)
        if place + columns >= count:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(xlabel)
    return Grid(figure, list(panels[:count]), list(heads[:count]))


class FreePanels(NamedTuple):
    """A figure of panels with separate axes."""

    figure: Figure
    panels: list[Axes]
    columns: int
    """Number of panels per row."""

    @property
    def lowest(self) -> list[Axes]:
        """The lowest panel of each column."""
        return self.panels[-self.columns :]

    @property
    def leftmost(self) -> list[Axes]:
        """The first panel of each row."""
        return self.panels[:: self.columns]


def free_panels(
    count: int,
    style: Style,
    columns: int,
    height: float,
    sharex: bool = False,
    sharey: bool = False,
    narrow: bool = False,
) -> FreePanels:
    """Return a figure of `count` panels in full rows, as wide as a page, or as a column (`narrow`)."""
    from matplotlib.figure import Figure

    columns = fitting(columns, style)
    rows = -(-count // columns)
    width = style.column if narrow else style.page
    figure = Figure(figsize=(width, height * rows + 0.5), layout="constrained")
    cells = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False).ravel()
    for spare in cells[count:]:
        spare.remove()
    return FreePanels(figure, list(cells[:count]), columns)


def fitting(columns: int, style: Style) -> int:
    """Return the number of panels, at most `columns`, that fit in one row of a page."""
    return max(1, min(columns, int(style.page / NARROWEST)))


def check_draws(draws: ArrayLike, labels: Sequence[str]) -> Array:
    """Return draws, shape (draws, parameters), or raise an `InputError` if labels or values do not fit."""
    values = np.asarray(draws, float)
    if values.ndim != 2 or values.shape[1] != len(labels) or not values.size:
        raise InputError(f"figure: draws of shape {values.shape} for {len(labels)} labels")
    if not np.isfinite(values).all():
        raise InputError("figure: a draw of a parameter is not finite")
    return values


def draw_bands(axes: Axes, x: Array, draws: Array, colour: str, style: Style, gid: str) -> None:
    """Draw the median and the central credible bands of curves, shape (draws, points), along x.

    A point where a draw is NaN leaves a gap, so that a failed prediction stays visible.
    """
    axes.plot(x, np.median(draws, axis=0), color=colour, label="median", gid=f"median/{gid}")
    for level, strength, order in zip(LEVELS, TINTS, (1.5, 1.0), strict=True):
        low, high = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
        band = axes.fill_between(x, low, high, color=style.tint(colour, strength), linewidth=0, zorder=order)
        band.set(label=f"{100 * level:.0f} % credible", gid=f"band{100 * level:.0f}/{gid}")


def draw_rug(axes: Axes, x: Array, style: Style, gid: str, names: Sequence[str] = ()) -> None:
    """Mark the fabrics of the data along the bottom of the panel."""
    (marks,) = axes.plot(
        x,
        np.full(np.shape(x), 0.03),
        linestyle="none",
        marker="|",
        markersize=5,
        markeredgewidth=0.7,
        color=style.data,
        transform=axes.get_xaxis_transform(),
        label="fabrics of the data",
        gid=f"fabrics/{gid}",
    )
    name_rows(marks, names)


def number_ticks(axis: Axis, narrow: bool = False) -> None:
    """Label the ticks of a logarithmic axis in one notation: plain numbers, or powers of ten.

    The limits of the axis must be set.

    A narrow panel has fewer ticks.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    decades = np.log10(high) - np.log10(low)
    sets = ((1, 2, 5), (1, 3), (1,)) if narrow else ((1, 2, 3, 4, 6, 8), (1, 2, 5), (1,))
    marks = sets[0] if decades < 1 else sets[1] if decades < 2 else sets[2]
    axis.set_major_locator(LogLocator(subs=marks, numticks=9))
    plain = low >= LEAST_PLAIN and high < MOST_PLAIN
    axis.set_major_formatter(FuncFormatter(_number if plain else _power))
    axis.set_minor_formatter(NullFormatter())
    if decades > 4:
        axis.set_minor_locator(LogLocator(subs=(2, 5), numticks=99))


def _number(value: float, _: int | None = None) -> str:
    return f"{value:.12g}"


def _power(value: float, _: int | None = None) -> str:
    """Return a number as a power of ten, multiplied by its first digit unless that is 1."""
    exponent = int(np.floor(np.log10(value) + 1e-9))
    first = round(value / 10.0**exponent)
    return rf"$10^{{{exponent}}}$" if first == 1 else rf"${first}\cdot10^{{{exponent}}}$"


def short(value: float) -> str:
    """Return a number with three significant digits, without an exponent."""
    return f"{float(f'{value:.3g}'):.12g}"


def say_grouped(figure: Figure, groups: LoadGroups, style: Style, curves: bool = True) -> None:
    """If the loads are grouped, write a note at the top of the figure, including the loads of the curves."""
    if groups.merged:
        at = "; curves are at the middle load of each" if curves else ""
        figure.suptitle(f"{groups.sentence}{at}", fontsize=style.small)


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
