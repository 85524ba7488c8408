"""The table of what was learnt about each quantity, and how accurately."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.inference.diagnostics import ess_tail, r_hat_between

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]


def summarise(names: Sequence[str], values: FloatArray, hdi_probability: float = 0.9) -> pd.DataFrame:
    """Mean, spread, interval and Monte-Carlo accuracy of each quantity, unrounded.

    Bulk ESS and Monte-Carlo errors take every walker as a chain, tail ESS comes from autocorrelation
    times of tail indicators, and R-hat compares the ensembles.

    Parameters
    ----------
    names
        Quantities, one row each.
    values
        Their draws after the burn-in, shape (ensembles, draws, walkers, quantities).
    hdi_probability
        Probability within the shortest interval.
    """
    import pandas as pd

    walks = np.moveaxis(values, -1, 1)
    tails, r_hats = ess_tail(walks), r_hat_between(walks)
    rows = {}
    for k, name in enumerate(names):
        chains = np.swapaxes(walks[:, k], 1, 2).reshape(-1, walks.shape[2])
        low, high = arviz_bridge.hdi(chains, hdi_probability)
        rows[name] = {
            "mean": chains.mean(),
            "sd": chains.std(ddof=1),
            "hdi_low": low,
            "hdi_high": high,
            "hdi_prob": hdi_probability,
            "ess_bulk": arviz_bridge.ess_bulk(chains),
            "ess_tail": tails[k],
            "r_hat": r_hats[k],
            "mcse_mean": arviz_bridge.mcse_mean(chains),
            "mcse_sd": arviz_bridge.mcse_sd(chains),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")
