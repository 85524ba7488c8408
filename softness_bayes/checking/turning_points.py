"""Table of turning points of the response: probabilities and positions, with Monte-Carlo errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.inflection import CurveShape, Inflection
from softness_bayes.sampler.precision import Estimate, quantile, share

if TYPE_CHECKING:
    import pandas as pd

PERCENTS = (0.05, 0.5, 0.95)
"""Lower limit, median and upper limit of turning points in tables."""

PLACES = {"e_fab_kpa": ("modulus", 1e-3), "ratio": ("ratio", 1.0), "force_n": ("force", 1.0), "drop": ("drop", 1.0)}
"""Field of `Inflection`, and conversion factor to the unit of the column, by column."""


def turning_table(
    draws: Inflection,
    loads: Sequence[str],
    prior: Inflection | None = None,
    ensemble: NDArray[Any] | None = None,
) -> pd.DataFrame:
    """Return the table of turning points, one row per load, with the columns of `Result.inflection`.

    Parameters
    ----------
    draws
        Turning points of posterior draws, with fields of shape (chains, draws, loads).
    loads
        Names of the loads.
    prior
        Turning points of independent prior draws, likewise; None if there are none.
    ensemble
        Ensemble of every chain, in order and with equal numbers of chains; None for a single one.
    """
    import pandas as pd

    rows = []
    for k, load in enumerate(loads):
        outcome = _walks(draws.outcome[..., k], ensemble)
        found = {f"p_{kind.name.lower()}": share(outcome == kind) for kind in CurveShape}
        before = Estimate(np.nan, np.nan)
        if prior is not None:
            before = share(prior.outcome[..., k].reshape(1, 1, -1) == CurveShape.INTERIOR)
        found |= {"prior_p_interior": before, "p_inside": share(_walks(draws.inside[..., k], ensemble))}
        for name, (field, factor) in PLACES.items():
            walks = factor * _walks(getattr(draws, field)[..., k], ensemble)
            columns = zip((f"{name}_low", name, f"{name}_high"), PERCENTS, strict=True)
            found |= {column: quantile(walks, probability) for column, probability in columns}
        errors = {f"{name}_mcse": one.error for name, one in found.items()}
        rows.append({"load": load, **{name: one.value for name, one in found.items()}, **errors})
    return pd.DataFrame(rows).set_index("load")


def with_errors(table: pd.DataFrame, columns: Sequence[str]) -> pd.DataFrame:
    """Return some columns of a `turning_table` as text, each number with its Monte-Carlo standard error.

    A number without an error comes from too few or constant draws and is left out.
    """
    import pandas as pd

    return pd.DataFrame(
        {
            name: [
                f"{value:.3g} ± {error:.1g}" if np.isfinite(value) and error > 0 else "–"
                for value, error in zip(table[name], table[f"{name}_mcse"], strict=True)
            ]
            for name in columns
        },
        table.index,
    )


def _walks(values: NDArray[Any], ensemble: NDArray[Any] | None = None) -> NDArray[Any]:
    """Rearrange draws (chains, draws) as (ensembles, draws, walkers)."""
    count = 1 if ensemble is None else np.unique(ensemble).size
    return np.swapaxes(values.reshape(count, -1, values.shape[-1]), 1, 2)
