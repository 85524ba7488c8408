"""Simulated ratings, and forces of a rigid plate, for given parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base import ranges
from softness_bayes.base.errors import InputError
from softness_bayes.data import Afferents, Compression, Fabrics, Measurements, Ratings
from softness_bayes.data.fabrics import log_sd
from softness_bayes.data.forms import PANEL, AggregatedCells
from softness_bayes.likelihood import scales
from softness_bayes.likelihood.contract import NO_RESPONSE, RATER_SPREADS, Model, Parameters
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import GUMBEL, NORMAL, ErrorLaw
from softness_bayes.likelihood.models import rating_model
from softness_bayes.likelihood.plate import OF_FORCES, PLATE_PARAMETERS, CompressionForces
from softness_bayes.model.build import recorded_terms
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import scaled, scene_of, touch_parameters
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.touch.contact import Finger, Load, require_loads
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED, Readings
from softness_bayes.touch.scene import Discretisation, Scene

_RNG, _VALUES = (
    "a generator, such as numpy.random.default_rng(1)",
    "usual_values(readings, given={'b': 80})",
)  # examples of arguments


class Simulation(NamedTuple):
    """Simulated ratings with the values from which they were generated."""

    ratings: Ratings
    truth: dict[str, float]
    """Every parameter in natural units, and mu, or c0 and c1 of standardised ratings."""
    participant_effect: NDArray[np.float64]
    """Log of each participant's rating scale, shape (participants,); 0 for standardised ratings."""
    total_rate: NDArray[np.float64]
    """Response [spikes/s], shape (fabrics, loads)."""


def simulate_ratings(
    rng: np.random.Generator,
    fabrics: Fabrics,
    loads: tuple[Load, ...],
    values: Mapping[str, float],
    readings: Readings = MENDED,
    participants: int = 30,
    missing: float = 0.0,
    mu: float | None = None,
    direction: scales.RatingDirection = scales.RISES,
    scale: scales.Scale = scales.MAGNITUDE,
    slope: float | None = None,
    discretisation: Discretisation = Discretisation(),
    finger: Finger = Finger(),
    load_cv: float = 0.0,
    errors: ErrorLaw = NORMAL,
    resolution: float = 0.0,
    categories: int | None = None,
) -> Simulation:
    """Simulate ratings in which every participant rates every fabric under every load once.

    Parameters
    ----------
    rng
        Random generator of rating scales, noise and missing ratings.
    fabrics, loads
        Fabrics and loads that are rated.
    values
        Every parameter, in natural units (see `usual_values`); with `tau_gamma` or `tau_varsigma`, raters have
        individual exponents or noise.
    readings
        Readings of the model.
    participants
        Number of participants.
    missing
        Share of ratings left out at random; for pairs, the share of whole answers.
    mu
        Mean log rating of magnitude estimates; by default the centre of its prior.
    direction
        Whether ratings rise or fall with the response.
    scale
        Scale of the ratings.
    slope
        c1 of standardised ratings, whose c0 is 0; by default the median of its prior.
    discretisation
        Resolution of the scene.
    finger
        The fingertip that touches.
    load_cv
        Relative standard error of each rating's load, log-normal about the stated one; the response is that at the
        actual load.
    errors
        Error law; its parameters are taken from `values` or are the medians of their priors. For rank orders, normal
        means the Gumbel law.
    resolution
        Step of the grid, including 0, to which ratings are rounded; 0 for exact numbers.
    categories
        Number of ordered categories, by default seven.

    Raises
    ------
    InputError
        If the number of participants or of ratings, the share of gaps, mu, the slope, the error of the loads or the
        resolution is out of range, mu or slope is given for the wrong scale, or an error of loads, a resolution or an
        error law for a scale that does not support it.
    """
    ranges.require_kind("rng", rng, np.random.Generator, _RNG)
    ranges.require_kind("fabrics", fabrics, Fabrics, "Fabrics, such as Fabrics(('felt',), effective_modulus=[3e4])")
    ranges.require_mapping("values", values, _VALUES)
    loads = require_loads("loads", loads)
    _require_ranges(scale, participants, len(fabrics) * len(loads), missing, mu, resolution, load_cv)
    model = _model_of(scale, direction, errors, categories, values)
    levels = _levels(model, scale, mu, slope)
    scene = scene_of(fabrics, loads, values, readings, discretisation=discretisation, finger=finger)
    rate = scene.total_rate(touch_parameters(values))
    conditions = np.arange(scene.n_conditions)
    people = np.repeat(np.arange(participants), conditions.size)
    design = Design(np.tile(conditions, participants), people, scene.fabric, participants)
    values = {**values, **{n: EVERY_PARAMETER[n].prior.median for n in model.needs if n not in values}}
    parameters = Parameters(**{name: values[name] for name in model.needs})
    drive = model.drive(design, rate / scene.n_receptors, parameters)
    effects = model.draw_effects(rng, parameters, (), participants, design.n_fabrics, levels)
    drawn = model.named_effects(effects)
    effect, _ = drawn.get("participant_effect", (np.zeros(participants), ()))
    absent = EVERY_PARAMETER.keys() - {*TouchParameters._fields, *model.needs, *OF_FORCES}
    truth = {name: value for name, value in values.items() if name not in absent}
    truth |= {name: float(value) for name, (value, axes) in drawn.items() if not axes}
    responses = rate.reshape(len(loads), len(fabrics)).T
    if scale == scales.PAIRS:
        ratings = paired(rng, model, scene, participants, missing, drive, parameters, fabrics.names, loads)
        return Simulation(ratings, truth, effect, responses)
    touched = design
    if load_cv:
        held = _held_rates(rng, scene, values, design, load_cv)
        drive = model.drive_at(held / scene.n_receptors, design, rate / scene.n_receptors, parameters)
        # each row is a separate condition
        touched = Design(np.arange(design.n_rows), people, design.fabric[design.condition], participants)
    filed = rounded(model.draw_ratings(rng, touched, drive, parameters, effects))
    if scale == scales.AGGREGATED:
        means = averaged(filed.reshape(participants, -1), scene, fabrics.names, loads)
        return Simulation(means, truth, effect.mean(keepdims=True), responses)
    if resolution:
        filed = rounded(np.floor(filed / resolution + 0.5) * resolution)
    filed[rng.random(filed.size) < missing] = np.nan
    # conditions are ordered by load
    table = filed.reshape(participants, len(loads), len(fabrics)).transpose(0, 2, 1)
    if scale == scales.RANKS:  # each fabric's place, from 1
        place = 1.0 + table.argsort(axis=1, kind="stable").argsort(axis=1, kind="stable")
        table = np.where(np.isnan(table), np.nan, place)
    ratings = Ratings.crossed(numbered("P", participants), fabrics.names, loads, table)
    if load_cv:
        ratings = replace(ratings, load_cv=np.full(len(ratings), load_cv))
    return Simulation(ratings, truth, effect, responses)


def _model_of(
    scale: scales.Scale,
    direction: scales.RatingDirection,
    errors: ErrorLaw,
    categories: int | None,
    values: Mapping[str, float],
) -> Any:
    """Return the rating model; for means, that of single raters.

    For rank orders, normal errors mean the Gumbel law.

    Raises
    ------
    InputError
        If a number of categories is given for another scale, or out of range; or spreads of raters' exponents or noise
        for a scale that does not support them.
    """
    if differ := tuple(name for name, spread in RATER_SPREADS.items() if values.get(spread, 0.0) > 0):
        return rating_model(scale, direction, errors, differ=differ)
    model: Any = rating_model(scale, direction, GUMBEL if scale == scales.RANKS and errors == NORMAL else errors)
    if scale == scales.AGGREGATED:
        model = model.of_one_rater
    if categories is None:
        return model
    if scale != scales.CATEGORIES:
        raise InputError(f"simulate: {categories} categories, expected none for {scale.name} ratings")
    ranges.CATEGORIES_RANGE.require("simulate: number of categories", categories)
    return replace(model, categories=categories)


def _held_rates(
    rng: np.random.Generator, scene: Scene, values: Mapping[str, float], design: Design, load_cv: float
) -> NDArray[np.float64]:
    """Return the response [spikes/s] of each rating at its actual load, shape (rows,).

    Parameters
    ----------
    rng
        Random generator of the loads, log-normal about the stated ones.
    scene, values, design
        All conditions at their stated loads, the parameters, and the condition of each rating.
    load_cv
        Relative standard error of the loads.
    """
    factor = np.exp(float(log_sd(np.array(load_cv))) * rng.standard_normal(design.n_rows))
    stated = [scene.loads[k] for k in scene.load[design.condition]]
    loads = tuple(scaled(load, one) for load, one in zip(stated, factor.tolist(), strict=True))
    touched = scene.under(loads, scene.fabric[design.condition], np.arange(design.n_rows))
    return touched.total_rate(touch_parameters(values))


def _require_ranges(
    scale: scales.Scale,
    participants: int,
    conditions: int,
    missing: float,
    mu: float | None,
    resolution: float,
    load_cv: float,
) -> None:
    """Raise an error for numbers that are out of range, or that the scale does not support."""
    ranges.RESOLUTIONS.require("simulate: resolution", resolution)
    ranges.LOAD_ERRORS.require("simulate: load_cv", load_cv)
    if resolution and scale in (scales.AGGREGATED, scales.STANDARDISED, scales.CATEGORIES, scales.RANKS, scales.PAIRS):
        raise InputError(f"simulate: resolution is {resolution}, expected none for {scale.name} ratings")
    if load_cv and scale != scales.MAGNITUDE:
        raise InputError(f"simulate: load_cv is {load_cv}, expected none for {scale.name} ratings")
    ranges.PARTICIPANTS.require("simulate: number of participants", participants)
    ranges.SIMULATED_RATINGS.require("simulate: number of ratings", participants * conditions)
    if not 0 <= missing < 1:
        raise InputError(f"simulate: share of missing ratings is {missing}, expected one in [0, 1)")
    if mu is not None and not abs(mu) <= scales.LARGEST_LOG_RATING:
        raise InputError(
            f"simulate: mu is {mu}, expected a number from -{scales.LARGEST_LOG_RATING:g} to "
            f"{scales.LARGEST_LOG_RATING:g}"
        )
    if scale == scales.AGGREGATED and (missing or participants < 2):
        raise InputError("simulate: means of raters need at least two raters and no missing ratings (missing 0)")


def _levels(model: Model, scale: scales.Scale, mu: float | None, slope: float | None) -> dict[str, ArrayLike]:
    """Return the levels of a rating model: the given ones, and prior medians for the others.

    Raises
    ------
    InputError
        If a given level does not belong to the scale, or the slope is out of range.
    """
    levels: dict[str, ArrayLike] = {name: prior.median for name, prior in model.levels.items()}
    for option, name, value in (("mu", "mu", mu), ("slope", "c1", slope)):
        if value is not None and name not in levels:
            raise InputError(f"simulate: {option} is {value}, expected none for {scale.name} ratings")
        levels |= {} if value is None else {name: value}
    if slope is not None:
        ranges.SLOPES.require("simulate: slope", slope)
    return levels


def averaged(filed: NDArray[np.float64], scene: Scene, fabrics: tuple[str, ...], loads: tuple[Load, ...]) -> Ratings:
    """Return geometric means and standard deviations over people of ratings (people, conditions), by condition."""
    log, conditions = np.log(filed), np.arange(filed.shape[1])
    return Ratings(
        (PANEL,),
        fabrics,
        loads,
        participant=np.zeros_like(conditions),
        fabric=scene.fabric,
        load=scene.load,
        rating=rounded(np.exp(log.mean(axis=0))),
        rows=conditions + 2,
        cells=AggregatedCells(len(filed), rounded(np.exp(log.std(axis=0, ddof=1)))),
    )


def paired(
    rng: np.random.Generator,
    model: Any,
    scene: Scene,
    participants: int,
    missing: float,
    drive: NDArray[np.float64],
    parameters: Parameters,
    fabrics: tuple[str, ...],
    loads: tuple[Load, ...],
) -> Ratings:
    """Return answers to pairs: each participant compares neighbours in a random circle of the fabrics for each load.

    Parameters
    ----------
    rng, model, scene, participants, missing
        As for `simulate_ratings`; the model is that of pairs.
    drive
        Drive of each condition, shape (conditions,).
    parameters
        Parameters of the model.
    fabrics, loads
        Names of the fabrics, and the loads.

    Raises
    ------
    InputError
        If all answers are left out.
    """
    each = [np.flatnonzero(scene.load == k) for k in np.unique(scene.load)]
    circles = np.array([[rng.permutation(conditions) for conditions in each] for _ in range(participants)])
    condition = np.stack([circles, np.roll(circles, -1, axis=2)], axis=-1).reshape(-1, 2)
    person = np.repeat(np.arange(participants), len(condition) // participants)
    kept = rng.random(len(condition)) >= missing
    rows, participant = condition[kept].ravel(), np.repeat(person[kept], 2)
    lists = np.repeat(np.arange(int(kept.sum())), 2)
    answers = np.tile([1.0, 0.0], int(kept.sum()))
    if not rows.size:
        raise InputError("simulate: all answers are missing at random; use a smaller share or another seed")
    zero = np.zeros(rows.size)
    asked = Design(rows, participant, scene.fabric, participants)
    observed = model.observe(answers, asked, Stated(answers, zero, zero, zero + np.inf, lists=lists))
    return Ratings(
        numbered("P", participants),
        fabrics,
        loads,
        participant=participant,
        fabric=scene.fabric[rows],
        load=scene.load[rows],
        rating=observed.replicate(rng, drive, parameters, None),
        rows=np.arange(2, 2 + rows.size),
        n_missing=2 * int((~kept).sum()),
        lists=lists,
    )


def rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values rounded to the digits that people and instruments typically report.

    Rounding also makes files identical on machines whose exponentials differ in the last bits.
    """
    return np.array([float(f"{value:.4g}") for value in values])


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Return names that sort by their numbers, as P01 to P30."""
    return tuple(f"{letter}{i:0{len(str(count))}d}" for i in range(1, count + 1))


PLATE_DEPTHS = (0.5e-3, 1e-3, 1.5e-3, 2e-3)
"""Indentations [m] of simulated fingers, as in the published measurements."""


class SimulatedForces(NamedTuple):
    """Simulated compression data, with the deviations of the fingers from the typical one."""

    compression: Compression
    log_b_effect: NDArray[np.float64]
    """Deviations in ln b, shape (fingers,)."""
    m_effect: NDArray[np.float64]
    """Deviations in m, shape (fingers,)."""


def simulate_compression(
    rng: np.random.Generator,
    values: Mapping[str, float],
    readings: Readings = MENDED,
    fingers: int = 8,
    depths: tuple[float, ...] = PLATE_DEPTHS,
    shape: Finger = Finger(),
) -> SimulatedForces:
    """Simulate a rigid flat plate pressed on fingers, once to every depth for each finger.

    Parameters
    ----------
    rng
        Random generator of fingers and noise.
    values
        b, m, tau_b, tau_m and varsigma_f in natural units (`usual_values` with a number of fingers).
    readings
        Readings of the model.
    fingers
        Number of fingers.
    depths
        Indentations [m].
    shape
        Shape of every fingertip.

    Raises
    ------
    InputError
        If there is no finger.
    """
    ranges.require_kind("rng", rng, np.random.Generator, _RNG)
    ranges.require_mapping("values", values, _VALUES)
    if missing := [name for name in PLATE_PARAMETERS if name not in values]:
        raise InputError(f"values: no {missing[0]}, expected all that usual_values(readings, n_fingers=8) returns")
    replace(ranges.FINGERS, low=1).require("simulate: number of fingers", fingers)
    skin = Parameters(**{name: np.float64(values[name]) * EVERY_PARAMETER[name].si for name in PLATE_PARAMETERS})
    finger, depth = np.repeat(np.arange(fingers), len(depths)), np.tile(depths, fingers)
    plate = CompressionForces(
        depth, np.ones(depth.size), finger, fingers, displacement=readings.skin_displacement, shape=shape
    )
    effects = plate.new_effects(rng, skin, ())
    force = rounded(plate.replicate(rng, plate.drive(NO_RESPONSE, skin), skin, effects))
    compression = Compression(numbered("F", fingers), finger, depth, force, np.arange(2, 2 + force.size))
    return SimulatedForces(compression, effects.log_b, effects.m)


def simulate_afferents(rng: np.random.Generator, design: Afferents, values: Mapping[str, float]) -> Afferents:
    """Simulate responses of afferents under the probes and loads of a table.

    Parameters
    ----------
    rng
        Random generator of sensitivities and noise.
    design
        The table; its own responses are placeholders.
    values
        The `RECORDING_PARAMETERS` that the table's model has, in natural units.
    """
    (term,) = recorded_terms(Measurements(afferents=design), ModelOptions())
    at = Parameters(**{name: np.float64(values[name]) * EVERY_PARAMETER[name].si for name in term.model.needs})
    made = term.replicate(rng, term.rate(at), at, term.new_effects(rng, at, ()))
    return replace(term.with_values(made).data, source="simulated")
