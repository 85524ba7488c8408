"""People's own means of a finished run, and what keeps its chain from speaking of other cloth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Fabrics
from softness_bayes.files.run_files import FABRIC_RATINGS, RULER
from softness_bayes.people.free_means import FreeMeans, free_means
from softness_bayes.results.fitted import experiment_of, options_of, rated_among
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load
from softness_bayes.touch.load_groups import groups_of

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

KEPT = 0.9
"""Share of what people's own means predict; a chain that keeps less for certain does not follow the ratings."""


def people_of(result: Stored) -> FreeMeans | None:
    """Return people's own means of the ratings of a run; None for a custom scale."""
    options = options_of(result)
    return None if options.scale.model is not None else free_means(experiment_of(result).ratings, options)


def conditions_of(result: Stored, people: FreeMeans, fabrics: Fabrics, load: Load) -> IntArray:
    """Return the index of people's mean of each fabric under a load, -1 for those that they did not rate."""
    found = np.full(len(fabrics), -1)
    if load not in result.loads:
        return found
    group = groups_of(result.loads).of[result.loads.index(load)]
    at = {fabric: c for c, (fabric, where) in enumerate(zip(people.fabric, people.load, strict=True)) if where == group}
    return np.array([at.get(k, -1) for k in rated_among(result, fabrics)], np.intp)


def beside(result: Stored, people: FreeMeans | None, fabrics: Fabrics, load: Load) -> dict[str, Array]:
    """Return people's own mean of each fabric under a load with its 90 % limits, by column; NaN where there is none."""
    names = ("people_low", "people", "people_high")
    found = dict.fromkeys(names, np.full(len(fabrics), np.nan))
    if people is None:
        return found
    at = conditions_of(result, people, fabrics, load)
    limits = np.quantile(people.rating, (0.05, 0.5, 0.95), axis=0)
    if not people.noise_known:
        limits[[0, 2]] = np.nan
    return {name: np.where(at >= 0, values[at], np.nan) for name, values in zip(names, limits, strict=True)}


def p_higher_among(people: FreeMeans | None, at: IntArray) -> Array:
    """Return the probability of each order by people's own means, (fabrics, fabrics); NaN for pairs not both rated."""
    found = np.full((at.size, at.size), np.nan)
    here = np.flatnonzero(at >= 0)
    if people is not None and people.noise_known and here.size:
        found[np.ix_(here, here)] = people.p_higher(at[here])
    return found


def rejected(result: Stored) -> bool:
    """Return whether the chain of a run does not follow its ratings: its ruler is below `KEPT` for certain."""
    return RULER in result.tables and bool(result.tables[RULER]["high"]["share"] < KEPT)


def cautions(result: Stored, fabrics: Fabrics | None) -> list[str]:
    """Return why predictions of a run should not be carried to some fabrics: simulated ratings, or a rising scale.

    Fabrics are None if they are not known yet; nothing is said of those that were rated.
    """
    if fabrics is not None and (rated_among(result, fabrics) >= 0).all():
        return []
    said = []
    if result.provenance.rating_data.simulated:
        said.append("the ratings of this run were simulated: nobody rated them, and they say nothing about real cloth")
    table = result.tables[FABRIC_RATINGS]
    trend = [
        rows["e_fab_kpa"].rank().corr(rows["rated"].rank()) for _, rows in table.groupby(level="load") if len(rows) > 2
    ]
    if trend and np.mean(trend) > 0 and "hard" not in result.provenance.rating_data.rating_column.casefold():
        said.append("in this run stiffer fabrics were rated higher, which is not what softness means for cloth")
    return said
