"""Replicated ratings, drawn after sampling in a fixed order, so that the seed determines the numbers."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.check_table import NEW_PARTICIPANTS
from softness_bayes.checking.quantities import EXCESS, excess_of_plateau, plateau
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.results.draws import Groups, RatedDraws, Subset, Variable, named

Array = NDArray[np.float64]

ROWS = ("rating_row",)
"""Axis of variables with one value per rating."""


def replicated_groups(rng: np.random.Generator, draws: RatedDraws) -> Groups:
    """Draw replicated ratings of the same and of new participants, and those of the prior.

    Ratings of the same participants are also drawn, with the same noise, for a response that stays at its peak beyond
    the turning point; the excess of their means is stored.
    """
    few, ratings = draws.subset(draws.replicates), draws.ratings
    drive, twin = ratings.drive(few.mean_rate, few.parameters), copy.deepcopy(rng)
    again = _rated(rng, draws, drive, few)
    strangers = ratings.with_new_participants(rng, few.parameters, few.effects)
    anew = _rated(rng, draws, drive, few._replace(effects=strangers))
    layout, groups = rated_layout(draws), draws.load_groups
    # with many loads, single loads have too few fabrics, so levelling is applied to groups of loads
    held = _held_at_peak(draws, replace(layout, load=groups.of[layout.load]))
    level = ratings.drive_at(held, few.mean_rate, few.parameters)
    if level.shape != drive.shape:  # under other loads, the drive of a condition falls by as much
        level = drive + (level - drive[..., : level.shape[-1]])[..., ratings.condition_of_rate]
    grouped = merge(layout, groups.of)[0]
    excess = excess_of_plateau(grouped, again, _rated(twin, draws, level, few))
    theta = draws.prior[: draws.replicates]
    rate, parameters = draws.posterior.response(theta), draws.posterior.rating_parameters(theta)
    before = Subset(theta, rate, parameters, ratings.new_effects(rng, parameters, theta.shape[:1]))
    prior = _rated(rng, draws, ratings.drive(rate, parameters), before)
    filed = draws.scale.filed
    return {
        "posterior_predictive": {
            "rating": Variable(filed(again)[None], ROWS),
            NEW_PARTICIPANTS: Variable(filed(anew)[None], ROWS),
        },
        "constant_data": {EXCESS: Variable(excess[grouped.design.condition], ROWS)},
        "prior": named(draws.posterior.space, draws.prior[None]),
        "prior_predictive": {"rating": Variable(filed(prior)[None], ROWS)},
    }


def rated_layout(draws: RatedDraws) -> Layout:
    """Return the design, with each condition's modulus: of one that is sampled the median of its draws."""
    model, conditions = draws.model, draws.experiment.ratings.conditions
    space, modulus = draws.posterior.space, draws.scene.modulus
    drawn = space.modulus(draws.theta)
    if drawn is not None and space.moduli is not None:
        places = [space.moduli.names.index(name) for name in draws.experiment.ratings.fabrics]
        modulus = np.median(drawn, axis=(0, 1))[places][conditions.fabric]
    rises = draws.rises[0]
    sign = model.direction.sign if np.isnan(rises) else (1.0 if rises >= 0.5 else -1.0)
    return Layout(draws.ratings.design, modulus, conditions.load, sign, model.scale)


def _held_at_peak(draws: RatedDraws, layout: Layout) -> Array:
    """Return the responses at the draws with replicates, held at their peak; those of fingers each at its own."""
    rate, width = draws.subset(draws.replicates).mean_rate, draws.scene.n_conditions
    if draws.posterior.fingers is None:
        return plateau(layout, rate[..., :width])
    return plateau(layout, rate.reshape(len(rate), -1, width)).reshape(rate.shape)


def _rated(rng: np.random.Generator, draws: RatedDraws, drive: Array, some: Subset) -> Array:
    """Return a rating for every row at each of some draws, drawn a few draws at a time."""
    made = np.empty((len(drive), draws.ratings.design.n_rows))
    for k in pieces(*made.shape):
        made[k] = draws.ratings.replicate(rng, drive[k], some.parameters.part(k), some.effects.part(k))
    return made
