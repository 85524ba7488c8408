"""Draws of ensembles of walkers, and the state of a run: all values needed to continue it bitwise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.diagnostics import NO_STARTS, Starts, Verdict
from softness_bayes.sampler.target import Nonfinite

FloatArray = NDArray[np.float64]

RandomState = tuple[str, NDArray[np.uint32], int, int, float]
"""State of a generator."""


class Segment(NamedTuple):
    """Consecutive steps of one ensemble."""

    coordinates: FloatArray
    """Sampler coordinates z, shape (steps, walkers, dimension)."""
    log_density: FloatArray
    """Log density in those coordinates, shape (steps, walkers)."""
    accepted: NDArray[np.int64]
    """Number of accepted proposals of each walker, shape (walkers,)."""

    @staticmethod
    def join(parts: Iterable[Segment]) -> Segment:
        """Return the steps of several segments of one ensemble, in order."""
        coordinates, log_density, accepted = zip(*parts, strict=True)
        return Segment(np.concatenate(coordinates), np.concatenate(log_density), np.sum(accepted, axis=0))

    def every(self, stride: int) -> Segment:
        """Return every ``stride``-th stored step, starting with step number ``stride``."""
        return Segment(self.coordinates[stride - 1 :: stride], self.log_density[stride - 1 :: stride], self.accepted)


@dataclass(frozen=True)
class Chains:
    """Stored steps of all ensembles, with every ``stride``-th step of the run stored.

    Parameters
    ----------
    coordinates
        Sampler coordinates z, shape (ensembles, stored, walkers, dimension).
    log_density
        Log density in those coordinates, shape (ensembles, stored, walkers).
    accepted
        Share of accepted proposals of each walker, shape (ensembles, walkers).
    steps
        Number of steps.
    stride
        Number of steps per stored step.
    """

    coordinates: FloatArray
    log_density: FloatArray
    accepted: FloatArray
    steps: int
    stride: int = 1

    @classmethod
    def of(cls, segments: Iterable[Segment], steps: int, stride: int) -> Chains:
        """Return the chains made of one segment per ensemble."""
        coordinates, log_density, accepted = zip(*segments, strict=True)
        share = np.array(accepted) / max(steps, 1)
        return cls(np.stack(coordinates), np.stack(log_density), share, steps, stride)

    def kept(self, burn_in: int, draws: int | None = None) -> Chains:
        """Return the chains without the first ``burn_in`` steps, thinned evenly.

        Parameters
        ----------
        burn_in
            Number of steps to drop.
        draws
            Number of draws of all walkers to retain, or a few more; the last step is always retained.
        """
        first = -(-burn_in // self.stride)
        left = self.log_density[:, first:].size
        every = 1 if draws is None else max(1, left // draws)
        picked = np.arange(self.log_density.shape[1] - 1, first - 1, -every)[::-1]
        return Chains(
            self.coordinates[:, picked],
            self.log_density[:, picked],
            self.accepted,
            self.steps,
            self.stride * every,
        )

    def by_walker(self, values: FloatArray) -> FloatArray:
        """Reshape values (ensembles, stored, walkers, ...) to (chains, draws, ...), with one chain per walker."""
        swapped = np.swapaxes(values, 1, 2)
        return swapped.reshape(-1, *swapped.shape[2:])

    @property
    def ensemble(self) -> NDArray[np.intp]:
        """Ensemble of each chain of `by_walker`, shape (chains,)."""
        ensembles, _, walkers = self.log_density.shape
        return np.repeat(np.arange(ensembles), walkers)


def random_state(random: np.random.RandomState) -> RandomState:
    """Return the state of a generator, which `numpy.random.RandomState.set_state` takes."""
    kind, keys, position, has_spare, spare = random.get_state(legacy=True)
    return str(kind), np.array(keys, np.uint32), int(position), int(has_spare), float(spare)


class EnsembleState(NamedTuple):
    """All values needed to continue an ensemble with bitwise identical draws, except the map and the moves."""

    coordinates: FloatArray
    """Map coordinates y of the walkers, shape (walkers, dimension)."""
    log_density: FloatArray
    """Their log density in sampler coordinates, shape (walkers,)."""
    random: RandomState
    """State of the generator."""


@dataclass(frozen=True)
class RunState:
    """A run between two steps.

    Parameters
    ----------
    phase
        Number of completed stages of the pilot run, including runs that were too slow; in the final run, at least the
        number of stages in the schedule.
    steps
        Number of steps in this phase.
    stride
        Number of steps per stored step.
    due
        Step of the next convergence check.
    ensembles
        States of the ensembles.
    map
        Coordinates in which the moves are made.
    parts
        Segments drawn by each ensemble in this phase.
    slow
        Whether the last scheduled check found the run slow, so that it becomes a stage of the pilot when it continues.
    verdict
        The most recent check, possibly made because a limit was reached.
    modes
        Maps of the separate modes, if there are several, ordered by decreasing number of draws.
    starts
        Result of the search for starting points.
    nonfinite
        Points at which the density could not be computed.
    seconds
        Time spent so far, including earlier sessions.
    ended
        Whether the run has converged or reached a limit.
    relearnt
        Number of steps of the slow run from which the map was learnt; 0 if it was learnt from the pilot run.
    """

    phase: int
    steps: int
    stride: int
    due: int
    ensembles: tuple[EnsembleState, ...]
    map: TriangularMap
    parts: tuple[tuple[Segment, ...], ...]
    slow: bool = False
    verdict: Verdict | None = None
    modes: tuple[TriangularMap, ...] = ()
    starts: Starts = NO_STARTS
    nonfinite: Nonfinite = field(default_factory=Nonfinite)
    seconds: float = 0.0
    ended: bool = False
    relearnt: int = 0

    @property
    def chains(self) -> Chains:
        """Draws of the ensembles in this phase, which must have at least one step."""
        return Chains.of((Segment.join(part) for part in self.parts), self.steps, self.stride)
