"""The ensembles of a run: traces, and agreement of their ranks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.plotting.panels import Array, check_draws, free_panels, legend_below
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_STEPS = 1000
"""Largest number of steps shown in a trace."""


def trace_figure(draws: ArrayLike, ensemble: ArrayLike, labels: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw the trace of each ensemble: median, 5 % and 95 % quantiles of its walkers at every stored step.

    Parameters
    ----------
    draws
        Draws of the walkers of all ensembles, shape (walkers, steps, parameters).
    ensemble
        Index of each walker's ensemble, shape (walkers,).
    labels
        Symbol and unit of each parameter.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Lines named ``median/k/ensemble``, ``low/k/ensemble`` and ``high/k/ensemble``, k the parameter.

    Raises
    ------
    InputError
        If the shapes disagree or a draw is not finite.
    """
    walkers, members = _walkers(draws, ensemble, labels)
    steps = np.unique(np.linspace(0, walkers.shape[1] - 1, MOST_STEPS).round().astype(int))
    with style.applied():
        grid = free_panels(len(labels), style, columns=2, height=0.85, sharex=True)
        for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
            for turn, name in enumerate(np.unique(members)):
                course = np.quantile(walkers[members == name][:, steps, place], [0.05, 0.5, 0.95], axis=0)
                colour = style.ensembles[turn % len(style.ensembles)]
                for kind, values, width in zip(("low", "median", "high"), course, (0.4, 0.9, 0.4), strict=True):
                    line = axes.plot(steps, values, color=colour, linewidth=width)[0]
                    line.set_gid(f"{kind}/{place}/{name}")
                    line.set_label(f"ensemble {name}" if kind == "median" else None)
            axes.set(ylabel=label, xlim=(0, max(1, steps[-1])))
        for axes in grid.lowest:
            axes.set_xlabel("kept step")
            axes.xaxis.set_tick_params(labelbottom=True)
        legend_below(grid.figure, grid.panels)
    return grid.figure


def rank_figure(
    draws: ArrayLike, ensemble: ArrayLike, labels: Sequence[str], *, bins: int = 20, style: Style = USUAL
) -> Figure:
    """Draw rank histograms of each ensemble's draws among all draws; they are flat if the ensembles agree.

    Parameters, artists (``rank/k/ensemble``, step patches around 1) and errors as in `trace_figure`.
    """
    walkers, members = _walkers(draws, ensemble, labels)
    edges = np.linspace(0.0, 1.0, bins + 1)
    with style.applied():
        grid = free_panels(len(labels), style, columns=4, height=1.0, sharex=True, sharey=True)
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
        for axes in grid.leftmost:
            axes.set_ylabel("density [–]")
        for axes in grid.lowest:
            axes.set_xlabel("rank / draws [–]")
            axes.xaxis.set_tick_params(labelbottom=True)
        legend_below(grid.figure, grid.panels)
    return grid.figure


def _walkers(draws: ArrayLike, ensemble: ArrayLike, labels: Sequence[str]) -> tuple[Array, NDArray[Any]]:
    walkers, members = np.asarray(draws, float), np.asarray(ensemble)
    if walkers.ndim != 3 or members.shape != walkers.shape[:1]:
        raise InputError(f"figure: draws of shape {walkers.shape} for {members.size} walkers")
    check_draws(walkers.reshape(-1, walkers.shape[-1]), labels)
    return walkers, members
