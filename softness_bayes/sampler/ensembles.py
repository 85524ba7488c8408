"""Steps of ensembles of walkers, evaluated together, with emcee's rules.

A call of a density for a few dozen points costs little more than one for half as many, because most of its time goes
into NumPy's calls. Several ensembles therefore make each step together: one call evaluates the proposals of all. Every
ensemble has its own random generator, so that its draws are those that it would have alone, and bitwise those of
`emcee.EnsembleSampler` with the same proposals (`tests/sampler/test_ensembles.py`).
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState, Segment, random_state
from softness_bayes.sampler.moves import Mode, Moves, Proposal, fitted
from softness_bayes.sampler.target import TargetDensity

FloatArray = NDArray[np.float64]


def advance(
    target: TargetDensity,
    states: Sequence[EnsembleState],
    steps: int,
    moves: Moves,
    map: TriangularMap,
    stride: int = 1,
    modes: Sequence[TriangularMap] = (),
) -> list[tuple[EnsembleState, Segment]]:
    """Advance ensembles together; two calls give bitwise the same result as one call over all steps.

    Parameters
    ----------
    target
        Density to sample.
    states
        States of the ensembles.
    steps
        Number of steps, a multiple of ``stride``.
    moves
        Proposals with their probabilities.
    map
        Coordinates in which the moves are made.
    stride
        Number of steps per stored step.
    modes
        Maps of the density's modes, if it has several.
    """
    proposals, shares = zip(*fitted(moves, map, [Mode(map, own) for own in modes]), strict=True)
    chances = np.array(shares) / sum(shares)
    ensembles = [_Ensemble(state, steps // stride) for state in states]
    for step in range(1, steps + 1):
        under_way = [one.step(proposals[one.random.choice(len(proposals), p=chances)]) for one in ensembles]
        answers: list[FloatArray | None] = [None] * len(under_way)
        while asked := _asked(under_way, answers):
            under_way, points = [one for one, _ in asked], [some for _, some in asked]
            ends = np.cumsum([len(some) for some in points])
            answers = [*np.split(target(map.forward(np.concatenate(points))), ends[:-1])]
        if step % stride == 0:
            for one in ensembles:
                one.store(step // stride - 1)
    return [(one.state, one.segment(map)) for one in ensembles]


_Step = Generator[FloatArray, FloatArray | None, None]
"""A step of one ensemble: it yields points, and is sent their log densities."""


def _asked(steps: Sequence[_Step], answers: Sequence[FloatArray | None]) -> list[tuple[_Step, FloatArray]]:
    """Continue steps with the log densities that they asked for; return those that go on, with their next points."""
    asked = []
    for one, answer in zip(steps, answers, strict=True):
        try:
            asked.append((one, one.send(answer)))
        except StopIteration:
            continue
    return asked


class _Ensemble:
    """Walkers in the coordinates of a map, with room for their stored steps."""

    def __init__(self, state: EnsembleState, stored: int) -> None:
        self._y, self._log_density = state.coordinates.copy(), state.log_density.copy()
        self.random = np.random.RandomState()
        self.random.set_state(state.random)
        self._accepted = np.zeros(len(self._y), dtype=np.int64)
        self._walk, self._height = np.empty((stored, *self._y.shape)), np.empty((stored, len(self._y)))

    def step(self, proposal: Proposal) -> _Step:
        """Move all walkers once, in one or two groups of which each is proposed from the positions of the other."""
        group = np.arange(len(self._y)) % (2 if proposal.in_halves else 1)
        if proposal.in_halves:
            self.random.shuffle(group)
        for k in range(group.max() + 1):
            moving = np.flatnonzero(group == k)
            proposed, ratio = proposal(self._y[moving], self.random, self._y[group != k])
            found = yield proposed
            assert found is not None
            gained = found - self._log_density[moving] + ratio
            accepted = np.log(self.random.rand(len(moving))) < gained
            moved = moving[accepted]
            self._y[moved], self._log_density[moved] = proposed[accepted], found[accepted]
            self._accepted[moved] += 1

    def store(self, row: int) -> None:
        """Store the present step."""
        self._walk[row], self._height[row] = self._y, self._log_density

    @property
    def state(self) -> EnsembleState:
        """The present state."""
        return EnsembleState(self._y, self._log_density, random_state(self.random))

    def segment(self, map: TriangularMap) -> Segment:
        """Return the stored steps in sampler coordinates."""
        return Segment(map.forward(self._walk), self._height, self._accepted)
