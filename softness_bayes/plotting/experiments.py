"""Information that a rating of each candidate touch would give, against its modulus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.plotting.style import USUAL, Style, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@styled
def gain_figure(gains: pd.DataFrame, about: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw the information of each candidate against its modulus, a panel for each load.

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
        Artists named ``gain/LOAD`` (all candidates), ``owned/LOAD`` (those that the experiment has) and
        ``chosen/LOAD``.
    """
    from matplotlib.figure import Figure

    loads = [
        (f"{row.indentation_mm:g} mm" if np.isfinite(row.indentation_mm) else f"{row.force_n:g} N", part)
        for (_, part) in gains.groupby(["indentation_mm", "force_n"], sort=False, dropna=False)
        for row in [part.iloc[0]]
    ]
    figure = Figure(figsize=(style.page, 2.6), layout="constrained")
    every = figure.subplots(1, len(loads), sharey=True, squeeze=False)[0]
    for axes, (load, part) in zip(every, loads, strict=True):
        line = part.sort_values("e_fab_kpa")
        axes.plot(line["e_fab_kpa"], line["gain_nats"], color=style.posterior, linewidth=1.0, gid=f"gain/{load}")
        owned, chosen = part[~part["to_obtain"]], part[part["chosen"] > 0]
        axes.plot(owned["e_fab_kpa"], owned["gain_nats"], "o", color=style.absent, markersize=3, gid=f"owned/{load}")
        axes.plot(
            chosen["e_fab_kpa"], chosen["gain_nats"], "D", color=style.posterior, markersize=5, gid=f"chosen/{load}"
        )
        axes.set(xscale="log", title=load, xlabel="E_fab [kPa]")
    every[0].set_ylabel(f"information on {', '.join(about)} [nats]")
    every[0].set_ylim(bottom=0.0)
    return figure
