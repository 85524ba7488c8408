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

from softness_bayes.base import arviz_bridge
from softness_bayes.base.errors import InputError
from softness_bayes.checking.exactness import largest_pareto_k
from softness_bayes.model.posterior import Posterior
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.result import Result
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.sampler.workers import Workers, available_processors

Array = NDArray[np.float64]

_WEIGHTED = 1000  # posterior draws that are weighted to leave out a condition
_DRAWS = 10_000  # draws of a refit


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


class Refits(NamedTuple):
    """Refits of models without a unit."""

    settings: Settings
    """Settings of the sampler."""
    progress: Callable[[str], None] = lambda unit: None
    """Function called with the name of the unit after each refit."""
    executor: Executor | None = None
    """Executor that runs refits instead of `settings.processes` processes, one task per refit, with the same draws."""


@dataclass(frozen=True)
class Leave:
    """A kind of unit to leave out, and the function that predicts each such unit of a result."""

    name: str
    predict: Callable[[Result, Refits], LeftOut]


def leave_by_weights(log_density: Array) -> LeftOut:
    """Weight posterior draws by 1 / p(unit | others, theta), to represent the posterior without the unit.

    Parameters
    ----------
    log_density
        log p(y_unit | y_others, theta), shape (draws, units).
    """
    weights, shape = arviz_bridge.psis(-log_density.T)
    return LeftOut(logsumexp(weights + log_density.T, axis=1), shape, len(log_density))


def _by_rating(result: Result, _: Refits) -> LeftOut:
    """Leave out each rating; lists and pairs, whose rows depend on one another, are left out as a whole."""
    if not result.scale.answer:
        return _stored(result, "log_likelihood", "rating")
    fitted = Fitted(result, _WEIGHTED)
    return leave_by_weights(fitted.posterior.observation.log_likelihood_answers(*_at_draws(fitted)))


def _by_response(result: Result, _: Refits) -> LeftOut:
    """Leave out each response of recorded afferents."""
    if not result.has_afferents:
        raise InputError(f"compare: {result.source} has no recorded afferents, whose responses could be held out")
    return _stored(result, "log_likelihood", "recorded_rate_hz")


def _stored(result: Result, group: str, name: str) -> LeftOut:
    values = result.group(group)[name].values
    return leave_by_weights(values.reshape(-1, values.shape[-1]))


def _at_draws(fitted: Fitted) -> tuple[Array, Any]:
    """Return mean rates and rating parameters at the draws to be weighted, in one batch."""
    return fitted.posterior.response(fitted.theta), fitted.posterior.rating_parameters(fitted.theta)


def _by_fabric(result: Result, refits: Refits) -> LeftOut:
    """Refit the model without each fabric, because a fabric changes the posterior too much for importance weights."""
    fitted, seed = Fitted(result, 1), (int(result.attributes["seed"]), 1 << 21)
    ratings = fitted.model.data.ratings
    unknown = np.full(len(ratings.fabrics), np.nan)
    none = LeftOut(unknown, unknown, 0)
    return _refitted(fitted.posterior, "fabric", ratings.fabric, ratings.fabrics, none, seed, refits)


def _by_condition(result: Result, refits: Refits) -> LeftOut:
    """Leave out each fabric under each load by importance weights, or by refits if these fail."""
    fitted, seed = Fitted(result, _WEIGHTED), (int(result.attributes["seed"]), 1 << 22)
    ratings = fitted.model.data.ratings
    group, pairs = ratings.conditions.of_rating, zip(ratings.conditions.fabric, ratings.conditions.load, strict=True)
    names = [f"{ratings.fabrics[fabric]} at {ratings.loads[load]}" for fabric, load in pairs]
    left = leave_by_weights(fitted.posterior.observation.log_likelihood_blocks(*_at_draws(fitted), group))
    return _refitted(fitted.posterior, "condition", group, names, left, seed, refits)


def _refitted(
    posterior: Posterior,
    unit: str,
    group: NDArray[np.intp],
    names: Sequence[str],
    left: LeftOut,
    seed: tuple[int, int],
    refits: Refits,
) -> LeftOut:
    """Refit a model without each group of ratings whose importance weights are missing or unreliable.

    Parameters
    ----------
    unit
        What a group is, for messages.
    group, names
        Index of each rating's group, shape (ratings,), and the names of the groups.
    left
        Predictions by importance weights, NaN where there are none.
    seed
        Seed of the run, and key of the seeds of refits.
    """
    if (group == group[0]).all():
        raise InputError(f"compare: there is only one {unit}, so no data remain to predict it from")
    settings, unfinished = replace(refits.settings, processes=1), 0
    density, shape = left.log_density.copy(), left.pareto_k.copy()
    again = np.flatnonzero(shape > largest_pareto_k(left.draws)) if left.draws else np.arange(len(shape))
    processes = min(refits.settings.processes or available_processors(), max(len(again), 1))
    tasks = [(int(k), group == k, (*seed, int(k)), settings) for k in again]
    with Workers(posterior, processes, refits.executor) as workers:
        for k, density[k], converged in workers.as_finished(_without, tasks):
            shape[k] = np.nan
            unfinished += not converged
            refits.progress(names[k])
    return LeftOut(density, shape, left.draws, unfinished)


def _without(
    posterior: Posterior, unit: int, rows: NDArray[np.bool_], seed: tuple[int, int, int], settings: Settings
) -> tuple[int, float, bool]:
    """Refit a model without some ratings; return their log density given all others, and whether it has converged."""
    observation = posterior.observation
    rest = posterior.with_term(observation.without(rows))
    sampled = sample_until(rest, settings, np.random.SeedSequence(seed[0], spawn_key=seed[1:]))
    kept = sampled.chains.kept(sampled.verdict.burn_in, _DRAWS)
    theta = posterior.natural(kept.coordinates).reshape(-1, posterior.space.dimension)
    at = posterior.response(theta), posterior.rating_parameters(theta)
    density = observation.log_likelihood_blocks(*at, rows.astype(np.intp))[:, 1]
    return unit, float(logsumexp(density) - np.log(density.size)), sampled.verdict.converged


LEAVE: Mapping[str, Leave] = MappingProxyType(
    {
        "rating": Leave("rating", _by_rating),
        "participant": Leave(
            "participant", lambda result, _: _stored(result, "log_likelihood_participant", "ratings_of_participant")
        ),
        "fabric": Leave("fabric", _by_fabric),
        "condition": Leave("condition", _by_condition),
        "response": Leave("recorded response", _by_response),
    }
)
"""The kinds of units to leave out, by name."""
