"""Names of fabrics above a panel: vertical text without overlap, with a line from each name to its fabric."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.plotting.style import Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
