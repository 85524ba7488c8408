"""Information that a rating of each candidate touch would give, against its modulus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softness_bayes.plotting.panels import MODULUS_LABEL, legend_below, make_panels, number_ticks
from softness_bayes.plotting.style import USUAL, Style, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@styled
def gain_figure(gains: pd.DataFrame, about: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw the information of each candidate against its modulus, a panel for each load.

    Behind it is the expected response, whose axis is on the right.

    Parameters
    ----------
    gains
        Table of `Plan.gains`.
    about
        What is to be learnt.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``gain/LOAD`` (all candidates), ``owned/LOAD`` (those that the experiment has), ``chosen/LOAD``
        and ``response/LOAD`` (90 % band).
    """
    loads = [
        (f"{row.indentation_mm:g} mm" if np.isfinite(row.indentation_mm) else f"{row.force_n:g} N", part)
        for (_, part) in gains.sort_values("e_fab_kpa").groupby(["indentation_mm", "force_n"], dropna=False)
        for row in [part.iloc[0]]
    ]
    grid = make_panels(
        len(loads),
        style,
        2.2,
        min(4, len(loads)),
        MODULUS_LABEL,
        f"information on {', '.join(about)} [nats]",
        sharey=True,
    )
    low, high = gains["response_low"].min(), gains["response_high"].max()
    behind = [axes.twinx() for axes in grid.panels]
    for axes, back, (load, part) in zip(grid.panels, behind, loads, strict=True):
        x = part["e_fab_kpa"]
        band = back.fill_between(x, part["response_low"], part["response_high"], gid=f"response/{load}", linewidth=0)
        band.set(color=style.tint(style.prior, 0.3), label="expected response, 90 % credible")
        back.set_ylim(low, high + 1e-9)
        back.tick_params(right=False, labelright=False)
        axes.set_zorder(back.get_zorder() + 1)
        axes.patch.set_visible(False)
        axes.plot(x, part["gain_nats"], color=style.posterior, linewidth=1.0, gid=f"gain/{load}", label="information")
        for what, some, mark, size in (("owned", ~part["to_obtain"], "o", 3), ("chosen", part["chosen"] > 0, "D", 5)):
            look: Any = {"markersize": size, "color": style.data if what == "chosen" else style.absent}
            axes.plot(x[some], part["gain_nats"][some], mark, gid=f"{what}/{load}", label=what, **look)
        axes.set(xscale="log", title=load, ylim=(0.0, None))
        number_ticks(axes.xaxis, narrow=True)
    behind[-1].tick_params(right=True, labelright=True)
    behind[-1].set_ylabel("response")
    behind[-1].spines["right"].set_visible(True)
    legend_below(grid.figure, [*grid.panels, *behind])
    return grid.figure
