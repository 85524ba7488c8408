"""Posterior of the turning point (maximum of the response) under each load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.plotting.panels import MODULUS_LABEL, WIDE, Array, check_loads, number_ticks, short, title
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.readable import chance
from softness_bayes.touch.contact import Load
from softness_bayes.touch.load_groups import LoadGroup

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softness_bayes.checking.inflection import Inflection

FEWEST_BINS, MOST_BINS = 60, 240
"""Smallest and largest number of bins over the whole range."""

MARGIN = 0.2
"""Height of the margin for the turning point above a response panel, as a fraction of the panel's height."""


def inflection_figure(
    inflection: Inflection,
    loads: Sequence[Load | LoadGroup],
    fabric_modulus: ArrayLike,
    *,
    style: Style = USUAL,
) -> Figure:
    """Draw the posterior of E_fab at the turning point (maximum), one row per load, with the outcomes' probabilities.

    The left panels show the density per decade for the draws with an interior maximum. The area under the density is
    the fraction of such draws, so that rows can be compared. The dot and the bar show the median and the central 95 %
    of these draws. The range of the fabrics is shaded. The right panels show the probabilities of the three outcomes.

    Parameters
    ----------
    inflection
        Return value of `checking.inflection.find_inflection`.
    loads
        The load of each row.
    fabric_modulus
        E_fab of the fabrics of the data [Pa].
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``density/1 mm`` (a step patch), ``interval/1 mm``, ``fabrics/1 mm`` and one bar
        ``interior/1 mm``, ``none/1 mm``, ``silent/1 mm`` each; E_fab in kPa.

    Raises
    ------
    InputError
        If there is not one load for each column of `inflection`.
    """
    from matplotlib.figure import Figure

    from softness_bayes.checking.inflection import RANGE_FACTOR

    check_loads(loads, inflection.outcome.shape[1])
    fabrics = np.asarray(fabric_modulus, float) / 1e3
    limits = np.array([fabrics.min() / RANGE_FACTOR, fabrics.max() * RANGE_FACTOR])
    edges = bin_edges(limits, inflection.modulus / 1e3)
    wide = style.page >= WIDE
    with style.applied():
        figure = Figure(figsize=(style.page, (0.75 if wide else 1.0) * len(loads) + 0.75), layout="constrained")
        cells = figure.subplots(len(loads), 2, sharex="col", sharey="col", squeeze=False, width_ratios=(2.4, 1))
        for index, ((left, right), load) in enumerate(zip(cells, loads, strict=True)):
            left.axvspan(fabrics.min(), fabrics.max(), color="#EFEFEF", linewidth=0, gid=f"fabrics/{load}")
            _draw_density(left, edges, inflection, index, style, str(load))
            _draw_outcomes(right, inflection, index, style, str(load))
            left.set_title(title(load), y=1.0, pad=-8, x=0.01)
        left, right = cells[-1]
        top = max(density(column / 1e3, edges).max() for column in inflection.modulus.T)
        xlabel = f"{MODULUS_LABEL}{' ' if wide else chr(10)}at the turning point (maximum)"
        left.set(xscale="log", xlim=limits, ylim=(0.0, 1.05 * top or 1.0), xlabel=xlabel)
        number_ticks(left.xaxis)
        right.set(xlim=(0, 100), xticks=(0, 50, 100), xlabel="probability [%]")
        figure.supylabel("posterior density [1/decade]", fontsize="medium")
    return figure


def bin_edges(x: Array, places: Array) -> Array:
    """Return bin edges over the range of x, evenly spaced in log x; the narrowest posterior sets the bin width.

    Parameters
    ----------
    x
        Values that span the range, in the unit of `places`.
    places
        Draws of the turning point, NaN for draws without one, shape (draws, loads).
    """
    span = np.log10(x.max() / x.min())
    bins = float(FEWEST_BINS)
    for column in places.T:
        known = np.log10(column[np.isfinite(column)])
        spread = np.subtract(*np.quantile(known, [0.75, 0.25])) if known.size > 1 else 0.0
        if spread > 0:
            bins = max(bins, span * known.size ** (1 / 3) / (2.0 * spread))  # rule of Freedman and Diaconis
    return np.geomspace(x.min(), x.max(), int(min(bins, MOST_BINS)) + 1)


def density(places: Array, edges: Array) -> Array:
    """Return the density per decade; its area is the fraction of draws that are not NaN."""
    counts, _ = np.histogram(places[np.isfinite(places)], edges)
    return counts / (places.size * np.diff(np.log10(edges)))


def draw_margin(margin: Axes, inflection: Inflection, index: int, style: Style, gid: str) -> None:
    """Draw the posterior and the probability of the turning point in the margin of a response panel."""
    from softness_bayes.checking.inflection import CurveShape

    edges = bin_edges(np.array(margin.get_xlim()), inflection.modulus / 1e3)
    heights = [density(column / 1e3, edges) for column in inflection.modulus.T]
    steps = margin.stairs(heights[index], edges, fill=True, color=style.tint(style.inflection, 0.6))
    steps.set_gid(f"density/{gid}")
    margin.set_ylim(0.0, 1.05 * np.max(heights) or 1.0)
    outcome = inflection.outcome[:, index]
    interior, silent = (float(np.mean(outcome == kind)) for kind in (CurveShape.INTERIOR, CurveShape.SILENT))
    said = f"turning point {chance(interior)}" + (f"\nsilent {chance(silent)}" if silent else "")
    # on the side away from the density
    known = inflection.modulus[np.isfinite(inflection.modulus[:, index]), index] / 1e3
    low, high = margin.get_xlim()
    right = known.size > 0 and np.median(known) ** 2 < low * high
    words = margin.text(1.0 if right else 0.0, 1.0, said, transform=margin.transAxes, gid=f"probability/{gid}")
    words.set(color=style.inflection, fontsize=style.small, va="top", ha="right" if right else "left")
    margin.spines[["left", "bottom"]].set_visible(False)
    margin.tick_params(which="both", left=False, bottom=False, labelleft=False, labelbottom=False)


def _draw_density(axes: Axes, edges: Array, inflection: Inflection, index: int, style: Style, gid: str) -> None:
    places = inflection.modulus[:, index] / 1e3
    colour = style.inflection
    steps = axes.stairs(density(places, edges), edges, fill=True, color=style.tint(colour, 0.6))
    steps.set_gid(f"density/{gid}")
    known = places[np.isfinite(places)]
    if known.size:
        low, middle, high = np.quantile(known, [0.025, 0.5, 0.975])
        foot = axes.get_xaxis_transform()
        (bar,) = axes.plot([low, high], [0, 0], linewidth=2.5, transform=foot, gid=f"interval/{gid}")
        (dot,) = axes.plot([middle], [0], "o", markersize=4, transform=foot, gid=f"median/{gid}")
        for artist in (bar, dot):
            artist.set(color=colour, clip_on=False, zorder=3)
        within = chance(float(np.mean(inflection.inside[:, index])))
        wide = style.page >= WIDE
        words = f"{short(middle)} kPa (95 %: {short(low)} to {short(high)})\n{within} within{' ' if wide else chr(10)}"
        place = axes.text(0.99, 0.95 if wide else 0.8, f"{words}the fabrics' range", transform=axes.transAxes)
        place.set(ha="right", va="top", fontsize=style.small)


def _draw_outcomes(axes: Axes, inflection: Inflection, index: int, style: Style, gid: str) -> None:
    from softness_bayes.checking.inflection import CurveShape

    outcome = inflection.outcome[:, index]
    bars = {
        "interior": (np.mean(outcome == CurveShape.INTERIOR), style.inflection),
        "none": (np.mean(outcome == CurveShape.NONE), style.absent),
        "silent": (np.mean(outcome == CurveShape.SILENT), style.absent),
    }
    for place, (name, (share, colour)) in enumerate(bars.items()):
        bar = axes.barh(-place, 100 * share, height=0.7, color=style.tint(colour, 0.6))[0]
        bar.set_gid(f"{name}/{gid}")
        axes.text(100 * share + 2, -place, chance(float(share)), va="center", fontsize=style.small)
    axes.set_yticks([-place for place in range(len(bars))], list(bars))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_position(("data", 0.0))
