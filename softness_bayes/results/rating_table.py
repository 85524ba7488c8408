"""Predicted ratings as table columns: typical rater, new rater, and mean of several raters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.data import Fabrics
from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.likelihood.design import IndexArray
from softness_bayes.ranges import PANEL
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.reasons import reasons
from softness_bayes.results.stored import Stored
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

LIMITS = {"_low": 0.05, "_low_50": 0.25, "": 0.5, "_high_50": 0.75, "_high": 0.95}
"""Quantiles by suffix of the column."""


ROOM = 2_000_000
"""Largest number of draws × touches predicted at once; some twenty arrays of this size exist then."""


def parts_of(fabrics: Fabrics, loads: int, draws: int = ANSWER_DRAWS) -> list[Fabrics]:
    """Return the fabrics in parts that are predicted one after the other, so that memory does not grow with them.

    Parameters
    ----------
    fabrics
        The fabrics.
    loads
        Number of loads under which each is touched.
    draws
        Number of posterior draws.
    """
    size = max(1, ROOM // (draws * max(loads, 1)))
    if len(fabrics) <= size:
        return [fabrics]
    return [fabrics.take(fabrics.names[first : first + size]) for first in range(0, len(fabrics), size)]


def joined(tables: Sequence[pd.DataFrame], loads: int) -> pd.DataFrame:
    """Return the tables of parts of the fabrics as one, with all fabrics under the first load before the second."""
    import pandas as pd

    load = np.concatenate([np.arange(len(table)) // (len(table) // loads) for table in tables])
    return pd.concat(tables).iloc[np.argsort(load, kind="stable")].reset_index(drop=True)


def rating_columns(
    result: Stored,
    fabrics: Fabrics,
    scene: Scene,
    draws: int = ANSWER_DRAWS,
    raters: int | None = None,
    seed: int = 0,
    values: Mapping[str, float] | None = None,
) -> pd.DataFrame:
    """Return the predicted ratings of every condition of a scene, with reasons for unusual predictions.

    Parameters
    ----------
    result
        A finished run on ratings.
    fabrics, scene
        The fabrics, and the scene of all of them under some loads.
    draws
        Number of posterior draws for medians and limits.
    raters
        Number of new raters whose mean rating is predicted; by default the number of raters in the data.
    seed
        Seed of quantities drawn given the posterior draws.
    values
        Values of parameters used instead of the draws, as for `fitted.drawn_values`.

    Returns
    -------
    DataFrame
        A row per condition: typical_rating, new_rater_rating and mean_rating, each with the limits of its 50 % and
        90 % intervals beside it; raters; the fields of `reasons.Reasons`.

    Raises
    ------
    InputError
        If the number of raters is out of range, or the result is incomplete.
    """
    import pandas as pd

    fitted, rng = Fitted(result, draws, values), np.random.default_rng(seed)
    panel = fitted.posterior.observation.raters if raters is None else raters
    PANEL.require("raters", panel)
    modulus = fitted.modulus(rng, fabrics)
    found = fitted.touches(fabrics, scene).ratings(rng, fitted.theta, panel, modulus)
    new = found.new.reshape(-1, scene.n_conditions)
    columns: dict[str, ArrayLike] = {}
    for name, drawn in (("typical_rating", found.typical), ("new_rater_rating", new), ("mean_rating", found.mean)):
        columns |= {f"{name}{end}": limit for end, limit in limits(drawn, found.alike).items()}
    columns["raters"] = np.full(scene.n_conditions, panel)
    return pd.DataFrame(columns | reasons(fitted, scene, found.rate, modulus)._asdict())


def limits(values: Array, alike: IndexArray | None = None) -> dict[str, Array]:
    """Return the quantiles of draws (draws, columns) by the suffixes of `LIMITS`.

    Parameters
    ----------
    values
        The draws.
    alike
        Group index of each column, shape (columns,), if columns of a group are draws of the same quantity; their draws
        are pooled to give common limits.
    """
    levels = list(LIMITS.values())
    found = np.quantile(values, levels, axis=0)
    if alike is not None:
        for group in np.flatnonzero(np.bincount(alike) > 1):
            found[:, alike == group] = np.quantile(values[:, alike == group], levels)[:, None]
    return dict(zip(LIMITS, found, strict=True))
