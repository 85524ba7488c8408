"""Schedule of a run: convergence checks, thinning, the transition from pilot to sampling, and the end.

The schedule depends on the number of steps and on the draws, never on the clock or on interruptions. Only a limit can
end a run at other steps, and the check made there does not change the chain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from softness_bayes.base.errors import InputError
from softness_bayes.sampler.chain_statistics import own_time
from softness_bayes.sampler.chains import RunState, Segment
from softness_bayes.sampler.diagnostics import LOG_POSTERIOR, Goal, Verdict, look
from softness_bayes.sampler.modes import labels, learn_modes
from softness_bayes.sampler.target import TargetDensity

APART = 0.05
"""Smallest number of steps between two checks, as a share of the run."""

NUMBERS, LEAST_STORED = 40_000_000, 1000
"""Largest number of stored numbers of all ensembles, and the stored steps of an ensemble that it always allows.

A slow run of many parameters, whose neighbouring steps are nearly the same, would otherwise fill the memory, and each
check would take longer than the steps since the last. A thousand stored steps suffice for the autocorrelation times of
a run that converges, whose length is at least ten of them.
"""

PARTS = 4
"""Number of possible checks per round; stored steps are thinned at the end of a round."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Length of a run, and its schedule.

    Parameters
    ----------
    pilot
        Number of steps of each stage of the pilot run; after each stage the map is refitted to its second half.
    relearning
        Number of times that a slow run may become one more stage of the pilot.
    slow
        Retained steps, in autocorrelation times, below which a run is slow.
    round_steps
        The first check is made after twice this number of steps, the others at multiples of a quarter of it.
    stored
        Largest number of stored steps of an ensemble, or fewer if together they exceed `NUMBERS`; when it is exceeded,
        every second one is dropped.
    goal
        Criteria of convergence.
    min_steps
        Smallest number of steps, even if the run has converged earlier.
    max_steps, max_seconds
        Limits at which a run stops without convergence; steps are counted since the last map, time is that of this
        session.
    """

    pilot: tuple[int, ...] = (100, 200)
    relearning: int = 4
    slow: float = 3.0
    round_steps: int = 100
    stored: int = 20_000
    goal: Goal = field(default_factory=Goal)
    min_steps: int = 0
    max_steps: int = 100_000
    max_seconds: float = math.inf

    def __post_init__(self) -> None:
        for name, bound in {"max_steps": 1, "min_steps": 0, "round_steps": 1, "stored": 2, "max_seconds": 0}.items():
            if not getattr(self, name) >= bound:
                raise InputError(f"sampling: {name} is {getattr(self, name)}, expected at least {bound}")
        if any(stage < 2 for stage in self.pilot):
            raise InputError(f"sampling: pilot is {self.pilot}, expected stages of at least 2 steps")

    @property
    def first_look(self) -> int:
        """Steps before the first convergence check."""
        return 2 * self.round_steps

    def relearned(self, target: TargetDensity, state: RunState) -> RunState:
        """Return the state from which to continue: with a new map and no draws if the last check found the run slow.

        The decision is made at a scheduled check (`settle`), so that it does not depend on limits; for a run that ended
        there, it takes effect on continuation.
        """
        if not state.slow:
            return state
        new = replace(_learn(target, state), stride=1, due=self.first_look, relearnt=state.steps)
        return replace(new, slow=False, verdict=None)

    def _is_slow(self, state: RunState, verdict: Verdict) -> bool:
        """Return whether a run should become one more stage of the pilot."""
        # times about individual means would not do: of walkers that hardly move, they are a tenth of the run's length
        return (
            0 <= state.phase - len(self.pilot) < self.relearning
            and verdict.lengths < self.slow
            and state.steps >= 2 * state.relearnt  # a map that is no better needs a longer run to learn from
        )

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
        while (
            state.steps // state.stride > self._most_stored(state)
            and state.steps % self._grid(state) == 0
            and state.steps % (2 * state.stride) == 0
        ):
            halved = tuple((Segment.join(part).every(2),) for part in state.parts)
            state = replace(state, parts=halved, stride=2 * state.stride)
        if state.steps >= state.due and state.steps % self._grid(state, PARTS) == 0:
            verdict = _look(target, state, self.goal)
            # at least a share of the run, because a check of a long run takes longer than a few steps
            wait = max(verdict.more_steps, math.ceil(APART * state.steps))
            joined = tuple((Segment.join(part),) for part in state.parts)
            due = state.steps + min(wait, state.steps)
            state = replace(state, parts=joined, slow=self._is_slow(state, verdict), verdict=verdict, due=due)
        last = state.verdict if state.verdict is not None and state.verdict.steps == state.steps else None
        if late or state.steps + state.stride > self.max_steps:
            return replace(state, ended=True, verdict=last or _look(target, state, self.goal))
        return replace(state, ended=last is not None and last.converged and state.steps >= self.min_steps)

    def next_steps(self, state: RunState, affordable: float) -> int:
        """Return the number of steps to the next state (check, limit or affordable number), in whole strides."""
        if self.in_pilot(state):
            most = self.pilot[state.phase] - state.steps
        else:
            grid, fine = self._grid(state), self._grid(state, PARTS)
            check = fine * max(-(-state.due // fine), state.steps // fine + 1)
            most = min(grid - state.steps % grid, check - state.steps, self.max_steps - state.steps)
        return max(int(min(most, affordable)) // state.stride * state.stride, state.stride)

    def missing(self, state: RunState) -> int:
        """Return an estimate of the remaining steps of a run after its pilot."""
        if state.ended:
            return 0
        steps = 0 if self.in_pilot(state) else state.steps
        goal = state.due if state.verdict is None else state.verdict.steps + state.verdict.more_steps
        return max(min(max(goal, self.min_steps), self.max_steps) - steps, 0)

    def _most_stored(self, state: RunState) -> int:
        """Return the largest number of stored steps of an ensemble."""
        at_each_step = sum(one.coordinates.size + one.log_density.size for one in state.ensembles)
        return min(self.stored, max(NUMBERS // at_each_step, LEAST_STORED))

    def _grid(self, state: RunState, parts: int = 1) -> int:
        """Return the steps of a round, or of one of its equal parts, in whole strides."""
        return -(-max(self.round_steps // parts, 1) // state.stride) * state.stride


def _look(target: TargetDensity, state: RunState, goal: Goal) -> Verdict:
    chains = state.chains
    natural = target.natural(chains.coordinates)
    values = np.concatenate([natural, chains.log_density[..., None]], axis=-1)
    names = (*target.names, LOG_POSTERIOR)
    inside = None
    if state.modes:
        inside = labels(state.modes, chains.coordinates)[..., None] == np.arange(len(state.modes))
    return look(names, values, chains.stride, float(chains.accepted.mean()), goal, inside, state.starts)


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
