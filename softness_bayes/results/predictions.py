"""Predictions of the fitted model beyond the data: response curves, turning points, and data of the figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.agreement import TYPICAL
from softness_bayes.checking.checks import MODULUS_STEP
from softness_bayes.checking.inflection import find_inflection, response_curves, turning_points
from softness_bayes.checking.modulus_errors import directions, posterior_shift, scores, shift_table
from softness_bayes.model.prediction import rates_of_other_moduli
from softness_bayes.results.draws import REWEIGHT_DRAWS, RatedDraws
from softness_bayes.results.groups import Groups, Variable, evenly, merged, named, turning_variables
from softness_bayes.results.pictures import membrane_illustration, touch_illustration
from softness_bayes.results.replicates import Replicates
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

TURNING = 4000
"""Approximate number of draws with stored turning points, the same number for every walker."""

ILLUSTRATED = 64
"""Number of posterior draws whose touches are stored in detail."""

SHIFT_DRAWS = 1000
"""Number of posterior draws from which the shifts are estimated."""

SHIFTED = ("b", "m", "sigma_0", "gamma")
"""Parameters whose shifts are reported, if they are sampled."""


def prediction_group(draws: RatedDraws, grid: Scene, error: float) -> dict[str, Variable]:
    """Return response and rating as functions of E_fab under each shown load, with their turning points.

    Parameters
    ----------
    draws
        The draws of the run.
    grid
        The scene of the curves, from `curve_scene`, under `draws.shown_loads`.
    error
        Numerical error of the response relative to its peak.
    """
    few, scene, ratings = draws.subset(draws.curves), draws.scene, draws.ratings
    curves = response_curves(grid, draws.touch(few.theta))
    fabrics = float(scene.modulus.min()), float(scene.modulus.max())
    turn = find_inflection(curves, error, fabrics)
    shape = curves.total_rate.shape
    everywhere = curves.total_rate.reshape(shape[0], -1) / scene.n_receptors
    drive = ratings.drive_at(everywhere, few.mean_rate, few.parameters)
    lines = {
        "total_rate": (curves.total_rate, "Hz"),
        "typical_rating": (_typical(draws, few, drive.reshape(shape)), ""),
        "e_skin_kpa": (curves.skin_modulus * 1e-3, "kPa"),
        "contact_radius_mm": (curves.radius * 1e3, "mm"),
        "contact_force_n": (curves.force, "N"),
    }
    along = (draws.load_axis, "e_fab_kpa")
    rated = ratings.expected(few.mean_rate, few.parameters, few.effects)
    return {
        TYPICAL: Variable(rated[None], ("condition",)),
        **{n: Variable(v[None].astype(np.float32), along, unit) for n, (v, unit) in lines.items()},
        **turning_variables(turn, (1, -1), draws.load_axis),
        **{f"at_{n}": v for n, v in named(draws.posterior.space, few.theta[None]).items()},
    }


def _typical(draws: RatedDraws, few: Any, drive: Array) -> Array:
    """Return the typical rating for these drives, shape (draws, loads, points)."""
    found = [
        draws.ratings.typical(
            few.mean_rate, few.parameters, few.effects, drive[:, k], np.flatnonzero(draws.scene.load == load)
        )
        for k, load in enumerate(draws.load_groups.at)
    ]
    return np.stack(found, axis=1)


def turning_draws(draws: RatedDraws) -> Array:
    """Return the points theta of the group `inflection`, shape (chains, draws, dimension)."""
    if draws.log_weight is not None:
        return draws.subset(REWEIGHT_DRAWS).theta[None]
    every = -(-draws.theta.shape[0] * draws.theta.shape[1] // int(draws.share * TURNING))
    return draws.theta[:, ::-1][:, ::every][:, ::-1]


def turning_groups(draws: RatedDraws, error: float) -> Groups:
    """Return turning points for many posterior and prior draws; arguments as for `prediction_group`."""
    found: Groups = {}
    loads = draws.shown_loads
    for group, points in {"inflection": turning_draws(draws), "prior_inflection": draws.prior[None]}.items():
        flat = points.reshape(-1, points.shape[-1])
        turn = turning_points(draws.scene, draws.touch(flat), error, loads=loads)
        found[group] = turning_variables(turn, points.shape[:2], draws.load_axis)
    return found


def illustration_groups(draws: RatedDraws, drawn: Replicates, turn: Array) -> tuple[Groups, dict[str, NDArray[Any]]]:
    """Return the data for the figures of touch and membrane, and coordinates of their axes.

    Parameters
    ----------
    draws, drawn
        The draws of the run, and the quantities drawn after it.
    turn
        E_fab at the turning points of the draws with curves [Pa], shape (draws, loads), NaN where there is none.
    """
    touched, fired = (draws.touch(draws.subset(size).theta) for size in (ILLUSTRATED, draws.curves))
    touch, along = touch_illustration(drawn.receptors, draws.scene, touched, turn)
    membrane, currents = membrane_illustration(drawn.trains(), draws.scene, fired)
    return merged(touch, membrane), {**along, **currents}


def modulus_shifts(draws: RatedDraws, inflection: Mapping[str, Variable]) -> pd.DataFrame | None:
    """Return the table of `shift_table` for the skin, the receptors' threshold, gamma and the turning points.

    Parameters
    ----------
    draws
        The draws of the run.
    inflection
        The group `inflection`, at the points of `turning_draws`.

    Returns
    -------
    DataFrame or None
        None if no modulus is taken as exact.
    """
    space, design = draws.posterior.space, draws.ratings.design
    exact = np.setdiff1d(np.arange(design.n_fabrics), () if space.moduli is None else space.moduli.uncertain)
    if not exact.size:
        return None
    points = turning_draws(draws)
    index = evenly(points.shape, int(draws.share * SHIFT_DRAWS))
    theta = points[index]
    signs, share = directions(exact.astype(np.intp), design.n_fabrics)
    rates = rates_of_other_moduli(draws.posterior, theta, MODULUS_STEP)
    score = scores(draws.ratings, rates, draws.posterior.rating_parameters(theta), signs)
    quantities = {name: np.log(np.abs(theta[:, space.names.index(name)])) for name in SHIFTED if name in space.names}
    modulus = inflection["inflection_e_fab_kpa"].values[index]
    for name, where in zip(draws.load_groups.names, modulus.T, strict=True):
        quantities[f"turning point at {name}"] = np.log(where)
    return shift_table([*quantities], [posterior_shift(values, score, share) for values in quantities.values()])
