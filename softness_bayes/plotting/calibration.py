"""Calibration: departures of the ranks of true values from uniformity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.checking.calibration import Calibration
from softness_bayes.checking.uniformity import simultaneous_band
from softness_bayes.errors import InputError
from softness_bayes.plotting.panels import free_panels
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST_TITLE = 20
"""Number of characters of a quantity's name that fit into one line above its panel."""


def rank_ecdf_figure(ranks: ArrayLike, draws: int, labels: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw the empirical distribution function of each quantity's ranks minus the uniform one, with limits.

    The limits are those of the verdict: if a curve leaves its band, the verdict reports ranks that are not uniform.
    The title of the panel then names the fault, such as intervals of the wrong width.

    Parameters
    ----------
    ranks
        Ranks from 0 to `draws`, shape (replicates, quantities).
    draws
        Number of posterior draws among which each true value was ranked.
    labels
        Names of the quantities.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Lines named ``ecdf/k`` and bands named ``band/k``, k the column.

    Raises
    ------
    InputError
        If labels and ranks disagree, or a rank lies outside its range.
    """
    ranks = np.asarray(ranks)
    if ranks.ndim != 2 or ranks.shape[1] != len(labels) or not len(ranks):
        raise InputError(f"calibration figure: ranks of shape {ranks.shape} for {len(labels)} quantities")
    if ranks.min() < 0 or ranks.max() > draws:
        raise InputError(f"calibration figure: ranks from {ranks.min()} to {ranks.max()}, expected 0 to {draws}")
    calibration = Calibration(tuple(labels), ranks, draws)
    points, faults = calibration.points, calibration.fault_of()
    band = simultaneous_band(len(ranks), points, 1.0 - calibration.threshold)
    with style.applied():
        grid = free_panels(len(labels), style, columns=4, height=1.2)
        for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
            share = (ranks[:, place, None] < np.arange(1, draws + 1)).mean(axis=0)
            area = axes.fill_between(
                points, band.low - points, band.high - points, step="mid", color=style.tint(style.prior, 0.4), lw=0
            )
            area.set_gid(f"band/{place}")
            axes.plot(points, share - points, color=style.posterior, drawstyle="steps-mid")[0].set_gid(f"ecdf/{place}")
            name = label if len(label) <= LONGEST_TITLE else label.replace("[", "\n[", 1)
            said = f"{name}: {faults[label].partition(':')[0]}" if label in faults else name
            axes.set(title=said, xlim=(0, 1), xlabel="rank / draws")
        for axes in grid.leftmost:
            axes.set_ylabel("ECDF − uniform")
    return grid.figure
