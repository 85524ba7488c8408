"""Simulated tables of every kind of ratings, each sampled until convergence, beside emcee's default moves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import emcee
import numpy as np

from softness_bayes.bench.precision import quickest, simulated
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.scales import RATING_SCALES
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.sampler.chain_statistics import pooled_time
from softness_bayes.sampler.sampling import Settings, walk
from softness_bayes.sampler.target import TargetDensity

KINDS: dict[str, dict[str, Any]] = {
    **{name: {"scale": scale} for name, scale in RATING_SCALES.items()},
    "whole numbers, heavy tails": {"resolution": 1.0, "errors": STUDENT},
}
"""Simulated tables by name: arguments of `simulate_ratings`."""


class Row(NamedTuple):
    """A table and its run."""

    table: str
    ratings: int
    parameters: int
    seconds: float
    """Time to convergence on all processors, without what follows the sampler."""
    evaluations: int
    """Parameter vectors evaluated, with those of optimisations and pilot."""
    microseconds: float
    """Processor time of the posterior for each of them."""
    converged: bool
    effective: float
    """Effective draws of the worst quantity per thousand evaluations, once converged."""
    effective_emcee: float
    """The same of emcee's default moves, begun at these draws."""


def sampled(quick: bool) -> Iterator[Row]:
    """Sample each table for at most ten minutes: of 180 ratings in a quick measurement, else of 1080."""
    for name, how in KINDS.items():
        ratings = simulated(5 if quick else 30, **how)
        options = {option: value for option, value in how.items() if option != "resolution"}
        posterior, begun = build(ratings, ModelOptions(**options)).posterior, time.monotonic()
        *_, state = walk(posterior, Settings(max_seconds=600.0), seed=1)
        seconds, verdict, target = time.monotonic() - begun, state.verdict, posterior.for_sampling
        assert verdict is not None, "a run that has ended was checked"
        points = np.concatenate([state.map.forward(one.coordinates) for one in state.ensembles])
        retained = verdict.kept * len(points)
        yield Row(
            name,
            len(ratings.ratings),
            len(posterior.names),
            seconds,
            state.nonfinite.evaluations,
            1e6 * quickest(partial(target, points), 5) / len(points),
            verdict.converged,
            1e3 * verdict.ess / retained,
            default_moves(target, points[: verdict.walkers], retained // verdict.walkers),
        )


def default_moves(target: TargetDensity, start: Any, steps: int) -> float:
    """Return the effective draws per thousand evaluations of emcee's default moves, for the worst parameter."""
    sampler = emcee.EnsembleSampler(*start.shape, target, vectorize=True)
    sampler.run_mcmc(emcee.State(start, random_state=np.random.RandomState(1).get_state()), steps)
    return float(1e3 / pooled_time(np.moveaxis(target.natural(sampler.get_chain()), -1, 0)).max())
