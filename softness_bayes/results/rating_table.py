"""Predicted ratings as table columns, with reasons for unusual predictions and people's own means beside them.

Reasons are silence, a contact beyond Hertz's geometry, and fabrics or loads outside the rated range.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.defaults import ANSWER_DRAWS
from softness_bayes.base.files.run_files import FABRIC_RATINGS
from softness_bayes.base.ranges import PANEL
from softness_bayes.base.readable import number, percent
from softness_bayes.checking.layout import PEOPLE_ORDERS
from softness_bayes.data import Fabrics
from softness_bayes.data.ratings import FREE_TOUCH, load_column
from softness_bayes.likelihood.design import IndexArray
from softness_bayes.model.prediction import log_rate_slope, prediction_table
from softness_bayes.parameters.declared import KPA
from softness_bayes.people.free_means import word_of
from softness_bayes.results.fitted import Fitted, rated_among
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.load_groups import groups_of
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

LIMITS = {"_low": 0.05, "_low_50": 0.25, "": 0.5, "_high_50": 0.75, "_high": 0.95}
"""Quantiles by suffix of the column."""


ROOM = 2_000_000
"""Largest number of draws × touches predicted at once; some twenty arrays of this size exist then."""

TOLD_APART = 0.9539
"""sqrt(2) Phi^-1(3/4): difference, in sds of the noise, of two ratings whose order is right three times in four."""

OUT_OF_REACH = 10.0
"""Ratio of moduli beyond which the local slope of the response says nothing."""

NOTICED = 0.05
"""Share of draws above which a remark is made."""

_RISES = 0.5
"""Mean rank correlation of ratings with stiffness above which they clearly rise with it."""

_SAME = 1e-6  # relative difference below which a value is at the end of a range
_HELD = {Indentation: "indentation", Force: "force"}  # field of the contact held constant by a load


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


def predicted(
    fitted: Fitted,
    fabrics: Fabrics,
    loads: tuple[Load, ...],
    raters: int | None = None,
    seed: int = 0,
    compiled: Callable[[Fabrics], Scene] | None = None,
) -> tuple[pd.DataFrame, list[Scene]]:
    """Return the predicted contact, firing and ratings of fabrics under loads, and the scenes of their parts.

    Parameters
    ----------
    fitted
        The model of a finished run on ratings.
    fabrics, loads
        All fabrics are touched under every load.
    raters
        Number of new raters whose mean rating is predicted; by default the number of raters in the data.
    seed
        Seed of quantities drawn given the posterior draws.
    compiled
        Function that returns the scene of some fabrics under these loads; by default `Fitted.scene`.

    Returns
    -------
    DataFrame
        A row per condition, all fabrics under the first load before the second: the columns of `prediction_table`;
        weber_fraction with its 90 % limits, where ratings have an exponent and noise; typical_rating, new_rater_rating
        and mean_rating, each with the limits of its 50 % and 90 % intervals beside it; raters; people_low, people and
        people_high, people's own mean of what they rated; the fields of `Reasons`.
    list of Scene
        The scenes of the parts in which the fabrics were predicted.

    Raises
    ------
    InputError
        If the number of raters is out of range, or the result is incomplete.
    """
    panel = fitted.posterior.observation.raters if raters is None else raters
    PANEL.require("raters", panel)
    tables, scenes = [], []
    for some in parts_of(fabrics, len(loads), len(fitted.theta)):
        scene, rng = fitted.scene(some, loads) if compiled is None else compiled(some), np.random.default_rng(seed)
        modulus = fitted.modulus(rng, some)
        found = fitted.touches(some, scene).ratings(rng, fitted.theta, panel, modulus)
        new = found.new.reshape(-1, scene.n_conditions)
        columns: dict[str, ArrayLike] = {"load": scene.load, **weber_fraction(fitted, scene, found.rate, modulus)}
        for name, drawn in (("typical_rating", found.typical), ("new_rater_rating", new), ("mean_rating", found.mean)):
            columns |= {f"{name}{end}": limit for end, limit in limits(drawn, found.alike).items()}
        own = [beside(fitted.result, some, load) for load in loads]
        columns |= {"raters": np.full(scene.n_conditions, panel)}
        columns |= {name: np.concatenate([one[name] for one in own]) for name in own[0]}
        rated = pd.concat([pd.DataFrame(columns), reasons(fitted, scene, found.rate, modulus)], axis=1)
        tables.append(pd.concat([prediction_table(some, scene, fitted.touch, modulus=modulus), rated], axis=1))
        scenes.append(scene)
    joined = pd.concat(tables).sort_values("load", kind="stable").reset_index(drop=True)
    return joined.drop(columns="load"), scenes


def weber_fraction(fitted: Fitted, scene: Scene, rate: Array, modulus: Array | None) -> dict[str, Array]:
    """Return the smallest relative difference in E_fab that ratings tell, with limits; empty without `gamma`.

    Two ratings by one rater are in the right order with probability 3/4 if the log responses differ by
    sqrt(2) Phi^-1(3/4) varsigma / gamma = 0.954 varsigma / gamma. The slope of the log response turns this into a
    difference in ln E_fab. It is infinite where even a fabric `OUT_OF_REACH` times as stiff would not be told apart.
    """
    known = vars(fitted.posterior.rating_parameters(fitted.theta))
    if not {"gamma", "varsigma", "eps"} <= known.keys():
        return {}
    gamma, varsigma, eps = (np.reshape(known[name], (-1, 1)) for name in ("gamma", "varsigma", "eps"))
    mean = rate / scene.n_receptors
    slope = log_rate_slope(scene, fitted.touch, modulus) * mean / (mean + eps)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = TOLD_APART * varsigma / np.abs(gamma * slope)
    apart = np.where(apart < np.log(OUT_OF_REACH), apart, np.inf)  # NaN is not
    levels = {name: level for name, level in LIMITS.items() if "50" not in name}
    found = np.quantile(np.expm1(apart), [*levels.values()], axis=0, method="closest_observation")
    return {f"weber_fraction{end}": values for end, values in zip(levels, found, strict=True)}


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


def reasons(fitted: Fitted, scene: Scene, rate: Array, modulus: Array | None = None) -> pd.DataFrame:
    """Return the reasons for predictions of the conditions of a scene, a row for each.

    A force is compared with the forces of the rated touches, an indentation with their indentations. If the rated loads
    are of the other kind, medians over the draws are used.

    Parameters
    ----------
    fitted
        The run.
    scene, rate
        The conditions, and their response at the draws, shape (draws, conditions).
    modulus
        E_fab [Pa] of each fabric at each draw; by default that of the scene.

    Returns
    -------
    DataFrame
        Shares of the draws in which no receptor fires (p_silent), and whose contact radius exceeds R/2, where Hertz's
        geometry is questionable (p_beyond_half_radius), or is R or more, where it is invalid (p_beyond_radius);
        "below" or "above" if E_fab (beyond_moduli) or the load (beyond_loads) lies outside the rated range, otherwise
        empty; and all of it as text (remarks).
    """
    touch, rated = fitted.touch, fitted.posterior.scene
    own = fitted.posterior.space.modulus(fitted.theta)
    extent = scene.contact(touch, modulus).radius / scene.fingertip(touch).radius
    asked = scene.modulus if modulus is None else np.median(modulus, axis=0)[scene.fabric]
    known = rated.modulus if own is None else np.median(own, axis=0)
    beyond_moduli, moduli = _beyond(asked / KPA, known / KPA, "kPa")
    contact = rated.contact(touch, own)
    beyond_loads, loads = np.full(scene.n_conditions, "", "U5"), []
    for k, load in enumerate(scene.loads):
        if load == FREE_TOUCH:
            loads.append("")
            continue
        column, kind, value = load_column(load)
        values = np.median(getattr(contact, _HELD[kind]), axis=0) / column.factor
        beyond_loads[scene.load == k], told = _beyond(np.array(value(load) / column.factor), values, column.unit)
        loads.append(told)
    columns = {
        "p_silent": (rate == 0).mean(axis=0),
        "p_beyond_half_radius": (extent > 0.5).mean(axis=0),
        "p_beyond_radius": (extent >= 1.0).mean(axis=0),
        "beyond_moduli": beyond_moduli,
        "beyond_loads": beyond_loads,
    }
    remarks = []
    for at, silent, half, whole, stiff, pressed in zip(scene.load, *columns.values(), strict=True):
        said = [
            f"no receptor fires in {percent(silent)} of the draws" if silent >= NOTICED else "",
            _hertz(half, whole),
            f"E_fab {stiff} the rated range ({moduli})" if stiff else "",
            f"load {pressed} the rated range ({loads[at]})" if pressed else "",
        ]
        remarks.append("; ".join(one for one in said if one))
    return pd.DataFrame({**columns, "remarks": remarks})


def _beyond(values: Array, rated: Array, unit: str) -> tuple[NDArray[np.str_], str]:
    """Return "below" or "above" for values outside the range of rated ones, else an empty text; and the range."""
    low, high = float(rated.min()), float(rated.max())
    side = np.select([values < low * (1.0 - _SAME), values > high * (1.0 + _SAME)], ["below", "above"], "")
    return side, f"{number(low)} to {number(high)} {unit}"


def _hertz(questionable: float, meaningless: float) -> str:
    """Describe the share of draws in which the contact is outside the range of Hertz's theory."""
    if meaningless >= NOTICED:
        return f"contact radius above R, where Hertz's geometry is meaningless, in {percent(meaningless)} of the draws"
    if questionable >= NOTICED:
        return (
            f"contact radius above R/2, where Hertz's geometry is questionable, in {percent(questionable)} of the draws"
        )
    return ""


def beside(result: Stored, fabrics: Fabrics, load: Load) -> dict[str, Array]:
    """Return people's own mean of each fabric under a load with its 90 % limits, by column; NaN where there is none."""
    names, table = ["people_low", "people", "people_high"], result.tables[FABRIC_RATINGS]
    found = dict.fromkeys(names, np.full(len(fabrics), np.nan))
    if load not in result.loads or "people" not in table:
        return found
    groups, among = groups_of(result.loads), rated_among(result, fabrics)
    known = [name if k >= 0 else None for name, k in zip(fabrics.names, among, strict=True)]
    under = table.xs(groups.names[groups.of[result.loads.index(load)]]).reindex(known)
    return {name: under[name].to_numpy(float) for name in names}


def people_orders(result: Stored, fabrics: Fabrics, load: Load) -> Array:
    """Return the probability that people rate each fabric (rows) higher than another (columns) under a load.

    NaN for pairs that they did not rate both.
    """
    found = np.full((len(fabrics), len(fabrics)), np.nan)
    stored, among = result.group("constant_data").get(PEOPLE_ORDERS), rated_among(result, fabrics)
    if stored is not None and load in result.loads:
        here, group = np.flatnonzero(among >= 0), groups_of(result.loads).of[result.loads.index(load)]
        found[np.ix_(here, here)] = stored.values[group][np.ix_(among[here], among[here])]
    return found


def cautions(result: Stored, fabrics: Fabrics | None) -> list[str]:
    """Return why predictions of a run should not be carried to some fabrics: simulated ratings, or a rising scale.

    Fabrics are None if they are not known yet; nothing is said of those that were rated.
    """
    if fabrics is not None and (rated_among(result, fabrics) >= 0).all():
        return []
    said = []
    if result.provenance.rating_data.simulated:
        said.append("the ratings of this run were simulated: nobody rated them, and they say nothing about real cloth")
    if rises_with_stiffness(result):
        said.append("in this run stiffer fabrics were rated higher, which is not what softness means for cloth")
    return said


def rises_with_stiffness(result: Stored) -> bool:
    """Return whether stiffer fabrics were clearly rated higher, on a scale that is not one of hardness."""
    table, data = result.tables[FABRIC_RATINGS], result.provenance.rating_data
    trend = [
        rows["e_fab_kpa"].rank().corr(rows["rated"].rank()) for _, rows in table.groupby(level="load") if len(rows) > 2
    ]
    return bool(trend) and bool(np.mean(trend) > _RISES) and word_of(data.rating_column, result.scale) != "hardest"
