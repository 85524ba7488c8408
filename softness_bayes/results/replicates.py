"""Random quantities drawn after sampling, and their groups; with those of compression data.

One function draws everything in a fixed order, so that the seed determines the numbers. The groups are functions of its
result.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.check_table import NEW_PARTICIPANTS
from softness_bayes.checking.checks import ExponentCheck
from softness_bayes.checking.turning_check import EXCESS, PLATEAU, TurnQuantities, plateau, plateau_quantities
from softness_bayes.data.columns import FORCE, INDENTATION
from softness_bayes.data.compression import Compression
from softness_bayes.likelihood.contract import NO_RESPONSE, Parameters
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.likelihood.pieces import part_of, pieces
from softness_bayes.likelihood.plate import CompressionForces, FingerEffects
from softness_bayes.model.posterior import Density
from softness_bayes.provenance import PlateData, attributes_of
from softness_bayes.results.draws import Groups, RatedDraws, Subset, Variable, named
from softness_bayes.results.predictions import Trains, example_trains
from softness_bayes.touch.contact import plate_force
from softness_bayes.touch.receptors import draw_receptors

Array = NDArray[np.float64]

ROWS = ("rating_row",)
"""Axis of variables with one value per rating."""

POINTS = 60
"""Number of indentations at which the force of the typical finger is stored."""


class PlateReplicates(NamedTuple):
    """Draws made after a run on compression data, each of shape (draws, ...)."""

    fingers: FingerEffects
    """Deviations of the fingers from the typical one, at every draw of every chain."""
    again: Array
    """Forces of the same fingers [N], for posterior draws."""
    prior: Array
    """Forces of new fingers [N], for prior draws."""


class Replicates(NamedTuple):
    """Replicated draws: ratings (draws, rows) at `RatedDraws.replicates` draws, forces, and data of the figures."""

    again: Array
    """Ratings of the same participants."""
    anew: Array
    """Ratings of new participants."""
    plateau: Array
    """Ratings as in `again`, with the same noise, for a response that stays at its peak beyond the turning point."""
    prior: Array
    """Ratings of new participants, for prior draws."""
    plate: PlateReplicates | None
    """Forces of a plate; None without compression data."""
    receptors: Array
    """Positions of the pad's receptors [m], shape (receptors, 2)."""
    trains: Trains
    """Example spike trains."""


def draw_replicates(rng: np.random.Generator, draws: RatedDraws) -> Replicates:
    """Draw all random quantities of a result except the posterior draws and their effects.

    Parameters
    ----------
    rng
        Random generator of all draws; the numbers depend on the order of the lines of this function.
    draws
        The draws of the run.
    """
    few, ratings = draws.subset(draws.replicates), draws.ratings
    drive = ratings.drive(few.mean_rate, few.parameters)
    twin = copy.deepcopy(rng)
    again = _rated(rng, draws, drive, few.mean_rate, few.parameters, few.effects)
    strangers = ratings.with_new_participants(rng, few.parameters, few.effects)
    anew = _rated(rng, draws, drive, few.mean_rate, few.parameters, strangers)
    level = _plateau_rated(twin, draws, few)
    prior = _prior_rated(rng, draws)
    plate = draw_plate(rng, draws.posterior, draws.theta, few.theta, draws.prior[: draws.replicates])
    receptors = draw_receptors(rng, draws.scene.finger, draws.scene.readings.receptor_density)
    trains = example_trains(rng, draws.scene, draws.touch(draws.subset(draws.curves).theta))
    return Replicates(again, anew, level, prior, plate, receptors, trains)


def predictive_groups(draws: RatedDraws, drawn: Replicates, alone: Array) -> Groups:
    """Return replicated ratings of the same and of new participants, and densities of ratings given others.

    Parameters
    ----------
    draws, drawn
        The draws of the run, and the quantities drawn after it.
    alone
        Log density of each rating given all others, at the draws of `RatedDraws.replicates`.
    """
    few = draws.subset(draws.replicates)
    whole = draws.ratings.log_likelihood_participants(few.mean_rate, few.parameters)
    replicates = {"rating": Variable(drawn.again[None], ROWS), NEW_PARTICIPANTS: Variable(drawn.anew[None], ROWS)}
    return {
        "posterior_predictive": replicates,
        "log_likelihood": {"rating": Variable(alone[None], ROWS)},
        # not named like the rating, which has a different axis
        "log_likelihood_participant": {"ratings_of_participant": Variable(whole[None], ("participant",))},
        **_plateau_groups(draws, drawn),
    }


def prior_groups(draws: RatedDraws, drawn: Replicates) -> Groups:
    """Return draws of the prior, and the ratings of new participants that they predict."""
    return {
        "prior": named(draws.posterior.space, draws.prior[None]),
        "prior_predictive": {"rating": Variable(drawn.prior[None], ROWS)},
    }


def _plateau_groups(draws: RatedDraws, drawn: Replicates) -> Groups:
    """Return test quantities of ratings, and of ratings for a response that levels off at its peak."""
    groups = draws.load_groups
    layout = merge(_layout(draws), groups.of)[0]
    found, excess = plateau_quantities(layout, drawn.again, drawn.plateau)
    shown = np.full((len(found), len(drawn.again), groups.at.size), np.nan)
    shown[..., layout.loads] = found
    tables = zip(TurnQuantities._fields, shown, strict=True)
    return {
        PLATEAU: {f"levelled_{name}": Variable(values[None], (draws.load_axis,)) for name, values in tables},
        "constant_data": {EXCESS: Variable(excess[layout.design.condition], ROWS)},
    }


def _layout(draws: RatedDraws) -> Layout:
    """Return the design, with each condition's modulus: of one that is sampled the median of its draws."""
    model, conditions = draws.model, draws.experiment.ratings.conditions
    space, modulus = draws.posterior.space, draws.scene.modulus
    drawn = space.modulus(draws.theta)
    if drawn is not None and space.moduli is not None:
        places = [space.moduli.names.index(name) for name in draws.experiment.ratings.fabrics]
        modulus = np.median(drawn, axis=(0, 1))[places][conditions.fabric]
    return Layout(draws.ratings.design, modulus, conditions.load, draws.sign, model.scale)


def _rated(
    rng: np.random.Generator,
    draws: RatedDraws,
    drive: Array,
    mean_rate: Array,
    parameters: Parameters,
    effects: Any,
) -> Array:
    """Return a rating for every row at every draw, drawn a few draws at a time."""
    made = np.empty((len(drive), draws.ratings.design.n_rows))
    for k in pieces(*made.shape):
        some = parameters.part(k), part_of(effects, k)
        made[k] = draws.ratings.replicate(rng, drive[k], *some, mean_rate[k])
    return made


def _plateau_rated(rng: np.random.Generator, draws: RatedDraws, few: Subset) -> Array:
    width, layout = draws.scene.n_conditions, _layout(draws)
    # with many loads, single loads have too few fabrics, so levelling is applied to groups of loads
    layout = replace(layout, load=draws.load_groups.of[layout.load])
    if draws.posterior.fingers is None:
        level = plateau(layout, few.mean_rate[..., :width])
    else:
        # the response of each finger levels off at its peak
        fingers = few.mean_rate.reshape(len(few.mean_rate), -1, width)
        level = plateau(layout, fingers).reshape(few.mean_rate.shape)
    drive = draws.ratings.drive_at(level, few.mean_rate, few.parameters)
    return _rated(rng, draws, drive, few.mean_rate, few.parameters, few.effects)


def _prior_rated(rng: np.random.Generator, draws: RatedDraws) -> Array:
    ratings, theta = draws.ratings, draws.prior[: draws.replicates]
    rate, parameters = draws.posterior.response(theta), draws.posterior.rating_parameters(theta)
    effects = ratings.new_effects(rng, parameters, theta.shape[:1])
    return _rated(rng, draws, ratings.drive(rate, parameters), rate, parameters, effects)


def draw_plate(
    rng: np.random.Generator, density: Density, theta: Array, replicates: Array, prior: Array
) -> PlateReplicates | None:
    """Draw the deviations of fingers, and replicated forces; None without compression data.

    Parameters
    ----------
    rng
        Random generator of effects and noise.
    density
        The density that was sampled.
    theta
        All draws, shape (chains, draws, dimension), for the deviations of fingers.
    replicates, prior
        Draws of the posterior and of the prior (draws, dimension) for which forces are simulated.
    """
    forces, skin = density.compression, density.skin_parameters
    if forces is None:
        return None

    def forces_at(points: Parameters, effects: FingerEffects) -> Array:
        return forces.replicate(rng, forces.drive(NO_RESPONSE, points), points, effects)

    fingers = forces.draw_effects(rng, NO_RESPONSE, skin(theta))
    again = forces_at(skin(replicates), forces.draw_effects(rng, NO_RESPONSE, skin(replicates)))
    made = forces_at(skin(prior), forces.new_effects(rng, skin(prior), prior.shape[:1]))
    return PlateReplicates(fingers, again, made)


def plate_groups(
    compression: Compression, forces: CompressionForces, typical: Parameters, drawn: PlateReplicates
) -> Groups:
    """Return fingers, replicated forces, the typical finger's force and the data.

    Parameters
    ----------
    compression, forces
        The data and their likelihood.
    typical
        The skin's parameters at some draws of the posterior, shape (draws,), for the typical finger's force.
    drawn
        Output of `draw_plate`.
    """
    depth = _depths(compression)
    line = plate_force(
        depth,
        np.asarray(typical.b)[:, None],
        np.asarray(typical.m)[:, None],
        displacement=forces.model.displacement,
    )
    row = ("force_row",)
    return {
        "posterior": {
            "log_b_effect": Variable(drawn.fingers.log_b, ("finger",)),
            "m_effect": Variable(drawn.fingers.m, ("finger",)),
        },
        "posterior_predictive": {"plate_force_n": Variable(drawn.again[None], row, FORCE.unit)},
        "prior_predictive": {"plate_force_n": Variable(drawn.prior[None], row, FORCE.unit)},
        "predictions": {"typical_force_n": Variable(line[None], ("plate_indentation_mm",), FORCE.unit)},
        "observed_data": {"plate_force_n": Variable(compression.force, row, FORCE.unit)},
        "constant_data": {
            "finger_index": Variable(compression.participant, row),
            "force_indentation_mm": Variable(compression.indentation / INDENTATION.factor, row, INDENTATION.unit),
        },
    }


def plate_coordinates(compression: Compression) -> dict[str, NDArray[Any]]:
    """Return the coordinates of the axes of `plate_groups`."""
    return {
        "finger": np.array(compression.participants),
        "force_row": compression.rows,
        "plate_indentation_mm": _depths(compression) / INDENTATION.factor,
    }


def plate_attributes(compression: Compression, check: ExponentCheck) -> dict[str, Any]:
    """Return the provenance of compression data."""
    return attributes_of(
        PlateData(
            digest_compression=compression.digest,
            zero_forces=compression.n_zero,
            forces_per_finger=check.points,
            force_exponent=check.observed,
            force_exponent_low=check.low,
            force_exponent_high=check.high,
            force_p_value=check.p_value,
        )
    )


def _depths(compression: Compression) -> Array:
    """Return indentations [m] from half the smallest to a tenth more than the largest of the data."""
    return np.geomspace(0.5 * compression.indentation.min(), 1.1 * compression.indentation.max(), POINTS)
