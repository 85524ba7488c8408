"""First state of a run: walkers of all ensembles about points that the workers have optimised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from softness_bayes.errors import NumericalError
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.nonfinite import Nonfinite, watching
from softness_bayes.sampler.starts import (
    HasSamplingForm,
    Optimum,
    Starts,
    TargetDensity,
    find_optimum,
    scatter,
    separate,
    worth_starting_from,
)
from softness_bayes.sampler.state import EnsembleState, RunState
from softness_bayes.sampler.workers import Workers


def place_walkers(
    workers: Workers, seed: np.random.SeedSequence, ensembles: int, walkers: int, optima: int, first_look: int
) -> RunState:
    """Return the state from which a run starts.

    Parameters
    ----------
    workers
        Processes with the target as their resident object.
    seed
        Seed of all random numbers; each ensemble and each optimisation uses a child of it.
    ensembles, walkers, optima
        Numbers of ensembles, of walkers per ensemble, and of optimised points about which these start.
    first_look
        Step of the first convergence check.

    Raises
    ------
    NumericalError
        If the density is zero at all starting points.
    """
    # children by key, not by spawn(), whose result depends on how often it was called before
    seeds = [
        [np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, e, k)) for k in range(optima + 2)]
        for e in range(ensembles)
    ]
    climbs, failed = watched(workers, [(_climb, climb, k == 0) for own in seeds for k, climb in enumerate(own[2:])])
    climbed = iter(climbs)
    own_climbs = [[next(climbed) for _ in own[2:]] for own in seeds]
    groups = worth_starting_from(own_climbs)
    hopeful = {id(o): o for group in groups for o in group}
    (modes,), compared = watched(workers, [(separate, list(hopeful.values()))])
    maps = tuple(TriangularMap.affine(mode.point, mode.root) for mode in modes)
    tasks = [(_place, *own[:2], group, walkers) for own, group in zip(seeds, groups, strict=True)]
    placed, lost = watched(workers, tasks)
    return RunState(
        phase=0,
        steps=0,
        stride=1,
        due=first_look,
        ensembles=tuple(placed),
        map=TriangularMap.identity(placed[0].coordinates.shape[1]),
        parts=tuple(() for _ in placed),
        modes=maps if len(maps) > 1 else (),
        starts=Starts(len(climbs), len(climbs) - len(hopeful), len(maps)),
        nonfinite=failed + compared + lost,
    )


def watched(workers: Workers, tasks: list[tuple[Any, ...]]) -> tuple[list[Any], Nonfinite]:
    """Return the results of tasks (work, argument, ...), and the points at which the density could not be computed."""
    done = workers.map(_watch, tasks)
    return [value for value, _ in done], sum((found for _, found in done), Nonfinite())


def _watch(target: TargetDensity, work: Callable[..., Any], *task: Any) -> tuple[Any, Nonfinite]:
    return watching(work, target.for_sampling if isinstance(target, HasSamplingForm) else target, *task)


def _climb(target: TargetDensity, seed: np.random.SeedSequence, best: bool) -> Optimum:
    return find_optimum(target, np.random.default_rng(seed), best)


def _place(
    target: TargetDensity,
    seed: np.random.SeedSequence,
    walking: np.random.SeedSequence,
    optima: list[Optimum],
    walkers: int,
) -> EnsembleState:
    points, density = scatter(target, np.random.default_rng(seed), optima, walkers)
    if not np.isfinite(density).any():
        raise NumericalError("every walker starts where the probability is zero")
    random = np.random.RandomState(np.random.MT19937(walking)).get_state()
    return EnsembleState(points, density, tuple(random))
