"""Independent ensembles of walkers, run until convergence.

A run has three parts. Walkers start about optimised points (`starts`). In a pilot run with a fixed number of steps, the
shape of the density is learnt (`adaptation`); its draws are dropped. If a check finds the subsequent sampling slow, it
becomes one more stage of the pilot, at most a few times. After that nothing is adapted, and the run is a Markov chain
with the density as its stationary distribution.

The chain depends only on target, settings and seed. A run is a sequence of states (`walk`), from each of which the same
chain continues, regardless of the speed of the machine and of interruptions: the steps at which it is checked depend
only on the chain, and a check at a limit does not change it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.base.ranges import PROCESSES, STEPS
from softness_bayes.sampler.chains import Chains, RunState
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.ensembles import advance
from softness_bayes.sampler.moves import FIRST_MOVES, MANY_DIMENSIONS, MANY_DIMENSIONS_MOVES, MOVES, Moves
from softness_bayes.sampler.schedule import Schedule
from softness_bayes.sampler.starts import place_walkers, watched
from softness_bayes.sampler.target import TargetDensity
from softness_bayes.sampler.workers import Workers, available_processors

MANY_WALKERS = 80
"""Default number of walkers, four per dimension, is capped at this value unless the moves require more."""

PATIENCE = 2.0
"""Time [s] between reports of an ensemble, which limits the loss if the run is terminated."""


FIRST_LOOK = Schedule().first_look
"""Number of steps before the default first check of the chains."""


@dataclass(frozen=True, kw_only=True)
class Settings(Schedule):
    """Settings of the sampler: a `Schedule`, the ensembles and their moves.

    Parameters
    ----------
    ensembles
        Number of independent ensembles, at least two.
    walkers
        Number of walkers of each; the default depends on the dimension.
    processes
        Number of worker processes; by default one per ensemble or processor, whichever is fewer. The draws do not
        depend on it.
    together
        Number of ensembles that walk together in a process, so that one call evaluates the points of all.
    optima
        Number of optimised points about which the walkers of an ensemble start.
    first_moves, moves
        Proposals with their probabilities in the first stage of the pilot, and afterwards.
    failures
        Largest tolerated share of evaluated points with a density of NaN; above it, the run stops.
    """

    ensembles: int = 4
    walkers: int | None = None
    processes: int | None = None
    together: int = 2
    optima: int = 2
    first_moves: Moves = FIRST_MOVES
    moves: Moves = MOVES
    failures: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, bound in {"ensembles": 2, "together": 1, "optima": 1}.items():
            if getattr(self, name) < bound:
                raise InputError(f"sampling: {name} is {getattr(self, name)}, expected at least {bound}")
        if self.processes is not None:
            PROCESSES.require("sampling: processes", self.processes)
        STEPS.require("sampling: max_steps", self.max_steps)

    def workers(self, target: TargetDensity) -> Workers:
        """Return the worker processes for the ensembles, each with a copy of the target."""
        return Workers(target, self.processes or min(self.ensembles, available_processors()))

    def walkers_for(self, dimension: int) -> int:
        """Return the number of walkers of each ensemble.

        Raises
        ------
        InputError
            If the requested number is odd or below twice the dimension plus two.
        """
        if self.walkers is None:
            return max(20, min(4 * dimension, max(MANY_WALKERS, 2 * dimension + 2)))
        if self.walkers % 2 or self.walkers < max(8, 2 * dimension + 2):
            least = max(8, 2 * dimension + 2)
            raise InputError(f"sampling: walkers is {self.walkers}, expected an even number from {least}")
        return self.walkers

    def usual_evaluations(self, dimension: int) -> int:
        """Return the number of points at which a run evaluates its target if its first checks find it converged."""
        return self.ensembles * self.walkers_for(dimension) * (sum(self.pilot) + 3 * self.round_steps)

    def moves_for(self, dimension: int) -> Moves:
        """Return the moves after the first stage; the default depends on the dimension."""
        return MANY_DIMENSIONS_MOVES if self.moves is MOVES and dimension > MANY_DIMENSIONS else self.moves

    def description(self, dimension: int) -> dict[str, str]:
        """Return the settings that affect the draws, by name, without limits and processes."""
        named = ("ensembles", "round_steps", "stored", "optima", "pilot", "relearning", "slow", "goal")
        plain = {name: getattr(self, name) for name in named}
        made = {"first_moves": self.first_moves, "moves": self.moves_for(dimension)}
        moves = {name: " + ".join(f"{share:g} {proposal}" for proposal, share in of) for name, of in made.items()}
        return {"walkers": str(self.walkers_for(dimension)), **{n: str(v) for n, v in plain.items()}, **moves}


class Progress(NamedTuple):
    """Progress of a run."""

    steps: int
    """Number of completed steps."""
    missing: int
    """Estimated number of remaining steps."""
    seconds: float
    """Time since the start, including earlier sessions."""
    verdict: Verdict | None
    """The last convergence check; None before the first."""
    failures: int = 0
    """Points at which the density could not be computed."""
    pilot: int = 0
    """Number of remaining steps of the pilot run."""


class Sampled(NamedTuple):
    """Result of a run."""

    chains: Chains
    """All stored steps, including the burn-in of the verdict."""
    verdict: Verdict
    """The last convergence check."""


def walk(
    target: TargetDensity,
    settings: Settings = Settings(),
    seed: int | np.random.SeedSequence = 0,
    begin: RunState | None = None,
    workers: Workers | None = None,
) -> Iterator[RunState]:
    """Sample a density with independent ensembles, yielding states until `RunState.ended`.

    Parameters
    ----------
    target
        Density to sample; it is sent to the worker processes once.
    settings
        Settings of the sampler.
    seed
        Seed of the draws, which do not depend on the number of processes.
    begin
        State of a run with the same target, settings and seed from which to continue; limits may differ.
    workers
        Processes with the target, from `Settings.workers`; by default new ones.

    Raises
    ------
    NumericalError
        If the density is zero at all starting points, or could not be computed at more than the tolerated share of
        points (raised after the state that records it).
    InputError
        If the settings are incompatible with the target.
    """
    begun = time.monotonic()
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    before = begin.seconds if begin is not None else 0.0
    walkers = settings.walkers_for(len(target.names))
    pace = math.inf  # steps per second, initially unknown

    with nullcontext(workers) if workers is not None else settings.workers(target) as workers:
        state = begin or place_walkers(workers, root, settings.ensembles, walkers, settings.optima, settings.first_look)
        while True:
            spent = time.monotonic() - begun
            state = settings.settle(target, replace(state, seconds=before + spent), spent >= settings.max_seconds)
            yield state
            if state.nonfinite.share > settings.failures:
                said = state.nonfinite.sentence(target.names, target.natural)
                raise NumericalError(f"stopped after {state.steps} steps: {said}")
            if state.ended:
                return
            state = settings.relearned(target, state)
            size = settings.next_steps(state, PATIENCE * pace)
            since = time.monotonic()
            state = _advance(workers, settings, state, size)
            pace = size / max(time.monotonic() - since, 1e-9)


def sample_until(
    target: TargetDensity,
    settings: Settings = Settings(),
    seed: int | np.random.SeedSequence = 0,
    progress: Callable[[Progress], None] | None = None,
) -> Sampled:
    """Sample a density with independent ensembles until convergence or a limit.

    Parameters
    ----------
    target, settings, seed
        As for `walk`.
    progress
        Function called after every state of the run.

    Raises
    ------
    NumericalError, InputError
        As for `walk`.
    """
    for state in walk(target, settings, seed):
        if progress is not None:
            progress(progress_of(state, settings))
    return sampled_of(state)


def sampled_of(state: RunState) -> Sampled:
    """Return the result of a run that has ended."""
    if not state.ended or state.verdict is None:
        raise ValueError("the run has not ended")
    return Sampled(state.chains, state.verdict)


def progress_of(state: RunState, settings: Settings) -> Progress:
    """Return the progress of a run."""
    pilot = sum(settings.pilot[state.phase :]) - state.steps if settings.in_pilot(state) else 0
    steps = 0 if pilot else state.steps
    return Progress(steps, settings.missing(state), state.seconds, state.verdict, state.nonfinite.count, pilot)


def _advance(workers: Workers, settings: Settings, state: RunState, steps: int) -> RunState:
    """Advance all ensembles."""
    first = state.phase == 0 and bool(settings.pilot)
    dimension = state.ensembles[0].coordinates.shape[-1]
    moves = settings.first_moves if first else settings.moves_for(dimension)
    groups = [state.ensembles[k : k + settings.together] for k in range(0, settings.ensembles, settings.together)]
    tasks = [(advance, group, steps, moves, state.map, state.stride, state.modes) for group in groups]
    walked, found = watched(workers, tasks)
    ensembles, segments = zip(*chain.from_iterable(walked), strict=True)
    parts = tuple((*part, segment) for part, segment in zip(state.parts, segments, strict=True))
    return replace(
        state, steps=state.steps + steps, ensembles=ensembles, parts=parts, nonfinite=state.nonfinite + found
    )
