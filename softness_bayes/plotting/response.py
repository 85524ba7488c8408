"""The response against the fabric's modulus under each load, and its turning point (model.md 8 and 11)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.defaults import LIMITS
from softness_bayes.base.readable import chance, number
from softness_bayes.plotting import stored
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    RATIO_LABEL,
    WIDE,
    Array,
    draw_bands,
    draw_interval,
    draw_rug,
    finish_load_panels,
    load_panels,
    number_ticks,
    say_grouped,
    title,
)
from softness_bayes.plotting.style import Style
from softness_bayes.touch.contact import HERTZ_LIMIT

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


class ModulusAxis(NamedTuple):
    """Horizontal axis of the curves under one load: E_fab [kPa], or E_fab / E_skin if the moduli of the skin are given.

    E_skin, and with it the ratio, differs from draw to draw (model.md 11). Curves are then interpolated, each in the
    logarithm of its own ratio, to a grid over the range that all draws share.
    """

    modulus: Array
    """E_fab on the grid of the curves [Pa], shape (points,)."""
    skin_modulus: Array | None
    """E_skin of every draw on this grid [Pa], shape (draws, points)."""

    @property
    def label(self) -> str:
        """Label of the axis."""
        return MODULUS_LABEL if self.skin_modulus is None else RATIO_LABEL

    @property
    def _log_ratio(self) -> Array:
        assert self.skin_modulus is not None
        return np.asarray(np.log(self.modulus) - np.log(np.asarray(self.skin_modulus, float)))

    @property
    def grid(self) -> Array:
        """Points of the axis, shape (points,)."""
        if self.skin_modulus is None:
            return self.modulus / 1e3
        low, high = self._log_ratio[:, 0].max(), self._log_ratio[:, -1].min()
        return np.exp(np.linspace(low, high, self.modulus.size))

    def carry(self, curves: Array) -> Array:
        """Return curves over E_fab, shape (draws, points), at the points of the axis."""
        if self.skin_modulus is None:
            return curves
        at = np.log(self.grid)
        return np.stack([np.interp(at, x, y) for x, y in zip(self._log_ratio, curves, strict=True)])

    def place(self, modulus: ArrayLike) -> Array:
        """Return the places of fabric moduli [Pa], shape (n,): of ratios, the posterior medians."""
        moduli = np.asarray(modulus, float)
        if self.skin_modulus is None:
            return np.asarray(moduli / 1e3)
        at, x = np.log(moduli), np.log(self.modulus)
        return np.exp(np.median([np.interp(at, x, ratio) for ratio in self._log_ratio], axis=0))


def modulus_axes(curves: Curves, against_ratio: bool) -> list[ModulusAxis]:
    """Return the axis of each load: E_fab, or its ratio to E_skin."""
    return [
        ModulusAxis(curves.modulus, skin if against_ratio else None) for skin in np.moveaxis(curves.skin_modulus, 1, 0)
    ]


def response(result: stored.Drawable, style: Style, against_ratio: bool = False) -> Figure:
    """Draw the total rate against E_fab or E_fab / E_skin: median, 50 % and 90 % credible bands, one panel per load.

    Fabrics of the data are marked along the bottom and named above. Against E_fab, the posterior of the turning point
    is drawn along the top with its probability, and the panel is grey where the draws' median contact radius exceeds
    R/2.

    Returns
    -------
    Figure
        Artists named ``median/1 mm``, ``band90/1 mm``, ``band50/1 mm``, ``fabrics/1 mm``, ``name/1 mm/NAME``,
        ``guide/1 mm``, and against E_fab ``hertz/1 mm``, ``density/1 mm`` and ``probability/1 mm``.
    """
    curves, loads, names = result.curves(), result.load_groups.called, stored.fabric_names(result)
    horizontal = modulus_axes(curves, against_ratio)
    margin = 0.0 if against_ratio else MARGIN
    grid = load_panels(loads, horizontal[0].label, RATE_LABEL, style, margin, names)
    places = [axis.place(stored.fabric_modulus(result)) for axis in horizontal]
    for k, (axes, load, axis) in enumerate(zip(grid.panels, loads, horizontal, strict=True)):
        draw_bands(axes, axis.grid, axis.carry(curves.total_rate[:, k]), style.posterior, style, str(load))
        draw_rug(axes, places[k], style, str(load), names)
        if not against_ratio:
            radius = float(result.group("constant_data")["finger_radius_mm"]) * 1e-3
            _mark_hertz(axes, axis.grid, curves.radius[:, k], radius, str(load))
    upper = np.quantile(curves.total_rate, LIMITS[-1], axis=0)
    top = 1.12 * float(upper[np.isfinite(upper)].max(initial=0.0)) or 1.0  # 1 spike/s if no receptor fires
    grid.panels[0].set_ylim(0.0, top)
    finish_load_panels(grid, loads, [axis.grid for axis in horizontal], [(at, names) for at in places], style)
    for k, (head, load) in enumerate(zip(grid.heads, loads, strict=True)):
        if not against_ratio:
            _draw_margin(head, result.inflections(), k, style, str(load))
    return say_grouped(grid.figure, result.load_groups, style)


def _mark_hertz(axes: Axes, x: Array, radius: Array, finger_radius: float, gid: str) -> None:
    """Shade the panel where Hertz's contact theory is questionable."""
    beyond = np.median(radius, axis=0) / finger_radius > HERTZ_LIMIT
    if beyond.any():
        ground = axes.fill_between(x, 0.0, 1.0, where=list(beyond), transform=axes.get_xaxis_transform())
        ground.set(facecolor=SHADE, edgecolor="none", linewidth=0.0, zorder=0.1, gid=f"hertz/{gid}")
        ground.set_label(f"contact radius above {HERTZ_LIMIT:g} R: geometry questionable")


def inflection(result: stored.Drawable, style: Style) -> Figure:
    """Draw the posterior of E_fab at the turning point (maximum), one row per load, with the outcomes' probabilities.

    The left panels show the density per decade for the draws with an interior maximum. The area under the density is
    the fraction of such draws, so that rows can be compared. The dot and the bar show the median and the central 90 %
    of these draws. The range of the fabrics is shaded. The right panels show the probabilities of the three outcomes.

    Returns
    -------
    Figure
        Artists named ``density/1 mm`` (a step patch), ``interval/1 mm``, ``fabrics/1 mm`` and one bar
        ``interior/1 mm``, ``none/1 mm``, ``silent/1 mm`` each; E_fab in kPa.
    """
    from matplotlib.figure import Figure

    from softness_bayes.checking.inflection import RANGE_FACTOR

    found, loads, fabrics = result.inflections(), result.load_groups.called, stored.fabric_modulus(result) / 1e3
    limits = (fabrics.min() / RANGE_FACTOR, fabrics.max() * RANGE_FACTOR)
    edges, heights = _densities(found, *limits)
    wide = style.page >= WIDE
    figure = Figure(figsize=(style.page, (0.75 if wide else 1.0) * len(loads) + 0.75), layout="constrained")
    cells = figure.subplots(len(loads), 2, sharex="col", sharey="col", squeeze=False, width_ratios=(2.4, 1))
    for index, ((left, right), load) in enumerate(zip(cells, loads, strict=True)):
        left.axvspan(fabrics.min(), fabrics.max(), color=SHADE, linewidth=0, gid=f"fabrics/{load}")
        _draw_density(left, edges, heights[index], style, str(load))
        _draw_summary(left, found, index, style, str(load))
        _draw_outcomes(right, found.outcome[:, index], style, str(load))
        left.set_title(title(load), y=1.0, pad=-8, x=0.01)
    left, right = cells[-1]
    xlabel = f"{MODULUS_LABEL}{' ' if wide else chr(10)}at the turning point (maximum)"
    left.set(xscale="log", xlim=limits, ylim=(0.0, 1.05 * np.max(heights) or 1.0), xlabel=xlabel)
    number_ticks(left.xaxis)
    right.set(xlim=(0, 100), xticks=(0, 50, 100), xlabel="probability [%]")
    figure.supylabel("posterior density [1/decade]", fontsize="medium")
    return say_grouped(figure, result.load_groups, style)


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
    """Draw and write median and 90 % interval of the turning point, if any draw has one."""
    places = inflection.modulus[:, index] / 1e3
    known = places[np.isfinite(places)]
    if known.size:
        gids = (f"interval/{gid}", f"median/{gid}")
        low, middle, high = map(number, draw_interval(axes, known, 0.0, style.inflection, (2.5, 4.0), gids))
        inside, wide = chance(float(np.mean(inflection.inside[:, index]))), style.page >= WIDE
        words = f"{middle} kPa (90 %: {low} to {high})\n{inside} within{' ' if wide else chr(10)}the fabrics' range"
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
