"""Predictive checks: test quantities of the observed ratings compared with those of replicated ratings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.errors import InputError
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.names import short_name
from softness_bayes.plotting.panels import MODULUS_LABEL, Array, free_panels, legend_below, number_ticks
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BINS = 24
"""Number of bins in the histogram of a test quantity."""

MOST_OUTSIDE = 6
"""Largest number of fabrics outside their limits that are named in a panel."""

FEW = 30
"""Smallest number of replicates for a histogram; fewer replicates are drawn as separate ticks."""


class Means(NamedTuple):
    """Mean log ratings of the fabrics under one load, every field of shape (fabrics,)."""

    load: str
    """Name of the load."""
    modulus: Array
    """E_fab [Pa]."""
    observed: Array
    low: Array
    """Lower limit of the replicates, simultaneous over all conditions."""
    high: Array
    fabrics: Sequence[str] = ()
    """Names of the fabrics; the figure names fabrics outside their limits."""


class Replicated(NamedTuple):
    """One test quantity, for the data and for the replicates."""

    name: str
    observed: float
    """Value for the data; NaN if it is undefined."""
    replicates: Array
    """Values for the replicates, NaN where undefined, shape (replicates,)."""
    p_value: float
    """Probability that a replicate exceeds the observed value."""


def checks_figure(
    means: Sequence[Means], quantities: Sequence[Replicated], scale: str = "log", *, style: Style = USUAL
) -> Figure:
    """Draw observed mean log ratings with the limits of the replicates, and histograms of test quantities.

    The bars contain 90 % of the replicates simultaneously over all conditions. Fabrics outside their bars are named.
    The histograms show the replicates for which a quantity is defined. If there are fewer than `FEW`, each one
    is drawn as a tick. A quantity that is undefined for the data and for all replicates is omitted. The location of
    a turning point is shown on a logarithmic axis.

    Parameters
    ----------
    means
        One panel for each load.
    quantities
        Test quantities, with one panel for each that is defined anywhere.
    scale
        Unit of the means.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``limits/1 mm`` and ``observed/1 mm`` (E_fab in kPa), ``observed/k``, and ``replicates/k``
        (a histogram) or ``each/k`` (ticks).

    Raises
    ------
    InputError
        If there is nothing to show.
    """
    shown = [one for one in quantities if np.isfinite(one.observed) or np.isfinite(one.replicates).any()]
    if not means and not shown:
        raise InputError("predictive checks: nothing to show")
    left = len(quantities) - len(shown)
    more = (
        f"not shown, because these ratings and their replicates do not have them: {left} of {len(quantities)} "
        "quantities"
        if left
        else ""
    )
    with style.applied():
        grid = free_panels(len(means) + len(shown), style, columns=4, height=1.2)
        for axes, of_load in zip(grid.panels, means, strict=False):
            _draw_means(axes, of_load, style)
        for place, (axes, quantity) in enumerate(zip(grid.panels[len(means) :], shown, strict=True)):
            _draw_quantity(axes, quantity, style, str(place))
        for axes in grid.panels[: len(means) : grid.columns]:
            axes.set_ylabel(f"mean rating\n[{scale}]")
        legend_below(grid.figure, grid.panels, more)
    return grid.figure


def _draw_means(axes: Axes, means: Means, style: Style) -> None:
    x = means.modulus / 1e3
    bars = axes.vlines(x, means.low, means.high, color=style.tint(style.posterior, 0.5), linewidth=3.0)
    bars.set(label="90 % of replicates", gid=f"limits/{means.load}")
    points = axes.plot(x, means.observed, "o", color=style.data, markersize=2.5, gid=f"observed/{means.load}")[0]
    points.set(label="observed", zorder=3)
    for marks in (bars, points):
        name_rows(marks, means.fabrics)
    axes.set(xscale="log", title=means.load, xlabel=MODULUS_LABEL)
    number_ticks(axes.xaxis, narrow=True)
    outside = np.flatnonzero((means.observed < means.low) | (means.observed > means.high))
    for k in outside[:MOST_OUTSIDE] if means.fabrics else ():
        words = axes.annotate(
            short_name(means.fabrics[k]), (x[k], means.observed[k]), (0, 4), textcoords="offset points"
        )
        words.set(ha="center", fontsize=style.small, color=style.data, gid=f"name/{means.load}/{means.fabrics[k]}")


def _draw_quantity(axes: Axes, quantity: Replicated, style: Style, gid: str) -> None:
    known, seen = quantity.replicates[np.isfinite(quantity.replicates)], quantity.observed
    every = np.append(known, seen) if np.isfinite(seen) else known
    yes_or_no = bool(np.isin(every, (0.0, 1.0)).all())
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 1.0)
    wide = low > 0 and high > 10 * low
    if yes_or_no:
        edges = np.array([-0.5, 0.5, 1.5])
    elif wide:
        edges = np.geomspace(low, high, BINS + 1)
    else:
        spare = 0.5 * (low == high)
        edges = np.linspace(low - spare, high + spare, BINS + 1)
    few = known.size < FEW and not yes_or_no
    top = _draw_each(axes, known, style, gid) if few else _draw_histogram(axes, known, edges, style, gid)
    if np.isfinite(seen):
        axes.axvline(seen, color=style.data, linewidth=1.2, gid=f"observed/{gid}", label="of the data")
    said = f"p = {quantity.p_value:.2f}" if np.isfinite(quantity.p_value) else "not in the data"
    if known.size < quantity.replicates.size:
        said += f"\nin {known.size} of {quantity.replicates.size} replicates"
    words = axes.text(0.98, 0.99, said, transform=axes.transAxes, ha="right", va="top", fontsize=style.small)
    words.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1})
    axes.set(xlabel=quantity.name, yticks=(), xscale="log" if wide else "linear")
    axes.set_ylim(0.0, (1.7 if "\n" in said else 1.3) * top or 1.0)  # space for the text
    axes.spines["left"].set_visible(False)
    if yes_or_no:
        axes.set_xticks((0, 1), ("no", "yes"))
    elif wide:
        number_ticks(axes.xaxis, narrow=True)


def _draw_histogram(axes: Axes, known: Array, edges: Array, style: Style, gid: str) -> float:
    """Draw the fraction of the replicates in each bin, and return the largest fraction."""
    heights = np.histogram(known, edges)[0] / max(known.size, 1)
    steps = axes.stairs(heights, edges, fill=True, color=style.tint(style.posterior, 0.5))
    steps.set(gid=f"replicates/{gid}", label="replicates")
    return float(heights.max())


def _draw_each(axes: Axes, known: Array, style: Style, gid: str) -> float:
    """Draw a tick for each replicate, and return the height of the ticks."""
    ticks = axes.vlines(known, 0.0, 0.4, color=style.tint(style.posterior, 0.7), linewidth=0.8)
    ticks.set(gid=f"each/{gid}", label="a single replicate")
    return 1.0


def loo_pit_figure(values: ArrayLike, points: ArrayLike, probability: float = 0.95, *, style: Style = USUAL) -> Figure:
    """Draw the distribution function of LOO-PIT values minus the uniform one, with simultaneous limits.

    The limits assume independent values. LOO-PIT values are dependent, so the limits are approximate and slightly
    too wide.

    Parameters
    ----------
    values
        LOO-PIT values, between 0 and 1, shape (ratings,).
    points
        Points at which the distribution function is evaluated, in ascending order inside (0, 1), shape (points,).
    probability
        Probability that independent uniform values stay inside the limits everywhere.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``ecdf`` and ``band``.

    Raises
    ------
    InputError
        If a value is not a probability.
    """
    from softness_bayes.checking.uniformity import simultaneous_band

    pit = np.asarray(values, float)
    if pit.ndim != 1 or not pit.size or not ((pit >= 0) & (pit <= 1)).all():
        raise InputError(f"LOO-PIT figure: expected values between 0 and 1, one for each rating, not {pit.shape}")
    x = np.asarray(points, float)
    band = simultaneous_band(pit.size, x, probability)
    share = np.searchsorted(np.sort(pit), x, side="right") / pit.size
    with style.applied():
        figure, (axes,), _ = free_panels(1, style, columns=1, height=1.7, narrow=True)
        area = axes.fill_between(
            x,
            band.low - x,
            band.high - x,
            step="mid",
            color=style.tint(style.prior, 0.4),
            linewidth=0,
        )
        area.set(gid="band", label=f"{100 * probability:.0f} % of independent ones: approximate for ratings")
        axes.plot(x, share - x, color=style.posterior, drawstyle="steps-mid", gid="ecdf")[0].set_label(
            "leave-one-out probability integral transform (LOO-PIT) of the ratings"
        )
        axes.axhline(0.0, color=style.prior, linewidth=0.6)
        axes.set(xlim=(0, 1), xlabel="LOO-PIT [–]", ylabel="ECDF − uniform [–]")
        figure.legend(loc="outside lower center")
    return figure
