"""Fabrics in the order of their predicted ratings: the probability of each rank, and the predicted ratings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.scales import Scale
from softness_bayes.plotting.panels import LONGEST_ROW, number_ticks, short_name, title
from softness_bayes.plotting.style import USUAL, Style, styled
from softness_bayes.touch.contact import Load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

NAMED = 40
"""Largest number of fabrics that are all named; of more fabrics, about `SOME` evenly spaced ones are named."""

SOME = 24
WRITTEN = 16
"""Largest number of fabrics whose probabilities are written into the cells."""

LEAST_WRITTEN = 0.05
KEYED = (0.01, 0.1, 0.5, 1.0)
"""Probabilities in the key of shades, which is drawn if the cells contain no numbers."""

LEAST_FRAMED, LEAST_SAID = 0.02, 0.16
"""Smallest fractions of the fabrics for which a tie is framed, and for which its number is written in the frame."""

_ROW, _SPARE, _KEY = 0.16, 1.0, 0.6  # height of a named row, of the margins, and of the key [in]


class Order(NamedTuple):
    """Fabrics under one load; all arrays are in the order of the fabrics, with the highest rating first."""

    load: Load
    fabrics: Sequence[str]
    probability: Array
    """Probability of each rank, shape (fabrics, ranks)."""
    rating: Array
    """Lower limit, median and upper limit of the rating, shape (3, fabrics)."""
    silent: NDArray[np.bool_]
    """True for fabrics that leave the receptors silent in most draws, shape (fabrics,)."""
    tie: NDArray[np.intp]
    """Number of the group of tied fabrics, 0 for none, shape (fabrics,)."""


@styled
def ranking_figure(orders: Sequence[Order], scale: Scale, *, style: Style = USUAL) -> Figure:
    """Draw a row of two panels per load: the probability of each fabric's rank, and the predicted ratings.

    Darker cells are more probable ranks. If there are few fabrics, the cells contain percentages; otherwise there is
    a key of shades. Tied fabrics are framed. Fabrics that leave the receptors silent are grey.

    Parameters
    ----------
    orders
        Contents for each load.
    scale
        Scale of the ratings.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``places/1 mm`` (the cells), ``ties/1 mm/1`` (frames), ``rating/1 mm`` (points) and
        ``band90/1 mm`` (lines), and ``silent/1 mm`` (points of silent fabrics).

    Raises
    ------
    InputError
        If there is nothing to show.
    """
    from matplotlib.figure import Figure

    if not orders or not all(order.fabrics for order in orders):
        raise InputError("figure: no fabrics in an order")
    rows = max(min(len(order.fabrics), NAMED) for order in orders)
    height = (_ROW * rows + _SPARE + (_KEY if rows > WRITTEN else 0.0)) * len(orders)
    figure = Figure(figsize=(style.page, max(height, 2.5)), layout="constrained")
    cells = figure.subplots(len(orders), 2, sharey="row", squeeze=False, width_ratios=[3, 2])
    for order, (left, right) in zip(orders, cells, strict=True):
        _draw_places(left, order, style)
        _draw_ratings(right, order, scale, style)
        unit = " [%]" if len(order.fabrics) <= WRITTEN else ""
        left.set_title(f"{title(order.load)}: probability of each rank{unit}")
        right.set_title("predicted rating, 90 % interval")
    cells[-1][0].set_xlabel("place (1: highest predicted rating)")
    cells[-1][1].set_xlabel(scale.label)
    return figure


def _draw_places(axes: Axes, order: Order, style: Style) -> None:
    """Draw the cells, the names and the frames around ties."""
    from matplotlib.colors import LinearSegmentedColormap, to_hex
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator

    count, gid = len(order.fabrics), str(order.load)
    shades = LinearSegmentedColormap.from_list("places", ["#FFFFFF", to_hex(style.tint(style.posterior, 0.9))])
    # square root, so that a probability of 0.1 is visible beside one of 1
    shown = np.sqrt(order.probability)
    extent = (0.5, count + 0.5, count + 0.5, 0.5)
    cells = axes.imshow(
        shown, cmap=shades, vmin=0.0, vmax=shown.max(), aspect="auto", extent=extent, interpolation="nearest"
    )
    cells.set_gid(f"places/{gid}")
    at = named_rows(count)
    axes.set_yticks(at + 1, [short_name(order.fabrics[k], LONGEST_ROW) for k in at])
    for label, k in zip(axes.get_yticklabels(), at, strict=True):
        label.set_color(style.absent if order.silent[k] else "black")
    axes.tick_params(axis="y", length=0 if count <= NAMED else 3)
    for number in range(1, int(order.tie.max(initial=0)) + 1):
        (here,) = np.nonzero(order.tie == number)
        size = here[-1] - here[0] + 1
        if size < LEAST_FRAMED * count:
            continue
        frame = Rectangle((here[0] + 0.5, here[0] + 0.5), size, size, fill=False, color=style.absent, linewidth=0.8)
        frame.set_gid(f"ties/{gid}/{number}")
        axes.add_patch(frame)
        if size >= LEAST_SAID * count:
            words = f"{size} tie" + (", silent" if order.silent[here].all() else "")
            middle = here[0] + 0.5 * (size + 1)
            axes.text(middle, middle, words, ha="center", va="center", fontsize=style.small).set_gid(f"tie-words/{gid}")
    if count <= WRITTEN:
        tied = order.tie > 0
        for k, place in zip(*np.nonzero(order.probability >= LEAST_WRITTEN), strict=True):
            if not tied[k]:
                share, dark = f"{100 * order.probability[k, place]:.0f}", shown[k, place] > 0.7
                colour = "white" if dark else "black"
                axes.text(place + 1, k + 1, share, ha="center", va="center", fontsize=style.small - 1, color=colour)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if count > WRITTEN:
        _add_key(axes, cells, style)


def _add_key(axes: Axes, cells: AxesImage, style: Style) -> None:
    """Add the key of shades; its axis is the square root of the probability, labelled with probabilities."""
    (figure, most) = (axes.get_figure(root=True), cells.norm.vmax or 1.0)
    assert figure is not None
    ticks = [probability for probability in KEYED if np.sqrt(probability) <= most]
    key = figure.colorbar(cells, ax=axes, location="bottom", aspect=40, shrink=0.6)
    key.set_ticks([float(np.sqrt(probability)) for probability in ticks], labels=[f"{one:g}" for one in ticks])
    key.ax.set_xlabel("probability of the rank", fontsize=style.small)
    key.ax.tick_params(labelsize=style.small)


def _draw_ratings(axes: Axes, order: Order, scale: Scale, style: Style) -> None:
    """Draw the median and interval of every fabric's rating; silent fabrics are drawn separately."""
    gid, y = str(order.load), np.arange(1, len(order.fabrics) + 1)
    low, middle, high = np.clip(order.rating, *scale.drawn)
    size = 3.0 if y.size <= NAMED else 1.2
    tint = style.tint(style.posterior, 0.45)
    if y.size <= NAMED:
        axes.hlines(y, low, high, color=tint, linewidth=1.5, gid=f"band90/{gid}")
    else:  # many lines with gaps between them would look like hatching
        axes.fill_betweenx(y, low, high, step="mid", color=tint, linewidth=0, gid=f"band90/{gid}")
    for what, here, colour in (("rating", ~order.silent, style.posterior), ("silent", order.silent, style.absent)):
        if here.any():
            (points,) = axes.plot(middle[here], y[here], "o", color=colour, markersize=size, gid=f"{what}/{gid}")
            points.set(label="no receptor fires in most draws" if what == "silent" else "median")
    axes.set(xscale=scale.axis, ylim=(y.size + 0.5, 0.5))
    if scale.axis == "log":
        number_ticks(axes.xaxis)
    axes.tick_params(axis="y", left=False, labelleft=False)
    if order.silent.any():
        axes.legend(loc="best")


def named_rows(count: int) -> NDArray[np.intp]:
    """Return the rows whose fabrics are named: all, or evenly spaced ones including the first and the last."""
    return np.arange(count) if count <= NAMED else np.linspace(0, count - 1, SOME).round().astype(np.intp)
