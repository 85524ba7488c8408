"""The membrane: firing rate against current, and example spike trains (model.md 7)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.errors import InputError
from softness_bayes.plotting.panels import Array, draw_bands, legend_below, short
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURRENT_LABEL = "receptor current [µA/cm²]"


def membrane_figure(
    current: ArrayLike,
    rate: ArrayLike,
    rheobase: ArrayLike,
    largest: ArrayLike,
    spikes: ArrayLike,
    train_current: ArrayLike,
    duration: float,
    *,
    style: Style = USUAL,
) -> Figure:
    """Draw firing rate against current with credible bands, and below it example spike trains at some currents.

    Parameters
    ----------
    current
        Grid of currents [µA/cm²], shape (points,).
    rate
        Draws of the rate [Hz], shape (draws, points).
    rheobase, largest
        Draws of the rheobase and of alpha [µA/cm²], shape (draws,). The rheobase is infinite if the membrane never
        fires. Bars above the panel show the central 95 % of each.
    spikes
        Spike times [ms], shape (trains, largest number of spikes); shorter trains are padded with NaN.
    train_current
        Current of each train [µA/cm²], shape (trains,).
    duration
        Length of the trains [ms].
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``median/rate``, ``band95/rate``, ``band50/rate``, ``rheobase``, ``alpha`` and ``train/k``.

    Raises
    ------
    InputError
        If the shapes disagree.
    """
    x, draws = np.asarray(current, float), np.asarray(rate, float)
    times, given = np.asarray(spikes, float), np.asarray(train_current, float)
    if draws.ndim != 2 or draws.shape[1:] != x.shape or times.shape[:1] != given.shape:
        raise InputError(f"membrane figure: rates of shape {draws.shape} at {x.size} currents")
    from matplotlib.figure import Figure

    with style.applied():
        figure = Figure(figsize=(style.column, 2.6 + 0.25 * given.size), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=(2.0, 0.25 + 0.25 * given.size))
        draw_bands(above, x, draws, style.posterior, style, "rate")
        _draw_interval(above, np.asarray(rheobase, float), 1.05, style.inflection, "rheobase")
        _draw_interval(above, np.asarray(largest, float), 1.12, style.data, "alpha")
        above.set(xlim=(x[0], x[-1]), ylim=(0.0, None), xlabel=CURRENT_LABEL, ylabel="firing rate [Hz]")
        _draw_trains(below, times, given, duration, style)
        legend_below(figure, [above])
    return figure


def _draw_trains(axes: Axes, times: Array, current: Array, duration: float, style: Style) -> None:
    """Draw a row of ticks for each train, with its current beside it."""
    for place, train in enumerate(times):
        times_of_spikes = train[np.isfinite(train)]
        axes.eventplot(
            times_of_spikes,
            lineoffsets=place,
            linelengths=0.7,
            linewidths=0.8,
            colors=style.posterior,
            gid=f"train/{place}",
        )
    axes.set(xlim=(0.0, duration), ylim=(-0.6, current.size - 0.4), xlabel="time since the current began [ms]")
    axes.set_yticks(range(current.size), [short(each) for each in current])
    axes.tick_params(axis="y", length=0)
    axes.set_ylabel("current\n[µA/cm²]")
    axes.spines["left"].set_visible(False)


def _draw_interval(axes: Axes, draws: Array, height: float, colour: str, name: str) -> None:
    """Draw a bar over the central 95 % of draws, and a dot at their median, above a panel."""
    foot, words = axes.get_xaxis_transform(), {"rheobase": "rheobase", "alpha": r"largest current $\alpha$"}[name]
    known = draws[np.isfinite(draws)]
    if known.size:
        low, middle, high = np.quantile(known, [0.025, 0.5, 0.975])
        (bar,) = axes.plot([low, high], [height] * 2, color=colour, linewidth=2.0, transform=foot, gid=name)
        bar.set(label=f"{words}, 95 % credible", zorder=3, clip_on=False)
        (dot,) = axes.plot([middle], [height], "o", color=colour, markersize=3, transform=foot, zorder=3)
        dot.set(clip_on=False, gid=f"{name} median")
