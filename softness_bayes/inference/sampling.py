"""Independent ensembles of walkers, run until they have converged; the only module that knows emcee.

A run has three parts. Walkers start about optimised points (`starts`). In a pilot walk of a fixed number of
steps, the density's shape is learnt (`adaptation`); its draws are dropped. From then on nothing is adapted:
what follows is a Markov chain with the density as its law.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import emcee
import numpy as np
from emcee.moves import DEMove, MHMove, Move
from numpy.typing import NDArray

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.inference.adaptation import Mapped, StudentProposal, TriangularMap, learn
from softness_bayes.inference.autocorrelation import autocorrelation_time
from softness_bayes.inference.chains import Chains, Segment
from softness_bayes.inference.diagnostics import LOG_POSTERIOR, Goal, Verdict, look
from softness_bayes.inference.starts import Optimum, Target, find_optimum, scatter, worth_starting_from
from softness_bayes.inference.workers import Workers, available_processors

FloatArray = NDArray[np.float64]

Moves = tuple[tuple[Move, float], ...]

FIRST_MOVES: Moves = ((DEMove(), 0.9), (DEMove(gamma0=1.0), 0.1))
"""Proposals with their probabilities before anything is known of the density's shape."""

MOVES: Moves = (
    (MHMove(StudentProposal()), 0.6),
    (DEMove(), 0.37),
    (DEMove(gamma0=1.0), 0.03),  # carries a walker from one mode to another
)
"""Proposals with their probabilities in the coordinates of the learnt map.

emcee's snooker move is not among them: up to emcee 3.1.6 its acceptance takes half of the Jacobian's exponent,
which narrows what it samples (`tests/test_invariance.py` shows both).
"""


@dataclass(frozen=True)
class Settings:
    """How to sample.

    Parameters
    ----------
    ensembles
        Independent ensembles, at least two.
    walkers
        Walkers of each; chosen by dimension if left out.
    max_steps, max_seconds
        Where to stop without having converged.
    round_steps
        Steps between reports of progress, and the least between looks.
    processes
        Worker processes; one for each ensemble or processor, whichever are fewer, if left out. The draws do
        not depend on it.
    stored
        Largest number of stored steps of an ensemble; beyond it every second one is dropped, again and again.
    optima
        Optimised points about which the walkers of an ensemble start.
    pilot
        Steps of each stage of the pilot walk; after each the map is learnt anew from its second half.
    first_moves, moves
        Proposals with their probabilities in the first stage of the pilot, and from then on.
    goal
        When the run counts as converged.
    """

    ensembles: int = 4
    walkers: int | None = None
    max_steps: int = 100_000
    max_seconds: float = math.inf
    round_steps: int = 100
    processes: int | None = None
    stored: int = 20_000
    optima: int = 2
    pilot: tuple[int, ...] = (100, 200)
    first_moves: Moves = FIRST_MOVES
    moves: Moves = MOVES
    goal: Goal = field(default_factory=Goal)

    def __post_init__(self) -> None:
        least = {"ensembles": 2, "max_steps": 1, "round_steps": 1, "stored": 2, "optima": 1}
        for name, bound in least.items():
            if getattr(self, name) < bound:
                raise InputError(f"sampling: {name} is {getattr(self, name)}, expected at least {bound}")
        if self.processes is not None and self.processes < 1:
            raise InputError(f"sampling: processes is {self.processes}, expected at least 1")

    def walkers_for(self, dimension: int) -> int:
        """Walkers of each ensemble.

        Raises
        ------
        InputError
            If the number asked for is odd or below twice the dimension plus two.
        """
        if self.walkers is None:
            return max(20, 4 * dimension)
        if self.walkers % 2 or self.walkers < max(8, 2 * dimension + 2):
            least = max(8, 2 * dimension + 2)
            raise InputError(f"sampling: walkers is {self.walkers}, expected an even number from {least}")
        return self.walkers


class EnsembleState(NamedTuple):
    """All that is needed to continue an ensemble bit by bit, besides the map and the moves."""

    coordinates: FloatArray
    """Map coordinates y of the walkers, shape (walkers, dimension)."""
    log_density: FloatArray
    """Their log density in sampler coordinates, shape (walkers,)."""
    random: tuple[Any, ...]
    """State of the generator, as `numpy.random.RandomState.get_state` gives it."""


class Progress(NamedTuple):
    """Where a run is."""

    steps: int
    """Steps walked."""
    missing: int
    """Estimate of the steps still to go."""
    seconds: float
    """Time since the start."""
    verdict: Verdict | None
    """The last look; none before the first."""


class Sampled(NamedTuple):
    """What a run leaves behind."""

    chains: Chains
    """All stored steps, those before the burn-in of the verdict included."""
    verdict: Verdict
    """The last look."""


def advance(
    target: Target, state: EnsembleState, steps: int, moves: Moves, map: TriangularMap, stride: int = 1
) -> tuple[EnsembleState, Segment]:
    """Let one ensemble walk; two calls give bit by bit what one call over all the steps gives.

    Parameters
    ----------
    target
        Density to sample.
    state
        Where the ensemble is.
    steps
        Steps to walk, a multiple of ``stride``.
    moves
        Proposals with their probabilities.
    map
        Coordinates in which the moves are made.
    stride
        Steps of the walk for one stored.
    """
    walkers, dimension = state.coordinates.shape
    mapped = Mapped(target, map)
    sampler = emcee.EnsembleSampler(walkers, dimension, mapped, moves=list(moves), vectorize=True)
    # emcee takes any state without complaint and keeps NumPy's global one if it does not understand it
    sampler.random_state = state.random
    if not _same_random(sampler.random_state, state.random):
        raise NumericalError("the state of the random generator was not accepted")
    first = emcee.State(state.coordinates, log_prob=state.log_density, random_state=state.random)
    last = sampler.run_mcmc(first, steps // stride, thin_by=stride, skip_initial_state_check=True)
    accepted = np.asarray(sampler.backend.accepted, dtype=np.int64)
    segment = Segment(map.forward(sampler.get_chain()), sampler.get_log_prob(), accepted)
    return EnsembleState(last.coords, last.log_prob, last.random_state), segment


def sample_until(
    target: Target,
    settings: Settings = Settings(),
    seed: int | np.random.SeedSequence = 0,
    progress: Callable[[Progress], None] | None = None,
) -> Sampled:
    """Sample a density with independent ensembles until they have converged, or a limit is reached.

    Parameters
    ----------
    target
        Density to sample; it is sent to the worker processes once.
    settings
        How to sample.
    seed
        Decides the draws, together with target and settings but whatever the number of processes.
    progress
        Called after every round.

    Raises
    ------
    NumericalError
        If a likelihood is not finite, or starting points have probability zero.
    InputError
        If the settings do not suit the target.
    """
    begun = time.monotonic()
    walkers = settings.walkers_for(len(target.names))
    processes = settings.processes or min(settings.ensembles, available_processors())
    stride, steps, due = 1, 0, 3 * settings.round_steps
    verdict: Verdict | None = None
    parts: list[list[Segment]] = [[] for _ in range(settings.ensembles)]

    def report() -> None:
        if progress is not None:
            goal = verdict.steps + verdict.more_steps if verdict is not None else due
            progress(Progress(steps, max(goal - steps, 0), time.monotonic() - begun, verdict))

    with Workers(target, processes) as workers:
        report()
        states = _start(workers, settings, walkers, seed)
        states, map = _pilot(workers, settings, states)
        report()
        while True:
            size = _round(settings, steps, stride)
            states, segments = _walk(workers, states, size, settings.moves, map, stride)
            parts = [[*part, segment] for part, segment in zip(parts, segments, strict=True)]
            steps += size
            if steps // stride > settings.stored and steps % (2 * stride) == 0:
                parts = [[Segment.join(part).every(2)] for part in parts]
                stride *= 2
            over = steps + stride > settings.max_steps or time.monotonic() - begun >= settings.max_seconds
            if steps >= due or over:
                parts = [[Segment.join(part)] for part in parts]
                chains = Chains.of((part[0] for part in parts), steps, stride)
                verdict = _look(target, chains, verdict, settings.goal)
                due = steps + min(max(verdict.more_steps, settings.round_steps), steps)
                if over or verdict.converged:
                    report()
                    return Sampled(chains, verdict)
            report()


def _round(settings: Settings, steps: int, stride: int) -> int:
    """Steps of the next round: as asked or what is left, in whole strides and at least one."""
    most = min(-(-settings.round_steps // stride) * stride, settings.max_steps - steps)
    return max(most // stride * stride, stride)


def _look(target: Target, chains: Chains, before: Verdict | None, goal: Goal) -> Verdict:
    natural = target.natural(chains.coordinates)
    values = np.concatenate([natural, chains.log_density[..., None]], axis=-1)
    names = (*target.names, LOG_POSTERIOR)
    return look(names, values, chains.stride, float(chains.accepted.mean()), before, goal)


def _start(
    workers: Workers, settings: Settings, walkers: int, seed: int | np.random.SeedSequence
) -> list[EnsembleState]:
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # children by key, not by spawn(): the same seed gives the same draws however often it was spawned before
    seeds = [
        [np.random.SeedSequence(root.entropy, spawn_key=(*root.spawn_key, e, k)) for k in range(settings.optima + 2)]
        for e in range(settings.ensembles)
    ]
    climbed = iter(workers.map(_climb, [(climb,) for own in seeds for climb in own[2:]]))
    groups = worth_starting_from([next(climbed) for _ in own[2:]] for own in seeds)
    tasks = [(*own[:2], group, walkers) for own, group in zip(seeds, groups, strict=True)]
    return workers.map(_place, tasks)


def _climb(target: Target, seed: np.random.SeedSequence) -> Optimum:
    return find_optimum(target, np.random.default_rng(seed))


def _place(
    target: Target,
    placing: np.random.SeedSequence,
    walking: np.random.SeedSequence,
    optima: list[Optimum],
    walkers: int,
) -> EnsembleState:
    points, density = scatter(target, np.random.default_rng(placing), optima, walkers)
    if not np.isfinite(density).any():
        raise NumericalError("every walker starts where the probability is zero")
    random = np.random.RandomState(np.random.MT19937(walking)).get_state()
    return EnsembleState(points, density, tuple(random))


def _pilot(
    workers: Workers, settings: Settings, states: list[EnsembleState]
) -> tuple[list[EnsembleState], TriangularMap]:
    """Walk the stages of the pilot and learn a map for all ensembles after each."""
    map, moves = TriangularMap.identity(states[0].coordinates.shape[1]), settings.first_moves
    for steps in settings.pilot:
        states, segments = _walk(workers, states, steps, moves, map, 1)
        late = np.stack([segment.coordinates[steps // 2 :] for segment in segments])
        height = np.stack([segment.log_density[steps // 2 :] for segment in segments])
        tau = autocorrelation_time(np.moveaxis(late, -1, 1)).max()
        learnt = learn(late, height, min(float(tau), steps))
        states = [s._replace(coordinates=learnt.inverse(map.forward(s.coordinates))) for s in states]
        map, moves = learnt, settings.moves
    return states, map


def _walk(
    workers: Workers,
    states: list[EnsembleState],
    steps: int,
    moves: Moves,
    map: TriangularMap,
    stride: int,
) -> tuple[list[EnsembleState], list[Segment]]:
    walked = workers.map(advance, [(state, steps, moves, map, stride) for state in states])
    return [state for state, _ in walked], [segment for _, segment in walked]


def _same_random(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
