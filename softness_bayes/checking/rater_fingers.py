"""Posterior of individual fingers and answers compared with the population, from the groups of a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.own_effects import EFFECT_OF_ANSWER, OWN_ANSWERS
from softness_bayes.likelihood.ratings import SKIN
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.touch.finger_grid import EFFECT_OF, SPREAD_OF

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

PROBABILITY = 0.9
"""Share of the draws within the limits."""

POPULATION = "population"
"""Row of the table for a rater drawn from the population."""


def finger_table(tree: xr.DataTree) -> pd.DataFrame | None:
    """Return the posterior of each rater's finger; None if all raters have the typical one.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        For each quantity that differs between raters a row for the population (a finger drawn from it) and one for
        each rater: participant and quantity (index); median, low and high (90 % limits) in the quantity's unit;
        ratio, the rater's median over that of the typical finger; and pressed, whether plate forces on this rater's
        finger also inform the quantity.
    """
    return _table(tree, EFFECT_OF, SPREAD_OF)


def answer_table(tree: xr.DataTree) -> pd.DataFrame | None:
    """Return the posterior of each rater's exponent and noise; None if all raters have the typical ones.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        As for `finger_table`, for gamma and varsigma, without `pressed`.
    """
    table = _table(tree, EFFECT_OF_ANSWER, OWN_ANSWERS)
    return None if table is None else table.drop(columns="pressed")


def _table(tree: xr.DataTree, effects: Mapping[str, str], spreads: Mapping[str, str]) -> pd.DataFrame | None:
    import pandas as pd

    posterior = tree["posterior"].to_dataset()
    names = [name for name, effect in effects.items() if effect in posterior]
    if not names:
        return None
    people, rows = posterior["participant"].values.astype(str), []
    fingers = posterior["finger"].values.astype(str).tolist() if "finger" in posterior.coords else []
    rng = np.random.default_rng(0)
    for name in names:
        typical = _drawn(tree, posterior, name)
        spread = _drawn(tree, posterior, spreads[name])
        anyone = spread * rng.standard_normal(np.broadcast_shapes(typical.shape, spread.shape))
        own = posterior[effects[name]].values.reshape(-1, people.size)
        columns = {POPULATION: anyone, **dict(zip(people.tolist(), own.T, strict=True))}
        pressed = set(fingers) if name in SKIN else set()
        rows += [{**_row(who, name, typical, own), "pressed": who in pressed} for who, own in columns.items()]
    return pd.DataFrame(rows).set_index(["participant", "quantity"])


def _drawn(tree: xr.DataTree, posterior: xr.Dataset, name: str) -> Array:
    held = tree["constant_data"].to_dataset()
    return np.ravel(posterior[name].values if name in posterior else held[name].values).astype(float)


def _row(who: str, name: str, typical: Array, deviation: Array) -> dict[str, Any]:
    # only m deviates in its own unit, all others in the logarithm
    value = np.maximum(typical + deviation, 0.0) if name == "m" else typical * np.exp(deviation)
    tail = 0.5 * (1.0 - PROBABILITY)
    low, median, high = np.quantile(value, [tail, 0.5, 1.0 - tail]).tolist()
    middle = float(np.median(typical))
    ratio = median / middle if middle > 0 else np.nan
    return {"participant": who, "quantity": name, "median": median, "low": low, "high": high, "ratio": ratio}


def finger_sentences(table: pd.DataFrame) -> list[str]:
    """Describe how much raters' fingers or answers differ, without names, which a report may hide.

    Parameters
    ----------
    table
        From `finger_table` or `answer_table`.
    """
    said = []
    for name, part in table.groupby(level="quantity", sort=False):
        rows = part.droplevel("quantity")
        anyone, raters = rows.loc[POPULATION], rows.drop(POPULATION)
        unit = PARAMETERS[str(name)].unit
        median = raters["median"]
        said.append(
            f"{name} of single raters: medians from {median.min():.3g} to "
            f"{median.max():.3g}{'' if unit == '–' else f' {unit}'}; 90 % of new raters lie between "
            f"{anyone['low']:.3g} and {anyone['high']:.3g}{_of_forces(raters)}"
        )
    return said


def _of_forces(raters: pd.DataFrame) -> str:
    # results of earlier versions have no such column
    pressed = int(raters["pressed"].sum()) if "pressed" in raters else 0
    return f"; plate forces are available for {pressed} of {len(raters)} raters" if pressed else ""
