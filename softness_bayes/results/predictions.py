"""Predictions of the fitted model beyond the data: response curves, turning points, and data of the figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.defaults import LIMITS
from softness_bayes.checking.agreement import TYPICAL
from softness_bayes.checking.checks import MODULUS_STEP
from softness_bayes.checking.inflection import find_inflection, response_curves, turning_points
from softness_bayes.checking.modulus_errors import directions, posterior_shift, scores, shift_table
from softness_bayes.model.prediction import rates_of_other_moduli
from softness_bayes.results import draws as of_run
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.neuron.spikes import spike_times
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.profiles import touch_profiles
from softness_bayes.touch.receptors import draw_receptors, kink_distances
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

TURNING = 4000
"""Approximate number of draws with stored turning points, the same number for every walker."""

ILLUSTRATED = 64
"""Number of posterior draws whose touches are stored in detail."""

SHIFT_DRAWS = 1000
"""Number of posterior draws from which the shifts are estimated."""

SHIFTED = ("b", "m", "sigma_0", "gamma")
"""Parameters whose shifts are reported, if they are sampled."""

ILLUSTRATIONS = "illustration_data"
"""Group of a result with quantiles over draws and single examples instead of draws."""

MOST_LOADS = 3
"""Largest number of illustrated loads: the smallest, a middle one and the largest."""

NEAR, FAR, REACH = 97, 8, 1.3
"""Points from the contact's axis to `REACH` radii of the largest contact, where rates fall off steeply, and beyond it
to the pad's farthest corner."""

UNTABLED = Discretisation(nodes=2, field_tolerance=1e-2)
"""Coarse discretisation of a scene whose stress tables are not used."""

CURRENTS = 121
"""Number of points of the rate curves."""

EXCESSES = (0.1, 0.4, 1.0)
"""Currents of the example trains, as shares of the way from the rheobase to the largest current."""

DURATION = 250.0
"""Length of the example trains [ms]."""

TRAIN_TOLERANCE = 1e-5
"""Tolerance of their integration: spikes are within 0.02 ms, which no figure shows."""


def prediction_group(draws: of_run.RatedDraws, grid: Scene, error: float) -> dict[str, of_run.Variable]:
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
    turn = find_inflection(curves, error, (float(scene.modulus.min()), float(scene.modulus.max())))
    everywhere = curves.total_rate.reshape(len(few.theta), -1) / scene.n_receptors
    drive = ratings.drive_at(everywhere, few.mean_rate, few.parameters).reshape(curves.total_rate.shape)
    typical = [
        ratings.typical(
            few.mean_rate, few.parameters, few.effects, drive[:, k], np.flatnonzero(draws.scene.load == load)
        )
        for k, load in enumerate(draws.load_groups.at)
    ]
    lines = {
        "total_rate": (curves.total_rate, "Hz"),
        "typical_rating": (draws.scale.filed(np.stack(typical, axis=1)), ""),
        "e_skin_kpa": (curves.skin_modulus * 1e-3, "kPa"),
        "contact_radius_mm": (curves.radius * 1e3, "mm"),
        "contact_force_n": (curves.force, "N"),
    }
    along = (draws.load_axis, "e_fab_kpa")
    rated = draws.scale.filed(ratings.expected(few.mean_rate, few.parameters, few.effects))
    return {
        TYPICAL: of_run.Variable(rated[None], ("condition",)),
        **{n: of_run.Variable(v[None].astype(np.float32), along, unit) for n, (v, unit) in lines.items()},
        **of_run.turning_variables(turn, (1, -1), draws.load_axis),
        **{f"at_{n}": v for n, v in of_run.named(draws.posterior.space, few.theta[None]).items()},
    }


def turning_draws(draws: of_run.RatedDraws) -> Array:
    """Return the points theta of the group `inflection`, shape (chains, draws, dimension)."""
    if draws.log_weight is not None:
        return draws.subset(of_run.REWEIGHT_DRAWS).theta[None]
    every = -(-draws.theta.shape[0] * draws.theta.shape[1] // int(draws.share * TURNING))
    return draws.theta[:, ::-1][:, ::every][:, ::-1]


def turning_groups(draws: of_run.RatedDraws, error: float) -> of_run.Groups:
    """Return turning points for many posterior and prior draws; arguments as for `prediction_group`."""
    found: of_run.Groups = {}
    for group, points in {"inflection": turning_draws(draws), "prior_inflection": draws.prior[None]}.items():
        touch = draws.touch(points.reshape(-1, points.shape[-1]))
        turn = turning_points(draws.scene, touch, error, loads=draws.shown_loads)
        found[group] = of_run.turning_variables(turn, points.shape[:2], draws.load_axis)
    return found


def modulus_shifts(draws: of_run.RatedDraws, inflection: Mapping[str, of_run.Variable]) -> pd.DataFrame | None:
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
    index = of_run.evenly(points.shape, int(draws.share * SHIFT_DRAWS))
    theta = points[index]
    signs, share = directions(exact.astype(np.intp), design.n_fabrics)
    rates = rates_of_other_moduli(draws.posterior, theta, MODULUS_STEP)
    score = scores(draws.ratings, rates, draws.posterior.rating_parameters(theta), signs)
    quantities = {name: np.log(np.abs(theta[:, space.names.index(name)])) for name in SHIFTED if name in space.names}
    modulus = inflection["inflection_e_fab_kpa"].values[index]
    for name, where in zip(draws.load_groups.names, modulus.T, strict=True):
        quantities[f"turning point at {name}"] = np.log(where)
    return shift_table({name: posterior_shift(values, score, share) for name, values in quantities.items()})


def touch_illustration(
    rng: np.random.Generator, scene: Scene, parameters: TouchParameters, inflection: Array
) -> of_run.Part:
    """Return pressure, stress and rate along the pad for three fabrics and some loads, and the pad's receptors.

    The fabrics are the lowest modulus, the highest, and the typical turning point of the response under the load with
    the most turning points; without any, half the way between the others in the logarithm.

    Parameters
    ----------
    rng
        Random generator of the receptors' positions.
    scene
        The scene of the data.
    parameters
        Draws of the parameters of the forward model, shape (draws,).
    inflection
        E_fab at the turning points of draws [Pa], shape (draws, loads), NaN if there is none.

    Returns
    -------
    Part
        The group `ILLUSTRATIONS`.
    """
    finger = scene.finger
    receptors = draw_receptors(rng, finger, scene.readings.receptor_density)
    low, high = float(scene.modulus.min()), float(scene.modulus.max())
    turns = inflection[:, (~np.isnan(inflection)).sum(axis=0).argmax()]
    known = turns[~np.isnan(turns)]
    middle = (
        ("at the turning point", float(np.median(known))) if known.size else ("halfway", float(np.sqrt(low * high)))
    )
    chosen = sorted([("lowest modulus", low), middle, ("highest modulus", high)], key=lambda one: one[1])
    moduli = np.array([modulus for _, modulus in chosen])
    loads = np.unique(np.linspace(0, len(scene.loads) - 1, MOST_LOADS).round().astype(np.intp))
    few = Scene(
        moduli,
        np.median(scene.poisson),
        [scene.loads[k] for k in loads],
        scene.firing,
        finger=finger,
        readings=scene.readings,
        discretisation=UNTABLED,
        finger_box=scene.finger_box,
    )
    contact, farthest = few.contact(parameters), float(kink_distances(finger)[-1])
    near = min(REACH * float(np.median(contact.radius, axis=0).max()), 0.9 * farthest)
    distance = np.append(np.linspace(0.0, near, NEAR), np.geomspace(near, farthest, FAR + 1)[1:])
    profiles = touch_profiles(few, parameters, distance)

    def limits(values: Array) -> NDArray[np.float32]:
        found = np.quantile(values, LIMITS, axis=0)
        return found.reshape(found.shape[0], loads.size, moduli.size, *found.shape[2:]).astype(np.float32)

    at = ("quantile", "touch_load", "touch_fabric")
    along = (*at, "distance_mm")
    variables = {
        "touch_pressure_kpa": of_run.Variable(limits(profiles.pressure * 1e-3), along, "kPa"),
        "touch_stress_kpa": of_run.Variable(limits(profiles.stress * 1e-3), along, "kPa"),
        "touch_rate_hz": of_run.Variable(limits(profiles.rate), along, "Hz"),
        "touch_radius_mm": of_run.Variable(limits(contact.radius * 1e3), at, "mm"),
        "touch_e_fab_kpa": of_run.Variable(moduli * 1e-3, ("touch_fabric",), "kPa"),
        "receptor_x_mm": of_run.Variable(receptors[:, 0] * 1e3, ("receptor",), "mm"),
        "receptor_y_mm": of_run.Variable(receptors[:, 1] * 1e3, ("receptor",), "mm"),
        "pad_mm": of_run.Variable(1e3 * np.array([finger.pad_length, finger.pad_width]), ("side",), "mm"),
        "contact_centre_mm": of_run.Variable(1e3 * np.array(finger.contact_centre), ("side",), "mm"),
    }
    coordinates = {
        "quantile": np.array(LIMITS),
        "touch_load": np.array([str(scene.loads[k]) for k in loads]),
        "touch_fabric": np.array([name for name, _ in chosen]),
        "distance_mm": distance * 1e3,
    }
    return of_run.Part({ILLUSTRATIONS: variables}, coordinates)


def membrane_illustration(rng: np.random.Generator, scene: Scene, parameters: TouchParameters) -> of_run.Part:
    """Return firing rate as a function of current for every draw, and example trains of spikes.

    The currents go from below the lowest rheobase to the largest alpha of the draws' central 95 %; those of the trains
    lie at `EXCESSES` of the way from median rheobase to median alpha.

    Parameters
    ----------
    rng
        Random generator of membrane noise, if the scene has any.
    scene
        The scene of the data.
    parameters
        Draws of the parameters of the forward model, shape (draws,).
    """
    curve = scene.firing.curves(parameters.channels, parameters.alpha)
    rheobase = np.broadcast_to(curve.rheobase, np.shape(parameters.alpha))
    top = min(float(np.quantile(parameters.alpha, 0.975)), float(np.min(curve.max_current)))
    begin = min(float(rheobase.min()), top)
    current = np.linspace(max(0.0, begin - 0.25 * (top - begin)) if begin < top else 0.0, top, CURRENTS)
    shape = rheobase.size, CURRENTS
    rate = np.broadcast_to(curve.rate(np.broadcast_to(current, shape)), shape)
    alpha, least = float(np.median(parameters.alpha)), float(np.median(curve.rheobase))
    channels = Channels(*(float(np.median(value)) for value in parameters.channels))
    given = least + np.array(EXCESSES) * (alpha - least) if least < alpha else np.array([alpha])
    how = channels, scene.readings.membrane, DURATION, scene.firing.noise, rng, TRAIN_TOLERANCE
    trains = [spike_times(float(each), *how) for each in given]
    spikes = np.full((len(trains), max(1, *(train.size for train in trains))), np.nan)
    for row, train in zip(spikes, trains, strict=True):
        row[: train.size] = train
    examples = {
        "spike_time_ms": of_run.Variable(spikes, ("train", "spike"), "ms"),
        "train_current_ua_cm2": of_run.Variable(given, ("train",), "µA/cm²"),
        "train_duration_ms": of_run.Variable(np.array(DURATION), (), "ms"),
    }
    curves = {
        "firing_rate_hz": of_run.Variable(rate[None].astype(np.float32), ("current_ua_cm2",), "Hz"),
        "rheobase_ua_cm2": of_run.Variable(rheobase[None], (), "µA/cm²"),
        "largest_current_ua_cm2": of_run.Variable(np.array(parameters.alpha)[None], (), "µA/cm²"),
    }
    return of_run.Part({ILLUSTRATIONS: examples, "predictions": curves}, {"current_ua_cm2": current})
