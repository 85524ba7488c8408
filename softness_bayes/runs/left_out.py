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


Predict = Callable[[Result, Settings, Callable[[str], None], Executor | None], LeftOut]
"""Predicts each unit of a result; takes settings of refits, a function called after each, and their executor."""


@dataclass(frozen=True)
class Leave:
    """A kind of unit to leave out, and the function that predicts each such unit."""

    name: str
    predict: Predict


def leave_by_weights(log_density: Array) -> LeftOut:
    """Weight posterior draws by 1 / p(unit | others, theta), to represent the posterior without the unit.

    Parameters
    ----------
    log_density
        log p(y_unit | y_others, theta), shape (draws, units).
    """
    weights, shape = arviz_bridge.psis(-log_density.T)
    return LeftOut(logsumexp(weights + log_density.T, axis=1), shape, len(log_density))


def _by_rating(result: Result, *_: Any) -> LeftOut:
    """Leave out each rating; lists and pairs, whose rows depend on one another, are left out as a whole."""
    if not result.scale.answer:
        return _stored(result, "log_likelihood", "rating")
    posterior = build(experiment_of(result), options_of(result)).posterior
    return leave_by_weights(posterior.observation.log_likelihood_answers(*_at_draws(posterior, result)))


def _by_participant(result: Result, *_: Any) -> LeftOut:
    return _stored(result, "log_likelihood_participant", "ratings_of_participant")


def _stored(result: Result, group: str, name: str) -> LeftOut:
    values = result.group(group)[name].values
    return leave_by_weights(values.reshape(-1, values.shape[-1]))


def _at_draws(posterior: Posterior, result: Result) -> tuple[Array, Any]:
    """Return mean rates and rating parameters at the draws to be weighted, in one batch."""
    values = result.values(_WEIGHTED)
    theta = np.stack([values[name] for name in posterior.names], axis=-1)
    return posterior.response(theta), posterior.rating_parameters(theta)


def _by_fabric(result: Result, *how: Any) -> LeftOut:
    """Refit the model without each fabric, because a fabric changes the posterior too much for importance weights."""
    ratings = experiment_of(result).ratings
    return _by_group(result, "fabric", ratings.fabric, ratings.fabrics, 1 << 21, False, *how)


def _by_condition(result: Result, *how: Any) -> LeftOut:
    """Leave out each fabric under each load by importance weights, or by refits if these fail."""
    ratings = experiment_of(result).ratings
    pairs = zip(ratings.conditions.fabric, ratings.conditions.load, strict=True)
    names = [f"{ratings.fabrics[fabric]} at {ratings.loads[load]}" for fabric, load in pairs]
    return _by_group(result, "condition", ratings.conditions.of_rating, names, 1 << 22, True, *how)


def _by_group(
    result: Result,
    unit: str,
    group: NDArray[np.intp],
    names: Sequence[str],
    key: int,
    weigh: bool,
    settings: Settings,
    progress: Callable[[str], None],
    executor: Executor | None = None,
) -> LeftOut:
    """Leave out groups of ratings, by importance weights where these are wanted and reliable, otherwise by refits.

    Parameters
    ----------
    unit
        What a group is, for messages.
    group, names
        Index of each rating's group, shape (ratings,), and the names of the groups.
    key
        Key of the seeds of refits.
    weigh
        Whether importance weights are tried first.
    """
    if (group == group[0]).all():
        raise InputError(f"compare: there is only one {unit}, so no data remain to predict it from")
    posterior = build(experiment_of(result), options_of(result)).posterior
    unknown = np.full(len(names), np.nan)
    left = LeftOut(unknown, unknown, 0)
    if weigh:
        left = leave_by_weights(posterior.observation.log_likelihood_blocks(*_at_draws(posterior, result), group))
    density, shape, seed = left.log_density.copy(), left.pareto_k.copy(), int(result.attributes["seed"])
    again = [k for k in range(len(names)) if not weigh or shape[k] > largest_pareto_k(left.draws)]
    without = [Without(k, names[k], group == k, (seed, key, k)) for k in again]
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
        "rating": Leave("rating", _by_rating),
        "participant": Leave("participant", _by_participant),
        "fabric": Leave("fabric", _by_fabric),
        "condition": Leave("condition", _by_condition),
    }
)
"""The kinds of units to leave out, by name."""
