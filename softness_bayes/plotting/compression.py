"""The force of a rigid plate against indentation, predicted and observed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.errors import InputError
from softness_bayes.plotting.panels import draw_bands, grid_of_panels, legend_below, number_ticks
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def compression_figure(
    indentation: ArrayLike,
    force: ArrayLike,
    observed_indentation: ArrayLike,
    observed_force: ArrayLike,
    finger: ArrayLike,
    *,
    style: Style = USUAL,
) -> Figure:
    """Draw the typical finger's force with credible bands, and the observed forces, on logarithmic axes.

    Parameters
    ----------
    indentation
        Grid of indentations [m], shape (points,).
    force
        Draws of the typical finger's force [N], shape (draws, points).
    observed_indentation, observed_force
        Observed indentations [m] and forces [N], shape (rows,).
    finger
        Index of each row's finger, shape (rows,).
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``median/plate``, ``band95/plate``, ``band50/plate`` and ``finger/k`` (points joined
        in order of indentation); indentation in mm.

    Raises
    ------
    InputError
        If the shapes disagree.
    """
    depth, draws = np.asarray(indentation, float) * 1e3, np.asarray(force, float)
    x, y, member = np.asarray(observed_indentation, float) * 1e3, np.asarray(observed_force, float), np.asarray(finger)
    if draws.shape[1:] != depth.shape or not x.shape == y.shape == member.shape:
        raise InputError(f"compression figure: forces of shape {draws.shape} at {depth.size} indentations")
    with style.applied():
        figure, panels, _ = grid_of_panels(1, "indentation [mm]", "force [N]", style)
        axes = panels[0]
        draw_bands(axes, depth, draws, style.posterior, style, "plate")
        for k in np.unique(member):
            own = np.flatnonzero(member == k)
            own = own[np.argsort(x[own], kind="stable")]
            label = "fingers" if k == member.min() else None
            line = axes.plot(x[own], y[own], "o-", color=style.data, markersize=3, linewidth=0.5, label=label)[0]
            line.set(gid=f"finger/{k}", zorder=3)
        axes.set(xscale="log", yscale="log", xlim=(depth.min(), depth.max()))
        number_ticks(axes.xaxis)
        number_ticks(axes.yaxis)
        legend_below(figure, panels)
    return figure
