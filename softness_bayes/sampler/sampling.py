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
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.base.ranges import PROCESSES, STEPS
from softness_bayes.sampler.chain_statistics import own_time
from softness_bayes.sampler.chains import Chains, RunState, Segment
from softness_bayes.sampler.diagnostics import LOG_POSTERIOR, Goal, Verdict, look
from softness_bayes.sampler.ensembles import advance
from softness_bayes.sampler.modes import labels, learn_modes
from softness_bayes.sampler.moves import FIRST_MOVES, MANY_DIMENSIONS, MANY_DIMENSIONS_MOVES, MOVES, Moves
from softness_bayes.sampler.starts import place_walkers, watched
from softness_bayes.sampler.target import TargetDensity
from softness_bayes.sampler.workers import Workers, available_processors

MANY_WALKERS = 80
"""Default number of walkers, four per dimension, is capped at this value unless the moves require more."""

PATIENCE, RARELY = 2.0, 20.0
"""Time [s] between two states of a run, which limits the loss if it is terminated; longer if it is less than so many
times as long as what is done with a state, such as writing it, takes."""

APART = 0.05
"""Smallest number of steps between two checks, as a share of the run."""

NUMBERS, LEAST_STORED = 40_000_000, 1000
"""Largest number of stored numbers of all ensembles, and the stored steps of an ensemble that it always allows.

A slow run of many parameters, whose neighbouring steps are nearly the same, would otherwise fill the memory, and each
check would take longer than the steps since the last. A thousand stored steps suffice for the autocorrelation times of
a run that converges, whose length is at least ten of them.
"""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of the sampler: the schedule of a run, the ensembles and their moves.

    The schedule depends on the number of steps and on the draws, never on the clock or on interruptions. Only a limit
    can end a run at other steps, and the check made there does not change the chain.

    Parameters
    ----------
    pilot
        Number of steps of each stage of the pilot run; after each stage the map is refitted to its second half.
    relearning
        Number of times that a slow run may become one more stage of the pilot.
    slow
        Retained steps, in autocorrelation times, below which a run is slow: about half of what convergence requires.
        A map learnt from all that has been walked then usually saves more steps than are dropped.
    round_steps
        The first check is made after twice this number of steps, the others at multiples of a quarter of it.
    stored
        Largest number of stored steps of an ensemble, or fewer if together they exceed `NUMBERS`; when a check finds
        more, every second one is dropped.
    goal
        Criteria of convergence.
    min_steps
        Smallest number of steps, even if the run has converged earlier.
    max_steps, max_seconds
        Limits at which a run stops without convergence; steps are counted since the last map, time is that of this
        session.
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

    pilot: tuple[int, ...] = (100, 200)
    relearning: int = 4
    slow: float = 5.0
    round_steps: int = 100
    stored: int = 20_000
    goal: Goal = field(default_factory=Goal)
    min_steps: int = 0
    max_steps: int = 100_000
    max_seconds: float = math.inf
    ensembles: int = 4
    walkers: int | None = None
    processes: int | None = None
    together: int = 2
    optima: int = 2
    first_moves: Moves = FIRST_MOVES
    moves: Moves = MOVES
    failures: float = 1e-3

    def __post_init__(self) -> None:
        bounds = {"max_steps": 1, "min_steps": 0, "round_steps": 1, "stored": 2, "max_seconds": 0}
        for name, bound in (bounds | {"ensembles": 2, "together": 1, "optima": 1}).items():
            if not getattr(self, name) >= bound:
                raise InputError(f"sampling: {name} is {getattr(self, name)}, expected at least {bound}")
        if any(stage < 2 for stage in self.pilot):
            raise InputError(f"sampling: pilot is {self.pilot}, expected stages of at least 2 steps")
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

    @property
    def first_look(self) -> int:
        """Steps before the first convergence check."""
        return 2 * self.round_steps

    def in_pilot(self, state: RunState) -> bool:
        """Return whether a run is still in its pilot stage, whose draws are not used."""
        return state.phase < len(self.pilot)

    def settle(self, target: TargetDensity, state: RunState, late: bool) -> RunState:
        """Perform what is due: learn a map, thin the stored steps, check the chains, end the run.

        Parameters
        ----------
        target
            The density to sample.
        state
            State of the run.
        late
            Whether its time limit is reached.
        """
        while self.in_pilot(state) and state.steps == self.pilot[state.phase]:
            state = _learn(target, state)
        if self.in_pilot(state) or not state.steps:
            return state
        if state.steps >= state.due:
            state = self._checked(target, state)
        last = state.verdict if state.verdict is not None and state.verdict.steps == state.steps else None
        if late or state.steps + state.stride > self.max_steps:
            return replace(state, ended=True, verdict=last or _look(target, state, self.goal))
        return replace(state, ended=last is not None and last.converged and state.steps >= self.min_steps)

    def _checked(self, target: TargetDensity, state: RunState) -> RunState:
        """Return the state after a scheduled check, with the step of the next one.

        Whether the run is slow is decided here alone, so that it does not depend on limits.
        """
        at_each_step = sum(one.coordinates.size + one.log_density.size for one in state.ensembles)
        most = min(self.stored, max(NUMBERS // at_each_step, LEAST_STORED))
        while state.steps // state.stride > most and state.steps % (2 * state.stride) == 0:
            halved = tuple((Segment.join(part).every(2),) for part in state.parts)
            state = replace(state, parts=halved, stride=2 * state.stride)
        verdict = _look(target, state, self.goal)
        # times about individual means would not do: of walkers that hardly move, they are a tenth of the run's length
        slow = verdict.lengths < self.slow and 0 <= state.phase - len(self.pilot) < self.relearning
        slow = slow and state.steps >= 2 * state.relearnt  # a map that is no better needs a longer run to learn from
        # at least a share of the run, because a check of a long run takes longer than a few steps
        wait = min(max(verdict.more_steps, math.ceil(APART * state.steps)), state.steps)
        quarter = -(-max(self.round_steps // 4, 1) // state.stride) * state.stride
        due = -(-(state.steps + wait) // quarter) * quarter
        joined = tuple((Segment.join(part),) for part in state.parts)
        return replace(state, parts=joined, slow=slow, verdict=verdict, due=due)

    def next_steps(self, state: RunState, affordable: float) -> int:
        """Return the number of steps to the next state (check, limit or affordable number), in whole strides."""
        end = self.pilot[state.phase] if self.in_pilot(state) else min(state.due, self.max_steps)
        return max(int(min(end - state.steps, affordable)) // state.stride * state.stride, state.stride)

    def missing(self, state: RunState) -> int:
        """Return an estimate of the remaining steps of a run after its pilot."""
        if state.ended:
            return 0
        steps = 0 if self.in_pilot(state) else state.steps
        goal = state.due if state.verdict is None else state.verdict.steps + state.verdict.more_steps
        return max(min(max(goal, self.min_steps), self.max_steps) - steps, 0)


FIRST_LOOK = Settings().first_look
"""Number of steps before the default first check of the chains."""


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
    pace = 10.0  # steps per second, until they are known

    with nullcontext(workers) if workers is not None else settings.workers(target) as workers:
        state = begin or place_walkers(workers, root, settings.ensembles, walkers, settings.optima, settings.first_look)
        while True:
            spent = time.monotonic() - begun
            state = settings.settle(target, replace(state, seconds=before + spent), spent >= settings.max_seconds)
            since = time.monotonic()
            yield state
            patience = max(PATIENCE, RARELY * (time.monotonic() - since))
            if state.nonfinite.share > settings.failures:
                said = state.nonfinite.sentence(target.names, target.natural)
                raise NumericalError(f"stopped after {state.steps} steps: {said}")
            if state.ended:
                return
            if state.slow:  # of a run that ended at a limit, on continuation
                steps, state = state.steps, _learn(target, state)
                state = replace(state, stride=1, due=settings.first_look, relearnt=steps, slow=False, verdict=None)
            size = settings.next_steps(state, patience * pace)
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
    dimension = state.ensembles[0].coordinates.shape[-1]
    moves = settings.first_moves if state.phase == 0 and settings.pilot else settings.moves_for(dimension)
    groups = [state.ensembles[k : k + settings.together] for k in range(0, settings.ensembles, settings.together)]
    tasks = [(advance, group, steps, moves, state.map, state.stride, state.modes) for group in groups]
    walked, found = watched(workers, tasks)
    ensembles, segments = zip(*chain.from_iterable(walked), strict=True)
    parts = tuple((*part, segment) for part, segment in zip(state.parts, segments, strict=True))
    return replace(
        state, steps=state.steps + steps, ensembles=ensembles, parts=parts, nonfinite=state.nonfinite + found
    )


def _look(target: TargetDensity, state: RunState, goal: Goal) -> Verdict:
    chains = state.chains
    natural = target.natural(chains.coordinates)
    values = np.concatenate([natural, chains.log_density[..., None]], axis=-1)
    names = (*target.names, LOG_POSTERIOR)
    inside = None
    if state.modes:
        inside = labels(state.modes, chains.coordinates)[..., None] == np.arange(len(state.modes))
    return look(names, values, chains.stride, goal, inside, state.starts)


def _learn(target: TargetDensity, state: RunState) -> RunState:
    """End a stage of the pilot: learn a map, or one per mode, from its second half, and drop its draws."""
    segments = [Segment.join(part) for part in state.parts]
    stored = state.steps // state.stride
    late = np.stack([segment.coordinates[stored // 2 :] for segment in segments])
    height = np.stack([segment.log_density[stored // 2 :] for segment in segments])
    tau = own_time(np.moveaxis(late, -1, 1)).max()  # walkers may not have come together yet
    modes = learn_modes(state.modes, late, height, min(float(tau), stored), getattr(target, "n_linear", 0))
    learnt = modes[0]
    moved = tuple(
        one._replace(coordinates=learnt.inverse(state.map.forward(one.coordinates))) for one in state.ensembles
    )
    parts: tuple[tuple[Segment, ...], ...] = tuple(() for _ in state.parts)
    several = modes if len(modes) > 1 else ()
    return replace(state, phase=state.phase + 1, steps=0, ensembles=moved, map=learnt, parts=parts, modes=several)
