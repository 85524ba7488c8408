"""Parameters: their posterior by pairs, and each against its prior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.errors import InputError
from softness_bayes.plotting.panels import LEVELS, TINTS, Array, check_draws, free_panels, legend_below
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpec

MOST_DRAWS = 5000
"""Draws that a corner plot takes; more of them cost time and change nothing that is seen."""

LEAST_CORNER = 0.53
"""Least width of a panel [in]: many parameters take a page, whatever the style's."""

CORNER_BINS = 24
"""Bins of a parameter over the range of its panels."""

CHARACTER = 0.05
"""Width of a digit of a tick's label [in]."""

_SHOWN = (0.025, 0.975)

FEWEST_DRAWS_FOR_CONTOURS = 400
"""With fewer draws the corner plot shows them as points."""


def corner_figure(draws: ArrayLike, labels: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw every parameter's and every pair's posterior, with 50 % and 95 % regions.

    Parameters
    ----------
    draws
        Shape (draws, parameters); thinned evenly to at most `MOST_DRAWS`.
    labels
        Symbol and unit of each parameter.
    style
        How it looks.

    Returns
    -------
    Figure
        Axes named ``corner/row/column``, on and below the diagonal.

    Raises
    ------
    InputError
        If labels and draws disagree, a draw is not finite, a parameter does not vary, or there are
        fewer draws than parameters.
    """
    values = _thinned(check_draws(draws, labels))
    count, dimension = values.shape
    if count <= dimension:
        raise InputError(f"corner plot: {count} draws of {dimension} parameters, expected more draws")
    still = [label for label, column in zip(labels, values.T, strict=True) if np.ptp(column) == 0]
    if still:
        raise InputError(f"corner plot: {', '.join(still)} does not vary")

    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    limits = _ranges(values, 0.05)
    with style.applied():
        width = max(style.page if dimension > 3 else style.column, LEAST_CORNER * (dimension + 1))
        figure = Figure(figsize=(width, width))
        grid = _corner_grid(figure, dimension, width)
        for row in range(dimension):
            for column in range(row + 1):
                axes = figure.add_subplot(grid[row, column])
                axes.set_gid(f"corner/{row}/{column}")
                if row == column:
                    _draw_alone(axes, values[:, row], limits[row], style)
                else:
                    _draw_pair(axes, values[:, column], values[:, row], limits[column], limits[row], style)
                _label(axes, labels, row, column, dimension)
        if count >= FEWEST_DRAWS_FOR_CONTOURS and dimension > 1:
            patches = [
                Patch(
                    facecolor=style.tint(style.posterior, strength),
                    edgecolor=style.posterior,
                    label=f"{100 * level:.0f} % credible region",
                )
                for level, strength in zip(LEVELS, TINTS, strict=True)
            ]
            figure.legend(handles=patches, loc="upper right")
    return figure


def _corner_grid(figure: Figure, dimension: int, width: float) -> GridSpec:
    """Return the cells of a corner plot: their margins are known, a layout engine would take seconds."""
    below, gap = 0.68, 0.05  # in
    panel = (width - below - 0.1) / dimension
    return figure.add_gridspec(
        dimension,
        dimension,
        left=below / width,
        bottom=below / width,
        right=1 - 0.1 / width,
        top=1 - 0.1 / width,
        wspace=gap / (panel - gap),
        hspace=gap / (panel - gap),
    )


def _draw_alone(axes: Axes, values: Array, limits: tuple[float, float], style: Style) -> None:
    axes.hist(values, CORNER_BINS, range=limits, histtype="step", color=style.posterior, linewidth=0.8)
    axes.set(xlim=limits, ylim=(0.0, None))


def _draw_pair(
    axes: Axes, x: Array, y: Array, x_limits: tuple[float, float], y_limits: tuple[float, float], style: Style
) -> None:
    """Draw the regions that hold `LEVELS` of the draws where they are densest; few draws as points."""
    from scipy.ndimage import gaussian_filter

    axes.set(xlim=x_limits, ylim=y_limits)
    if x.size < FEWEST_DRAWS_FOR_CONTOURS:
        axes.plot(x, y, ".", color=style.posterior, markersize=1.5, alpha=0.5)
        return
    counts, x_edges, y_edges = np.histogram2d(x, y, CORNER_BINS, (x_limits, y_limits))
    # a margin of empty cells, so that a region that ends at the limits is closed there
    height = np.pad(gaussian_filter(counts, 1.0, mode="constant"), 1)
    falling = np.sort(height, axis=None)[::-1]
    share = np.cumsum(falling) / falling.sum()
    levels = np.array([falling[np.searchsorted(share, level)] for level in LEVELS[::-1]])
    levels += 1e-9 * falling[0] * np.arange(levels.size)  # one cell may hold both
    centres = [_padded(0.5 * (edges[1:] + edges[:-1])) for edges in (x_edges, y_edges)]
    tints = [style.tint(style.posterior, strength) for strength in TINTS[::-1]]
    axes.contourf(*centres, height.T, levels=[*levels, 2.0 * falling[0]], colors=tints)
    axes.contour(*centres, height.T, levels=levels, colors=[style.posterior], linewidths=0.6)


def _padded(values: Array) -> Array:
    step = values[1] - values[0]
    return np.concatenate([[values[0] - step], values, [values[-1] + step]])


def _label(axes: Axes, labels: Sequence[str], row: int, column: int, dimension: int) -> None:
    """Give a panel numbers and labels where it stands at the foot or the left of the plot, else none."""
    below, left = row == dimension - 1, column == 0 < row
    panel = axes.get_window_extent().width / axes.figure.dpi
    axes.tick_params(length=2)
    for axis, wanted, label in ((axes.xaxis, below, labels[column]), (axes.yaxis, left, labels[row])):
        if wanted:
            axis.set_label_text(_stacked(label))
            axis.set_ticks(_inner_ticks(*axis.get_view_interval(), panel))
        else:
            axis.set_visible(False)
    axes.xaxis.set_label_coords(0.5, -0.26 / panel)
    axes.yaxis.set_label_coords(-0.37 / panel, 0.5)


def _inner_ticks(low: float, high: float, width: float) -> Array:
    """Return one or two round numbers that touch neither each other nor those of the next panel.

    They keep a margin from the limits of a panel of some width [in], and stand as far apart as they are long.
    """
    from matplotlib.ticker import MaxNLocator

    margin = 0.14 * (high - low)
    one = np.array([0.5 * (low + high)])
    for bins in range(1, 12):
        ticks = np.array(MaxNLocator(bins, steps=[1, 2, 5, 10]).tick_values(low, high))
        inner = ticks[(ticks >= low + margin) & (ticks <= high - margin)]
        if inner.size and bins < 4:
            one = inner[[inner.size // 2]]
        if inner.size > 1:
            length = CHARACTER * (1 + max(len(f"{tick:.6g}") for tick in inner[[0, -1]]))
            if inner[-1] - inner[0] > max(0.35, length / width) * (high - low):
                return inner[[0, -1]]
    return one


def _ranges(values: Array, beyond: float) -> list[tuple[float, float]]:
    """Return limits around the central 99.8 % of each column: a stray draw must not shrink a panel.

    They reach `beyond` these draws by that share of their range.
    """
    low, high = np.quantile(values, [0.001, 0.999], axis=0)
    low, high = np.where(high > low, low, values.min(0)), np.where(high > low, high, values.max(0))
    return [(float(a - beyond * (b - a)), float(b + beyond * (b - a))) for a, b in zip(low, high, strict=True)]


def prior_figure(posterior: ArrayLike, prior: ArrayLike, labels: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw prior and posterior density of each parameter.

    Parameters
    ----------
    posterior, prior
        Draws, shapes (draws, parameters) and (prior draws, parameters).
    labels
        Symbol and unit of each parameter.
    style
        How it looks.

    Returns
    -------
    Figure
        Artists named ``posterior/k`` and ``prior/k`` (step patches of densities), k the column.

    Raises
    ------
    InputError
        If labels and draws disagree or a draw is not finite.
    """
    after, before = check_draws(posterior, labels), check_draws(prior, labels)
    with style.applied():
        grid = free_panels(len(labels), style, columns=4, height=1.1)
        for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
            kinds = (
                ("posterior", after[:, place], {"fill": True, "color": style.tint(style.posterior, 0.5)}),
                ("prior", before[:, place], {"color": style.prior}),
            )
            for name, values, look in kinds:
                height, edges = _histogram(values)
                axes.stairs(height, edges, label=name, **look).set_gid(f"{name}/{place}")
            # a wide prior must not shrink the posterior to a line: beyond its central 95 % it may be cut
            (low, high), (least, most) = _ranges(after[:, [place]], 0.05)[0], np.quantile(before[:, place], _SHOWN)
            if most > least:
                axes.set_xlim(min(low, least), max(high, most))
            axes.set(xlabel=label, yticks=(), ylim=(0.0, None))
        for axes in grid.leftmost:
            axes.set_ylabel("density")
        legend_below(grid.figure, grid.panels)
    return grid.figure


def _histogram(values: Array) -> tuple[Array, Array]:
    """Return density and edges over the central 99.8 % of draws, counted against all of them."""
    ((low, high),) = _ranges(values[:, None], 0.0)
    if low == high:  # one draw, or a parameter that does not vary
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    bins = int(np.clip(2.0 * values.size ** (1 / 3), 10, 40))
    edges = np.linspace(low, high, bins + 1)
    return np.histogram(values, edges)[0] / (values.size * np.diff(edges)), edges


def _stacked(label: str) -> str:
    """Put the unit of a label under its symbol."""
    return label.replace(" [", "\n[")


def _thinned(values: Array) -> Array:
    return values[np.linspace(0, len(values) - 1, min(len(values), MOST_DRAWS)).round().astype(int)]
