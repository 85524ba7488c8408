"""Parameters of a run: joint posterior of pairs, comparison with the prior, and agreement of the ensembles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.base.arviz_bridge import without
from softness_bayes.base.defaults import LEVELS, LIMITS
from softness_bayes.base.errors import InputError
from softness_bayes.base.readable import counted
from softness_bayes.plotting import stored
from softness_bayes.plotting.data import carry
from softness_bayes.plotting.panels import TINTS, Array, make_panels
from softness_bayes.plotting.style import Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_DRAWS = 5000
"""Largest number of draws in a corner plot; more take time without a visible difference."""

_SHOWN = LIMITS[:: len(LIMITS) - 1]

POINTS = 241
"""Number of points in the density curve of a prior."""

MOST_PARAMETERS = 6
"""Number of parameters in a corner plot of the most informative pairs."""

MOST_STEPS = 1000
"""Largest number of steps shown in a trace."""

FEWEST_DRAWS_FOR_CONTOURS = 400
"""Smallest number of draws for contours in the corner plot; fewer draws are shown as points."""


def informative(draws: ArrayLike, most: int = MOST_PARAMETERS) -> list[int]:
    """Return the columns of the pairs with the largest rank correlations, the largest first.

    Parameters
    ----------
    draws
        Shape (draws, parameters).
    most
        Largest number of columns.
    """
    import pandas as pd

    values = _thinned(np.asarray(draws, float))
    related = pd.DataFrame(values).corr("spearman").abs().fillna(0.0).to_numpy()
    rows, columns = np.triu_indices(values.shape[1], 1)
    order = np.argsort(-related[rows, columns], kind="stable")
    members = [int(k) for pair in zip(rows[order], columns[order], strict=True) for k in pair]
    return list(dict.fromkeys([*members, *range(values.shape[1])]))[:most]


def corner(result: stored.Drawable, style: Style, every: bool = False) -> Figure:
    """Draw the posterior of the most correlated parameters, or of all: each and every pair, with 50 and 90 % regions.

    Draws are thinned evenly to at most `MOST_DRAWS`. Few draws are shown as points.

    Returns
    -------
    Figure
        Axes named ``corner/row/column``.

    Raises
    ------
    InputError
        If a parameter does not vary, or there are fewer draws than parameters.
    """
    import pandas as pd
    from matplotlib.figure import Figure

    with without("arviz", "corner"):
        import corner as library

    names, labels = stored.sampled_parameters(result)
    draws = _thinned(stored.draws_of(result, "posterior", names))
    shown = list(range(len(names))) if every else informative(draws)
    values, labels = draws[:, shown], [labels[k] for k in shown]
    count, dimension = values.shape
    if count <= dimension:
        raise InputError(f"corner plot: {count} draws of {dimension} parameters, expected more draws")
    still = [label for label, column in zip(labels, values.T, strict=True) if np.ptp(column) == 0]
    if still:
        raise InputError(f"corner plot: {', '.join(still)} does not vary")
    hidden = counted(len(names) - dimension, "less correlated parameter is", "less correlated parameters are")
    note = f"{hidden} not shown:\n'softness-bayes plot --all'" if dimension < len(names) else ""
    contours = count >= FEWEST_DRAWS_FOR_CONTOURS
    tints = [style.tint(style.posterior, strength) for strength in TINTS]
    width = style.page if dimension > 3 else style.column
    figure = Figure(figsize=(width, width))
    figure.subplots(dimension, dimension, squeeze=False)
    library.corner(
        values,
        bins=24,
        range=_ranges(values, 0.05),
        labels=[label.replace(" [", "\n[") for label in labels],
        color=style.posterior,
        smooth=1.0 if contours else None,
        levels=LEVELS,
        plot_density=False,
        plot_datapoints=not contours,
        plot_contours=contours,
        fill_contours=contours,
        max_n_ticks=3 if dimension <= 6 else 2,
        fig=figure,
        contour_kwargs={"linewidths": 0.6},
        contourf_kwargs={"colors": ["white", *tints[::-1]]},
        hist_kwargs={"linewidth": 0.8},
        data_kwargs={"alpha": 0.5},
    )
    _tidy(figure, dimension, width)
    if dimension > 1 and (contours or note):
        _region_legend(figure, tints if contours else (), note, style)
    carry(figure, pd.DataFrame(values, columns=[names[k] for k in shown]))
    return figure


def _region_legend(figure: Figure, tints: Sequence[tuple[float, float, float]], note: str, style: Style) -> None:
    """Draw the legend of the regions and a note in the empty corner."""
    from matplotlib.patches import Patch

    patches = [
        Patch(facecolor=tint, edgecolor=style.posterior, label=f"{100 * level:.0f} % credible region")
        for level, tint in zip(LEVELS, tints, strict=False)
    ]
    legend = figure.legend(handles=patches, loc="upper right", title=note or None, alignment="left")
    legend.get_title().set_fontsize(style.small)


def _tidy(figure: Figure, dimension: int, width: float) -> None:
    """Adjust the margins, ticks and labels of the corner package to a page; its defaults suit wide panels."""
    from matplotlib.ticker import FixedLocator, MaxNLocator

    margin, gap = 0.64, 0.05  # in
    panel = (width - margin - 0.1) / dimension
    figure.subplots_adjust(
        left=margin / width,
        bottom=margin / width,
        right=1 - 0.1 / width,
        top=1 - 0.1 / width,
        wspace=gap / (panel - gap),
        hspace=gap / (panel - gap),
    )
    for place, axes in enumerate(figure.axes):
        row, column = divmod(place, dimension)
        axes.set_gid(f"corner/{row}/{column}")
        axes.tick_params(length=2, labelrotation=45)
        for axis in (axes.xaxis, axes.yaxis) if column < row else (axes.xaxis,) if column == row else ():
            low, high = axis.get_view_interval()
            ticks = np.asarray(MaxNLocator(4 if dimension <= 6 else 3).tick_values(low, high))
            away = 0.1 * (high - low)  # distance from the corners, where the tick labels of two panels meet
            axis.set_major_locator(FixedLocator(ticks[(ticks > low + away) & (ticks < high - away)].tolist()))
        axes.xaxis.set_label_coords(0.5, -0.32 / panel)
        axes.yaxis.set_label_coords(-0.32 / panel, 0.5)


def _ranges(values: Array, beyond: float) -> list[tuple[float, float]]:
    """Return limits around the central 99.8 % of each column, so that outlying draws do not compress a panel.

    The range is extended by the fraction `beyond`.
    """
    low, high = np.quantile(values, [0.001, 0.999], axis=0)
    low, high = np.where(high > low, low, values.min(0)), np.where(high > low, high, values.max(0))
    return [(float(a - beyond * (b - a)), float(b + beyond * (b - a))) for a, b in zip(low, high, strict=True)]


def prior(result: stored.Drawable, style: Style) -> Figure:
    """Draw prior and posterior density of each parameter.

    The prior density is that of the declared distribution, or else a histogram of the prior draws.

    Returns
    -------
    Figure
        Artists named ``posterior/k`` (a step patch) and ``prior/k`` (a line, or a step patch of draws), k the column.
    """
    from softness_bayes.base.laws import Truncated
    from softness_bayes.checking.provenance import Provenance
    from softness_bayes.parameters.declared import EVERY_PARAMETER

    names, labels = stored.sampled_parameters(result)
    after, before = (stored.draws_of(result, group, names) for group in ("posterior", "prior"))
    declared = Provenance(result.tree.attrs).priors
    grid = make_panels(len(labels), style, 1.1, ylabel="density")
    for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
        name = names[place]
        known = name in declared
        law = Truncated(declared[name], -np.inf, EVERY_PARAMETER[name].largest) if known else None
        _draw_steps(axes, after[:, place], f"posterior/{place}", fill=True, color=style.tint(style.posterior, 0.5))
        # a wide prior may be cut outside its central 90 %, so that the posterior remains visible
        (low, high), (least, most) = (
            _ranges(after[:, [place]], 0.05)[0],
            np.quantile(before[:, place], _SHOWN) if law is None else law.quantile(np.array(_SHOWN)),
        )
        if most > least:
            axes.set_xlim(min(low, least), max(high, most))
        if law is None:
            _draw_steps(axes, before[:, place], f"prior/{place}", color=style.prior)
        else:
            x = np.linspace(*axes.get_xlim(), POINTS)
            line = axes.plot(x, np.exp(law.log_density(x)), color=style.prior, linewidth=0.9)[0]
            line.set(gid=f"prior/{place}", label="prior")
        axes.set(xlabel=label, yticks=(), ylim=(0.0, None))
    return grid.with_legend()


def _draw_steps(axes: Axes, values: Array, gid: str, **look: Any) -> None:
    """Draw the density of draws over their central 99.8 %, normalised by all draws, in steps."""
    ((low, high),) = _ranges(values[:, None], 0.0)
    if low == high:  # one draw, or a parameter that does not vary
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    edges = np.linspace(low, high, int(np.clip(2.0 * values.size ** (1 / 3), 10, 40)) + 1)
    height = np.histogram(values, edges)[0] / (values.size * np.diff(edges))
    axes.stairs(height, edges, label=gid.partition("/")[0], **look).set_gid(gid)


def _thinned(values: Array) -> Array:
    return values[np.linspace(0, len(values) - 1, min(len(values), MOST_DRAWS)).round().astype(int)]


def trace(result: stored.Drawable, style: Style) -> Figure:
    """Draw the trace of each ensemble: median, 5 % and 95 % quantiles of its walkers at every stored step.

    Returns
    -------
    Figure
        Lines named ``median/k/ensemble``, ``low/k/ensemble`` and ``high/k/ensemble``, k the parameter.
    """
    names, labels = stored.sampled_parameters(result)
    walkers, members = stored.walkers_of(result, names)
    steps = np.unique(np.linspace(0, walkers.shape[1] - 1, MOST_STEPS).round().astype(int))
    grid = make_panels(len(labels), style, 0.85, 2, xlabel="kept step", sharex=True)
    for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
        for turn, name in enumerate(np.unique(members)):
            course = np.quantile(walkers[members == name][:, steps, place], [0.05, 0.5, 0.95], axis=0)
            colour = style.ensembles[turn % len(style.ensembles)]
            for kind, values, width in zip(("low", "median", "high"), course, (0.4, 0.9, 0.4), strict=True):
                line = axes.plot(steps, values, color=colour, linewidth=width)[0]
                line.set_gid(f"{kind}/{place}/{name}")
                line.set_label(f"ensemble {name}" if kind == "median" else None)
        axes.set(ylabel=label, xlim=(0, max(1, steps[-1])))
    return grid.with_legend()


def rank(result: stored.Drawable, style: Style) -> Figure:
    """Draw rank histograms of each ensemble's draws among all draws; they are flat if the ensembles agree.

    Returns
    -------
    Figure
        Step patches around 1 named ``rank/k/ensemble``, k the parameter.
    """
    names, labels = stored.sampled_parameters(result)
    walkers, members = stored.walkers_of(result, names)
    edges = np.linspace(0.0, 1.0, 21)
    grid = make_panels(len(labels), style, 1.0, 4, "rank / draws [–]", "density [–]", sharex=True, sharey=True)
    for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
        flat = walkers[..., place].ravel()
        rank = np.empty(flat.size)
        rank[np.argsort(flat, kind="stable")] = (np.arange(flat.size) + 0.5) / flat.size
        places = rank.reshape(walkers.shape[:2])
        axes.axhline(1.0, color=style.prior, linewidth=0.6)
        for turn, name in enumerate(np.unique(members)):
            height, _ = np.histogram(places[members == name], edges, density=True)
            colour = style.ensembles[turn % len(style.ensembles)]
            steps = axes.stairs(height, edges, baseline=None, color=colour, label=f"ensemble {name}")
            steps.set_gid(f"rank/{place}/{name}")
        axes.set_title(label)
        axes.set(xlim=(0, 1), xticks=(0, 0.5, 1))
    grid.panels[0].set_ylim(0.0, None)  # limits of the shared axis, set after everything is drawn
    return grid.with_legend()
