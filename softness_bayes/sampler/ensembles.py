"""Steps of ensembles of walkers, evaluated together, with emcee's rules.

A call of a density for a few dozen points costs little more than one for half as many, because most of its time goes
into NumPy's calls. Several ensembles therefore make each step together: one call evaluates the proposals of all. Every
ensemble has its own random generator, so that its draws are those that it would have alone, and bitwise those of
`emcee.EnsembleSampler` with the same proposals (`tests/sampler/test_ensembles.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState, Segment, random_state
from softness_bayes.sampler.moves import Moves, OneParameter, Proposal, Student, StudentModes
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
    proposals = [_placed(one, map, tuple(modes)) for one, _ in moves]
    chances = np.array([share for _, share in moves])
    chances /= sum(share for _, share in moves)
    ensembles = [_Ensemble(state, map.log_volume(state.coordinates), steps // stride) for state in states]
    for step in range(1, steps + 1):
        for one in ensembles:
            one.begin(proposals[one.random.choice(len(proposals), p=chances)])
        for group in range(2):
            moving = [one for one in ensembles if group < one.groups]
            if not moving:
                break
            points = [one.propose(group) for one in moving]
            y, ends = np.concatenate(points), np.cumsum([len(some) for some in points])[:-1]
            found = (np.split(values, ends) for values in (target(map.forward(y)), map.log_volume(y)))
            for one, density, volume in zip(moving, *found, strict=True):
                one.decide(density, volume)
        if step % stride == 0:
            for one in ensembles:
                one.store(step // stride - 1)
    return [(one.state, one.segment(map)) for one in ensembles]


def _placed(proposal: Proposal, map: TriangularMap, modes: tuple[TriangularMap, ...]) -> Proposal:
    """Return a proposal that knows the map, and is about each of several modes instead of about the origin."""
    if isinstance(proposal, OneParameter):
        return OneParameter(map)
    return StudentModes(proposal, map, modes) if modes and isinstance(proposal, Student) else proposal


class _Ensemble:
    """Walkers in the coordinates of a map, with room for their stored steps.

    A step moves all walkers once, in one or two groups, of which each is proposed from the positions of the other.
    """

    def __init__(self, state: EnsembleState, log_volume: FloatArray, stored: int) -> None:
        self._y, self._log_density = state.coordinates.copy(), state.log_density.copy()
        self._log_volume = log_volume.copy()
        self.random = np.random.RandomState()
        self.random.set_state(state.random)
        self._accepted = np.zeros(len(self._y), dtype=np.int64)
        self._walk, self._height = np.empty((stored, *self._y.shape)), np.empty((stored, len(self._y)))

    def begin(self, proposal: Proposal) -> None:
        """Begin a step, with its walkers in random groups."""
        self._proposal, self.groups = proposal, 2 if proposal.in_halves else 1
        self._group = np.arange(len(self._y)) % self.groups
        if proposal.in_halves:
            self.random.shuffle(self._group)

    def propose(self, group: int) -> FloatArray:
        """Return the points proposed to a group of walkers."""
        self._moving = np.flatnonzero(self._group == group)
        self._proposed, self._ratio = self._proposal(self._y[self._moving], self.random, self._y[self._group != group])
        return self._proposed

    def decide(self, log_density: FloatArray, log_volume: FloatArray) -> None:
        """Accept or reject the last proposed points, given their log density and the map's Jacobian there."""
        before = self._log_density[self._moving] + self._log_volume[self._moving]
        gained = (log_density + log_volume) - before + self._ratio
        accepted = np.log(self.random.rand(len(self._moving))) < gained
        moved = self._moving[accepted]
        self._y[moved], self._log_density[moved] = self._proposed[accepted], log_density[accepted]
        self._log_volume[moved] = log_volume[accepted]
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
