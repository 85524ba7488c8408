"""Data of a figure as a table, collected from its named artists."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DIGITS = 7
"""Number of significant digits in the table."""

_NAMES, _TABLE = "softness_bayes_names", "softness_bayes_table"

LEFT_OUT = ("name", "guide")
"""Artists that are omitted because they repeat the data of others."""


class _Rows(NamedTuple):
    """Table rows of one artist: points, or ranges along an axis; the end of a point is NaN."""

    x: ArrayLike
    y: ArrayLike
    x_end: ArrayLike = np.nan
    y_end: ArrayLike = np.nan
    value: ArrayLike = np.nan


def name_rows(artist: Artist, names: Sequence[str]) -> None:
    """Attach names, such as those of fabrics, to the points of an artist."""
    if len(names):
        setattr(artist, _NAMES, [str(name) for name in names])


def carry(figure: Figure, table: pd.DataFrame) -> None:
    """Attach a table of data to a figure whose artists do not contain these data."""
    setattr(figure, _TABLE, table)


def data_of(figure: Figure) -> pd.DataFrame:
    """Return the data of a figure.

    Returns
    -------
    DataFrame
        The table attached to the figure, if any. Otherwise one row for each point, bar or step of each artist with a
        ``gid``. The columns are: element and panel (the parts of the gid before and after its first slash), name (of
        a fabric), x, y, x_end and y_end (of a band, bar or step), value (the quantity shown by the colour), x_axis
        and y_axis (the labels of the panel).
    """
    import pandas as pd

    if (table := getattr(figure, _TABLE, None)) is not None:
        return _rounded(table)
    parts = []
    for axes in figure.axes:
        for artist in axes.get_children():
            element, _, panel = str(artist.get_gid() or "").partition("/")
            if not element or element in LEFT_OUT:
                continue
            for rows in _rows_of(artist):
                columns = dict(zip(_Rows._fields, np.broadcast_arrays(*map(np.atleast_1d, rows)), strict=True))
                if not _is_height(artist, axes):
                    columns |= {name: np.full(columns["x"].shape, np.nan) for name in ("y", "y_end")}
                names = getattr(artist, _NAMES, None)
                fits = names is not None and len(names) == columns["x"].size
                own = {"element": element, "panel": panel, "name": names if fits else ""}
                labels = {f"{which}_axis": _plain(_label(axes, which)) for which in "xy"}
                parts.append(pd.DataFrame(own | columns | labels))
    head = ["element", "panel", "name", *_Rows._fields, "x_axis", "y_axis"]
    return _rounded(pd.concat(parts, ignore_index=True)) if parts else pd.DataFrame(columns=head)


def _rows_of(artist: Artist) -> Iterator[_Rows]:
    """Yield the table rows of an artist."""
    from matplotlib.collections import LineCollection, PathCollection, PolyCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, Rectangle, StepPatch

    match artist:
        case Line2D():
            yield _Rows(artist.get_xdata(), artist.get_ydata())
        case StepPatch():
            values, edges, _ = artist.get_data()
            yield _Rows(edges[:-1], values, edges[1:])
        case LineCollection():
            # a segment with an unknown end contains no points
            segments = [np.asarray(segment) for segment in artist.get_segments()]
            ends = np.array([s[[0, -1]] if len(s) else np.full((2, 2), np.nan) for s in segments]).reshape(-1, 2, 2)
            yield _Rows(ends[:, 0, 0], ends[:, 0, 1], ends[:, 1, 0], ends[:, 1, 1])
        case PathCollection():
            places, colours = np.asarray(artist.get_offsets()), artist.get_array()
            yield _Rows(places[:, 0], places[:, 1], value=np.nan if colours is None else colours)
        case PolyCollection():
            for path in artist.get_paths():
                yield _band(np.asarray(path.vertices))
        case Rectangle():
            x, y = artist.get_xy()
            yield _Rows(x, y, x + artist.get_width(), y + artist.get_height())
        case Circle():
            middle: Any = artist.get_center()
            yield _Rows(middle[0], middle[1], value=artist.get_radius())


def _is_height(artist: Artist, axes: Axes) -> bool:
    """Return whether an artist's heights are values on the vertical axis, rather than positions in the panel."""
    from matplotlib.collections import PathCollection

    up: bool = artist.get_transform().contains_branch_seperately(axes.transData)[1]
    return up or isinstance(artist, PathCollection)  # markers use a separate transform


def _band(vertices: Any) -> _Rows:
    """Return the lower and upper limits along x of an outline drawn by ``fill_between``."""
    points = (len(vertices) - 3) // 2
    low, high = vertices[1 : points + 1], vertices[points + 2 : -1][::-1]
    return _Rows(low[:, 0], low[:, 1], y_end=high[:, 1])


def _label(axes: Axes, which: str) -> str:
    """Return the label of a panel's axis; for a shared axis it may come from a neighbouring panel."""
    own = str(getattr(axes, f"get_{which}label")())
    if own:
        return own
    others = getattr(axes, f"get_shared_{which}_axes")().get_siblings(axes)
    return next((label for other in others if (label := str(getattr(other, f"get_{which}label")()))), "")


def _plain(label: str) -> str:
    """Return a label without mathtext markup."""
    for mark, plain in (("\\mathrm", ""), ("\\,", " "), ("{", ""), ("}", ""), ("$", ""), ("\n", " ")):
        label = label.replace(mark, plain)
    return " ".join(label.split())


def _rounded(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with numbers rounded to `DIGITS` significant digits."""
    numbers = table.select_dtypes("float").items()
    return table.assign(**{str(name): [float(f"{value:.{DIGITS}g}") for value in column] for name, column in numbers})
