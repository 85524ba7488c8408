"""Predictions of left-out ratings by one fitted model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from softness_bayes import arviz_bridge
from softness_bayes.checking.exactness import largest_pareto_k
from softness_bayes.errors import InputError
from softness_bayes.model.build import build
from softness_bayes.model.posterior import Posterior
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.results.result import Result
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.sampler.workers import Workers, available_processors

Array = NDArray[np.float64]

_WEIGHTED = 1000  # posterior draws that are weighted to leave out a condition
_DRAWS = 100  # draws of each walker in a refit


class LeftOut(NamedTuple):
    """Predictions of each unit from all others by one model, arrays of shape (units,)."""

    log_density: Array
    """log p(y_unit | other ratings), with the parameters integrated out; a density of ratings as in the file."""
    pareto_k: Array
    """Pareto k of the importance weights; NaN if the model was refitted instead."""
    draws: int
    """Number of draws in each importance-weighted mean; 0 if the model was refitted."""
    unfinished: int = 0
    """Number of refits that did not converge."""


@dataclass(frozen=True)
class Leave:
    """A kind of unit to leave out, and the function that predicts each such unit."""

    name: str
    predict: Callable[[Result, Settings, Callable[[str], None], Executor | None], LeftOut]


def leave_by_weights(log_density: Array) -> LeftOut:
    """Weight posterior draws by 1 / p(unit | others, theta), to represent the posterior without the unit.

    Parameters
    ----------
    log_density
        log p(y_unit | y_others, theta), shape (draws, units).
    """
    weights, shape = arviz_bridge.psis(-log_density.T)
    return LeftOut(logsumexp(weights + log_density.T, axis=1), shape, len(log_density))


def _stored(group: str, name: str) -> Callable[[Result, Settings, Callable[[str], None], Executor | None], LeftOut]:
    def predict(
        result: Result, settings: Settings, progress: Callable[[str], None], executor: Executor | None = None
    ) -> LeftOut:
        values = result.group(group)[name].values
        return leave_by_weights(values.reshape(-1, values.shape[-1]))

    return predict


def _by_rating(
    result: Result, settings: Settings, progress: Callable[[str], None], executor: Executor | None = None
) -> LeftOut:
    """Leave out each rating; lists and pairs, whose rows depend on one another, are left out as a whole."""
    if not result.scale.answer:
        return _stored("log_likelihood_loo", "rating")(result, settings, progress, executor)
    posterior = build(experiment_of(result), options_of(result)).posterior
    return leave_by_weights(posterior.observation.log_likelihood_answers(*_at_draws(posterior, result)))


def _at_draws(posterior: Posterior, result: Result) -> tuple[Array, Any]:
    """Return mean rates and rating parameters at the draws to be weighted, in one batch."""
    values = result.values(_WEIGHTED)
    theta = np.stack([values[name] for name in posterior.names], axis=-1)
    return posterior.response(theta), posterior.rating_parameters(theta)


def _refit(
    result: Result, settings: Settings, progress: Callable[[str], None], executor: Executor | None = None
) -> LeftOut:
    """Refit the model without each fabric, because a fabric changes the posterior too much for importance weights."""
    experiment = experiment_of(result)
    posterior, fabric = build(experiment, options_of(result)).posterior, experiment.ratings.fabric
    if (fabric == fabric[0]).all():
        raise InputError("compare: there is only one fabric, so no data remain to predict it from")
    seed, names = int(result.attributes["seed"]), experiment.ratings.fabrics
    without = [Without(k, name, fabric == k, (seed, 1 << 21, k)) for k, name in enumerate(names)]
    found = _each_anew(posterior, without, settings, progress, executor)
    density = np.array([found[k].log_density for k in range(len(names))])
    unfinished = sum(not one.converged for one in found.values())
    return LeftOut(density, np.full(len(names), np.nan), 0, unfinished)


def _by_condition(
    result: Result, settings: Settings, progress: Callable[[str], None], executor: Executor | None = None
) -> LeftOut:
    """Leave out each fabric under each load by importance weights, or by refits if these fail."""
    experiment = experiment_of(result)
    posterior, conditions = build(experiment, options_of(result)).posterior, experiment.ratings.conditions
    if len(conditions.fabric) < 2:
        raise InputError("compare: there is only one condition, so no data remain to predict it from")
    at = _at_draws(posterior, result)
    left = leave_by_weights(posterior.observation.log_likelihood_blocks(*at, conditions.of_rating))
    density, shape, seed = left.log_density.copy(), left.pareto_k.copy(), int(result.attributes["seed"])
    without = [
        Without(
            k,
            f"{experiment.ratings.fabrics[conditions.fabric[k]]} at {experiment.ratings.loads[conditions.load[k]]}",
            conditions.of_rating == k,
            (seed, 1 << 22, k),
        )
        for k in np.flatnonzero(shape > largest_pareto_k(left.draws)).tolist()
    ]
    found = _each_anew(posterior, without, settings, progress, executor)
    for k, one in found.items():
        density[k], shape[k] = one.log_density, np.nan
    return LeftOut(density, shape, left.draws, sum(not one.converged for one in found.values()))


class Without(NamedTuple):
    """A unit without which a model is refitted."""

    unit: int
    name: str
    rows: NDArray[np.bool_]
    """Mask of the ratings in the unit."""
    seed: tuple[int, int, int]


class Anew(NamedTuple):
    """Prediction of a unit by a model that was refitted without it."""

    unit: int
    log_density: float
    """Log density of the unit's ratings given all others."""
    converged: bool


def _each_anew(
    posterior: Posterior,
    without: Sequence[Without],
    settings: Settings,
    progress: Callable[[str], None],
    executor: Executor | None,
) -> dict[int, Anew]:
    """Refit a model without each of some units, one task per unit; return predictions by index."""
    found: dict[int, Anew] = {}
    processes = min(settings.processes or available_processors(), max(len(without), 1))
    names = {one.unit: one.name for one in without}
    with Workers(posterior, processes, executor) as workers:
        for one in workers.as_finished(_anew, [(one, replace(settings, processes=1)) for one in without]):
            found[one.unit] = one
            progress(names[one.unit])
    return found


def _anew(posterior: Posterior, left: Without, settings: Settings) -> Anew:
    """Refit a model without a unit, and predict the unit."""
    observation, rows = posterior.observation, left.rows
    rest = posterior.with_term(observation.without(rows))
    sampled = sample_until(rest, settings, np.random.SeedSequence(left.seed[0], spawn_key=left.seed[1:]))
    kept = sampled.chains.kept(sampled.verdict.burn_in, _DRAWS)
    theta = posterior.natural(kept.coordinates).reshape(-1, posterior.space.dimension)
    at = posterior.response(theta), posterior.rating_parameters(theta)
    density = observation.log_likelihood_blocks(*at, rows.astype(np.intp))[:, 1]
    return Anew(left.unit, float(logsumexp(density) - np.log(density.size)), sampled.verdict.converged)


LEAVE: Mapping[str, Leave] = MappingProxyType(
    {
        leave.name: leave
        for leave in (
            Leave("rating", _by_rating),
            Leave("participant", _stored("log_likelihood_participant", "ratings_of_participant")),
            Leave("fabric", _refit),
            Leave("condition", _by_condition),
        )
    }
)
"""The kinds of units to leave out, by name."""
