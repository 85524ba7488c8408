"""The response against the fabric's modulus under each load, and its turning point (model.md 8 and 11)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.plotting import stored
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    RATIO_LABEL,
    WIDE,
    Array,
    Panels,
    check_loads,
    draw_bands,
    draw_interval,
    draw_rug,
    finish_load_panels,
    load_panels,
    number_ticks,
    say_grouped,
    title,
)
from softness_bayes.plotting.style import USUAL, Style, styled
from softness_bayes.readable import chance, number
from softness_bayes.touch.contact import HERTZ_LIMIT, Load
from softness_bayes.touch.load_groups import LoadGroup

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softness_bayes.checking.inflection import Curves, Inflection

RATE_LABEL = "total rate [spikes/s]"

SHADE = "#EFEFEF"
"""Background colour where Hertz's contact theory is questionable, and over the range of the fabrics."""

FEWEST_BINS, MOST_BINS = 60, 240
"""Smallest and largest number of bins over the whole range of turning points."""

MARGIN = 0.2
"""Height of the margin for the turning point above a response panel, as a fraction of the panel's height."""


class RatioAxis(NamedTuple):
    """A grid of E_fab / E_skin in the range common to all draws of one load, and interpolation to this grid.

    E_skin, and with it the ratio, differs from draw to draw (model.md 11).
    """

    log_modulus: Array
    """ln E_fab on the grid of the curves, shape (points,)."""
    log_ratio: Array
    """ln(E_fab / E_skin) of every draw on the same grid, shape (draws, points)."""

    @classmethod
    def of(cls, modulus: ArrayLike, skin_modulus: ArrayLike) -> RatioAxis:
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


def response(result: stored.Drawable, style: Style, against_ratio: bool = False) -> Figure:
    """Draw the response against E_fab, or against E_fab / E_skin."""
    groups = result.load_groups
    shown = result.curves(), groups.called, stored.fabric_modulus(result)
    names = stored.fabric_names(result)
    if against_ratio:
        return say_grouped(ratio_figure(*shown, names=names, style=style), groups, style)
    radius = float(result.group("constant_data")["finger_radius_mm"]) * 1e-3
    figure = response_figure(*shown, inflection=result.inflections(), finger_radius=radius, names=names, style=style)
    return say_grouped(figure, groups, style)


def inflection(result: stored.Drawable, style: Style) -> Figure:
    """Draw the posterior of the turning point of the response."""
    groups = result.load_groups
    figure = inflection_figure(result.inflections(), groups.called, stored.fabric_modulus(result), style=style)
    return say_grouped(figure, groups, style)


@styled
def response_figure(
    curves: Curves,
    loads: Sequence[Load | LoadGroup],
    fabric_modulus: ArrayLike,
    *,
    inflection: Inflection | None = None,
    finger_radius: float | None = None,
    names: Sequence[str] = (),
    style: Style = USUAL,
) -> Figure:
    """Draw the total rate against E_fab: median, 50 % and 95 % credible bands, one panel per load.

    Parameters
    ----------
    curves
        Draws of the response: the return value of `checking.inflection.response_curves`.
    loads
        The load of each panel.
    fabric_modulus
        E_fab of the fabrics of the data [Pa], marked along the bottom of each panel.
    inflection
        If given, its posterior is drawn along the top of each panel, with the probability of a turning
        point.
    finger_radius
        Radius R of the fingertip [m]. If given, the panel is grey where the draws' median contact radius exceeds R/2.
    names
        Names of the fabrics, written above the panels; by default no names are written.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``median/1 mm``, ``band95/1 mm``, ``band50/1 mm``, ``fabrics/1 mm``, and, where
        drawn, ``hertz/1 mm``, ``density/1 mm``, ``probability/1 mm``, ``name/1 mm/NAME`` and ``guide/1 mm``; E_fab
        in kPa.

    Raises
    ------
    InputError
        If there is not one load for each set of curves.
    """
    check_loads(loads, curves.total_rate.shape[1])
    kilopascal, fabrics = curves.modulus / 1e3, np.asarray(fabric_modulus) / 1e3
    margin = 0.0 if inflection is None else MARGIN
    grid = load_panels(loads, MODULUS_LABEL, RATE_LABEL, style, margin, names)
    panels = [(kilopascal, rate, fabrics) for rate in np.moveaxis(curves.total_rate, 1, 0)]
    _draw_rates(grid, panels, curves, loads, names, style, finger_radius)
    for index, (head, load) in enumerate(zip(grid.heads, loads, strict=True)):
        if inflection is not None:
            _draw_margin(head, inflection, index, style, str(load))
    return grid.figure


@styled
def ratio_figure(
    curves: Curves,
    loads: Sequence[Load | LoadGroup],
    fabric_modulus: ArrayLike,
    *,
    names: Sequence[str] = (),
    style: Style = USUAL,
) -> Figure:
    """Draw the total rate against E_fab / E_skin, otherwise like `response_figure`.

    E_skin differs from draw to draw. The curve of each draw is interpolated, in the logarithm of the ratio
    for that draw, to a grid over the range common to all draws. The fabrics of the data are drawn at their
    median ratios.
    """
    check_loads(loads, curves.total_rate.shape[1])
    grid = load_panels(loads, RATIO_LABEL, RATE_LABEL, style, names=names)
    panels = []
    for index in range(len(loads)):
        axis = RatioAxis.of(curves.modulus, curves.skin_modulus[:, index])
        panels.append((axis.grid, axis.carry(curves.total_rate[:, index]), axis.place(fabric_modulus)))
    _draw_rates(grid, panels, curves, loads, names, style)
    return grid.figure


def _draw_rates(
    grid: Panels,
    panels: Sequence[tuple[Array, Array, Array]],
    curves: Curves,
    loads: Sequence[Load | LoadGroup],
    names: Sequence[str],
    style: Style,
    finger_radius: float | None = None,
) -> None:
    """Draw grid, curves and places of the fabrics in each panel, set the axes, and write names and legend."""
    for index, (axes, load, (x, rate, places)) in enumerate(zip(grid.panels, loads, panels, strict=True)):
        draw_bands(axes, x, rate, style.posterior, style, str(load))
        draw_rug(axes, places, style, str(load), names)
        if finger_radius is not None:
            _mark_hertz(axes, x, curves.radius[:, index], finger_radius, str(load))
    upper = np.quantile(curves.total_rate, 0.975, axis=0)
    top = 1.12 * float(upper[np.isfinite(upper)].max(initial=0.0)) or 1.0  # 1 spike/s if no receptor fires
    grid.panels[0].set_ylim(0.0, top)
    ends = min(x.min() for x, _, _ in panels), max(x.max() for x, _, _ in panels)
    finish_load_panels(grid, loads, ends, [(places, names) for _, _, places in panels], style)


def _mark_hertz(axes: Axes, x: Array, radius: Array, finger_radius: float, gid: str) -> None:
    """Shade the panel where Hertz's contact theory is questionable."""
    beyond = np.median(radius, axis=0) / finger_radius > HERTZ_LIMIT
    if beyond.any():
        ground = axes.fill_between(x, 0.0, 1.0, where=list(beyond), transform=axes.get_xaxis_transform())
        ground.set(facecolor=SHADE, edgecolor="none", linewidth=0.0, zorder=0.1, gid=f"hertz/{gid}")
        ground.set_label(f"contact radius above {HERTZ_LIMIT:g} R: geometry questionable")


@styled
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
    limits = (fabrics.min() / RANGE_FACTOR, fabrics.max() * RANGE_FACTOR)
    edges, heights = _densities(inflection, *limits)
    wide = style.page >= WIDE
    figure = Figure(figsize=(style.page, (0.75 if wide else 1.0) * len(loads) + 0.75), layout="constrained")
    cells = figure.subplots(len(loads), 2, sharex="col", sharey="col", squeeze=False, width_ratios=(2.4, 1))
    for index, ((left, right), load) in enumerate(zip(cells, loads, strict=True)):
        left.axvspan(fabrics.min(), fabrics.max(), color=SHADE, linewidth=0, gid=f"fabrics/{load}")
        _draw_density(left, edges, heights[index], style, str(load))
        _draw_summary(left, inflection, index, style, str(load))
        _draw_outcomes(right, inflection.outcome[:, index], style, str(load))
        left.set_title(title(load), y=1.0, pad=-8, x=0.01)
    left, right = cells[-1]
    xlabel = f"{MODULUS_LABEL}{' ' if wide else chr(10)}at the turning point (maximum)"
    left.set(xscale="log", xlim=limits, ylim=(0.0, 1.05 * np.max(heights) or 1.0), xlabel=xlabel)
    number_ticks(left.xaxis)
    right.set(xlim=(0, 100), xticks=(0, 50, 100), xlabel="probability [%]")
    figure.supylabel("posterior density [1/decade]", fontsize="medium")
    return figure


def _densities(inflection: Inflection, low: float, high: float) -> tuple[Array, Array]:
    """Return bin edges [kPa] between two limits and the density per decade under each load, shape (loads, bins).

    The area under a density is the fraction of draws with a turning point. The bins are evenly spaced in the
    logarithm; the narrowest posterior sets their width.
    """
    places = inflection.modulus.T / 1e3
    bins = float(FEWEST_BINS)
    for column in places:
        known = np.log10(column[np.isfinite(column)])
        spread = np.subtract(*np.quantile(known, [0.75, 0.25])) if known.size > 1 else 0.0
        if spread > 0:  # rule of Freedman and Diaconis
            bins = max(bins, np.log10(high / low) * known.size ** (1 / 3) / (2.0 * spread))
    edges = np.geomspace(low, high, int(min(bins, MOST_BINS)) + 1)
    counts = np.stack([np.histogram(column[np.isfinite(column)], edges)[0] for column in places])
    return edges, counts / (places.shape[1] * np.diff(np.log10(edges)))


def _draw_density(axes: Axes, edges: Array, height: Array, style: Style, gid: str) -> None:
    """Draw the posterior density of the turning point."""
    axes.stairs(height, edges, fill=True, color=style.tint(style.inflection, 0.6), gid=f"density/{gid}")


def _draw_margin(margin: Axes, inflection: Inflection, index: int, style: Style, gid: str) -> None:
    """Draw the posterior and the probability of the turning point in the margin of a response panel."""
    from softness_bayes.checking.inflection import CurveShape

    low, high = margin.get_xlim()
    edges, heights = _densities(inflection, low, high)
    _draw_density(margin, edges, heights[index], style, gid)
    margin.set_ylim(0.0, 1.05 * np.max(heights) or 1.0)
    outcome = inflection.outcome[:, index]
    interior, silent = (float(np.mean(outcome == kind)) for kind in (CurveShape.INTERIOR, CurveShape.SILENT))
    words = f"turning point {chance(interior)}" + (f"\nsilent {chance(silent)}" if silent else "")
    # on the side away from the density
    known = inflection.modulus[np.isfinite(inflection.modulus[:, index]), index] / 1e3
    right = known.size > 0 and np.median(known) ** 2 < low * high
    text = margin.text(1.0 if right else 0.0, 1.0, words, transform=margin.transAxes, gid=f"probability/{gid}")
    text.set(color=style.inflection, fontsize=style.small, va="top", ha="right" if right else "left")
    margin.spines[["left", "bottom"]].set_visible(False)
    margin.tick_params(which="both", left=False, bottom=False, labelleft=False, labelbottom=False)


def _draw_summary(axes: Axes, inflection: Inflection, index: int, style: Style, gid: str) -> None:
    """Draw and write median and 95 % interval of the turning point, if any draw has one."""
    places = inflection.modulus[:, index] / 1e3
    known = places[np.isfinite(places)]
    if known.size:
        gids = (f"interval/{gid}", f"median/{gid}")
        low, middle, high = map(number, draw_interval(axes, known, 0.0, style.inflection, (2.5, 4.0), gids))
        inside, wide = chance(float(np.mean(inflection.inside[:, index]))), style.page >= WIDE
        words = f"{middle} kPa (95 %: {low} to {high})\n{inside} within{' ' if wide else chr(10)}the fabrics' range"
        text = axes.text(0.99, 0.95 if wide else 0.8, words, transform=axes.transAxes, fontsize=style.small)
        text.set(ha="right", va="top")


def _draw_outcomes(axes: Axes, outcome: NDArray[np.int8], style: Style, gid: str) -> None:
    """Draw the probability of each outcome as a bar."""
    from softness_bayes.checking.inflection import CurveShape

    kinds = {"interior": CurveShape.INTERIOR, "none": CurveShape.NONE, "silent": CurveShape.SILENT}
    for place, (name, kind) in enumerate(kinds.items()):
        share, colour = float(np.mean(outcome == kind)), style.inflection if name == "interior" else style.absent
        bar = axes.barh(-place, 100 * share, height=0.7, color=style.tint(colour, 0.6))[0]
        bar.set_gid(f"{name}/{gid}")
        axes.text(100 * share + 2, -place, chance(share), va="center", fontsize=style.small)
    axes.set_yticks([-place for place in range(len(kinds))], list(kinds))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_position(("data", 0.0))
