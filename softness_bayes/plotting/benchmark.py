"""Work-precision diagram: time per parameter vector against error, on logarithmic axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.errors import InputError
from softness_bayes.plotting.style import USUAL, Style, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = "s^vDP*X<>dph"
"""Markers of the peers, used in turn."""


@styled
def work_precision_figure(
    series: Mapping[str, Sequence[tuple[float, float]]],
    peers: Mapping[str, tuple[float, float]],
    dial: Sequence[tuple[float, float]] = (),
    machine: str = "",
    *,
    style: Style = USUAL,
) -> Figure:
    """Draw time against error: a line for each series, and a point for each peer.

    Parameters
    ----------
    series
        Name of each series -> time per parameter vector [s] and largest error of each setting.
    peers
        Name of each peer -> time per parameter vector [s] and error.
    dial
        Time and error at the default accuracy setting, which is marked.
    machine
        Description of the machine on which the times were measured.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Lines named ``series/NAME``, points named ``peer/NAME`` and ``dial``.

    Raises
    ------
    InputError
        If there is nothing to draw.
    """
    from matplotlib.figure import Figure

    if not series:
        raise InputError("work against precision: expected at least one series")
    figure = Figure(figsize=(style.page, 0.55 * style.page), layout="constrained")
    axes = figure.add_subplot()
    _draw_series(axes, series, style)
    for k, (name, (second, off)) in enumerate(peers.items()):
        mark = MARKERS[k % len(MARKERS)]
        (line,) = axes.plot([off], [1e6 * second], mark, ms=4, color=style.prior, ls="none", label=name)
        line.set_gid(f"peer/{name}")
    if dial:
        time, wrong = 1e6 * np.array(dial).T[0], np.array(dial).T[1]
        (line,) = axes.plot(wrong, time, "o", ms=9, mfc="none", color="black", ls="none", label="default accuracy")
        line.set_gid("dial")
    axes.set(xscale="log", yscale="log", xlabel="largest error, relative to the peak response")
    axes.set_ylabel("time per parameter vector [µs]")
    axes.invert_xaxis()
    axes.set_title(machine)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _draw_series(axes: Axes, series: Mapping[str, Sequence[tuple[float, float]]], style: Style) -> None:
    """Draw a line for each series, omitting settings without a positive error because the axis is logarithmic."""
    colours = [*style.ensembles]
    for k, (name, pairs) in enumerate(series.items()):
        time, wrong = np.reshape(pairs, (-1, 2)).T * [[1e6], [1.0]]
        some = (time > 0) & (wrong > 0)
        (line,) = axes.plot(wrong[some], time[some], "o-", ms=2.5, color=colours[k % len(colours)], label=name)
        line.set_gid(f"series/{name}")
