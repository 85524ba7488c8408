"""The touch: pressure, stress and firing under the pad, the membrane, and a plate's force (model.md 3 to 8)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softness_bayes.base.defaults import LIMITS
from softness_bayes.base.readable import number
from softness_bayes.data.columns import CURVATURE, DISTANCE, FORCE, INDENTATION
from softness_bayes.plotting import stored
from softness_bayes.plotting.panels import (
    WIDE,
    draw_bands,
    draw_interval,
    fitting,
    legend_below,
    make_panels,
    number_ticks,
    short_name,
)
from softness_bayes.plotting.style import Style, styled

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpec
    from matplotlib.lines import Line2D

SEEN = 0.02
"""Fraction of the largest stress at which the axis of distances ends."""

MARGIN = 1.25
"""Half-width of the shown part of the pad, relative to the largest contact radius."""

COLOURS = "viridis"
"""Colour map of rates, which is perceptually uniform and suitable for colour-blind readers."""


def touch(result: stored.Drawable, style: Style) -> Figure:
    """Draw pressure, stress and firing rate against the distance from the axis, and maps of the pad's receptors below.

    Each column is a load; a narrow page shows the smallest and the largest. Lines are medians over the draws, and
    bands are their central 90 %. Receptor positions are sampled from the receptor density. Their colour is the median
    rate at their distance; open symbols are silent receptors. The circle is the edge of the contact. Only the part
    of the pad around the contact is shown.

    Returns
    -------
    Figure
        Artists named ``stress/1 mm/0``, ``pressure/1 mm/0``, ``band90/1 mm/0``, ``rate/1 mm/0``, ``firing/1 mm/0``,
        ``silent/1 mm/0`` and ``contact/1 mm/0``. The last number is the index of the fabric. Lengths are in mm,
        stresses in kPa.
    """
    from matplotlib.figure import Figure

    every = result.group("illustration_data")
    columns = fitting(every.sizes["touch_load"], style)
    loads = np.unique(np.linspace(0, every.sizes["touch_load"] - 1, columns).round().astype(int))
    touches = every.isel(touch_load=loads)
    fabrics = _fabric_labels(result)
    width, length = style.column if columns == 1 else style.page, touches["pad_mm"].values
    # the maps have the proportions of the pad, which determines the height
    tall = (width - 0.9) / columns * length[1] / length[0]
    legend = 0.0 if width >= WIDE else 0.5
    height = 3.6 + legend + len(fabrics) * (tall + 0.12) + 0.8
    figure = Figure(figsize=(width, height), layout="constrained")
    ratios = [1.7 / tall, 1.4 / tall, *[1.0] * len(fabrics)]
    grid = figure.add_gridspec(len(fabrics) + 2, columns, height_ratios=ratios)
    keys = [*_draw_profiles(figure, grid, touches, fabrics, style), *_draw_maps(figure, grid, touches, fabrics, style)]
    figure.legend(handles=keys, loc="outside lower center", ncols=3 if width >= WIDE else 1)
    return figure


def _fabric_labels(result: stored.Drawable) -> list[str]:
    """Return labels of the fabrics that are touched, with the names of rated fabrics and the moduli."""
    touches, modulus, names = (
        result.group("illustration_data"),
        stored.given_modulus(result),
        stored.fabric_names(result),
    )
    labels = []
    for what, kilopascal in zip(touches["touch_fabric"].values, touches["touch_e_fab_kpa"].values, strict=True):
        same = np.flatnonzero(np.isclose(modulus, kilopascal * 1e3, rtol=1e-6))
        name = f" ({short_name(names[same[0]])})" if same.size else ""
        labels.append(f"{what}{name}, {number(kilopascal)} kPa")
    return labels


def _draw_profiles(
    figure: Figure, grid: GridSpec, touches: xr.Dataset, fabrics: list[str], style: Style
) -> list[Line2D]:
    """Draw stress, pressure and rates against the distance, in a column for each load; return keys of the lines."""
    from matplotlib.lines import Line2D

    x, low, middle, high = touches["distance_mm"].values, *(touches.sel(quantile=q) for q in LIMITS[::2])
    stress = middle["touch_stress_kpa"].values
    seen = x[(stress > SEEN * stress.max()).any(axis=(0, 1))].max(initial=x[1])
    colours = [style.ensembles[k % len(style.ensembles)] for k in range(len(fabrics))]
    cells: list[list[Axes]] = []
    for k, load in enumerate(touches["touch_load"].values):
        first = cells[0] if cells else [None, None]
        above, below = (figure.add_subplot(grid[row, k], sharey=first[row]) for row in (0, 1))
        cells.append([above, below])
        for fabric, colour in enumerate(colours):
            gid = f"{load}/{fabric}"
            ends = (limit["touch_stress_kpa"].values[k, fabric] for limit in (low, high))
            above.fill_between(x, *ends, color=style.tint(colour, 0.25), linewidth=0, gid=f"band90/{gid}")
            above.plot(x, stress[k, fabric], color=colour, gid=f"stress/{gid}")
            pressure, rate = (middle[name].values[k, fabric] for name in ("touch_pressure_kpa", "touch_rate_hz"))
            above.plot(x, pressure, color=colour, linewidth=0.7, linestyle="--", gid=f"pressure/{gid}")
            below.plot(x, rate, color=colour, gid=f"rate/{gid}")
        above.set_title(str(load))
        below.set_xlabel("from the axis [mm]")
        for panel in (above, below):
            panel.set_xlim(0.0, seen)
            panel.tick_params(labelleft=k == 0, labelbottom=panel is below)
    cells[0][0].set(ylim=(0.0, None), ylabel="stress [kPa]")
    cells[0][1].set(ylim=(0.0, None), ylabel="firing rate [Hz]")
    return [
        Line2D([], [], color="black", linewidth=0.9, label="stress at the receptors, 90 % credible"),
        Line2D([], [], color="black", linewidth=0.9, linestyle="--", label="pressure on the skin"),
        *(Line2D([], [], color=colour, label=label) for colour, label in zip(colours, fabrics, strict=True)),
    ]


def _draw_maps(figure: Figure, grid: GridSpec, touches: xr.Dataset, fabrics: list[str], style: Style) -> list[Line2D]:
    """Draw a map of the pad for each fabric and load, and the key of rates; return keys of the symbols.

    Receptors are coloured by their rates. The map shows a part of the pad with all contacts inside, which has the
    pad's proportions.
    """
    from matplotlib.patches import Circle
    from matplotlib.ticker import MultipleLocator

    middle, centre, pad = touches.sel(quantile=0.5), touches["contact_centre_mm"].values, touches["pad_mm"].values
    half = min(MARGIN * float(middle["touch_radius_mm"].max()), 0.5 * float(pad[1]))
    size = np.array([half * pad[0] / pad[1], half])
    shown = np.clip(centre, size, pad - size) + np.array([-size, size])
    places = np.stack([touches[f"receptor_{side}_mm"].values for side in "xy"], axis=-1)
    away = np.hypot(*(places - centre).T)
    distance, profiles = touches["distance_mm"].values, middle["touch_rate_hz"].values
    rate = np.apply_along_axis(lambda profile: np.interp(away, distance, profile), -1, profiles)
    firing = rate[rate > 0]
    low, high = (float(firing.min()), float(firing.max())) if firing.size else (0.0, 1.0)
    ends = (low if high > low else 0.0, high)
    cells: list[Axes] = []
    for row, label in enumerate(fabrics):
        for k, load in enumerate(touches["touch_load"].values):
            axes = figure.add_subplot(grid[row + 2, k])
            cells.append(axes)
            fires, gid = rate[k, row] > 0, f"{load}/{row}"
            hollow: dict[str, Any] = {"markersize": 2.2, "markerfacecolor": "none", "markeredgewidth": 0.4}
            axes.plot(*places[~fires].T, "o", color=style.absent, gid=f"silent/{gid}", zorder=1, **hollow)
            x, y = places[fires].T
            colours: dict[str, Any] = {"c": rate[k, row][fires], "cmap": COLOURS, "vmin": ends[0], "vmax": ends[1]}
            axes.scatter(x, y, 16, linewidths=0, zorder=2, gid=f"firing/{gid}", **colours)
            radius = float(middle["touch_radius_mm"][k, row])
            axes.add_patch(Circle(tuple(centre), radius, fill=False, linewidth=0.6, gid=f"contact/{gid}"))
            axes.set(xlim=shown[:, 0], ylim=shown[:, 1], aspect="equal")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(MultipleLocator(5.0))
            axes.tick_params(labelleft=k == 0, labelbottom=row == len(fabrics) - 1)
            if k == 0:
                axes.set_ylabel("across [mm]")
                axes.set_title(label, color=style.ensembles[row % len(style.ensembles)])
            if row == len(fabrics) - 1:
                axes.set_xlabel("along the finger [mm]")
    return _draw_keys(figure, cells, ends, style)


def _draw_keys(figure: Figure, cells: list[Axes], ends: tuple[float, float], style: Style) -> list[Line2D]:
    """Draw the key of rates below the maps, and return keys of the receptors' symbols."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    mapped, words = ScalarMappable(Normalize(*ends), COLOURS), "firing rate of a receptor [Hz]"
    figure.colorbar(mapped, ax=cells, location="bottom", aspect=50, shrink=0.6, label=words)
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o"}
    return [
        Line2D([], [], color=colormaps[COLOURS](0.7), markersize=4, label="firing receptor (colour: rate)", **dot),
        Line2D([], [], color=style.absent, markerfacecolor="none", markersize=3, label="silent receptor", **dot),
        Line2D([], [], color="black", linewidth=0.6, label="edge of the contact"),
    ]


def membrane(result: stored.Drawable, style: Style) -> Figure:
    """Draw firing rate against current with credible bands, and below it example spike trains at some currents.

    Bars above the panel show the central 90 % of the rheobase and of alpha, the largest current.

    Returns
    -------
    Figure
        Artists named ``median/rate``, ``band90/rate``, ``band50/rate``, ``rheobase``, ``alpha`` and ``train/k``.
    """
    from matplotlib.figure import Figure

    predicted, examples = result.group("predictions").isel(chain=0), result.group("illustration_data")
    currents, x = examples["train_current_ua_cm2"].values, predicted["current_ua_cm2"].values
    figure = Figure(figsize=(style.column, 2.6 + 0.25 * currents.size), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(2.0, 0.25 + 0.25 * currents.size))
    draw_bands(above, x, predicted["firing_rate_hz"].values, style.posterior, style, "rate")
    for name, gid, height, colour, words in (
        ("rheobase_ua_cm2", "rheobase", 1.05, style.inflection, "rheobase"),
        ("largest_current_ua_cm2", "alpha", 1.12, style.data, r"largest current $\alpha$"),
    ):
        draws = predicted[name].values
        known = draws[np.isfinite(draws)]  # the rheobase is infinite if the membrane never fires
        if known.size:
            label = f"{words}, 90 % credible"
            draw_interval(above, known, height, colour, (2.0, 3.0), (gid, f"{gid} median"), label)
    above.set(xlim=(x[0], x[-1]), ylim=(0.0, None), xlabel="receptor current [µA/cm²]", ylabel="firing rate [Hz]")
    for place, train in enumerate(examples["spike_time_ms"].values):
        look: dict[str, Any] = {"linelengths": 0.7, "linewidths": 0.8, "colors": style.posterior}
        below.eventplot(train[np.isfinite(train)], lineoffsets=place, gid=f"train/{place}", **look)
    below.set(xlim=(0.0, float(examples["train_duration_ms"])), ylim=(-0.6, currents.size - 0.4))
    below.set(xlabel="time since the current began [ms]", ylabel="current\n[µA/cm²]")
    below.set_yticks(range(currents.size), [number(current) for current in currents])
    below.tick_params(axis="y", length=0)
    below.spines["left"].set_visible(False)
    legend_below(figure, [above])
    return figure


def compression(result: stored.Drawable, style: Style) -> Figure:
    """Draw the force of a rigid plate on the typical finger, with credible bands, and the observed forces.

    The axes are logarithmic; the indentation is in mm.

    Returns
    -------
    Figure
        Artists named ``median/plate``, ``band90/plate``, ``band50/plate`` and ``finger/k`` (points joined
        in order of indentation).
    """
    predicted, constant = result.group("predictions").isel(chain=0), result.group("constant_data")
    depth, force = predicted["plate_indentation_mm"].values, result.group("observed_data")["plate_force_n"].values
    indentation, finger = constant["force_indentation_mm"].values, constant["finger_index"].values
    grid = make_panels(1, style, 2.0, 1, "indentation [mm]", "force [N]", narrow=True)
    (axes,) = grid.panels
    draw_bands(axes, depth, predicted["typical_force_n"].values, style.posterior, style, "plate")
    for k in np.unique(finger):
        rows = np.flatnonzero(finger == k)
        rows = rows[np.argsort(indentation[rows], kind="stable")]
        (line,) = axes.plot(indentation[rows], force[rows], "o-", color=style.data, markersize=3, linewidth=0.5)
        line.set_label("fingers" if k == finger.min() else None)
        line.set(gid=f"finger/{k}", zorder=3)
    axes.set(xscale="log", yscale="log", xlim=(depth.min(), depth.max()))
    number_ticks(axes.xaxis)
    number_ticks(axes.yaxis)
    return grid.with_legend()


PLACES = {f"recorded_{column.name}": column for column in (FORCE, INDENTATION, CURVATURE, DISTANCE)}
"""Variables of the result that place a recorded response, with their columns."""


@styled
def recorded(result: stored.Drawable, style: Style) -> Figure:
    """Draw recorded rates and their expectation, with credible bands, against each quantity that varies.

    Each series has one value of all other quantities, stated at its end. Its points are joined by the bands of the
    expected rate, the sensitivities of named afferents included.

    Returns
    -------
    Figure
        Artists named ``median/k``, ``band90/k``, ``band50/k`` and ``data/k`` for series k, in a panel for each
        quantity.
    """
    constant, rate = result.group("constant_data"), result.group("observed_data")["recorded_rate_hz"].values
    expected = result.group("predictions")["expected_rate_hz"].isel(chain=0).values
    place = np.column_stack([np.nan_to_num(constant[name].values) for name in PLACES])
    columns, who = [*PLACES.values()], constant["afferent_index"].values
    varying = [k for k in range(len(columns)) if np.unique(place[:, k]).size > 1] or [0]
    grid = make_panels(len(varying), style, 2.4, len(varying), "", "firing rate [Hz]", sharey=True)
    series = 0
    for axes, k in zip(grid.panels, varying, strict=True):
        axes.set_xlabel(f"{columns[k].label} [{columns[k].unit}]")
        others = np.column_stack([np.delete(place, k, axis=1), who])
        units = [column.unit for column in columns if column is not columns[k]]
        for fixed in np.unique(others, axis=0):
            rows = np.flatnonzero((others == fixed).all(axis=1))
            rows = rows[np.argsort(place[rows, k], kind="stable")]
            x = place[rows, k]
            if np.unique(x).size < 2 and len(varying) > 1:
                continue
            draw_bands(axes, x, expected[:, rows], style.posterior, style, str(series))
            (points,) = axes.plot(x, rate[rows], "o", color=style.data, markersize=3)
            points.set(label="recorded", gid=f"data/{series}", zorder=3)
            told = [f"{value:g} {unit}" for value, unit in zip(fixed, units, strict=False) if value]
            axes.annotate(", ".join(told) or "flat", (x[-1], rate[rows][-1]), fontsize=style.small, ha="right")
            series += 1
        axes.set_ylim(bottom=0.0)
    return grid.with_legend()
