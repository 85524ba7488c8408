"""Recorded firing of afferents against load, curvature and distance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.plotting import stored
from softness_bayes.plotting.panels import draw_bands, legend_below, make_panels
from softness_bayes.plotting.style import Style, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUANTITIES = {
    "probe_force_n": ("force [N]", "N"),
    "probe_indentation_mm": ("indentation [mm]", "mm"),
    "probe_curvature_per_m": ("curvature of the probe [1/m]", "/m"),
    "probe_distance_mm": ("distance from the axis [mm]", "mm"),
}
"""Variables of the result -> label of the axis, and unit."""


@styled
def recorded(result: stored.Drawable, style: Style) -> Figure:
    """Draw recorded rates and their expectation, with credible bands, against each quantity that varies.

    Each series has one value of all other quantities, stated at its end. Its points are joined by the bands of the
    expected rate, the sensitivities of named afferents included.

    Returns
    -------
    Figure
        Artists named ``median/k``, ``band95/k``, ``band50/k`` and ``data/k`` for series k, in a panel for each
        quantity.
    """
    constant = result.group("constant_data")
    rate = result.group("observed_data")["recorded_rate_hz"].values
    expected = result.group("predictions")["expected_rate_hz"].isel(chain=0).values
    place = np.column_stack([np.nan_to_num(constant[name].values) for name in QUANTITIES])
    who = constant["afferent_index"].values
    varying = [k for k in range(place.shape[1]) if np.unique(place[:, k]).size > 1] or [0]
    grid = make_panels(len(varying), style, 2.4, len(varying), "", "firing rate [Hz]", sharey=True)
    series = 0
    for axes, k in zip(grid.panels, varying, strict=True):
        label, _ = [*QUANTITIES.values()][k]
        axes.set_xlabel(label)
        others = np.column_stack([np.delete(place, k, axis=1), who])
        for fixed in np.unique(others, axis=0):
            rows = np.flatnonzero((others == fixed).all(axis=1))
            rows = rows[np.argsort(place[rows, k], kind="stable")]
            if np.unique(place[rows, k]).size < 2 and len(varying) > 1:
                continue
            x = place[rows, k]
            draw_bands(axes, x, expected[:, rows], style.posterior, style, str(series))
            (points,) = axes.plot(x, rate[rows], "o", color=style.data, markersize=3)
            points.set(label="recorded", gid=f"data/{series}", zorder=3)
            units = [unit for place_, (_, unit) in enumerate(QUANTITIES.values()) if place_ != k]
            told = [f"{value:g} {unit}" for value, unit in zip(fixed, units, strict=False) if value]
            axes.annotate(", ".join(told) or "flat", (x[-1], rate[rows][-1]), fontsize=style.small, ha="right")
            series += 1
        axes.set_ylim(bottom=0.0)
    legend_below(grid.figure, grid.panels)
    return grid.figure
